//! Draws the scene's triangles: selection, pipelines by kind of material, and frustum culling.

use super::World;
use crate::error::Result;
use crate::gpu::{Bind, Draw, Format, Pipeline, Stream};
use crate::scene::{Mesh, Primitive, Vertex};
use crate::shared::{DrawPush, KIND_MASKED, TEXTURE_COUNT};
use glam::{Mat4, Vec2, Vec3, Vec4};
use std::sync::Arc;

/// Layout of a vertex for the stages that draw the scene.
pub(in crate::frame) const VERTEX: Stream<'static> = Stream {
    stride: size_of::<Vertex>() as u32,
    attributes: &[
        (0, Format::R32G32B32_SFLOAT, 0),
        (1, Format::R32G32B32_SFLOAT, 12),
        (2, Format::R32G32B32A32_SFLOAT, 24),
        (3, Format::R32G32_SFLOAT, 40),
        (4, Format::R32G32_SFLOAT, 48),
        (5, Format::R8G8B8A8_UNORM, 56),
    ],
};

/// The same layout without tangents, for `mesh_plain.vert`.
pub(in crate::frame) const VERTEX_PLAIN: Stream<'static> = Stream {
    stride: size_of::<Vertex>() as u32,
    attributes: &[
        VERTEX.attributes[0],
        VERTEX.attributes[1],
        VERTEX.attributes[3],
        VERTEX.attributes[4],
        VERTEX.attributes[5],
    ],
};

/// The position only, for `mesh_depth.vert`.
pub(in crate::frame) const VERTEX_PLACE: Stream<'static> =
    Stream { stride: size_of::<Vertex>() as u32, attributes: &[VERTEX.attributes[0]] };

/// Indices in a run of triangles with its own bounds.
const RUN: u32 = 3 * 1024;

/// Triangles of one instance with one material.
pub(super) struct DrawItem {
    pub(super) instance: u32,
    pub(super) material: u32,
    /// Kind of the material.
    pub(super) kind: usize,
    pub(super) vertex_offset: u64,
    /// First vertex of the mesh at rest.
    pub(super) first_rest: u32,
    pub(super) index_offset: u64,
    pub(super) first_index: u32,
    pub(super) index_count: u32,
    /// First of the model's references, in pairs.
    pub(super) reference_base: u32,
    /// Atlas index of the instance's first cache.
    pub(super) cache_base: u32,
    /// The instance's model.
    pub(super) grid: u32,
    /// First of the instance's vertices or cells among those of all instances.
    pub(super) first_slot: u32,
    pub(super) masked: bool,
    pub(super) seen_through: bool,
    /// Whether the model has caches to reference.
    pub(super) has_caches: bool,
    /// Smallest and largest coordinates in model space; `None` for deformed meshes.
    pub(super) bounds: Option<[Vec3; 2]>,
    /// Bounds of each run of `RUN` indices; the last run may be shorter. Empty for deformed meshes and those with a
    /// single run.
    pub(super) runs: Arc<[[Vec3; 2]]>,
}

/// One pipeline for each kind of material in the scene.
pub(in crate::frame) struct ByKind(Vec<Pipeline>);

/// Selects the triangles that a pass draws.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Which {
    /// All.
    All,
    /// Opaque and alpha-masked surfaces.
    Solid,
    /// Surfaces without holes that nothing is seen through.
    Whole,
    /// Transparent surfaces.
    SeenThrough,
    /// Materials without an alpha mask.
    Opaque,
    /// Materials with an alpha mask.
    Masked,
}

/// The four side planes of a view in model space; negative distances are outside. The second value is the magnitude of
/// the numbers that a plane was computed from.
struct Sides([(Vec4, f32); 4]);

impl Sides {
    fn new(clip_from_world: Mat4, world_from_model: Mat4) -> Self {
        let (x, y, w) = (clip_from_world.row(0), clip_from_world.row(1), clip_from_world.row(3));
        Self(
            [w + x, w - x, w + y, w - y]
                .map(|side| (world_from_model.transpose() * side, side.abs().dot(world_from_model.w_axis.abs()))),
        )
    }

    /// Whether a box is certainly outside one of the planes.
    fn hide(&self, [low, high]: &[Vec3; 2]) -> bool {
        let (middle, half) = (0.5 * (*low + *high), 0.5 * (*high - *low));
        self.0.iter().any(|(plane, size)| {
            let normal = plane.truncate();
            let farthest = normal.dot(middle) + plane.w + normal.abs().dot(half);
            // Rounding errors are a few millionths of the largest number involved.
            farthest < -1e-5 * (size + normal.abs().dot(middle.abs() + half))
        })
    }
}

impl World {
    /// Creates pipelines for drawing the scene. Their first constant is the kind of material.
    pub(in crate::frame) fn by_kind(&self, make: impl Fn(u32) -> Result<Pipeline>) -> Result<ByKind> {
        Ok(ByKind(self.kinds.iter().map(|kind| make(*kind)).collect::<Result<_>>()?))
    }

    /// Number of triangles of all draws.
    pub(in crate::frame) fn triangle_count(&self) -> u64 {
        self.draws.iter().map(|item| u64::from(item.index_count / 3)).sum()
    }

    /// Whether a material has a texture.
    pub(in crate::frame) fn has_textures(&self) -> bool {
        self.kinds.iter().any(|kind| kind & ((1 << TEXTURE_COUNT) - 1) != 0)
    }

    /// Draws the scene's triangles. Bindings 0 to 14 of the shaders belong to the scene (see `lib/textures.glsl`).
    pub(in crate::frame) fn draw(
        &self,
        draw: &Draw<'_, '_>,
        by_kind: &ByKind,
        which: Which,
        clip_from_world: Mat4,
        eye: Vec4,
    ) {
        self.draw_large(draw, by_kind, (which, &[]), (clip_from_world, eye), 0.0);
    }

    /// Draws the scene's triangles without draws that are smaller in the view than `least` \[NDC, in which width and
    /// height are 2\]. `more` are the resources from binding 15 on.
    pub(in crate::frame) fn draw_large(
        &self,
        draw: &Draw<'_, '_>,
        by_kind: &ByKind,
        (which, more): (Which, &[Bind<'_>]),
        (clip_from_world, eye): (Mat4, Vec4),
        least: f32,
    ) {
        let mut bound = None;
        for (i, item) in self.draws.iter().enumerate() {
            let wanted = match which {
                Which::All => true,
                Which::Solid => !item.seen_through,
                Which::Whole => !item.seen_through && self.kinds[item.kind] & KIND_MASKED == 0,
                Which::SeenThrough => item.seen_through,
                Which::Opaque => !item.masked,
                Which::Masked => item.masked,
            };
            let instance = item.instance as usize;
            if !wanted || self.dynamic.hidden[instance] || self.shows_nothing(item, clip_from_world, least) {
                continue;
            }
            let pipeline = &by_kind.0[item.kind];
            let mut record = |first: u32, count: u32| {
                if bound.replace(item.material) != Some(item.material) {
                    self.bind_material(draw, pipeline, item.material as usize, more);
                }
                draw.push(&DrawPush {
                    clip_from_world,
                    instance: item.instance,
                    material: item.material,
                    draw: i as u32 + 1,
                    first_triangle: first / 3,
                    eye,
                });
                draw.front_is_ccw(!self.dynamic.mirrored[instance]);
                if pipeline.has_vertex_buffers() {
                    draw.vertices(&[(&self.vertices, item.vertex_offset)]);
                    draw.indices(&self.indices, item.index_offset);
                    draw.draw_indexed(count, item.first_index + first);
                } else {
                    draw.draw_from(count, first);
                }
            };
            if item.runs.is_empty() {
                record(0, item.index_count);
                continue;
            }
            // Consecutive runs that may be visible are drawn together.
            let sides = Sides::new(clip_from_world, self.dynamic.instances[instance].world_from_model);
            let mut from = None;
            for (run, bounds) in item.runs.iter().enumerate() {
                let first = run as u32 * RUN;
                match (sides.hide(bounds), from) {
                    (false, None) => from = Some(first),
                    (true, Some(begin)) => {
                        record(begin, first - begin);
                        from = None;
                    }
                    _ => {}
                }
            }
            if let Some(begin) = from {
                record(begin, item.index_count - begin);
            }
        }
    }

    /// Whether a draw is certainly outside a view, or smaller there than `least`.
    fn shows_nothing(&self, item: &DrawItem, clip_from_world: Mat4, least: f32) -> bool {
        let Some(bounds) = item.bounds else { return false };
        let clip_from_model = clip_from_world * self.dynamic.instances[item.instance as usize].world_from_model;
        let corner = |i: usize| {
            let side = |axis: usize| bounds[i >> axis & 1][axis];
            clip_from_model * Vec4::new(side(0), side(1), side(2), 1.0)
        };
        let corners: [Vec4; 8] = std::array::from_fn(corner);
        // Rounding errors are a few millionths of the largest number involved.
        let slack = 1e-5 * corners.iter().fold(0.0, |most: f32, c| most.max(c.abs().max_element()));
        let beyond = |distance: fn(Vec4) -> f32| corners.iter().all(|c| distance(*c) < -slack);
        if beyond(|c| c.w + c.x) || beyond(|c| c.w - c.x) || beyond(|c| c.w + c.y) || beyond(|c| c.w - c.y) {
            return true;
        }
        let places = corners.map(|c| c.truncate().truncate() / c.w);
        let size = places.iter().copied().fold(Vec2::NEG_INFINITY, Vec2::max)
            - places.iter().copied().fold(Vec2::INFINITY, Vec2::min);
        corners.iter().all(|c| c.w > slack) && size.max_element() < least
    }

    /// Binds the scene's resources, followed by `more`, as far as the pipeline's shaders declare them.
    fn bind_material(&self, draw: &Draw<'_, '_>, pipeline: &Pipeline, material: usize, more: &[Bind<'_>]) {
        let texture = |i: usize| {
            let (image, sampler) = self.material_textures[material][i];
            Bind::Texture(&self.textures[image], sampler)
        };
        let own = [&self.instances, &self.materials, &self.texture_slots].map(Bind::Buffer);
        // Read by vertex shaders that pull their vertices.
        let pulled = [&self.vertices, &self.indices, &self.draw_records].map(Bind::Buffer);
        const TEXTURES: usize = 3;
        const MORE: usize = TEXTURES + TEXTURE_COUNT as usize;
        const PULLED: usize = MORE + 2;
        let binding = |i: usize| match i {
            0..TEXTURES => own[i],
            TEXTURES..MORE => texture(i - TEXTURES),
            MORE..PULLED => more[i - MORE],
            _ => pulled[i - PULLED],
        };
        let mut used = [own[0]; PULLED + 3];
        let mut count = 0;
        for i in pipeline.bindings() {
            used[count] = binding(i as usize);
            count += 1;
        }
        draw.bind(pipeline, &used[..count]);
    }
}

/// Bounds of a primitive's triangles, and of its runs if it has several.
pub(super) fn bounds_of(mesh: &Mesh, primitive: &Primitive) -> ([Vec3; 2], Arc<[[Vec3; 2]]>) {
    let first = primitive.first_index as usize;
    let indices = &mesh.indices[first..first + primitive.index_count as usize];
    let none = [Vec3::INFINITY, Vec3::NEG_INFINITY];
    let runs = indices.chunks(RUN as usize).map(|run| {
        let positions = run.iter().map(|i| mesh.vertices[*i as usize].position);
        positions.fold(none, |[low, high], p| [low.min(p), high.max(p)])
    });
    let runs: Vec<_> = runs.collect();
    let all = runs.iter().fold(none, |[low, high], run| [low.min(run[0]), high.max(run[1])]);
    (all, if runs.len() > 1 { runs.into() } else { Arc::default() })
}
