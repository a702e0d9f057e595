//! The scene's triangles as rays on the device read them: a hierarchy of compressed nodes, and textures in one buffer.

use super::{InstanceLayout, World, textures};
use crate::bake::bvh::hierarchy;
use crate::error::Result;
use crate::gpu::{Bind, Buffer, Gpu};
use crate::image::{linear_from_srgb, mip_chain};
use crate::scene::{Image, Sampler, Scene, Wrap};
use crate::shared::{
    HitTexture, RAY_AREA_LIGHT, RAY_HOLES, RAY_KIND_BITS, RAY_MIRRORED, RAY_TWO_SIDED, TEXTURE_COUNT, TEXTURE_NORMAL,
};
use glam::{DVec3, Vec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::node::CwBvhNode;
use rayon::prelude::*;
use std::collections::{BTreeMap, HashSet};

/// Texels of a side that rays look up at most: what they see is taken together.
const MOST_TEXELS: u32 = 256;

/// The same of textures that cut holes: rays pass where pixels show none.
const MOST_CUT: u32 = 1024;

/// What rays read of a scene.
pub struct RayBuffers {
    nodes: Buffer,
    triangles: Buffer,
    /// Those that move.
    instances: Buffer,
    textures: Buffer,
    texels: Buffer,
    /// Entries of the stack that a ray needs at most.
    stack: u32,
    /// Whether some material has holes.
    holes: bool,
    /// Triangles; a surface with two sides is one.
    pub triangle_count: usize,
    /// The node that rays begin with.
    pub root: u32,
}

/// A triangle in the world, relative to the scene's origin.
#[derive(Clone, Copy)]
struct Triangle {
    corners: [Vec3; 3],
    /// Of its indices, among all.
    first_index: u32,
    material: u32,
    /// Its instance, and what it is.
    what: u32,
}

impl RayBuffers {
    /// Builds the hierarchy of a scene as it stands, on all cores; `is_area` says which triangles are parts of area lights, by
    /// instance and vertices.
    pub(super) fn new(
        gpu: &Gpu,
        scene: &Scene,
        origin: DVec3,
        layouts: &[InstanceLayout],
        is_area: &HashSet<(usize, [usize; 3])>,
    ) -> Result<Self> {
        let triangles = placed(scene, origin, layouts, is_area);
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
        let words: Vec<[[f32; 4]; 3]> = (tree.primitive_indices.par_iter())
            .map(|&i| {
                let Triangle { corners: [a, b, c], first_index, material, what } = triangles[i as usize];
                let word = |p: Vec3, bits: u32| [p.x, p.y, p.z, f32::from_bits(bits)];
                [word(a, first_index), word(b, material), word(c, what)]
            })
            .collect();
        let (textures, texels) = hit_textures(scene);
        Ok(Self {
            nodes: gpu.buffer_from("rays.nodes", &tree.nodes)?,
            triangles: gpu.buffer_from("rays.triangles", &words)?,
            instances: gpu.buffer_from("rays.instances", &[[0.0_f32; 4]; 4])?,
            textures: gpu.buffer_from("rays.textures", &textures)?,
            texels: gpu.buffer_from("rays.texels", &texels)?,
            stack: depth(&tree),
            holes: scene.materials.iter().any(|material| material.alpha_cutoff.is_some()),
            triangle_count: triangles.len(),
            root: 0,
        })
    }

    /// Constants 0 to 3 of shaders with rays.
    pub fn constants(&self, gpu: &Gpu) -> [u32; 4] {
        // Whole sizes: another hierarchy seldom needs another pipeline.
        [self.stack.next_multiple_of(8), 1, u32::from(gpu.is_software()), u32::from(self.holes)]
    }

    /// Bindings 0 to 11 of shaders with rays.
    pub fn binds<'a>(&'a self, world: &'a World) -> [Bind<'a>; 12] {
        [
            (&self.nodes).into(),
            Bind::Texels(&self.nodes),
            (&self.triangles).into(),
            Bind::Texels(&self.triangles),
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
}

/// Bytes of the triangles of a scene, at most.
pub(super) fn bytes(scene: &Scene) -> u64 {
    let of_instance = |instance: &crate::scene::Instance| -> u64 {
        let primitives = &scene.meshes[instance.mesh].primitives;
        primitives
            .iter()
            .map(|p| u64::from(p.index_count / 3) >> u32::from(scene.materials[p.material].double_sided))
            .sum()
    };
    size_of::<[[f32; 4]; 3]>() as u64 * scene.instances.iter().map(of_instance).sum::<u64>()
}

/// All triangles that are drawn, bent as they stand. Both sides of a surface are one triangle.
fn placed(
    scene: &Scene,
    origin: DVec3,
    layouts: &[InstanceLayout],
    is_area: &HashSet<(usize, [usize; 3])>,
) -> Vec<Triangle> {
    let of_instance = |(i, instance): (usize, &crate::scene::Instance)| {
        let mesh = &scene.meshes[instance.mesh];
        let posed = instance.pose.as_ref().map(|pose| mesh.posed(pose));
        let vertices = posed.as_ref().unwrap_or(&mesh.vertices);
        let mut place = instance.world_from_model;
        place.translation -= origin;
        let mirrored = place.matrix3.determinant() < 0.0;
        let mut all: Vec<Triangle> = Vec::with_capacity(mesh.triangle_count());
        for primitive in &mesh.primitives {
            let material = &scene.materials[primitive.material];
            let kind = [
                (material.alpha_cutoff.is_some(), RAY_HOLES),
                (material.double_sided, RAY_TWO_SIDED),
                (mirrored, RAY_MIRRORED),
            ];
            let kind: u32 = kind.into_iter().filter_map(|(is, bit)| is.then_some(bit)).sum();
            for first in (primitive.first_index..primitive.first_index + primitive.index_count).step_by(3) {
                let at = mesh.triangle(first as usize / 3);
                let corners = at.map(|v| place.transform_point3(vertices[v].position.as_dvec3()).as_vec3());
                let area = if is_area.contains(&(i, at)) { RAY_AREA_LIGHT } else { 0 };
                all.push(Triangle {
                    corners,
                    first_index: layouts[i].first_index + first,
                    material: primitive.material as u32,
                    what: (i as u32) << RAY_KIND_BITS | kind | area,
                });
            }
        }
        // Of two sides the first stays; what is no larger than a point is met by no ray, and very many points in one place make
        // a hierarchy as deep as they are many.
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
    };
    scene.instances.par_iter().enumerate().filter(|(_, i)| !i.hidden).flat_map_iter(of_instance).collect()
}

/// Nodes on the longest way down: a ray keeps one group of nodes for each.
fn depth(tree: &CwBvh) -> u32 {
    let mut depths = vec![1_u32; tree.nodes.len()];
    // Children come after parents.
    for (at, node) in tree.nodes.iter().enumerate() {
        for child in 0..node.imask.count_ones() {
            depths[(node.child_base_idx + child) as usize] = depths[at] + 1;
        }
    }
    depths.into_iter().max().unwrap_or(1)
}

/// How each texture of each material is looked up, and the texels.
fn hit_textures(scene: &Scene) -> (Vec<HitTexture>, Vec<u32>) {
    let cut = scene.materials.iter().filter(|m| m.alpha_cutoff.is_some());
    let cut: HashSet<usize> = cut.filter_map(|m| Some(m.base_color_texture?.image)).collect();
    let most = |image: usize| if cut.contains(&image) { MOST_CUT } else { MOST_TEXELS };
    let used = |m| textures::used(m).into_iter().enumerate().filter(|(which, _)| *which != TEXTURE_NORMAL as usize);
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
