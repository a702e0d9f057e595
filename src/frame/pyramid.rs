//! Stage 4, its end: VALs -> pyramids of nodes that can stand for them. METHOD 9, thesis listing 6.6. One
//! dispatch per level for all views.

use super::vals::Vals;
use super::world::World;
use crate::error::Result;
use crate::gpu::{Buffer, Cmd, Gpu, Pipeline, Use};
use crate::shared::{ClusterNode, ClusterView, PyramidPush};

/// Builds the pyramids over the VALs of every view of every light.
pub struct Pyramid {
    pipeline: Pipeline,
    views: Buffer,
    /// The level below and the one being built, in turn: a level's cells row by row, view by view.
    levels: [Buffer; 2],
    /// The nodes of all views, depth first.
    pub nodes: Buffer,
    /// How many.
    pub node_count: u32,
    view_count: u32,
    /// Of the largest view: texels of its side, levels above them.
    largest: [u32; 2],
}

impl Pyramid {
    /// Makes the pipeline and the nodes for RSMs of `rsm` texels a side.
    ///
    /// # Errors
    /// Fails if the device runs out of memory or the driver rejects the shaders.
    pub fn new(gpu: &Gpu, world: &World, rsm: u32) -> Result<Self> {
        let (views, node_count) = layout(world, rsm);
        let largest = views.iter().map(|v| [v.size, v.levels]).max().unwrap_or_default();
        let bytes = u64::from(node_count.max(1)) * size_of::<ClusterNode>() as u64;
        let level = |name| gpu.buffer(name, bytes);
        Ok(Self {
            levels: [level("pyramid.even")?, level("pyramid.odd")?],
            pipeline: gpu.compute("pyramid.comp", &[])?,
            views: gpu.buffer_from("pyramid.views", &views)?,
            nodes: gpu.buffer("pyramid.nodes", bytes)?,
            node_count,
            view_count: views.len() as u32,
            largest,
        })
    }

    /// Records the pass; stage 4 has waited for its VALs. A pass that reads the nodes waits for compute writes.
    pub fn record(&self, cmd: &Cmd<'_>, vals: &Vals) {
        let [size, levels] = self.largest;
        for level in 1..=levels {
            if level > 1 {
                // The level below; and the one before it has been read.
                cmd.barrier(Use::ComputeRead | Use::ComputeWrite, Use::ComputeRead | Use::ComputeWrite);
            }
            let [even, odd] = &self.levels;
            let (below, own) = if level % 2 == 0 { (odd, even) } else { (even, odd) };
            let binds = [&self.views, &vals.all, below, own, &self.nodes].map(Into::into);
            cmd.bind(&self.pipeline, &binds);
            cmd.push(&PyramidPush { level });
            let cells = size.div_ceil(1 << level);
            cmd.dispatch(cells, cells, self.view_count);
        }
    }
}

/// Where the VALs and nodes of all views lie, and how many nodes there are.
fn layout(world: &World, rsm: u32) -> (Vec<ClusterView>, u32) {
    let sizes = world.lights().iter().flat_map(|light| (0..light.views).map(|_| light.rsm_size(rsm)));
    // Those of the surfaces that emit lie like a picture, too.
    let emitters = (!world.emitters.is_empty()).then(|| world.emitters.len().isqrt() as u32);
    let (mut views, mut first_val, mut first_node) = (Vec::new(), 0, 0);
    for size in sizes.chain(emitters) {
        // At least one level, so that a lone VAL has a node over it.
        let levels = size.next_power_of_two().ilog2().max(1);
        views.push(ClusterView { first_val, size, first_node, levels });
        first_val += size * size;
        first_node += (1..=levels).map(|level| size.div_ceil(1 << level).pow(2)).sum::<u32>();
    }
    (views, first_node)
}
