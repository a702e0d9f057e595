//! Interface of a pipeline's shaders together: descriptors, push constants, and the Vulkan layouts created from them.

use super::device::Shared;
use super::graveyard::{Remains, lock};
use super::hazards::Use;
use super::reflect::{Binding, Interface};
use super::{Device, vulkan};
use crate::error::Result;
use ash::vk;
use std::collections::HashMap;
use std::sync::{Arc, Weak};

/// One descriptor, with the uses that binding a resource to it implies.
#[derive(Clone, Debug)]
pub(crate) struct DescriptorSlot {
    pub(crate) binding: u32,
    pub(crate) kind: vk::DescriptorType,
    pub(crate) uses: Vec<Use>,
    /// Required view type of an image, whether it has many samples per texel, and required format of a storage image.
    pub(super) image: (Option<(vk::ImageViewType, bool)>, Option<vk::Format>),
    stages: vk::ShaderStageFlags,
}

/// Key of a layout: number, kind and stages of each binding, and the push constants.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(super) struct Signature {
    bindings: Vec<(u32, vk::DescriptorType, vk::ShaderStageFlags)>,
    push_bytes: u32,
    push_stages: vk::ShaderStageFlags,
}

/// Layouts shared by all pipelines with the same interface.
pub(super) struct Layout {
    shared: Arc<Shared>,
    pub(super) handle: vk::PipelineLayout,
    pub(super) set_layout: vk::DescriptorSetLayout,
    pub(super) id: u64,
}

/// Layouts in use, by key.
pub(super) type Layouts = HashMap<Signature, Weak<Layout>>;

/// Combined interface of a pipeline's shaders.
pub(super) struct Declared {
    pub(super) layout: Arc<Layout>,
    pub(super) slots: Vec<DescriptorSlot>,
    pub(super) push_bytes: u32,
    pub(super) push_stages: vk::ShaderStageFlags,
    /// Workgroup size; only for compute shaders.
    pub(super) group: [u32; 3],
}

impl Device {
    /// The combined interface of these shaders, and its layouts.
    pub(super) fn declared(&self, name: &str, shaders: &[(vk::ShaderStageFlags, Interface)]) -> Result<Declared> {
        let mut slots: Vec<DescriptorSlot> = Vec::new();
        for (stage, interface) in shaders {
            for binding in &interface.bindings {
                let uses = uses(*stage, *binding);
                match slots.iter_mut().find(|s| s.binding == binding.binding) {
                    Some(slot) => {
                        assert_eq!(
                            (slot.kind, slot.image),
                            (binding.kind, (binding.view, binding.format)),
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
                        image: (binding.view, binding.format),
                        stages: *stage,
                    }),
                }
            }
        }
        slots.sort_by_key(|s| s.binding);
        let push_stages = shaders
            .iter()
            .filter(|(_, i)| i.push_bytes > 0)
            .fold(vk::ShaderStageFlags::empty(), |all, (s, _)| all | *s);
        let push_bytes = shaders.iter().map(|(_, i)| i.push_bytes).max().unwrap_or(0);
        assert!(push_bytes <= 128, "{name}: {push_bytes} bytes of push constants; devices guarantee only 128");
        let bindings = slots.iter().map(|s| (s.binding, s.kind, s.stages)).collect();
        let layout = self.layout(name, Signature { bindings, push_bytes, push_stages })?;
        Ok(Declared { layout, slots, push_bytes, push_stages, group: shaders[0].1.group })
    }

    fn layout(&self, name: &str, signature: Signature) -> Result<Arc<Layout>> {
        let mut layouts = lock(&self.layouts);
        if let Some(layout) = layouts.get(&signature).and_then(Weak::upgrade) {
            return Ok(layout);
        }
        layouts.retain(|_, layout| layout.strong_count() > 0);
        let bindings: Vec<_> = signature
            .bindings
            .iter()
            .map(|&(binding, kind, stages)| {
                vk::DescriptorSetLayoutBinding::default()
                    .binding(binding)
                    .descriptor_type(kind)
                    .descriptor_count(1)
                    .stage_flags(stages)
            })
            .collect();
        let device = &self.shared.device;
        let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
        // SAFETY: the device is alive; destroyed with the layout below, in `Drop`.
        let set_layout = unsafe { device.create_descriptor_set_layout(&info, None) }
            .map_err(vulkan(format!("descriptors of {name}")))?;
        self.shared.name(set_layout, name);
        let mut layout = Layout {
            shared: self.shared.clone(),
            handle: vk::PipelineLayout::null(),
            set_layout,
            id: self.shared.new_id(),
        };
        let set_layouts = [set_layout];
        let ranges =
            [vk::PushConstantRange { stage_flags: signature.push_stages, offset: 0, size: signature.push_bytes }];
        let info = vk::PipelineLayoutCreateInfo::default()
            .set_layouts(&set_layouts)
            .push_constant_ranges(if signature.push_bytes > 0 { &ranges } else { &[] });
        // SAFETY: the device and the set layout are alive; destroyed in `Drop`.
        layout.handle =
            unsafe { device.create_pipeline_layout(&info, None) }.map_err(vulkan(format!("layout of {name}")))?;
        self.shared.name(layout.handle, name);
        let layout = Arc::new(layout);
        layouts.insert(signature, Arc::downgrade(&layout));
        Ok(layout)
    }
}

impl Drop for Layout {
    fn drop(&mut self) {
        self.shared.bury(self.id, Remains::Layout { layout: self.handle, set_layout: self.set_layout });
    }
}

/// Uses of a resource at a binding, from the shader's declaration.
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
