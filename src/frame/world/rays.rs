//! Ray tracing data: compressed BVHs over triangles, and textures in one buffer.
//!
//! Static instances share one BVH in the world. If instances may move, a top level covers that BVH and those of the
//! movable instances. Each movable instance has a BVH in its own space, which instances of a rigid mesh share. Frames
//! copy a new top level and refit the boxes of deformed meshes (`frame/refit.rs`).

use super::movers::{Movers, Top};
use super::update::Dynamic;
use super::{InstanceLayout, World, textures};
use crate::bake::bvh::{self, hierarchy};
use crate::error::Result;
use crate::gpu::{Bind, Buffer, Cmd, Device};
use crate::image::{linear_from_srgb, mip_chain};
use crate::scene::{Image, Sampler, Scene, Wrap};
use crate::shared::{
    HitTexture, RAY_AREA_LIGHT, RAY_HOLES, RAY_KIND_BITS, RAY_MIRRORED, RAY_MODEL, RAY_ONE_SIDE, RAY_TWIN,
    RAY_TWO_SIDED, RefitBox, RefitNode, TEXTURE_COUNT, TEXTURE_NORMAL, TEXTURE_TRANSMISSION,
};
use glam::{DVec3, Vec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::node::CwBvhNode;
use rayon::prelude::*;
use std::collections::{BTreeMap, HashSet};
use std::ops::Range;

/// Minimum number of stack entries that shaders reserve \[8 bytes\]. AMD's driver RADV keeps arrays of up to 256 bytes in
/// registers, which are then too few for the rest of the shader.
const LEAST_STACK: u32 = 40;

/// Maximum side of textures at ray hits \[texels\]; rays are averaged anyway.
const MOST_TEXELS: u32 = 256;

/// Maximum side of alpha masks, so that rays pass where pixels show holes.
const MOST_CUT: u32 = 1024;

/// Ray tracing data of a scene.
pub struct RayBuffers {
    /// Nodes of all BVHs; the top level, if there is one, comes first.
    pub nodes: Buffer,
    /// Triangles of all BVHs, three words each.
    pub triangles: Buffer,
    /// Instances below the top level, four words each.
    pub instances: Buffer,
    textures: Buffer,
    texels: Buffer,
    /// Maximum number of stack entries that a ray needs.
    stack: u32,
    /// 2 if instances may move, else 1.
    levels: u32,
    /// Whether some material has an alpha mask.
    holes: bool,
    /// Number of triangles. A two-sided surface counts once, as does a mesh that moves.
    pub triangle_count: usize,
    /// The node at which rays start.
    pub root: u32,
    /// Movable instances.
    movers: Movers,
    /// The top level that the device has or is about to receive.
    top: Top,
    /// Data for refitting deformed meshes.
    pub(in crate::frame) refit: Option<RefitBuffers>,
}

/// Nodes of deformed meshes.
pub(in crate::frame) struct RefitBuffers {
    /// The nodes, by depth.
    pub(in crate::frame) list: Buffer,
    /// Boxes of the nodes, in node order.
    pub(in crate::frame) boxes: Buffer,
    /// First entry of the list and number of entries, for each depth, deepest first.
    pub(in crate::frame) depths: Vec<[u32; 2]>,
    /// The first node.
    pub(in crate::frame) first_node: u32,
}

/// A triangle in the world, relative to the scene's origin, or in model space.
#[derive(Clone, Copy)]
struct Triangle {
    corners: [Vec3; 3],
    /// First of its indices among all.
    first_index: u32,
    material: u32,
    /// Its instance or `RAY_MODEL`, and bits for its kind.
    what: u32,
}

/// Input for building BVHs.
pub(super) struct Placed<'a> {
    pub(super) scene: &'a Scene,
    pub(super) origin: DVec3,
    pub(super) layouts: &'a [InstanceLayout],
    /// Triangles of area lights, by instance and vertices.
    pub(super) is_area: &'a HashSet<(usize, [usize; 3])>,
    /// The current state.
    pub(super) now: &'a Dynamic,
}

impl RayBuffers {
    /// Builds all BVHs, on all cores. `moves` says which instances have their own.
    pub(super) fn new(gpu: &Device, placed: &Placed<'_>, moves: Vec<bool>) -> Result<Self> {
        let scene = placed.scene;
        let may_move = moves.iter().filter(|moves| **moves).count();
        let levels = if may_move > 0 { 2 } else { 1 };
        let mut all = Hierarchies::default();
        if levels == 2 {
            all.nodes = vec![CwBvhNode::default(); may_move + 1];
            all.above = bvh::most_depth(may_move + 1) + 1;
        }
        let shown = |i: &usize| !moves[*i] && !scene.instances[*i].hidden;
        let still = (0..scene.instances.len()).into_par_iter().filter(shown).flat_map_iter(|i| placed.in_world(i));
        let still = Hierarchy::new(&still.collect::<Vec<_>>());
        let some = levels == 1 || !still.words.is_empty();
        let still = some.then(|| (still.bounds, all.add(&still).start));
        let (mut list, mut made) = (Vec::new(), Vec::new());
        for (group, of_mesh) in placed.groups(&moves) {
            let mut nodes = None;
            for instance in group.instances {
                // Deformed instances share nothing.
                let own = nodes.take().filter(|_| !group.bends).unwrap_or_else(|| all.add(&of_mesh));
                if group.bends {
                    let first_vertex = placed.layouts[instance].drawn_vertex;
                    let node = |(node, depth)| (depth, RefitNode { node, first_vertex });
                    list.extend(own.clone().zip(bvh::depths(&of_mesh.tree)).map(node));
                }
                made.push((instance, own.start, (group.centre, of_mesh.bounds)));
                nodes = Some(own);
            }
        }
        let movers = Movers::new(scene, placed.layouts, moves, still, made);
        let mut top = Top::default();
        if levels == 2 {
            top = movers.top(placed.now);
            all.nodes[..top.nodes.len()].copy_from_slice(&top.nodes);
        }
        let mut instances = top.instances.clone();
        instances.resize(may_move + 1, [[0.0; 4]; 4]);
        let (textures, texels) = hit_textures(scene);
        Ok(Self {
            nodes: gpu.buffer_from("rays.nodes", &all.nodes)?,
            triangles: gpu.buffer_from("rays.triangles", &all.triangles)?,
            instances: gpu.buffer_from("rays.instances", &instances)?,
            textures: gpu.buffer_from("rays.textures", &textures)?,
            texels: gpu.buffer_from("rays.texels", &texels)?,
            stack: all.above + all.deepest,
            levels,
            holes: scene.materials.iter().any(|material| material.alpha_cutoff.is_some()),
            triangle_count: all.triangles.len(),
            root: 0,
            movers,
            top,
            refit: RefitBuffers::new(gpu, list)?,
        })
    }

    /// Constants 0 to 3 of shaders with rays.
    pub fn constants(&self, gpu: &Device) -> [u32; 4] {
        // Rounded up, so that another BVH seldom needs another pipeline.
        let stack = self.stack.next_multiple_of(8).max(LEAST_STACK);
        let as_texels = gpu.reads_texels(self.nodes.size.max(self.triangles.size));
        [stack, self.levels, u32::from(as_texels), u32::from(self.holes)]
    }

    /// Bindings 0 to 11 of shaders with rays.
    pub fn binds<'a>(&'a self, world: &'a World) -> [Bind<'a>; 12] {
        [
            (&self.nodes).into(),
            Bind::SomeTexels(&self.nodes),
            (&self.triangles).into(),
            Bind::SomeTexels(&self.triangles),
            (&self.instances).into(),
            world.vertices().into(),
            world.indices().into(),
            (&world.instances).into(),
            (&world.materials).into(),
            (&world.texture_slots).into(),
            (&self.textures).into(),
            (&self.texels).into(),
        ]
    }

    /// Which instances have their own BVH.
    pub(super) fn moves(&self) -> &[bool] {
        &self.movers.moves
    }

    /// Rebuilds the top level. The next frame copies it.
    pub(super) fn place(&mut self, now: &Dynamic) {
        if self.levels == 2 {
            self.top = self.movers.top(now);
        }
    }

    /// Records the copy of the top level.
    pub(super) fn record_top(&self, cmd: &Cmd<'_>) {
        cmd.update(&self.nodes, 0, &self.top.nodes);
        cmd.update(&self.instances, 0, &self.top.instances);
    }
}

impl RefitBuffers {
    /// Creates the buffers for nodes with their depths; `None` without nodes.
    fn new(gpu: &Device, mut list: Vec<(u32, RefitNode)>) -> Result<Option<Self>> {
        let Some(&(_, RefitNode { node: first_node, .. })) = list.first() else { return Ok(None) };
        list.sort_by_key(|(depth, _)| std::cmp::Reverse(*depth));
        let depths = list.chunk_by(|a, b| a.0 == b.0).scan(0, |first, nodes| {
            let depth = [*first, nodes.len() as u32];
            *first += depth[1];
            Some(depth)
        });
        let nodes: Vec<RefitNode> = list.iter().map(|(_, node)| *node).collect();
        Ok(Some(Self {
            list: gpu.buffer_from("refit.list", &nodes)?,
            boxes: gpu.buffer("refit.boxes", (size_of::<RefitBox>() * nodes.len()) as u64)?,
            depths: depths.collect(),
            first_node,
        }))
    }
}

/// Upper bound of the size of a scene's triangles \[bytes\].
pub(super) fn bytes(scene: &Scene) -> u64 {
    let of_instance = |instance: &crate::scene::Instance| -> u64 {
        let mesh = &scene.meshes[instance.mesh];
        // Deformed meshes keep the triangles of both sides.
        let sides = |material: usize| scene.materials[material].double_sided && mesh.deform.is_none();
        mesh.primitives.iter().map(|p| u64::from(p.index_count / 3) >> u32::from(sides(p.material))).sum()
    };
    size_of::<[[f32; 4]; 3]>() as u64 * scene.instances.iter().map(of_instance).sum::<u64>()
}

/// A BVH over triangles, and the triangles in its order.
struct Hierarchy {
    tree: CwBvh,
    words: Vec<[[f32; 4]; 3]>,
    bounds: Aabb,
}

impl Hierarchy {
    fn new(triangles: &[Triangle]) -> Self {
        let boxes: Vec<Aabb> = (triangles.par_iter())
            .map(|t| {
                let [a, b, c] = t.corners.map(Vec3A::from);
                Aabb::new(a.min(b).min(c), a.max(b).max(c))
            })
            .collect();
        let mut tree = hierarchy(&boxes);
        if tree.nodes.is_empty() {
            tree.nodes.push(CwBvhNode::default()); // without children
        }
        let word = |p: Vec3, bits: u32| [p.x, p.y, p.z, f32::from_bits(bits)];
        let words = (tree.primitive_indices.par_iter())
            .map(|&i| {
                let Triangle { corners: [a, b, c], first_index, material, what } = triangles[i as usize];
                [word(a, first_index), word(b, material), word(c, what)]
            })
            .collect();
        Self { tree, words, bounds: boxes.iter().fold(Aabb::empty(), |all, b| all.union(b)) }
    }
}

/// Several BVHs, one after the other.
#[derive(Default)]
struct Hierarchies {
    nodes: Vec<CwBvhNode>,
    triangles: Vec<[[f32; 4]; 3]>,
    /// Nodes on the longest path through any of the BVHs.
    deepest: u32,
    /// Stack entries for the levels above the BVHs.
    above: u32,
}

impl Hierarchies {
    /// Adds a BVH and returns the range of its nodes.
    fn add(&mut self, of: &Hierarchy) -> Range<u32> {
        let (first_node, first_triangle) = (self.nodes.len() as u32, self.triangles.len() as u32);
        self.nodes.extend(of.tree.nodes.iter().map(|node| CwBvhNode {
            child_base_idx: node.child_base_idx + first_node,
            primitive_base_idx: node.primitive_base_idx + first_triangle,
            ..*node
        }));
        self.triangles.extend_from_slice(&of.words);
        self.deepest = self.deepest.max(bvh::depth(&of.tree));
        first_node..self.nodes.len() as u32
    }
}

/// Instances with the same BVH in their own space, shared or copied.
struct Group {
    instances: Vec<usize>,
    bends: bool,
    /// Origin of that space, in model space.
    centre: Vec3,
}

impl Placed<'_> {
    /// Groups the movable instances by shared data and builds their BVHs, rigid ones first. Triangles of area lights
    /// are marked, so instances of a mesh with and without area lights are in different groups.
    fn groups(&self, moves: &[bool]) -> Vec<(Group, Hierarchy)> {
        let mut groups: BTreeMap<(bool, usize, Vec<usize>), Vec<usize>> = BTreeMap::new();
        for (i, instance) in self.scene.instances.iter().enumerate().filter(|(i, _)| moves[*i]) {
            let mesh = &self.scene.meshes[instance.mesh];
            let is_part = |t: &usize| self.is_area.contains(&(i, mesh.triangle(*t)));
            let parts = (0..mesh.triangle_count()).filter(is_part).collect();
            groups.entry((mesh.deform.is_some(), instance.mesh, parts)).or_default().push(i);
        }
        let make = |((bends, mesh, _), instances): ((bool, usize, Vec<usize>), Vec<usize>)| {
            let positions = || self.scene.meshes[mesh].vertices.iter().map(|v| v.position);
            let (low, high) = (positions().reduce(Vec3::min), positions().reduce(Vec3::max));
            // For deformed meshes the device computes positions, without a centre.
            let centre = low.zip(high).map_or(Vec3::ZERO, |(low, high)| 0.5 * low + 0.5 * high);
            let centre = if bends || !centre.is_finite() { Vec3::ZERO } else { centre };
            let hierarchy = Hierarchy::new(&self.in_model(instances[0], bends, centre));
            (Group { instances, bends, centre }, hierarchy)
        };
        groups.into_par_iter().map(make).collect()
    }

    /// The triangles of an instance in its current place.
    fn in_world(&self, i: usize) -> Vec<Triangle> {
        let instance = &self.scene.instances[i];
        let mut place = instance.world_from_model;
        place.translation -= self.origin;
        let mirrored = if place.matrix3.determinant() < 0.0 { RAY_MIRRORED } else { 0 };
        let at = |p: Vec3| place.transform_point3(p.as_dvec3()).as_vec3();
        without_twins(self.triangles(i, (i as u32) << RAY_KIND_BITS | mirrored, at))
    }

    /// The triangles of an instance at rest, about a centre. For a deformed mesh all are kept: degenerate or coinciding
    /// triangles need not stay so.
    fn in_model(&self, i: usize, bends: bool, centre: Vec3) -> Vec<Triangle> {
        let all = self.triangles(i, RAY_MODEL << RAY_KIND_BITS, |p| p - centre);
        if bends { all } else { without_twins(all) }
    }

    /// All triangles of an instance; `what` is the instance's bits.
    fn triangles(&self, i: usize, what: u32, place: impl Fn(Vec3) -> Vec3) -> Vec<Triangle> {
        let mesh = &self.scene.meshes[self.scene.instances[i].mesh];
        let mut all: Vec<Triangle> = Vec::with_capacity(mesh.triangle_count());
        for primitive in &mesh.primitives {
            let material = &self.scene.materials[primitive.material];
            let kind = [
                (material.alpha_cutoff.is_some(), RAY_HOLES),
                (material.double_sided, RAY_TWO_SIDED),
                (material.double_sided && mesh.deform.is_some(), RAY_ONE_SIDE),
            ];
            let kind: u32 = kind.into_iter().filter_map(|(is, bit)| is.then_some(bit)).sum();
            for first in (primitive.first_index..primitive.first_index + primitive.index_count).step_by(3) {
                let at = mesh.triangle(first as usize / 3);
                let area = if self.is_area.contains(&(i, at)) { RAY_AREA_LIGHT } else { 0 };
                all.push(Triangle {
                    corners: at.map(|v| place(mesh.vertices[v].position)),
                    first_index: self.layouts[i].first_index + first,
                    material: primitive.material as u32,
                    what: what | kind | area,
                });
            }
        }
        all
    }
}

/// Keeps only the first side of two-sided surfaces, which also stands for the second side that follows it. Drops
/// triangles that are points, which no ray can hit. Many points in one place would also make a BVH as deep as their
/// number.
fn without_twins(mut all: Vec<Triangle>) -> Vec<Triangle> {
    for at in 1..all.len() {
        let [first, second] = [all[at - 1], all[at]];
        let [a, b, c] = first.corners;
        let follows = second.first_index == first.first_index + 3 && second.material == first.material;
        if follows && first.what & RAY_TWO_SIDED != 0 && second.corners == [a, c, b] {
            all[at - 1].what |= RAY_TWIN;
        }
    }
    let mut seen = HashSet::new();
    all.retain(|t| {
        let [a, b, c] = t.corners;
        if !(a.is_finite() && b.is_finite() && c.is_finite()) || (a == b && b == c) {
            return false;
        }
        let mut key = t.corners.map(|p| (p + Vec3::ZERO).to_array().map(f32::to_bits));
        key.sort_unstable();
        t.what & RAY_TWO_SIDED == 0 || seen.insert((key, t.material))
    });
    all
}

/// Lookup parameters of all textures of all materials, and their texels.
fn hit_textures(scene: &Scene) -> (Vec<HitTexture>, Vec<u32>) {
    let cut = scene.materials.iter().filter(|m| m.alpha_cutoff.is_some());
    let cut: HashSet<usize> = cut.filter_map(|m| Some(m.base_color_texture?.image)).collect();
    let most = |image: usize| if cut.contains(&image) { MOST_CUT } else { MOST_TEXELS };
    // Normal maps, transmission, coats and sheen matter only in pictures.
    let of_pictures = |which: u32| which == TEXTURE_NORMAL || which >= TEXTURE_TRANSMISSION;
    let used = |m| {
        let all = textures::used(m).map(|(texture, holds)| (texture, holds == textures::Holds::Colors));
        all.into_iter().enumerate().filter(|(which, _)| !of_pictures(*which as u32))
    };
    let all = scene.materials.iter().flat_map(used);
    let mut wanted: BTreeMap<(usize, bool), u32> =
        all.filter_map(|(_, (texture, srgb))| Some(((texture?.image, srgb), 0))).collect();
    let keys: Vec<(usize, bool)> = wanted.keys().copied().collect();
    let pages: Vec<Vec<Vec<u32>>> =
        keys.par_iter().map(|&(image, srgb)| page(&scene.images[image], most(image), srgb)).collect();
    let mut texels = Vec::new();
    for (key, page) in keys.iter().zip(pages) {
        wanted.insert(*key, texels.len() as u32);
        let mut start = texels.len() + page.len();
        for level in &page {
            texels.push(start as u32);
            start += level.len();
        }
        texels.extend(page.into_iter().flatten());
    }
    let wrap = |wrap| match wrap {
        Wrap::Repeat => 0,
        Wrap::Mirror => 1,
        Wrap::Clamp => 2,
    };
    let mut out = vec![HitTexture::default(); scene.materials.len() * TEXTURE_COUNT as usize];
    for (m, material) in scene.materials.iter().enumerate() {
        for (which, (texture, srgb)) in used(material) {
            let Some(texture) = texture else { continue };
            let image = &scene.images[texture.image];
            let [width, height] =
                [image.width, image.height].map(|s| (s >> left_out(image, most(texture.image))).max(1));
            let Sampler { wrap_u, wrap_v, nearest } = texture.sampler;
            let how = wrap(wrap_u) | wrap(wrap_v) << 2 | u32::from(srgb) << 4 | u32::from(nearest) << 5;
            let first = wanted[&(texture.image, srgb)];
            out[m * TEXTURE_COUNT as usize + which] = HitTexture { first, width, height, how };
        }
    }
    (out, texels)
}

/// Number of levels that are dropped so that no side exceeds `most` texels.
fn left_out(image: &Image, most: u32) -> u32 {
    (0..32).find(|level| image.width.max(image.height) >> level <= most).unwrap_or(0)
}

/// RGBA8 texels of each of the kept levels. Colours are stored as square roots of linear values.
fn page(image: &Image, most: u32, srgb: bool) -> Vec<Vec<u32>> {
    let levels = mip_chain(&image.rgba, image.width, image.height, srgb);
    let root = |c: usize| (linear_from_srgb(c as u8).sqrt() * 255.0 + 0.5) as u8;
    let table: [u8; 256] = std::array::from_fn(|c| if srgb { root(c) } else { c as u8 });
    let coded = |t: &[u8]| {
        u32::from_le_bytes([table[usize::from(t[0])], table[usize::from(t[1])], table[usize::from(t[2])], t[3]])
    };
    let kept = levels.iter().skip(left_out(image, most) as usize);
    kept.map(|level| level.chunks_exact(4).map(coded).collect()).collect()
}
