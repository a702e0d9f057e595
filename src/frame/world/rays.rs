//! What rays on the device read: hierarchies of compressed nodes over triangles, and textures in one buffer.
//!
//! What stands still is one hierarchy in the world. Where something may move, a top level is over that one and the instances
//! that may: each has a hierarchy in its own space, which instances of a rigid mesh share. A frame copies another top level,
//! and fits the boxes about what bends (`frame/refit.rs`).

use super::movers::{Movers, Top};
use super::update::Dynamic;
use super::{InstanceLayout, World, textures};
use crate::bake::bvh::{self, hierarchy};
use crate::error::Result;
use crate::gpu::{Bind, Buffer, Cmd, Gpu};
use crate::image::{linear_from_srgb, mip_chain};
use crate::scene::{Image, Sampler, Scene, Wrap};
use crate::shared::{
    HitTexture, RAY_AREA_LIGHT, RAY_HOLES, RAY_KIND_BITS, RAY_MIRRORED, RAY_MODEL, RAY_TWO_SIDED, RefitBox, RefitNode,
    TEXTURE_COUNT, TEXTURE_NORMAL, TEXTURE_TRANSMISSION,
};
use glam::{DVec3, Vec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::node::CwBvhNode;
use rayon::prelude::*;
use std::collections::{BTreeMap, HashSet};
use std::ops::Range;

/// Texels of a side that rays look up at most: what they see is taken together.
const MOST_TEXELS: u32 = 256;

/// The same of textures that cut holes: rays pass where pixels show none.
const MOST_CUT: u32 = 1024;

/// What rays read of a scene.
pub struct RayBuffers {
    /// Of all hierarchies; the top level, where there is one, comes first.
    pub nodes: Buffer,
    /// Of all hierarchies: three words each.
    pub triangles: Buffer,
    /// What the top level is over: four words each.
    pub instances: Buffer,
    textures: Buffer,
    texels: Buffer,
    /// Entries of the stack that a ray needs at most.
    stack: u32,
    /// 2 where something may move.
    levels: u32,
    /// Whether some material has holes.
    holes: bool,
    /// Triangles; a surface with two sides is one, and a mesh that moves is there once.
    pub triangle_count: usize,
    /// The node that rays begin with.
    pub root: u32,
    /// What moves.
    movers: Movers,
    /// The top level as the device has it, or is about to get it.
    top: Top,
    /// What bends.
    pub(in crate::frame) refit: Option<RefitBuffers>,
}

/// Nodes about what bends.
pub(in crate::frame) struct RefitBuffers {
    /// Depth by depth.
    pub(in crate::frame) list: Buffer,
    /// Their boxes, in the order of nodes.
    pub(in crate::frame) boxes: Buffer,
    /// Of each depth, the deepest first: the first of the list, and how many.
    pub(in crate::frame) depths: Vec<[u32; 2]>,
    /// The first of the nodes.
    pub(in crate::frame) first_node: u32,
}

/// A triangle in the world, relative to the scene's origin, or in model space.
#[derive(Clone, Copy)]
struct Triangle {
    corners: [Vec3; 3],
    /// Of its indices, among all.
    first_index: u32,
    material: u32,
    /// Its instance, or `RAY_MODEL`, and what it is.
    what: u32,
}

/// What hierarchies are built of.
pub(super) struct Placed<'a> {
    pub(super) scene: &'a Scene,
    pub(super) origin: DVec3,
    pub(super) layouts: &'a [InstanceLayout],
    /// Triangles that are parts of area lights, by instance and vertices.
    pub(super) is_area: &'a HashSet<(usize, [usize; 3])>,
    /// How all stands now.
    pub(super) now: &'a Dynamic,
}

impl RayBuffers {
    /// Builds all hierarchies, on all cores; `moves` says which instances have one of their own.
    pub(super) fn new(gpu: &Gpu, placed: &Placed<'_>, moves: Vec<bool>) -> Result<Self> {
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
                // What bends shares nothing.
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
    pub fn constants(&self, gpu: &Gpu) -> [u32; 4] {
        // Whole sizes: another hierarchy seldom needs another pipeline.
        let most = self.nodes.size.max(self.triangles.size) / 16;
        let as_texels = gpu.is_software() && most <= gpu.most_texels();
        [self.stack.next_multiple_of(8), self.levels, u32::from(as_texels), u32::from(self.holes)]
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

    /// Which instances have a hierarchy of their own.
    pub(super) fn moves(&self) -> &[bool] {
        &self.movers.moves
    }

    /// Rebuilds the top level; the next frame copies it.
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
    /// Of nodes with their depths; nothing where there are none.
    fn new(gpu: &Gpu, mut list: Vec<(u32, RefitNode)>) -> Result<Option<Self>> {
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

/// Bytes of the triangles of a scene, at most.
pub(super) fn bytes(scene: &Scene) -> u64 {
    let of_instance = |instance: &crate::scene::Instance| -> u64 {
        let mesh = &scene.meshes[instance.mesh];
        // Of what bends both sides are there.
        let sides = |material: usize| scene.materials[material].double_sided && mesh.deform.is_none();
        mesh.primitives.iter().map(|p| u64::from(p.index_count / 3) >> u32::from(sides(p.material))).sum()
    };
    size_of::<[[f32; 4]; 3]>() as u64 * scene.instances.iter().map(of_instance).sum::<u64>()
}

/// A hierarchy over triangles, and these in its order.
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

/// Hierarchies one after the other.
#[derive(Default)]
struct Hierarchies {
    nodes: Vec<CwBvhNode>,
    triangles: Vec<[[f32; 4]; 3]>,
    /// Nodes on the longest way down any of them.
    deepest: u32,
    /// Entries of the stack that what is above them needs.
    above: u32,
}

impl Hierarchies {
    /// Adds one; says which nodes are its.
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

/// Instances that have one hierarchy in their own space, or such copies of one.
struct Group {
    instances: Vec<usize>,
    bends: bool,
    /// Of the space, in model space.
    centre: Vec3,
}

impl Placed<'_> {
    /// The instances that may move, by what they share, and their hierarchies: rigid ones first. Parts of area lights are told
    /// from others, so not all instances of a mesh are alike.
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
            // Where it bends to is known to the device.
            let centre = low.zip(high).map_or(Vec3::ZERO, |(low, high)| 0.5 * low + 0.5 * high);
            let centre = if bends || !centre.is_finite() { Vec3::ZERO } else { centre };
            let hierarchy = Hierarchy::new(&self.in_model(instances[0], bends, centre));
            (Group { instances, bends, centre }, hierarchy)
        };
        groups.into_par_iter().map(make).collect()
    }

    /// The triangles of an instance as it stands.
    fn in_world(&self, i: usize) -> Vec<Triangle> {
        let instance = &self.scene.instances[i];
        let mut place = instance.world_from_model;
        place.translation -= self.origin;
        let mirrored = if place.matrix3.determinant() < 0.0 { RAY_MIRRORED } else { 0 };
        let at = |p: Vec3| place.transform_point3(p.as_dvec3()).as_vec3();
        without_twins(self.triangles(i, (i as u32) << RAY_KIND_BITS | mirrored, at))
    }

    /// The triangles of an instance at rest, about a centre. Of one that bends all are there: what is a point, or in one place
    /// with another, need not stay so.
    fn in_model(&self, i: usize, bends: bool, centre: Vec3) -> Vec<Triangle> {
        let all = self.triangles(i, RAY_MODEL << RAY_KIND_BITS, |p| p - centre);
        if bends { all } else { without_twins(all) }
    }

    /// All triangles of an instance; `what` stands for the instance.
    fn triangles(&self, i: usize, what: u32, place: impl Fn(Vec3) -> Vec3) -> Vec<Triangle> {
        let mesh = &self.scene.meshes[self.scene.instances[i].mesh];
        let mut all: Vec<Triangle> = Vec::with_capacity(mesh.triangle_count());
        for primitive in &mesh.primitives {
            let material = &self.scene.materials[primitive.material];
            let kind = [(material.alpha_cutoff.is_some(), RAY_HOLES), (material.double_sided, RAY_TWO_SIDED)];
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

/// Of two sides of a surface the first; without what is no larger than a point, which no ray meets: very many points in one
/// place make a hierarchy as deep as they are many.
fn without_twins(mut all: Vec<Triangle>) -> Vec<Triangle> {
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

/// How each texture of each material is looked up, and the texels.
fn hit_textures(scene: &Scene) -> (Vec<HitTexture>, Vec<u32>) {
    let cut = scene.materials.iter().filter(|m| m.alpha_cutoff.is_some());
    let cut: HashSet<usize> = cut.filter_map(|m| Some(m.base_color_texture?.image)).collect();
    let most = |image: usize| if cut.contains(&image) { MOST_CUT } else { MOST_TEXELS };
    // What is seen through or lies over a surface is so in pictures alone.
    let of_pictures = |which: u32| which == TEXTURE_NORMAL || which >= TEXTURE_TRANSMISSION;
    let used = |m| {
        let all = textures::used(m).map(|(texture, holds)| (texture, holds == textures::Holds::Colors));
        all.into_iter().enumerate().filter(|(which, _)| !of_pictures(*which as u32))
    };
    let all = scene.materials.iter().flat_map(used);
    let mut wanted: BTreeMap<(usize, bool), u32> =
        all.filter_map(|(_, (texture, srgb))| Some(((texture?.image, srgb), 0))).collect();
    let keys: Vec<(usize, bool)> = wanted.keys().copied().collect();
    let pages: Vec<Vec<u32>> =
        keys.par_iter().map(|&(image, srgb)| page(&scene.images[image], most(image), srgb)).collect();
    let mut texels = Vec::new();
    for (key, page) in keys.iter().zip(pages) {
        wanted.insert(*key, texels.len() as u32);
        texels.extend(page);
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

/// Levels of an image that are left out where a side has `most` texels.
fn left_out(image: &Image, most: u32) -> u32 {
    (0..32).find(|level| image.width.max(image.height) >> level <= most).unwrap_or(0)
}

/// RGBA8 texels of the levels that are kept; of colours the square roots of linear values.
fn page(image: &Image, most: u32, srgb: bool) -> Vec<u32> {
    let levels = mip_chain(&image.rgba, image.width, image.height, srgb);
    let root = |c: usize| (linear_from_srgb(c as u8).sqrt() * 255.0 + 0.5) as u8;
    let table: [u8; 256] = std::array::from_fn(|c| if srgb { root(c) } else { c as u8 });
    let coded = |t: &[u8]| {
        u32::from_le_bytes([table[usize::from(t[0])], table[usize::from(t[1])], table[usize::from(t[2])], t[3]])
    };
    levels.iter().skip(left_out(image, most) as usize).flat_map(|level| level.chunks_exact(4).map(coded)).collect()
}
