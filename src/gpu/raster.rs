//! Graphics pipelines: the state that the caller sets besides the shaders.

use super::image::{SAMPLES, count, is_depth, texel_bytes};
use super::pipeline::{Pipeline, RasterState, specialization, spirv, stages_of};
use super::{Device, reflect};
use crate::error::{Error, Result};
use ash::vk;

/// Blending of a fragment's colour with the existing one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Blend {
    /// Replaces the existing colour.
    Replace,
    /// Is added.
    Add,
    /// The existing colour is multiplied by it.
    Multiply,
    /// Alpha blend over the existing colour, with premultiplied alpha.
    Over,
}

/// Depth test; depth is reversed, 1 near and 0 far.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Depth {
    /// No depth attachment.
    None,
    /// The nearest fragment wins, and depth is written.
    Nearest,
    /// As `Nearest`, but writes a slightly larger distance, so that the same surface passes when it is drawn again.
    Farther,
    /// Only fragments behind the existing depth pass, so nothing is drawn where the depth is empty. Writes no depth.
    Behind,
}

impl Depth {
    /// Whether fragments write their depth.
    pub(super) fn is_written(self) -> bool {
        matches!(self, Self::Nearest | Self::Farther)
    }
}

/// Drawn sides of triangles.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Cull {
    /// The front only.
    Back,
    /// Both sides.
    None,
}

/// Primitive type.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Shape {
    /// Every three vertices form a triangle.
    Triangles,
    /// Each vertex is a point of one pixel.
    Points,
    /// Every two vertices form a line, one pixel wide.
    Lines,
}

/// A vertex attribute: location, format, offset in its stream.
pub type Attribute = (u32, vk::Format, u32);

/// Vertices in one buffer: stride and attributes.
#[derive(Clone, Copy, Debug)]
pub struct Stream<'a> {
    /// Bytes from one vertex to the next.
    pub stride: u32,
    /// Attributes of each vertex.
    pub attributes: &'a [Attribute],
}

/// Description of a graphics pipeline.
#[derive(Clone, Copy, Debug)]
pub struct Raster<'a> {
    /// File name of the vertex shader. It names the pipeline if there is no fragment shader.
    pub vertex: &'static str,
    /// File name of the fragment shader; `None` for depth only.
    pub fragment: Option<&'static str>,
    /// Primitive type.
    pub shape: Shape,
    /// Vertex buffers, in binding order.
    pub streams: &'a [Stream<'a>],
    /// Formats of the colour attachments.
    pub colors: &'a [vk::Format],
    /// Blending of colours.
    pub blend: Blend,
    /// Depth attachment (D32) and test.
    pub depth: Depth,
    /// Drawn sides.
    pub cull: Cull,
    /// Whether the attachments have `SAMPLES` samples per texel.
    pub multisampled: bool,
    /// Specialisation constants 0, 1, ... of both shaders.
    pub constants: &'a [u32],
}

impl Device {
    /// Creates a graphics pipeline, or returns the existing one.
    ///
    /// # Errors
    /// Fails if the driver rejects the shaders.
    pub fn raster(&self, raster: &Raster<'_>) -> Result<Pipeline> {
        self.kept(raster.into())
    }

    /// Asserts that vertices lie within their strides and the device's limits.
    fn check_streams(&self, name: &str, streams: &[Stream<'_>]) {
        let limits = &self.shared.limits;
        let count: usize = streams.iter().map(|stream| stream.attributes.len()).sum();
        let few = streams.len() <= limits.max_vertex_input_bindings as usize
            && count <= limits.max_vertex_input_attributes as usize;
        assert!(few, "{name}: {} vertex buffers with {count} attributes", streams.len());
        for Stream { stride, attributes } in streams {
            let words = stride.is_multiple_of(4) && *stride <= limits.max_vertex_input_binding_stride;
            assert!(words, "{name}: {stride} bytes from one vertex to the next");
            for (location, format, offset) in *attributes {
                let bytes = if *format == vk::Format::R32G32B32_SFLOAT { 12 } else { texel_bytes(*format) };
                let inside = offset.is_multiple_of(4) && u64::from(*offset) + bytes <= u64::from(*stride);
                assert!(inside, "{name}: attribute {location} at byte {offset} of {stride}");
                let known = self.uses_of(*format).buffer_features.contains(vk::FormatFeatureFlags::VERTEX_BUFFER);
                let usable = known && *location < limits.max_vertex_input_attributes;
                assert!(usable, "{name}: attribute {location} of {format:?}");
            }
        }
    }

    /// Checks that the device can draw, and blend, into such attachments.
    fn check_colors(&self, name: &str, raster: &Raster<'_>) -> Result<()> {
        let most = self.most_color_targets() as usize;
        assert!(raster.colors.len() <= most, "{name}: {} colours, but the device allows {most}", raster.colors.len());
        let mut needed = vk::FormatFeatureFlags::COLOR_ATTACHMENT;
        if raster.blend != Blend::Replace {
            needed |= vk::FormatFeatureFlags::COLOR_ATTACHMENT_BLEND;
        }
        for format in raster.colors {
            assert!(!is_depth(*format), "{name}: depth format among the colours");
            // Unknown formats panic before the driver sees them.
            texel_bytes(*format);
            if !self.uses_of(*format).optimal_tiling_features.contains(needed) {
                let what = format!("pipeline {name} for {format:?}");
                return Err(Error::Vulkan { what, result: format!("the device lacks {needed:?}") });
            }
        }
        Ok(())
    }

    pub(super) fn make_raster(&self, raster: &Raster<'_>) -> Result<Pipeline> {
        let name = raster.fragment.unwrap_or(raster.vertex);
        let mut codes = vec![(vk::ShaderStageFlags::VERTEX, spirv(raster.vertex, ".vert"))];
        codes.extend(raster.fragment.map(|f| (vk::ShaderStageFlags::FRAGMENT, spirv(f, ".frag"))));
        self.check_streams(name, raster.streams);
        self.check_colors(name, raster)?;
        let interfaces: Vec<_> =
            codes.iter().map(|(stage, code)| (*stage, reflect::interface(code, raster.constants))).collect();
        let declared = self.declared(name, &interfaces)?;
        let (entries, bytes) = specialization(raster.constants);
        let special = vk::SpecializationInfo::default().map_entries(&entries).data(&bytes);
        let modules =
            codes.iter().map(|(stage, code)| Ok((*stage, self.module(name, code)?))).collect::<Result<Vec<_>>>()?;
        let stages = stages_of(&modules, &special);
        let layout = declared.layout.handle;
        // SAFETY: all structs live to the end of the call; the modules may be destroyed once the pipeline is created.
        let made = with_state(raster, &stages, layout, vk::PipelineCreateFlags::empty(), |info| unsafe {
            let made = self.shared.device.create_graphics_pipelines(self.disk.cache, &[*info], None);
            for (_, module) in &modules {
                self.shared.device.destroy_shader_module(*module, None);
            }
            made
        });
        let state = RasterState {
            colors: raster.colors.to_vec(),
            depth: raster.depth,
            multisampled: raster.multisampled,
            strides: raster.streams.iter().map(|stream| stream.stride).collect(),
        };
        self.pipeline(name, declared, Some(state), made)
    }
}

/// Calls `make` with the Vulkan description of a graphics pipeline.
pub(super) fn with_state<T>(
    raster: &Raster<'_>,
    stages: &[vk::PipelineShaderStageCreateInfo<'_>],
    layout: vk::PipelineLayout,
    flags: vk::PipelineCreateFlags,
    make: impl FnOnce(&vk::GraphicsPipelineCreateInfo<'_>) -> T,
) -> T {
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
        Shape::Lines => vk::PrimitiveTopology::LINE_LIST,
    });
    let viewport = vk::PipelineViewportStateCreateInfo::default().viewport_count(1).scissor_count(1);
    let rasterization = vk::PipelineRasterizationStateCreateInfo::default()
        .polygon_mode(vk::PolygonMode::FILL)
        .cull_mode(if raster.cull == Cull::Back { vk::CullModeFlags::BACK } else { vk::CullModeFlags::NONE })
        .line_width(1.0)
        .depth_bias_enable(raster.depth == Depth::Farther)
        .depth_bias_constant_factor(-16.0)
        .depth_bias_slope_factor(-1.0);
    let samples = vk::PipelineMultisampleStateCreateInfo::default()
        .rasterization_samples(count(if raster.multisampled { SAMPLES } else { 1 }));
    let depth = vk::PipelineDepthStencilStateCreateInfo::default()
        .depth_test_enable(raster.depth != Depth::None)
        .depth_write_enable(raster.depth.is_written())
        .depth_compare_op(match raster.depth {
            Depth::Behind => vk::CompareOp::LESS,
            Depth::Nearest | Depth::Farther | Depth::None => vk::CompareOp::GREATER,
        });
    let (new, kept) = match raster.blend {
        Blend::Replace | Blend::Add => (vk::BlendFactor::ONE, vk::BlendFactor::ONE),
        Blend::Multiply => (vk::BlendFactor::DST_COLOR, vk::BlendFactor::ZERO),
        Blend::Over => (vk::BlendFactor::ONE, vk::BlendFactor::ONE_MINUS_SRC_ALPHA),
    };
    let blend = vk::PipelineColorBlendAttachmentState {
        blend_enable: (raster.blend != Blend::Replace).into(),
        src_color_blend_factor: new,
        dst_color_blend_factor: kept,
        color_blend_op: vk::BlendOp::ADD,
        src_alpha_blend_factor: new,
        dst_alpha_blend_factor: kept,
        alpha_blend_op: vk::BlendOp::ADD,
        // Without a fragment shader there are no colours.
        color_write_mask: raster.fragment.map_or(vk::ColorComponentFlags::empty(), |_| vk::ColorComponentFlags::RGBA),
    };
    let blends = vec![blend; raster.colors.len()];
    let blending = vk::PipelineColorBlendStateCreateInfo::default().attachments(&blends);
    let dynamic = [vk::DynamicState::VIEWPORT, vk::DynamicState::SCISSOR, vk::DynamicState::FRONT_FACE];
    let dynamic = vk::PipelineDynamicStateCreateInfo::default().dynamic_states(&dynamic);
    let mut rendering =
        vk::PipelineRenderingCreateInfo::default().color_attachment_formats(raster.colors).depth_attachment_format(
            if raster.depth == Depth::None { vk::Format::UNDEFINED } else { vk::Format::D32_SFLOAT },
        );
    let info = vk::GraphicsPipelineCreateInfo::default()
        .stages(stages)
        .vertex_input_state(&input)
        .input_assembly_state(&assembly)
        .viewport_state(&viewport)
        .rasterization_state(&rasterization)
        .multisample_state(&samples)
        .depth_stencil_state(&depth)
        .color_blend_state(&blending)
        .dynamic_state(&dynamic)
        .layout(layout)
        .flags(flags)
        .push_next(&mut rendering);
    make(&info)
}
