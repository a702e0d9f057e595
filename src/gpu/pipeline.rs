//! Pipelines: layout, descriptors and push constants follow from the shaders; the caller names only what they cannot know.

use super::device::Shared;
use super::hazards::Use;
use super::reflect::{self, Binding, Interface};
use super::resource::is_depth;
use super::{Gpu, vulkan};
use crate::error::Result;
use ash::vk;
use std::collections::HashMap;
use std::sync::Arc;

include!(concat!(env!("OUT_DIR"), "/shaders.rs"));

/// A compute or graphics pipeline with what its shaders declare.
pub struct Pipeline {
    shared: Arc<Shared>,
    pub(crate) handle: vk::Pipeline,
    pub(crate) layout: vk::PipelineLayout,
    pub(crate) set_layout: vk::DescriptorSetLayout,
    pub(crate) id: u64,
    pub(crate) name: &'static str,
    pub(crate) slots: Vec<DescriptorSlot>,
    pub(crate) push_bytes: u32,
    pub(crate) stages: vk::ShaderStageFlags,
    pub(crate) point: vk::PipelineBindPoint,
    pub(crate) group: [u32; 3],
}

/// One descriptor, with the uses that binding a resource there means.
#[derive(Clone, Debug)]
pub(crate) struct DescriptorSlot {
    pub(crate) binding: u32,
    pub(crate) kind: vk::DescriptorType,
    pub(crate) uses: Vec<Use>,
    stages: vk::ShaderStageFlags,
}

/// What happens to a fragment's colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Blend {
    /// It replaces the old one.
    Replace,
    /// It is added.
    Add,
}

/// Depth test; depth is reversed, 1 near and 0 far.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Depth {
    /// No depth attachment.
    None,
    /// The nearest wins and is written.
    Nearest,
    /// Only fragments behind what is there: where nothing is, nothing is drawn. Writes no depth.
    Behind,
}

/// Which sides of triangles are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cull {
    /// The front alone.
    Back,
    /// Both.
    None,
}

/// What vertices are put together to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// Three make a triangle.
    Triangles,
    /// Each is a point of one pixel.
    Points,
}

/// A vertex attribute: location, format, offset in its stream.
pub type Attribute = (u32, vk::Format, u32);

/// Vertices of one buffer: stride and attributes.
#[derive(Clone, Copy, Debug)]
pub struct Stream<'a> {
    /// Bytes from one vertex to the next.
    pub stride: u32,
    /// What each vertex holds.
    pub attributes: &'a [Attribute],
}

/// A graphics pipeline to be made.
#[derive(Clone, Copy, Debug)]
pub struct Raster<'a> {
    /// Vertex shader's file name; names the pipeline unless there is a fragment shader.
    pub vertex: &'static str,
    /// Fragment shader's file name; `None` for depth alone.
    pub fragment: Option<&'static str>,
    /// What vertices make.
    pub shape: Shape,
    /// Vertex buffers, in binding order.
    pub streams: &'a [Stream<'a>],
    /// Formats of the colour attachments.
    pub colors: &'a [vk::Format],
    /// What happens to colours.
    pub blend: Blend,
    /// Depth attachment (D32) and test.
    pub depth: Depth,
    /// Which sides are drawn.
    pub cull: Cull,
    /// Specialisation constants 0, 1, ... of both shaders.
    pub constants: &'a [u32],
}

/// Bytes of an entry shader's SPIR-V, by file name.
pub(crate) fn shader(name: &str) -> &'static [u8] {
    SHADERS.iter().find(|(n, _)| *n == name).unwrap_or_else(|| panic!("no shader glsl/{name}")).1
}

fn spirv(name: &str) -> Vec<u32> {
    bytemuck::pod_collect_to_vec(shader(name))
}

impl Gpu {
    /// A compute pipeline from `glsl/NAME`, with specialisation constants 0, 1, ...
    pub fn compute(&self, name: &'static str, constants: &[u32]) -> Result<Pipeline> {
        self.compute_of(name, &spirv(name), constants, None)
    }

    /// The same with subgroups of so many threads, all there: what `voting_threads` gives.
    pub fn compute_in_subgroups(&self, name: &'static str, constants: &[u32], threads: u32) -> Result<Pipeline> {
        self.compute_of(name, &spirv(name), constants, Some(threads))
    }

    /// A compute pipeline from SPIR-V made elsewhere; tests use it for shaders of their own.
    pub fn compute_from_spirv(&self, name: &'static str, code: &[u32], constants: &[u32]) -> Result<Pipeline> {
        self.compute_of(name, code, constants, None)
    }

    fn compute_of(
        &self,
        name: &'static str,
        code: &[u32],
        constants: &[u32],
        subgroup: Option<u32>,
    ) -> Result<Pipeline> {
        let stage = vk::ShaderStageFlags::COMPUTE;
        let mut pipeline = self.layout(name, &[(stage, reflect::interface(code))])?;
        let module = self.module(name, code)?;
        let (entries, bytes) = specialization(constants);
        let special = vk::SpecializationInfo::default().map_entries(&entries).data(&bytes);
        let mut size = vk::PipelineShaderStageRequiredSubgroupSizeCreateInfo::default();
        let mut stage = vk::PipelineShaderStageCreateInfo::default()
            .stage(stage)
            .module(module)
            .name(c"main")
            .specialization_info(&special);
        if let Some(threads) = subgroup {
            size = size.required_subgroup_size(threads);
            stage = stage.flags(vk::PipelineShaderStageCreateFlags::REQUIRE_FULL_SUBGROUPS).push_next(&mut size);
        }
        let info = vk::ComputePipelineCreateInfo::default().stage(stage).layout(pipeline.layout);
        // SAFETY: module and layout are alive; the module may go once the pipeline is made.
        let made = unsafe {
            let made = self.shared.device.create_compute_pipelines(vk::PipelineCache::null(), &[info], None);
            self.shared.device.destroy_shader_module(module, None);
            made
        };
        pipeline.handle = made.map_err(|(_, r)| r).map_err(vulkan(format!("pipeline {name}")))?[0];
        self.shared.name(pipeline.handle, name);
        Ok(pipeline)
    }

    /// A graphics pipeline.
    pub fn raster(&self, raster: &Raster<'_>) -> Result<Pipeline> {
        let name = raster.fragment.unwrap_or(raster.vertex);
        let mut codes = vec![(vk::ShaderStageFlags::VERTEX, spirv(raster.vertex))];
        codes.extend(raster.fragment.map(|f| (vk::ShaderStageFlags::FRAGMENT, spirv(f))));
        let interfaces: Vec<_> = codes.iter().map(|(stage, code)| (*stage, reflect::interface(code))).collect();
        let mut pipeline = self.layout(name, &interfaces)?;
        let (entries, bytes) = specialization(raster.constants);
        let special = vk::SpecializationInfo::default().map_entries(&entries).data(&bytes);
        let modules =
            codes.iter().map(|(stage, code)| Ok((*stage, self.module(name, code)?))).collect::<Result<Vec<_>>>()?;
        let stages: Vec<_> = modules
            .iter()
            .map(|(stage, module)| {
                vk::PipelineShaderStageCreateInfo::default()
                    .stage(*stage)
                    .module(*module)
                    .name(c"main")
                    .specialization_info(&special)
            })
            .collect();
        let mut bindings = Vec::new();
        let mut attributes = Vec::new();
        for (binding, stream) in raster.streams.iter().enumerate() {
            let binding = binding as u32;
            bindings.push(vk::VertexInputBindingDescription {
                binding,
                stride: stream.stride,
                input_rate: vk::VertexInputRate::VERTEX,
            });
            attributes.extend(stream.attributes.iter().map(|&(location, format, offset)| {
                vk::VertexInputAttributeDescription { location, binding, format, offset }
            }));
        }
        let input = vk::PipelineVertexInputStateCreateInfo::default()
            .vertex_binding_descriptions(&bindings)
            .vertex_attribute_descriptions(&attributes);
        let assembly = vk::PipelineInputAssemblyStateCreateInfo::default().topology(match raster.shape {
            Shape::Triangles => vk::PrimitiveTopology::TRIANGLE_LIST,
            Shape::Points => vk::PrimitiveTopology::POINT_LIST,
        });
        let viewport = vk::PipelineViewportStateCreateInfo::default().viewport_count(1).scissor_count(1);
        let rasterization = vk::PipelineRasterizationStateCreateInfo::default()
            .polygon_mode(vk::PolygonMode::FILL)
            .cull_mode(if raster.cull == Cull::Back { vk::CullModeFlags::BACK } else { vk::CullModeFlags::NONE })
            .line_width(1.0);
        let samples =
            vk::PipelineMultisampleStateCreateInfo::default().rasterization_samples(vk::SampleCountFlags::TYPE_1);
        let depth = vk::PipelineDepthStencilStateCreateInfo::default()
            .depth_test_enable(raster.depth != Depth::None)
            .depth_write_enable(raster.depth == Depth::Nearest)
            .depth_compare_op(match raster.depth {
                Depth::Behind => vk::CompareOp::LESS,
                Depth::Nearest | Depth::None => vk::CompareOp::GREATER,
            });
        let blend = vk::PipelineColorBlendAttachmentState {
            blend_enable: (raster.blend == Blend::Add).into(),
            src_color_blend_factor: vk::BlendFactor::ONE,
            dst_color_blend_factor: vk::BlendFactor::ONE,
            color_blend_op: vk::BlendOp::ADD,
            src_alpha_blend_factor: vk::BlendFactor::ONE,
            dst_alpha_blend_factor: vk::BlendFactor::ONE,
            alpha_blend_op: vk::BlendOp::ADD,
            color_write_mask: vk::ColorComponentFlags::RGBA,
        };
        let blends = vec![blend; raster.colors.len()];
        let blending = vk::PipelineColorBlendStateCreateInfo::default().attachments(&blends);
        let dynamic = [vk::DynamicState::VIEWPORT, vk::DynamicState::SCISSOR, vk::DynamicState::FRONT_FACE];
        let dynamic = vk::PipelineDynamicStateCreateInfo::default().dynamic_states(&dynamic);
        assert!(!raster.colors.iter().any(|f| is_depth(*f)), "{name}: depth format among the colours");
        let mut rendering =
            vk::PipelineRenderingCreateInfo::default().color_attachment_formats(raster.colors).depth_attachment_format(
                if raster.depth == Depth::None { vk::Format::UNDEFINED } else { vk::Format::D32_SFLOAT },
            );
        let info = vk::GraphicsPipelineCreateInfo::default()
            .stages(&stages)
            .vertex_input_state(&input)
            .input_assembly_state(&assembly)
            .viewport_state(&viewport)
            .rasterization_state(&rasterization)
            .multisample_state(&samples)
            .depth_stencil_state(&depth)
            .color_blend_state(&blending)
            .dynamic_state(&dynamic)
            .layout(pipeline.layout)
            .push_next(&mut rendering);
        // SAFETY: all chained structs live to the end of the call; the modules may go once the pipeline is made.
        let made = unsafe {
            let made = self.shared.device.create_graphics_pipelines(vk::PipelineCache::null(), &[info], None);
            for (_, module) in &modules {
                self.shared.device.destroy_shader_module(*module, None);
            }
            made
        };
        pipeline.handle = made.map_err(|(_, r)| r).map_err(vulkan(format!("pipeline {name}")))?[0];
        self.shared.name(pipeline.handle, name);
        Ok(pipeline)
    }

    fn module(&self, name: &str, code: &[u32]) -> Result<vk::ShaderModule> {
        let info = vk::ShaderModuleCreateInfo::default().code(code);
        // SAFETY: glslang made the code, for this Vulkan version.
        let module = unsafe { self.shared.device.create_shader_module(&info, None) };
        let module = module.map_err(vulkan(format!("shader {name}")))?;
        self.shared.name(module, name);
        Ok(module)
    }

    /// The pipeline less its handle: descriptor layout and push range from what the shaders declare.
    fn layout(&self, name: &'static str, shaders: &[(vk::ShaderStageFlags, Interface)]) -> Result<Pipeline> {
        let mut slots: Vec<DescriptorSlot> = Vec::new();
        for (stage, interface) in shaders {
            for binding in &interface.bindings {
                let uses = uses(*stage, *binding);
                match slots.iter_mut().find(|s| s.binding == binding.binding) {
                    Some(slot) => {
                        assert_eq!(
                            slot.kind, binding.kind,
                            "{name}: binding {} differs between its shaders",
                            binding.binding
                        );
                        slot.stages |= *stage;
                        slot.uses.extend(uses);
                    }
                    None => slots.push(DescriptorSlot {
                        binding: binding.binding,
                        kind: binding.kind,
                        uses,
                        stages: *stage,
                    }),
                }
            }
        }
        slots.sort_by_key(|s| s.binding);
        let bindings: Vec<_> = slots
            .iter()
            .map(|s| {
                vk::DescriptorSetLayoutBinding::default()
                    .binding(s.binding)
                    .descriptor_type(s.kind)
                    .descriptor_count(1)
                    .stage_flags(s.stages)
            })
            .collect();
        let device = &self.shared.device;
        let stages = shaders
            .iter()
            .filter(|(_, i)| i.push_bytes > 0)
            .fold(vk::ShaderStageFlags::empty(), |all, (s, _)| all | *s);
        let push_bytes = shaders.iter().map(|(_, i)| i.push_bytes).max().unwrap_or(0);
        assert!(
            push_bytes <= 128,
            "{name}: {push_bytes} bytes of push constants; every device has 128 and some no more"
        );
        // SAFETY: the device is alive; both layouts are destroyed in `Drop`.
        unsafe {
            let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
            let set_layout =
                device.create_descriptor_set_layout(&info, None).map_err(vulkan(format!("descriptors of {name}")))?;
            let set_layouts = [set_layout];
            let ranges = [vk::PushConstantRange { stage_flags: stages, offset: 0, size: push_bytes }];
            let info = vk::PipelineLayoutCreateInfo::default()
                .set_layouts(&set_layouts)
                .push_constant_ranges(if push_bytes > 0 { &ranges } else { &[] });
            let layout = device.create_pipeline_layout(&info, None).map_err(vulkan(format!("layout of {name}")))?;
            self.shared.name(set_layout, name);
            self.shared.name(layout, name);
            let group = shaders[0].1.group;
            let compute = shaders[0].0 == vk::ShaderStageFlags::COMPUTE;
            let point = if compute { vk::PipelineBindPoint::COMPUTE } else { vk::PipelineBindPoint::GRAPHICS };
            let handle = vk::Pipeline::null();
            let id = self.shared.new_id();
            Ok(Pipeline {
                shared: self.shared.clone(),
                handle,
                layout,
                set_layout,
                id,
                name,
                slots,
                push_bytes,
                stages,
                point,
                group,
            })
        }
    }
}

impl Pipeline {
    /// Numbers of the bindings that its shaders declare, ascending.
    pub fn bindings(&self) -> impl Iterator<Item = u32> {
        self.slots.iter().map(|s| s.binding)
    }
}

/// What binding a resource means, from the shader's own declaration.
fn uses(stage: vk::ShaderStageFlags, binding: Binding) -> Vec<Use> {
    let (read, write) = match stage {
        vk::ShaderStageFlags::VERTEX => (Use::VertexRead, None),
        vk::ShaderStageFlags::FRAGMENT => (Use::FragmentRead, Some(Use::FragmentWrite)),
        _ => (Use::ComputeRead, Some(Use::ComputeWrite)),
    };
    let write = binding.writes.then(|| write.expect("vertex shaders write nothing; qualify the buffer readonly"));
    match (binding.reads, write) {
        (true, Some(write)) => vec![read | write],
        (_, Some(write)) => vec![write],
        _ => vec![read],
    }
}

fn specialization(constants: &[u32]) -> (Vec<vk::SpecializationMapEntry>, Vec<u8>) {
    let entry = |i: usize| vk::SpecializationMapEntry { constant_id: i as u32, offset: 4 * i as u32, size: 4 };
    ((0..constants.len()).map(entry).collect(), bytemuck::cast_slice(constants).to_vec())
}

impl Drop for Pipeline {
    fn drop(&mut self) {
        self.shared.wait_to_drop();
        let device = &self.shared.device;
        // SAFETY: made from this device, and nothing submitted uses it after the wait.
        unsafe {
            device.destroy_pipeline(self.handle, None);
            device.destroy_pipeline_layout(self.layout, None);
            device.destroy_descriptor_set_layout(self.set_layout, None);
        }
    }
}

/// Descriptor sets by what is bound; written once on first use, so that a frame like the last one makes none.
#[derive(Default)]
pub(crate) struct DescriptorCache {
    pools: Vec<vk::DescriptorPool>,
    left: u32,
    sets: HashMap<Vec<u64>, vk::DescriptorSet>,
}

const SETS_PER_POOL: u32 = 256;

impl DescriptorCache {
    /// The set with this key, or a fresh one that `write` fills.
    pub(crate) fn get(
        &mut self,
        shared: &Shared,
        key: &[u64],
        (name, layout): (&str, vk::DescriptorSetLayout),
        write: impl FnOnce(vk::DescriptorSet) -> Result<()>,
    ) -> Result<vk::DescriptorSet> {
        if let Some(set) = self.sets.get(key) {
            return Ok(*set);
        }
        if self.left == 0 {
            let size = |ty| vk::DescriptorPoolSize { ty, descriptor_count: 8 * SETS_PER_POOL };
            let sizes = [
                size(vk::DescriptorType::STORAGE_BUFFER),
                size(vk::DescriptorType::UNIFORM_BUFFER),
                size(vk::DescriptorType::UNIFORM_TEXEL_BUFFER),
                size(vk::DescriptorType::COMBINED_IMAGE_SAMPLER),
            ];
            let info = vk::DescriptorPoolCreateInfo::default().max_sets(SETS_PER_POOL).pool_sizes(&sizes);
            // SAFETY: the device is alive; destroyed in `destroy`.
            let pool =
                unsafe { shared.device.create_descriptor_pool(&info, None) }.map_err(vulkan("descriptor pool"))?;
            shared.name(pool, "gpu.descriptors");
            self.pools.push(pool);
            self.left = SETS_PER_POOL;
        }
        let layouts = [layout];
        let pool = *self.pools.last().expect("made above");
        let info = vk::DescriptorSetAllocateInfo::default().descriptor_pool(pool).set_layouts(&layouts);
        // SAFETY: pool and layout are alive; `left` guards the pool's count of sets.
        let set = unsafe { shared.device.allocate_descriptor_sets(&info) }.map_err(vulkan("descriptor set"))?[0];
        self.left -= 1;
        shared.name(set, name);
        write(set)?;
        self.sets.insert(key.to_vec(), set);
        Ok(set)
    }

    pub(crate) fn destroy(&mut self, device: &ash::Device) {
        for pool in self.pools.drain(..) {
            // SAFETY: called once, after the device is idle.
            unsafe { device.destroy_descriptor_pool(pool, None) };
        }
    }
}
