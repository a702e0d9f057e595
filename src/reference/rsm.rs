//! Stage 4, extended RSM: VALs from one ray per texel of a primary light. METHOD 2, thesis 5.2.

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::light::{intensity, range_window, shine};
use super::triangle::{Hit, Triangle, nearest};
use crate::scene::{Light, LightKind};

/// A virtual area light: one RSM texel as a diffuse disc.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Val {
    /// World position of the disc's centre \[m\].
    pub position: DVec3,
    /// Area [m^2], eq. 5.10.
    pub area: f64,
    /// Unit normal on the lit side; zero where there is no VAL.
    pub normal: DVec3,
    /// Reflected flux \[lm\].
    pub flux: DVec3,
}

impl Val {
    /// A texel without light or surface: it lights nothing and has no weight.
    pub const NOTHING: Self = Self { position: DVec3::ZERO, area: 0.0, normal: DVec3::ZERO, flux: DVec3::ZERO };
}

/// Largest half angle \[rad\] of a spot's frustum: at 90 degrees it would be infinite.
pub const WIDEST_SPOT: f64 = 1.553; // 89 degrees

/// Sub-samples per texel and axis for averaging the intensity: the cone's edge cuts texels.
pub const SUB_SAMPLES: usize = 4;

/// One square image of a light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Origin of the rays \[m\]; for parallel rays the centre of their start plane.
    pub origin: DVec3,
    /// Unit direction of increasing x.
    pub right: DVec3,
    /// Unit direction of increasing y.
    pub up: DVec3,
    /// Unit direction of the projection axis.
    pub forward: DVec3,
    /// Half extents in x and y: tangents of half angles, or metres for parallel rays.
    pub half: DVec2,
    /// Whether rays are parallel.
    pub parallel: bool,
}

impl View {
    /// Ray (origin, unit direction) through a point of an `n` x `n` image, in texels from its corner.
    pub fn ray(&self, x: f64, y: f64, n: usize) -> (DVec3, DVec3) {
        let place = (DVec2::new(x, y) * 2.0 / n as f64 - 1.0) * self.half;
        let aside = place.x * self.right + place.y * self.up;
        match self.parallel {
            true => (self.origin + aside, self.forward),
            false => (self.origin, (self.forward + aside).normalize()),
        }
    }
}

/// Solid angle \[sr\] of the flat convex quadrilateral with corners `a`, `b`, `c`, `d` in order, seen from the origin:
/// two triangles by van Oosterom and Strackee (1983).
pub fn solid_angle(a: DVec3, b: DVec3, c: DVec3, d: DVec3) -> f64 {
    triangle_solid_angle(a, b, c) + triangle_solid_angle(a, c, d)
}

/// `tan(Omega/2) = |a.(b x c)| / (|a||b||c| + (a.b)|c| + (b.c)|a| + (c.a)|b|)`.
fn triangle_solid_angle(a: DVec3, b: DVec3, c: DVec3) -> f64 {
    // a.(b x c) = a.((b-a) x (c-a)); the product of short edges avoids cancellation for tiny triangles.
    let volume = a.dot((b - a).cross(c - a)).abs();
    let (la, lb, lc) = (a.length(), b.length(), c.length());
    2.0 * volume.atan2(la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb)
}

/// Solid angle \[sr\] of texel (`x`, `y`) of an `n` x `n` image with a square frustum of half angle `atan(tan_half)`.
pub fn texel_solid_angle(x: usize, y: usize, n: usize, tan_half: f64) -> f64 {
    let edge = |i: usize| (2.0 * i as f64 / n as f64 - 1.0) * tan_half;
    let corner = |i, j| DVec3::new(edge(i), edge(j), 1.0);
    solid_angle(corner(x, y), corner(x + 1, y), corner(x + 1, y + 1), corner(x, y + 1))
}

/// Area [m^2] of a texel's footprint on a plane perpendicular to the projection axis at depth `z` \[m\], eq. 5.10.
pub fn texel_area(z: f64, n: usize, tan_half: f64) -> f64 {
    (2.0 * z * tan_half / n as f64).powi(2)
}

/// The images of a light: for a spot one square frustum around its cone, for a point light the six faces of a cube (+X,
/// -X, +Y, -Y, +Z, -Z), for a directional light a parallel frustum that just contains all triangles.
pub fn views(triangles: &[Triangle], light: &Light) -> Vec<View> {
    match light.kind {
        LightKind::Spot { outer, .. } => {
            let half = DVec2::splat(f64::from(outer).min(WIDEST_SPOT).tan());
            vec![view_along(shine(light), light.position, half, false)]
        }
        LightKind::Point => [DVec3::X, -DVec3::X, DVec3::Y, -DVec3::Y, DVec3::Z, -DVec3::Z]
            .map(|axis| view_along(axis, light.position, DVec2::ONE, false))
            .to_vec(),
        LightKind::Directional => parallel_view(triangles, shine(light)).into_iter().collect(),
    }
}

fn view_along(forward: DVec3, origin: DVec3, half: DVec2, parallel: bool) -> View {
    // The cube's faces must meet at their edges: for an axis along a world axis the other two are world axes, too.
    let (right, up) = if forward.abs().max_element() == 1.0 {
        (DVec3::new(forward.z, forward.x, forward.y).abs(), DVec3::new(forward.y, forward.z, forward.x).abs())
    } else {
        forward.any_orthonormal_pair()
    };
    View { origin, right, up, forward, half, parallel }
}

fn parallel_view(triangles: &[Triangle], forward: DVec3) -> Option<View> {
    let mut view = view_along(forward, DVec3::ZERO, DVec2::ZERO, true);
    let place = |p: DVec3| DVec3::new(p.dot(view.right), p.dot(view.up), p.dot(forward));
    let corners = || triangles.iter().flat_map(|triangle| triangle.positions).map(place);
    let (low, high) = (corners().reduce(DVec3::min)?, corners().reduce(DVec3::max)?);
    let centre = 0.5 * (low + high);
    let depth = low.z - 0.5 * (high - low).length();
    view.origin = centre.x * view.right + centre.y * view.up + depth * forward;
    view.half = 0.5 * (high - low).truncate();
    Some(view)
}

/// All VALs of a light, `n` x `n` per image, images in the order of [`views`], rows by increasing y.
pub fn cast(triangles: &[Triangle], light: &Light, n: usize) -> Vec<Val> {
    views(triangles, light).iter().flat_map(|view| cast_view(triangles, light, view, n)).collect()
}

/// The VALs of one image, row by row; [`Val::NOTHING`] where there is none.
pub fn cast_view(triangles: &[Triangle], light: &Light, view: &View, n: usize) -> Vec<Val> {
    (0..n * n).into_par_iter().map(|i| cast_texel(triangles, light, view, i % n, i / n, n)).collect()
}

fn cast_texel(triangles: &[Triangle], light: &Light, view: &View, x: usize, y: usize, n: usize) -> Val {
    let (origin, direction) = view.ray(x as f64 + 0.5, y as f64 + 0.5, n);
    nearest(triangles, origin, direction).map_or(Val::NOTHING, |hit| val(light, view, [x, y], n, &hit))
}

/// The VAL of a texel whose ray ends at `hit`, or [`Val::NOTHING`] if it carries no light.
///
/// Flux `rho_d * mean(I) * Omega * window`; for parallel light `rho_d * E * A`. It does not depend on the triangle's
/// tilt, because all light that enters through the texel arrives.
pub fn val(light: &Light, view: &View, [x, y]: [usize; 2], n: usize, hit: &Hit) -> Val {
    let (origin, direction) = view.ray(x as f64 + 0.5, y as f64 + 0.5, n);
    let (area, beam) = if view.parallel {
        let area = 4.0 * view.half.x * view.half.y / (n * n) as f64;
        (area, intensity(light, direction) * area)
    } else {
        let depth = (hit.position - origin).dot(view.forward);
        let omega = texel_solid_angle(x, y, n, view.half.x);
        let beam = mean_intensity(light, view, x, y, n) * omega * range_window(hit.distance, light.range);
        (texel_area(depth, n, view.half.x), beam)
    };
    if beam == DVec3::ZERO {
        return Val::NOTHING;
    }
    Val { position: hit.position, area, normal: sending(hit.normal, hit.geometric), flux: hit.diffuse * beam }
}

/// The normal by which a lit surface sends light: its triangle's. Below .8 degrees the vertex normal counts as the same.
pub fn sending(vertex_normal: DVec3, geometric: DVec3) -> DVec3 {
    if vertex_normal.dot(geometric) < 0.9999 { geometric } else { vertex_normal }
}

/// Mean intensity \[cd\] over the texel's sub-samples.
pub(crate) fn mean_intensity(light: &Light, view: &View, x: usize, y: usize, n: usize) -> DVec3 {
    let place = |texel: usize, sub: usize| texel as f64 + (sub as f64 + 0.5) / SUB_SAMPLES as f64;
    let count = SUB_SAMPLES * SUB_SAMPLES;
    let sub_samples = (0..count).map(|i| view.ray(place(x, i % SUB_SAMPLES), place(y, i / SUB_SAMPLES), n).1);
    sub_samples.map(|direction| intensity(light, direction)).sum::<DVec3>() / count as f64
}
