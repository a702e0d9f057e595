//! Pipelines. Layout, descriptors and push constants follow from the shaders; the caller sets only the remaining state.
//! A repeated request returns the same pipeline.

use super::device::Shared;
use super::graveyard::{Remains, lock};
use super::layout::{Declared, DescriptorSlot, Layout};
use super::raster::Depth;
use super::recipe::Recipe;
use super::{Device, reflect, vulkan};
use crate::error::{Error, Result};
use ash::vk;
use std::collections::HashMap;
use std::sync::Arc;

include!(concat!(env!("OUT_DIR"), "/shaders.rs"));

/// A compute or graphics pipeline with its shaders' interface. Clones are the same pipeline.
#[derive(Clone)]
pub struct Pipeline(pub(super) Arc<Made>);

/// Content of a pipeline; destroyed with the last clone.
pub(super) struct Made {
    pub(super) shared: Arc<Shared>,
    pub(super) handle: vk::Pipeline,
    pub(super) layout: Arc<Layout>,
    pub(super) name: &'static str,
    pub(super) slots: Vec<DescriptorSlot>,
    pub(super) push_bytes: u32,
    pub(super) push_stages: vk::ShaderStageFlags,
    /// Only for graphics pipelines.
    pub(super) raster: Option<RasterState>,
    pub(super) group: [u32; 3],
}

/// State that a graphics pipeline was created for.
pub(super) struct RasterState {
    pub(super) colors: Vec<vk::Format>,
    pub(super) depth: Depth,
    pub(super) multisampled: bool,
    /// Bytes from one vertex to the next, for each buffer.
    pub(super) strides: Vec<u32>,
}

impl Made {
    pub(super) fn point(&self) -> vk::PipelineBindPoint {
        match self.raster {
            Some(_) => vk::PipelineBindPoint::GRAPHICS,
            None => vk::PipelineBindPoint::COMPUTE,
        }
    }
}

/// Cached pipelines, and the number of pipelines created.
#[derive(Default)]
pub(super) struct Pipelines {
    kept: HashMap<Recipe, Kept>,
    turn: u64,
    made: u64,
}

struct Kept {
    pipeline: Pipeline,
    /// When it was last requested.
    turn: u64,
}

impl Kept {
    /// Whether anything besides the cache holds it.
    fn is_used(&self) -> bool {
        Arc::strong_count(&self.pipeline.0) > 1
    }
}

/// Maximum number of unused pipelines in the cache, the most recently used ones. So switching settings back and forth
/// recompiles nothing.
const SPARE: usize = 128;

/// SPIR-V of an entry shader, by file name.
pub(crate) fn shader(name: &str) -> &'static [u8] {
    SHADERS.iter().find(|(n, _)| *n == name).unwrap_or_else(|| panic!("no shader glsl/{name}")).1
}

/// Names of all shaders.
pub(super) fn shader_names() -> impl Iterator<Item = &'static str> {
    SHADERS.iter().map(|(name, _)| *name)
}

/// SPIR-V of an entry shader of this stage, by file name.
pub(super) fn spirv(name: &str, stage: &str) -> Vec<u32> {
    assert!(name.ends_with(stage), "{name}: not a shader of stage {stage}");
    #[cfg(feature = "glsl")]
    if let Some(code) = super::reload::replaced(name) {
        return code;
    }
    bytemuck::pod_collect_to_vec(shader(name))
}

impl Pipelines {
    /// Number of pipelines created since the device was opened.
    pub(super) fn made(&self) -> u64 {
        self.made
    }

    /// Number of pipelines in the cache.
    pub(super) fn kept(&self) -> usize {
        self.kept.len()
    }

    /// Any pipeline of the cache.
    pub(super) fn any(&self) -> Option<Pipeline> {
        self.kept.values().next().map(|kept| kept.pipeline.clone())
    }

    /// Drops all cached pipelines that are not in use.
    pub(super) fn clear(&mut self) {
        self.kept.clear();
    }
}

impl Device {
    /// Creates a compute pipeline from `glsl/NAME`, with specialisation constants 0, 1, ..., or returns the existing
    /// one.
    ///
    /// # Errors
    /// Fails if the driver rejects the shaders.
    pub fn compute(&self, name: &'static str, constants: &[u32]) -> Result<Pipeline> {
        self.kept(Recipe::Compute { name, constants: constants.to_vec(), threads: None })
    }

    /// The same with full subgroups of this many threads.
    ///
    /// # Panics
    /// Panics if `voting_threads` does not return this number, or it does not divide the width of a workgroup.
    ///
    /// # Errors
    /// Fails if the driver rejects the shaders.
    pub fn compute_in_subgroups(&self, name: &'static str, constants: &[u32], threads: u32) -> Result<Pipeline> {
        assert!(self.voting_threads() == Some(threads), "{name}: subgroups of {threads} threads are not available");
        self.kept(Recipe::Compute { name, constants: constants.to_vec(), threads: Some(threads) })
    }

    /// Creates a compute pipeline from other SPIR-V, newly with each call; tests use it for their own shaders.
    ///
    /// # Errors
    /// Fails if the code is not a SPIR-V module, or the driver rejects it.
    ///
    /// # Safety
    /// The module must be valid for Vulkan 1.3 with these constants and use only the features of `needs`. It must not
    /// read or write outside the resources bound to it.
    pub unsafe fn compute_from_spirv(&self, name: &'static str, code: &[u32], constants: &[u32]) -> Result<Pipeline> {
        if !reflect::is_module(code) {
            return Err(Error::Vulkan { what: format!("shader {name}"), result: "not a SPIR-V module".into() });
        }
        self.make_compute(name, code, constants, None)
    }

    /// Clears the cache, so that pipelines are created again. Pipelines in use are not affected. For measurements: on
    /// some drivers, pipelines built from identical code differ in speed.
    pub fn forget_pipelines(&self) {
        lock(&self.pipelines).clear();
    }

    /// The pipeline of this recipe: the cached one, or a new one.
    pub(super) fn kept(&self, recipe: Recipe) -> Result<Pipeline> {
        {
            let pipelines = &mut *lock(&self.pipelines);
            pipelines.turn += 1;
            if let Some(kept) = pipelines.kept.get_mut(&recipe) {
                kept.turn = pipelines.turn;
                return Ok(kept.pipeline.clone());
            }
        }
        if let Some(other) = self.stand_in(&recipe) {
            return Ok(other);
        }
        let pipeline = self.follow(&recipe)?;
        let pipelines = &mut *lock(&self.pipelines);
        // Another thread may have made it meanwhile.
        let turn = pipelines.turn;
        let pipeline = pipelines.kept.entry(recipe).or_insert(Kept { pipeline, turn }).pipeline.clone();
        let spare = pipelines.kept.iter().filter(|(_, kept)| !kept.is_used());
        let mut spare: Vec<_> = spare.map(|(recipe, kept)| (kept.turn, recipe.clone())).collect();
        spare.sort_unstable_by_key(|(turn, _)| *turn);
        for (_, recipe) in spare.iter().rev().skip(SPARE) {
            pipelines.kept.remove(recipe);
        }
        Ok(pipeline)
    }

    /// Makes all pipelines in use again that need one of these shaders, and drops them: a test of changed shaders.
    #[cfg(feature = "glsl")]
    pub(super) fn try_again(&self, shaders: &[&str]) -> Result<()> {
        let concerned = |(recipe, kept): &(&Recipe, &Kept)| kept.is_used() && shaders.iter().any(|s| recipe.needs(s));
        let recipes: Vec<Recipe> =
            lock(&self.pipelines).kept.iter().filter(concerned).map(|(recipe, _)| recipe.clone()).collect();
        recipes.iter().try_for_each(|recipe| self.follow(recipe).map(drop))
    }

    pub(super) fn make_compute(
        &self,
        name: &'static str,
        code: &[u32],
        constants: &[u32],
        subgroup: Option<u32>,
    ) -> Result<Pipeline> {
        let stage = vk::ShaderStageFlags::COMPUTE;
        let declared = self.declared(name, &[(stage, reflect::interface(code, constants))])?;
        check_group(name, declared.group, &self.shared.limits)?;
        if let Some(threads) = subgroup {
            let [width, ..] = declared.group;
            assert!(
                width.is_multiple_of(threads),
                "{name}: groups {width} threads wide, not full subgroups of {threads}"
            );
        }
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
        let info = vk::ComputePipelineCreateInfo::default().stage(stage).layout(declared.layout.handle);
        // SAFETY: module and layout are alive; the module may be destroyed once the pipeline is created.
        let made = unsafe {
            let made = self.shared.device.create_compute_pipelines(self.disk.cache, &[info], None);
            self.shared.device.destroy_shader_module(module, None);
            made
        };
        self.pipeline(name, declared, None, made)
    }

    /// Wraps a pipeline that Vulkan has created.
    pub(super) fn pipeline(
        &self,
        name: &'static str,
        declared: Declared,
        raster: Option<RasterState>,
        made: std::result::Result<Vec<vk::Pipeline>, (Vec<vk::Pipeline>, vk::Result)>,
    ) -> Result<Pipeline> {
        let handle = made.map_err(|(_, r)| r).map_err(vulkan(format!("pipeline {name}")))?[0];
        self.shared.name(handle, name);
        lock(&self.pipelines).made += 1;
        let Declared { layout, slots, push_bytes, push_stages, group } = declared;
        let shared = self.shared.clone();
        Ok(Pipeline(Arc::new(Made { shared, handle, layout, name, slots, push_bytes, push_stages, raster, group })))
    }

    pub(super) fn module(&self, name: &str, code: &[u32]) -> Result<vk::ShaderModule> {
        let info = vk::ShaderModuleCreateInfo::default().code(code);
        // SAFETY: glslang compiled the code for this Vulkan version, or a caller of `compute_from_spirv` promised that it
        // is as valid.
        let module = unsafe { self.shared.device.create_shader_module(&info, None) };
        let module = module.map_err(vulkan(format!("shader {name}")))?;
        self.shared.name(module, name);
        Ok(module)
    }
}

impl Pipeline {
    /// Numbers of the bindings that its shaders declare, ascending.
    pub fn bindings(&self) -> impl Iterator<Item = u32> {
        self.0.slots.iter().map(|s| s.binding)
    }

    /// Whether it reads vertex buffers. Other pipelines look up or compute their vertices.
    pub fn has_vertex_buffers(&self) -> bool {
        self.0.raster.as_ref().is_some_and(|state| !state.strides.is_empty())
    }
}

/// Rejects workgroups that a device cannot run.
pub(super) fn check_group(name: &str, group: [u32; 3], limits: &vk::PhysicalDeviceLimits) -> Result<()> {
    let (sides, most) = (limits.max_compute_work_group_size, limits.max_compute_work_group_invocations);
    let inside = group.iter().zip(sides).all(|(side, most)| (1..=most).contains(side));
    let threads: u64 = group.into_iter().map(u64::from).product();
    if inside && threads <= most.into() {
        return Ok(());
    }
    Err(Error::Vulkan {
        what: format!("shader {name}, groups of {group:?} threads"),
        result: format!("the device allows {sides:?}, and {most} in all"),
    })
}

pub(super) fn specialization(constants: &[u32]) -> (Vec<vk::SpecializationMapEntry>, Vec<u8>) {
    let entry = |i: usize| vk::SpecializationMapEntry { constant_id: i as u32, offset: 4 * i as u32, size: 4 };
    ((0..constants.len()).map(entry).collect(), bytemuck::cast_slice(constants).to_vec())
}

/// Stages with these modules and constants.
pub(super) fn stages_of<'a>(
    modules: &[(vk::ShaderStageFlags, vk::ShaderModule)],
    constants: &'a vk::SpecializationInfo<'a>,
) -> Vec<vk::PipelineShaderStageCreateInfo<'a>> {
    let stage = |&(stage, module)| {
        let info = vk::PipelineShaderStageCreateInfo::default().stage(stage).module(module);
        info.name(c"main").specialization_info(constants)
    };
    modules.iter().map(stage).collect()
}

impl Drop for Made {
    fn drop(&mut self) {
        // Descriptor sets refer to a pipeline's layout, never to the pipeline.
        self.shared.bury(0, Remains::Pipeline(self.handle));
    }
}
