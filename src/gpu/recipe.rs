//! What a pipeline is made from. Equal recipes give the same pipeline, and a recipe can be followed again.

use super::Device;
use super::pipeline::{Pipeline, spirv};
use super::raster::{Attribute, Blend, Cull, Depth, Raster, Shape, Stream};
use crate::error::Result;
use ash::vk;

/// Everything that a pipeline depends on, except the SPIR-V of its shaders.
#[derive(Clone, PartialEq, Eq, Hash)]
pub(super) enum Recipe {
    Compute {
        name: &'static str,
        constants: Vec<u32>,
        /// Threads of its full subgroups, if it asks for them.
        threads: Option<u32>,
    },
    Raster {
        vertex: &'static str,
        fragment: Option<&'static str>,
        shape: Shape,
        /// Stride and attributes of each vertex buffer.
        streams: Vec<(u32, Vec<Attribute>)>,
        colors: Vec<vk::Format>,
        blend: Blend,
        depth: Depth,
        cull: Cull,
        multisampled: bool,
        constants: Vec<u32>,
    },
}

impl From<&Raster<'_>> for Recipe {
    fn from(raster: &Raster<'_>) -> Self {
        Self::Raster {
            vertex: raster.vertex,
            fragment: raster.fragment,
            shape: raster.shape,
            streams: raster.streams.iter().map(|stream| (stream.stride, stream.attributes.to_vec())).collect(),
            colors: raster.colors.to_vec(),
            blend: raster.blend,
            depth: raster.depth,
            cull: raster.cull,
            multisampled: raster.multisampled,
            constants: raster.constants.to_vec(),
        }
    }
}

impl Recipe {
    /// Whether it needs this shader.
    #[cfg(feature = "glsl")]
    pub(super) fn needs(&self, shader: &str) -> bool {
        match self {
            Self::Compute { name, .. } => *name == shader,
            Self::Raster { vertex, fragment, .. } => *vertex == shader || *fragment == Some(shader),
        }
    }
}

impl Device {
    /// Makes a pipeline with the shaders of now.
    pub(super) fn follow(&self, recipe: &Recipe) -> Result<Pipeline> {
        match recipe {
            Recipe::Compute { name, constants, threads } => {
                self.make_compute(name, &spirv(name, ".comp"), constants, *threads)
            }
            Recipe::Raster {
                vertex,
                fragment,
                shape,
                streams,
                colors,
                blend,
                depth,
                cull,
                multisampled,
                constants,
            } => {
                let streams: Vec<Stream<'_>> =
                    streams.iter().map(|(stride, attributes)| Stream { stride: *stride, attributes }).collect();
                self.make_raster(&Raster {
                    vertex,
                    fragment: *fragment,
                    shape: *shape,
                    streams: &streams,
                    colors,
                    blend: *blend,
                    depth: *depth,
                    cull: *cull,
                    multisampled: *multisampled,
                    constants,
                })
            }
        }
    }
}
