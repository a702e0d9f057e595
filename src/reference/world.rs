//! A scene's triangles in the world, and ray queries: nearest hit, any hit, all hits. The BVH's boxes are f32,
//! triangles f64.

use glam::{DMat3, DVec2, DVec3, Vec2, Vec3A, Vec4};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::cwbvh::{CwBvh, builder::build_cwbvh};
use obvhs::ray::{Ray, RayHit};
use rayon::prelude::*;

use crate::scene::material::Reflectance;
use crate::scene::{Material, Mesh, Scene, Vertex};

/// Margin of boxes around their triangles as a share of the scene's radius: covers the f32 rounding of rays.
const BOX_MARGIN: f64 = 1e-6;

/// Hits nearer than this share of the scene's radius are ignored: positions in files are f32, so that neighbours in one
/// plane are not exactly coplanar.
const NEAREST: f64 = 1e-6;

/// Distance behind its origin at which a ray against the boxes starts, as a share of the scene's radius: the traversal
/// ignores boxes that end within 1e-4 of its start.
const BEHIND: f64 = 2e-4;

/// A scene prepared for ray queries.
pub struct World<'a> {
    scene: &'a Scene,
    /// Centre of the scene's bounds \[m\]; internal positions are relative to it.
    centre: DVec3,
    /// Half the diagonal of the bounds \[m\]; 1 for a scene without extent.
    pub radius: f64,
    triangles: Vec<WorldTriangle>,
    /// Normal matrix (model to world) of each instance.
    normal_matrices: Vec<DMat3>,
    /// `None` for a scene without triangles.
    hierarchy: Option<CwBvh>,
}

/// A triangle in the world, relative to the centre.
struct WorldTriangle {
    corner: DVec3,
    edges: [DVec3; 2],
    instance: u32,
    /// Index in its mesh.
    triangle: u32,
    material: u32,
    /// 1, or -1 if the instance mirrors, which flips the winding.
    side: f64,
}

/// Sides of surfaces that a ray hits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sides {
    /// Front sides as seen from the origin, including transparent surfaces: for camera rays.
    Front,
    /// Both sides: for light. Of a double-sided material's two triangles, the one that faces the origin.
    Both,
    /// Both sides, ignoring alpha masks: for light inside a body.
    Any,
    /// Front sides, but of this material the back sides: for camera rays inside a body of glass. If the material is
    /// double-sided, both.
    Within(usize),
}

/// A ray's hit on a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance along the ray \[m\].
    pub distance: f64,
    /// Index into the scene's instances.
    pub instance: usize,
    /// Triangle of the instance's mesh.
    pub triangle: usize,
    /// Index into the scene's materials.
    pub material: usize,
    /// Barycentric weights of the second and third corner.
    pub weights: DVec2,
    /// Whether the ray comes from the front side by the winding.
    pub front: bool,
    /// Index into the world's triangles.
    index: u32,
}

/// A point of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// World position \[m\].
    pub position: DVec3,
    /// Unit normal of the triangle on the side that the ray came from.
    pub geometric: DVec3,
    /// Unit interpolated vertex normal on that side.
    pub vertex_normal: DVec3,
    /// The same, perturbed by the normal map.
    pub normal: DVec3,
    /// Reflectance.
    pub reflection: Reflectance,
    /// Emitted radiance [cd/m^2] on the front; zero on the back.
    pub emission: DVec3,
    /// Instance and material of the scattering medium below, if any.
    pub inside: Option<(usize, usize)>,
}

impl Surface {
    /// The same point seen from the other side.
    pub fn turned(self) -> Self {
        let Self { geometric, vertex_normal, normal, .. } = self;
        Self { geometric: -geometric, vertex_normal: -vertex_normal, normal: -normal, ..self }
    }
}

impl<'a> World<'a> {
    /// Places all triangles and builds the BVH, on all cores.
    pub fn new(scene: &'a Scene) -> Self {
        let (low, high) = scene.bounds().unwrap_or_default();
        let centre = 0.5 * (low + high);
        let radius = Some(0.5 * (high - low).length()).filter(|r| *r > 0.0).unwrap_or(1.0);
        let placed = |(index, instance): (usize, &crate::scene::Instance)| {
            let mesh = &scene.meshes[instance.mesh];
            let place = instance.world_from_model;
            let side = if place.matrix3.determinant() < 0.0 { -1.0 } else { 1.0 };
            let materials = mesh.triangle_materials();
            let triangle = move |(t, material): (usize, usize)| {
                let corner = |v: usize| place.transform_point3(mesh.vertices[v].position.as_dvec3()) - centre;
                let [a, b, c] = mesh.triangle(t).map(corner);
                WorldTriangle {
                    corner: a,
                    edges: [b - a, c - a],
                    instance: index as u32,
                    triangle: t as u32,
                    material: material as u32,
                    side,
                }
            };
            materials.into_iter().enumerate().map(triangle).collect::<Vec<_>>()
        };
        let triangles: Vec<WorldTriangle> = scene.instances.par_iter().enumerate().flat_map_iter(placed).collect();
        let boxes: Vec<Aabb> = triangles
            .par_iter()
            .map(|t| {
                let corners = [t.corner, t.corner + t.edges[0], t.corner + t.edges[1]].map(|p| p / radius);
                let low = corners[0].min(corners[1]).min(corners[2]) - BOX_MARGIN;
                let high = corners[0].max(corners[1]).max(corners[2]) + BOX_MARGIN;
                Aabb::new(low.as_vec3a(), high.as_vec3a())
            })
            .collect();
        let build = || build_cwbvh(&boxes, BvhBuildParams::medium_build(), &mut std::time::Duration::default());
        let hierarchy = (!boxes.is_empty()).then(build);
        let normal_matrices =
            scene.instances.iter().map(|i| i.world_from_model.matrix3.inverse().transpose()).collect();
        Self { scene, centre, radius, triangles, normal_matrices, hierarchy }
    }

    /// The placed scene.
    pub fn scene(&self) -> &'a Scene {
        self.scene
    }

    /// First hit of the ray from `origin` \[m\] in the unit `direction`.
    pub fn nearest(&self, origin: DVec3, direction: DVec3, sides: Sides) -> Option<Hit> {
        let hierarchy = self.hierarchy.as_ref()?;
        let local = origin - self.centre;
        let mut best: Option<Hit> = None;
        let mut unused = RayHit::none();
        let (ray, start) = self.ray(local, direction, f64::INFINITY);
        hierarchy.ray_traverse(ray, &mut unused, |_, slot| {
            let index = hierarchy.primitive_indices[slot];
            match self.meet(index, local, direction, sides) {
                Some(hit) if best.is_none_or(|b| hit.distance < b.distance) => {
                    best = Some(hit);
                    // Rounded up, so that slightly nearer hits are still tested.
                    ((hit.distance / self.radius - start) as f32) * (1.0 + 1e-6)
                }
                _ => f32::INFINITY,
            }
        });
        best
    }

    /// Calls `met` for every hit of the ray from `origin` \[m\] in the unit `direction`, in no particular order.
    pub fn all(&self, origin: DVec3, direction: DVec3, mut met: impl FnMut(Hit)) {
        let Some(hierarchy) = &self.hierarchy else { return };
        let local = origin - self.centre;
        let (ray, _) = self.ray(local, direction, f64::INFINITY);
        hierarchy.ray_traverse_anyhit(ray, |_, slot| {
            if let Some(hit) = self.meet(hierarchy.primitive_indices[slot], local, direction, Sides::Both) {
                met(hit);
            }
        });
    }

    /// Whether anything lies between two points \[m\], excluding both ends.
    pub fn blocked(&self, from: DVec3, to: DVec3) -> bool {
        let distance = from.distance(to);
        distance > 0.0 && self.blocked_within(from, (to - from) / distance, distance - NEAREST * self.radius)
    }

    /// Whether a ray hits anything nearer than `distance` \[m\], which may be infinite.
    pub fn blocked_within(&self, origin: DVec3, direction: DVec3, distance: f64) -> bool {
        let Some(hierarchy) = &self.hierarchy else { return false };
        if distance <= 0.0 {
            return false;
        }
        let local = origin - self.centre;
        let (ray, _) = self.ray(local, direction, distance);
        !hierarchy.ray_traverse_miss(ray, |_, slot| {
            let hit = self.meet(hierarchy.primitive_indices[slot], local, direction, Sides::Both);
            if hit.is_some_and(|hit| hit.distance < distance) { 0.0 } else { f32::INFINITY }
        })
    }

    /// A ray against the boxes up to `distance` \[m\], and its start on the original ray, both in scene radii.
    fn ray(&self, local: DVec3, direction: DVec3, distance: f64) -> (Ray, f64) {
        // From far away f32 would miss the boxes: start where the ray enters the scene's bounding sphere.
        let place = local / self.radius;
        let start = (-place.dot(direction) - 1.0).max(0.0) - BEHIND;
        // The traversal misses everything for directions with a negative zero; adding 0 makes it positive.
        let unit = |v: DVec3| Vec3A::from(v.as_vec3()) + Vec3A::ZERO;
        let farthest = (distance / self.radius - start).min(f64::from(f32::MAX)) as f32;
        (Ray::new(unit(place + start * direction), unit(direction), 0.0, farthest), start)
    }

    /// Intersection by Moeller and Trumbore; respects sides and alpha masks.
    fn meet(&self, index: u32, local: DVec3, direction: DVec3, sides: Sides) -> Option<Hit> {
        // A ray through a shared edge must hit one of the two triangles: edges overlap by this share of a triangle.
        const OVERLAP: f64 = 1e-12;
        let triangle = &self.triangles[index as usize];
        let [u, v] = triangle.edges;
        let p = direction.cross(v);
        let determinant = u.dot(p);
        let inverse = 1.0 / determinant;
        let offset = local - triangle.corner;
        let second = offset.dot(p) * inverse;
        // Also fails for NaN and infinity: a triangle seen edge-on or without area.
        if !(-OVERLAP..=1.0 + OVERLAP).contains(&second) {
            return None;
        }
        let q = offset.cross(u);
        let third = direction.dot(q) * inverse;
        let distance = v.dot(q) * inverse;
        if !(third >= -OVERLAP && second + third <= 1.0 + OVERLAP && distance > NEAREST * self.radius) {
            return None;
        }
        let front = determinant * triangle.side > 0.0;
        let material = &self.scene.materials[triangle.material as usize];
        let is_own = sides == Sides::Within(triangle.material as usize);
        let shown = match sides {
            _ if material.double_sided => front,
            Sides::Front | Sides::Within(_) => front != is_own,
            Sides::Both | Sides::Any => true,
        };
        if !shown {
            return None;
        }
        let hit = Hit {
            distance,
            instance: triangle.instance as usize,
            triangle: triangle.triangle as usize,
            material: triangle.material as usize,
            weights: DVec2::new(second, third),
            front,
            index,
        };
        let cutoff = match sides {
            Sides::Front | Sides::Within(_) => material.seen_cutoff(),
            Sides::Both => material.alpha_cutoff,
            Sides::Any => None,
        };
        if let Some(cutoff) = cutoff {
            let [a, b, c] = self.corners(&hit);
            let (uv, color) = interpolated(&hit, a, b, c);
            let texture = material.base_color_texture.map_or(1.0, |t| t.sample(self.scene, uv, true).w);
            if material.base_color.w * color.w * texture < cutoff {
                return None;
            }
        }
        Some(hit)
    }

    fn mesh(&self, hit: &Hit) -> &'a Mesh {
        &self.scene.meshes[self.scene.instances[hit.instance].mesh]
    }

    fn corners(&self, hit: &Hit) -> [&'a Vertex; 3] {
        let mesh = self.mesh(hit);
        mesh.triangle(hit.triangle).map(|v| &mesh.vertices[v])
    }

    /// For a transparent hit: the share of the surface's own light along the unit `direction`, by channel the share of
    /// light from behind it, and whether it bends light. `None` if opaque.
    pub fn seen_through(&self, hit: &Hit, surface: &Surface, direction: DVec3) -> Option<(f64, DVec3, bool)> {
        let material = &self.scene.materials[hit.material];
        if !material.is_seen_through() {
            return None;
        }
        let [a, b, c] = self.corners(hit);
        let (uv, color) = interpolated(hit, a, b, c);
        let (alpha, behind) = material.seen_through(self.scene, uv, color, -surface.normal.dot(direction));
        Some((alpha.into(), behind.as_dvec3(), material.bends_light(self.scene, uv)))
    }

    /// The surface at a hit.
    pub fn surface(&self, hit: &Hit) -> Surface {
        let triangle = &self.triangles[hit.index as usize];
        let [a, b, c] = self.corners(hit);
        let (second, third) = (hit.weights.x, hit.weights.y);
        let position = self.centre + triangle.corner + second * triangle.edges[0] + third * triangle.edges[1];
        let facing = if hit.front { 1.0 } else { -1.0 };
        let winding = triangle.edges[0].cross(triangle.edges[1]) * triangle.side;
        let geometric = facing * winding.normalize_or_zero();

        let model_normal =
            (1.0 - second - third) * a.normal.as_dvec3() + second * b.normal.as_dvec3() + third * c.normal.as_dvec3();
        let own_normal =
            (self.normal_matrices[hit.instance] * model_normal).try_normalize().unwrap_or(facing * geometric);

        let material = &self.scene.materials[hit.material];
        let (uv, color) = interpolated(hit, a, b, c);
        let mut normal = own_normal;
        if let Some(texture) = material.normal_texture {
            let texel = texture.sample(self.scene, uv, false).truncate().as_dvec3() * 2.0 - 1.0;
            let scale = f64::from(material.normal_scale);
            let tilt = DVec3::new(texel.x * scale, texel.y * scale, texel.z);
            let tangent = Vec4::from(a.tangent) * (1.0 - second - third) as f32
                + Vec4::from(b.tangent) * second as f32
                + Vec4::from(c.tangent) * third as f32;
            let frame = if tangent.truncate().length_squared() > 0.0 && texture.uv_set == 0 {
                let place = self.scene.instances[hit.instance].world_from_model.matrix3;
                let across = place * tangent.truncate().as_dvec3();
                let across = (across - own_normal * own_normal.dot(across)).normalize_or_zero();
                Some((across, own_normal.cross(across) * f64::from(tangent.w) * triangle.side))
            } else {
                let set = |v: &Vertex| {
                    texture.transform.transform_vector2(if texture.uv_set == 0 { v.uv0 } else { v.uv1 }).as_dvec2()
                };
                let [tx, ty] = [set(b) - set(a), set(c) - set(a)];
                derived_frame(own_normal, triangle.edges, [tx, ty], tangent.w < 0.0)
            };
            if let Some((across, along)) = frame {
                let tilted = across * tilt.x + along * tilt.y + own_normal * tilt.z;
                normal = tilted.try_normalize().unwrap_or(own_normal);
            }
        }
        let emitted = material.emissive_texture.map_or(Vec4::ONE, |t| t.sample(self.scene, uv, true)).truncate();
        Surface {
            position,
            geometric,
            vertex_normal: facing * own_normal,
            normal: facing * normal,
            reflection: material.reflectance(self.scene, uv, color),
            inside: material.subsurface.map(|_| (hit.instance, hit.material)),
            emission: if hit.front { (material.emissive * emitted).as_dvec3() } else { DVec3::ZERO },
        }
    }

    /// Corner \[m\], edges \[m\] and material of every triangle in the world.
    pub(crate) fn placed(&self) -> impl Iterator<Item = (DVec3, [DVec3; 2], usize)> + '_ {
        self.triangles.iter().map(|t| (t.corner + self.centre, t.edges, t.material as usize))
    }

    /// Index of a hit's triangle in [`Self::placed`].
    pub(crate) fn index(&self, hit: &Hit) -> usize {
        hit.index as usize
    }

    /// The front surface at a point of a triangle of [`Self::placed`].
    pub(crate) fn front_at(&self, index: usize, weights: DVec2) -> Surface {
        let t = &self.triangles[index];
        self.surface(&Hit {
            distance: 0.0,
            instance: t.instance as usize,
            triangle: t.triangle as usize,
            material: t.material as usize,
            weights,
            front: true,
            index: index as u32,
        })
    }
}

/// Texture coordinates and vertex colour at a hit.
fn interpolated(hit: &Hit, a: &Vertex, b: &Vertex, c: &Vertex) -> ([Vec2; 2], Vec4) {
    let (second, third) = (hit.weights.x as f32, hit.weights.y as f32);
    let first = 1.0 - second - third;
    let color = |v: &Vertex| Vec4::from(v.color.map(|c| f32::from(c) / 255.0));
    (
        [a.uv0 * first + b.uv0 * second + c.uv0 * third, a.uv1 * first + b.uv1 * second + c.uv1 * third],
        color(a) * first + color(b) * second + color(c) * third,
    )
}

/// Tangent and bitangent of a triangle whose file has none, from how texture coordinates change along its edges. glTF's
/// v runs down the image, its bitangent up. On a back side the whole frame is flipped, as the normal is.
fn derived_frame(n: DVec3, edges: [DVec3; 2], uv: [DVec2; 2], second_side: bool) -> Option<(DVec3, DVec3)> {
    let a = edges[1].cross(n);
    let b = n.cross(edges[0]);
    let side = if (n.dot(edges[0].cross(edges[1])) < 0.0) != second_side { -1.0 } else { 1.0 };
    let across = side * (a * uv[0].x + b * uv[1].x);
    let along = -side * (a * uv[0].y + b * uv[1].y);
    let size = across.length_squared().max(along.length_squared());
    (size > 0.0).then(|| (across / size.sqrt(), along / size.sqrt()))
}

/// Whether a material can emit at all.
pub(crate) fn emits(scene: &Scene, material: &Material) -> bool {
    material.emission(scene).is_some()
}
