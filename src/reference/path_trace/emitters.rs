//! Light sources of the path tracer: punctual lights and emitting surfaces, evaluated and sampled.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};

use super::scatter::around;
use crate::reference::gather::luminance;
use crate::reference::light::{facing_irradiance, shine};
use crate::reference::world::{Hit, Sides, Surface, World, emits};
use crate::scene::{Light, LightKind};

/// The light sources of a world.
pub(super) struct Emitters {
    punctual: Vec<Beam>,
    /// Running sums of the punctual lights' power shares; the last is 1.
    chosen: Vec<f64>,
    /// Emitting triangles: index into the world's triangles, area [m^2].
    surfaces: Vec<(usize, f64)>,
    /// Running sums of the triangles' power shares; the last is 1.
    surface_sums: Vec<f64>,
    /// Probability density [1/m^2] of a point on each triangle of the world.
    surface_density: Vec<f64>,
}

/// A punctual light and the rays that leave it.
struct Beam {
    light: Light,
    /// Unit axis.
    axis: DVec3,
    /// Density of rays by the cosine with the axis; unused by parallel light.
    cone: Cone,
    /// Centre and radius \[m\] of the perpendicular disc that parallel rays fill.
    disc: (DVec3, f64),
    /// Probability with which the light is chosen.
    share: f64,
}

impl Emitters {
    /// Collects these punctual lights and, if `surfaces`, the scene's emitting surfaces.
    pub(super) fn new<'l>(world: &World<'_>, lights: impl Iterator<Item = &'l Light>, surfaces: bool) -> Self {
        let scene = world.scene();
        let (low, high) = scene.bounds().unwrap_or_default();
        let centre = 0.5 * (low + high);
        let beam = |light: &Light| {
            let cone = match light.kind {
                LightKind::Spot { inner, outer } => Cone::new(inner.into(), outer.into()),
                _ => Cone::ALL,
            };
            let axis = if light.kind == LightKind::Point { DVec3::Z } else { shine(light) };
            let disc = (centre - 2.0 * world.radius * axis, world.radius);
            Beam { light: light.clone(), axis, cone, disc, share: 0.0 }
        };
        let mut beams: Vec<Beam> = lights.map(beam).collect();
        let powers: Vec<f64> = beams.iter().map(Beam::power).collect();
        let chosen = running_shares(&powers);
        for (i, beam) in beams.iter_mut().enumerate() {
            beam.share = chosen[i] - if i > 0 { chosen[i - 1] } else { 0.0 };
        }

        let shining: Vec<bool> = scene.materials.iter().map(|m| surfaces && emits(scene, m)).collect();
        let mut list = Vec::new();
        let mut powers = Vec::new();
        for (index, (_, [u, v], material)) in world.placed().enumerate() {
            let area = 0.5 * u.cross(v).length();
            if shining[material] && area > 0.0 {
                list.push((index, area));
                powers.push(area * luminance(scene.materials[material].emissive.as_dvec3()));
            }
        }
        let surface_sums = running_shares(&powers);
        let mut surface_density = Vec::new();
        if !list.is_empty() {
            surface_density = vec![0.0; world.placed().count()];
            let total: f64 = powers.iter().sum();
            for ((index, area), power) in list.iter().zip(&powers) {
                surface_density[*index] = power / total / area;
            }
        }
        Self { punctual: beams, chosen, surfaces: list, surface_sums, surface_density }
    }

    /// Whether any surface emits.
    pub(super) fn has_surfaces(&self) -> bool {
        !self.surfaces.is_empty()
    }

    /// Whether any punctual light has a size.
    pub(super) fn has_soft(&self) -> bool {
        self.punctual.iter().any(|beam| beam.light.radius > 0.0)
    }

    /// Reflection of the selected punctual lights at a point, `sum reflected(w_i) E_i V_i`, and the density [1/m^2]
    /// with which the lights' own rays find the point. `reflected` is BRDF times cosine [1/sr]. The light `known` to
    /// reach the point needs no shadow ray. A light with a size is tested for visibility at a sampled point, by `u`,
    /// which is uniform in the unit square; it reflects as if from its centre.
    pub(super) fn direct(
        &self,
        world: &World<'_>,
        position: DVec3,
        geometric: DVec3,
        (known, which): (Option<usize>, Which),
        u: DVec2,
        reflected: impl Fn(DVec3) -> DVec3,
    ) -> (DVec3, f64) {
        let (mut sum, mut density) = (DVec3::ZERO, 0.0);
        for (index, beam) in self.punctual.iter().enumerate() {
            let is_soft = beam.light.radius > 0.0;
            if which != Which::All && is_soft != (which == Which::Soft) {
                continue;
            }
            let (facing, towards) = facing_irradiance(&beam.light, position);
            let cosine = geometric.dot(towards);
            if facing == DVec3::ZERO || cosine <= 0.0 {
                continue;
            }
            let parallel = beam.light.kind == LightKind::Directional;
            let blocked = if known == Some(index) {
                false
            } else if is_soft {
                beam.point_is_hidden(world, position, geometric, towards, (u + 0.618 * index as f64).fract())
            } else if parallel {
                world.blocked_within(position, towards, f64::INFINITY)
            } else {
                world.blocked(position, beam.light.position)
            };
            if !blocked {
                sum += reflected(towards) * facing;
                density += beam.share * beam.density(position, cosine, -towards);
            }
        }
        (sum, density)
    }

    /// Samples a light and the first surface that one of its rays hits; `u` is uniform in the unit cube.
    pub(super) fn lit_surface(&self, world: &World<'_>, u: DVec3) -> Option<(usize, Surface)> {
        let light = choose(&self.chosen, u.z)?;
        let (origin, direction) = self.punctual[light].ray(DVec2::new(u.x, u.y));
        Some((light, world.surface(&world.nearest(origin, direction, Sides::Both)?)))
    }

    /// Samples a point on an emitting surface; returns its density [1/m^2]. `u` is uniform in the unit cube.
    pub(super) fn surface_point(&self, world: &World<'_>, u: DVec3) -> Option<(Surface, f64)> {
        let (index, _) = self.surfaces[choose(&self.surface_sums, u.z)?];
        let root = u.x.sqrt();
        let weights = DVec2::new(root * (1.0 - u.y), root * u.y);
        Some((world.front_at(index, weights), self.surface_density[index]))
    }

    /// Density [1/m^2] of a point on an emitting surface, at a ray's hit.
    pub(super) fn surface_density(&self, world: &World<'_>, hit: &Hit) -> f64 {
        self.surface_density.get(world.index(hit)).copied().unwrap_or(0.0)
    }
}

/// Selection of punctual lights.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Which {
    All,
    /// Lights without a size.
    Sharp,
    /// Lights with a size.
    Soft,
}

impl Beam {
    /// Whether a point of the light is occluded; the point lies on the disc that the light shows towards `position`.
    fn point_is_hidden(&self, world: &World<'_>, position: DVec3, geometric: DVec3, towards: DVec3, u: DVec2) -> bool {
        let (right, up) = towards.any_orthonormal_pair();
        let (y, x) = (TAU * u.y).sin_cos();
        let aside = u.x.sqrt() * (x * right + y * up);
        let radius = f64::from(self.light.radius);
        if self.light.kind == LightKind::Directional {
            let towards = (towards + radius.tan() * aside).normalize();
            return geometric.dot(towards) <= 0.0 || world.blocked_within(position, towards, f64::INFINITY);
        }
        let point = self.light.position + radius * aside;
        geometric.dot(point - position) <= 0.0 || world.blocked(position, point)
    }

    /// Emitted flux \[lm\], or flux through the disc; used only to choose lights.
    fn power(&self) -> f64 {
        let full = luminance(self.light.color.as_dvec3()) * f64::from(self.light.intensity);
        match self.light.kind {
            LightKind::Directional => full * 0.5 * TAU * self.disc.1.powi(2),
            _ => full * TAU * self.cone.total(),
        }
    }

    /// Samples a ray: origin \[m\] and unit direction, by intensity over cone, sphere or disc.
    fn ray(&self, u: DVec2) -> (DVec3, DVec3) {
        if self.light.kind == LightKind::Directional {
            let (right, up) = self.axis.any_orthonormal_pair();
            let (y, x) = (TAU * u.y).sin_cos();
            let r = self.disc.1 * u.x.sqrt();
            return (self.disc.0 + r * (x * right + y * up), self.axis);
        }
        (self.light.position, around(self.axis, self.cone.sample(u.x), u.y))
    }

    /// Density [1/m^2] of rays at a visible point whose normal makes `cosine` with the light.
    fn density(&self, position: DVec3, cosine: f64, direction: DVec3) -> f64 {
        if self.light.kind == LightKind::Directional {
            return cosine / (0.5 * TAU * self.disc.1.powi(2));
        }
        let falloff = self.cone.falloff(self.axis.dot(direction));
        falloff / (TAU * self.cone.total()) * cosine / self.light.position.distance_squared(position)
    }
}

/// A spot's falloff over the cosine with its axis: 0 up to `least`, a squared ramp of `width`, 1 from `full` on.
struct Cone {
    least: f64,
    full: f64,
    width: f64,
}

impl Cone {
    /// Uniform in all directions.
    const ALL: Self = Self { least: -1.0, full: -1.0, width: 1e-9 };

    /// The cone between these half angles \[rad\]; see [`crate::reference::light::spot_falloff`].
    fn new(inner: f64, outer: f64) -> Self {
        let (least, width) = (outer.cos(), (inner.cos() - outer.cos()).max(0.001));
        Self { least, full: (least + width).min(1.0), width }
    }

    fn falloff(&self, cosine: f64) -> f64 {
        ((cosine - self.least) / self.width).clamp(0.0, 1.0).powi(2)
    }

    /// Integral of the falloff over the ramp.
    fn ramp(&self) -> f64 {
        (self.full - self.least).powi(3) / (3.0 * self.width * self.width)
    }

    /// Integral of the falloff over all cosines.
    fn total(&self) -> f64 {
        self.ramp() + 1.0 - self.full
    }

    /// Samples a cosine with the falloff as density; `u` is uniform in [0, 1).
    fn sample(&self, u: f64) -> f64 {
        // Counted from the axis outwards: u = 0 is on the axis.
        let from_edge = (1.0 - u) * self.total();
        if from_edge < self.ramp() {
            self.least + (3.0 * self.width * self.width * from_edge).cbrt()
        } else {
            self.full + from_edge - self.ramp()
        }
    }
}

/// Running sums of each power's share of the total; all 0 if the total is 0.
pub(super) fn running_shares(powers: &[f64]) -> Vec<f64> {
    let total: f64 = powers.iter().sum();
    if total <= 0.0 {
        return vec![0.0; powers.len()];
    }
    let mut sum = 0.0;
    powers
        .iter()
        .map(|power| {
            sum += power / total;
            sum
        })
        .collect()
}

/// The index whose share `u` in [0, 1) falls into.
pub(super) fn choose(sums: &[f64], u: f64) -> Option<usize> {
    let last = *sums.last()?;
    (last > 0.0).then(|| sums.partition_point(|sum| *sum <= u * last))
}
