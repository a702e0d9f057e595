//! VALs by rays (stage 4): the device's own light views, one ray per texel, VALs as in `reference::rsm`. METHOD 2.

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use crate::frame::world::lights;
use crate::reference::light::{intensity, range_window};
use crate::reference::rsm::{Val, View, mean_intensity, sending, texel_area, texel_solid_angle};
use crate::reference::world::{Sides, World};
use crate::scene::{Light, LightKind};

/// A VAL and its piece of surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Texel {
    /// The disc, with the area perpendicular to the light's axis (5.10).
    pub val: Val,
    /// Edges \[m\] of the parallelogram that the texel covers on the plane through the disc, to first order in its
    /// size.
    pub edges: [DVec3; 2],
}

/// Lower bound of the cosine between surface and light ray for the footprint, which is infinite at 0.
const GRAZING: f64 = 1e-3;

impl Texel {
    /// Area [m^2] of the footprint on the tilted surface.
    pub fn footprint(&self) -> f64 {
        self.edges[0].cross(self.edges[1]).length()
    }

    /// Corners of the footprint, in order.
    pub fn corners(&self) -> [DVec3; 4] {
        let [u, v] = self.edges.map(|edge| 0.5 * edge);
        let centre = self.val.position;
        [centre - u - v, centre + u - v, centre + u + v, centre - u + v]
    }
}

/// The device's views from each of a scene's lights, and their RSM sides \[texels\] if the settings ask for `n`.
pub fn views<'a>(world: &World<'a>, n: u32) -> Vec<(&'a Light, View, usize)> {
    let scene = world.scene();
    let Some((low, high)) = scene.bounds() else { return Vec::new() };
    let origin = 0.5 * (low + high);
    let half = (0.5 * (high - low)).max(DVec3::splat(1e-6 * world.radius));
    let (infos, _, views) = lights::prepare(&scene.lights, origin, half);
    let mut all = Vec::new();
    for (light, info) in scene.lights.iter().zip(infos) {
        for view in &views[info.first_view as usize..(info.first_view + info.views) as usize] {
            let (right, up, forward) = (view.right.as_dvec3(), view.up.as_dvec3(), view.forward.as_dvec3().normalize());
            let parallel = light.kind == LightKind::Directional;
            let view = View {
                origin: if parallel { origin - 2.0 * world.radius * forward } else { light.position },
                right: right.normalize(),
                up: up.normalize(),
                forward,
                half: DVec2::new(right.length(), up.length()),
                parallel,
            };
            all.push((light, view, info.rsm_size(n) as usize));
        }
    }
    all
}

/// All VALs with light, from RSMs with `n` texels per side.
pub fn cast(world: &World<'_>, n: u32) -> Vec<Texel> {
    views(world, n).iter().flat_map(|(light, view, n)| cast_view(world, light, view, *n)).flatten().collect()
}

/// Texels of one view, row by row by increasing y; `None` if there is no VAL or it is black.
pub fn cast_view(world: &World<'_>, light: &Light, view: &View, n: usize) -> Vec<Option<Texel>> {
    (0..n * n).into_par_iter().map(|i| cast_texel(world, light, view, i % n, i / n, n)).collect()
}

fn cast_texel(world: &World<'_>, light: &Light, view: &View, x: usize, y: usize, n: usize) -> Option<Texel> {
    let (origin, direction) = view.ray(x as f64 + 0.5, y as f64 + 0.5, n);
    let hit = world.nearest(origin, direction, Sides::Both)?;
    let surface = world.surface(&hit);
    let (depth, area, beam) = if view.parallel {
        let area = 4.0 * view.half.x * view.half.y / (n * n) as f64;
        (1.0, area, intensity(light, direction) * area)
    } else {
        let depth = hit.distance * direction.dot(view.forward);
        let omega = texel_solid_angle(x, y, n, view.half.x);
        let beam = mean_intensity(light, view, x, y, n) * omega * range_window(hit.distance, light.range);
        (depth, texel_area(depth, n, view.half.x), beam)
    };
    let normal = sending(surface.vertex_normal, surface.geometric);
    let flux = surface.reflection.sent_on().as_dvec3() * beam;
    // The ray scaled to depth 1: gives the motion of its hit on the tilted plane with the texel.
    let ray = direction / direction.dot(view.forward);
    let slope = (-normal.dot(ray)).max(GRAZING);
    let edge = |axis: DVec3, half: f64| 2.0 * half / n as f64 * depth * (axis + ray * (normal.dot(axis) / slope));
    let val = Val { position: surface.position, area, normal, flux };
    let edges = [edge(view.right, view.half.x), edge(view.up, view.half.y)];
    (flux != DVec3::ZERO).then_some(Texel { val, edges })
}
