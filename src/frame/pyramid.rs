//! End of stage 4: builds pyramids of nodes over the VALs; a node can replace the VALs below it. METHOD 9, thesis
//! listing 6.6. One dispatch per level covers all views.

use super::vals::Vals;
use super::world::World;
use crate::error::Result;
use crate::gpu::{Buffer, Cmd, Device, Pipeline, Use};
use crate::shared::{ClusterNode, ClusterView, PyramidPush};

/// Builds the pyramids over the VALs of every view of every light.
pub struct Pyramid {
    pipeline: Pipeline,
    views: Buffer,
    /// The level below and the one being built, alternating. Cells of a level are stored row by row, view by view.
    levels: [Buffer; 2],
    /// The nodes of all views, in depth-first order.
    pub nodes: Buffer,
    /// Number of nodes.
    pub node_count: u32,
    view_count: u32,
    /// Of the largest view: texels a side, and number of levels above them.
    largest: [u32; 2],
}

impl Pyramid {
    /// Creates the pipeline and the nodes for RSMs with `rsm` texels a side.
    ///
    /// # Errors
    /// Fails if the device runs out of memory or the driver rejects the shaders.
    pub fn new(gpu: &Device, world: &World, rsm: u32) -> Result<Self> {
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

    /// Records the pass. Stage 4 has already waited for its VALs. A pass that reads the nodes must wait for compute
    /// writes.
    pub fn record(&self, cmd: &Cmd<'_>, vals: &Vals) {
        let [size, levels] = self.largest;
        for level in 1..=levels {
            if level > 1 {
                // Waits for the level below, and for reads of the buffer that this level overwrites.
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

/// Places of the VALs and nodes of all views, and the number of nodes.
fn layout(world: &World, rsm: u32) -> (Vec<ClusterView>, u32) {
    let sizes = world.lights().iter().flat_map(|light| (0..light.views).map(|_| light.rsm_size(rsm)));
    // The VALs of emissive surfaces form a square like those of an RSM.
    let emitters = (!world.emitters.is_empty()).then(|| world.emitters.len().isqrt() as u32);
    let (mut views, mut first_val, mut first_node) = (Vec::new(), 0, 0);
    for size in sizes.chain(emitters) {
        // At least one level, so that a lone VAL also has a node above it.
        let levels = size.next_power_of_two().ilog2().max(1);
        views.push(ClusterView { first_val, size, first_node, levels });
        first_val += size * size;
        first_node += (1..=levels).map(|level| size.div_ceil(1 << level).pow(2)).sum::<u32>();
    }
    (views, first_node)
}
