//! A stage for files without one: soft studio light, a daylight sky, a ground, and the backdrop.

use super::build::{add_material, add_mesh, patch, phong, place};
use super::sky::Sky;
use super::{LightKind, Scene, luminance};
use glam::{DAffine3, DVec3, Vec3};
use std::borrow::Cow;
use std::f64::consts::PI;

/// What is shown where there is no surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Backdrop {
    /// The sky's radiance with its sun; nothing without a sky.
    #[default]
    Sky,
    /// Below the horizon the radiance of an unshadowed ground, fading to half above it.
    Studio,
    /// Nothing.
    Nothing,
}

/// Number of directional lights for the skies added here.
pub(super) const LIGHTS: usize = 16;

/// Diffuse albedo of the ground.
pub const GROUND_ALBEDO: f32 = 0.4;

/// Radius of the ground, in radii of the scene on it.
const GROUND_RADIUS: f64 = 2.5;

/// Points of the ground's mesh along each side of its grid.
const GROUND_POINTS: usize = 25;

/// Radius of the ground's middle, where caches are densest, as a share of its radius.
const GROUND_MIDDLE: f32 = 0.3;

/// Largest share of cache area that the ground may take, relative to the area of the other surfaces.
const GROUND_SHARE: f64 = 0.3;

/// Columns and rows of the grids made here.
const GRID: [u32; 2] = [128, 64];

/// A studio light: its direction relative to the viewer's, to the left and up [degrees], the width of its soft edge
/// [degrees], and its radiance at the centre, relative to the brightest light.
struct Softbox {
    left: f64,
    up: f64,
    width: f64,
    radiance: f64,
}

const SOFTBOXES: [Softbox; 3] = [
    Softbox { left: 38.0, up: 40.0, width: 22.0, radiance: 1.0 }, // key
    Softbox { left: -55.0, up: 25.0, width: 35.0, radiance: 0.2 }, // fill
    Softbox { left: 160.0, up: 40.0, width: 25.0, radiance: 0.15 }, // edges
];

/// Radiance of the rest of the upper hemisphere, of the glow at the horizon, and of the lower hemisphere without a
/// ground.
const REST: f64 = 0.045;
const GLOW: f64 = 0.05;
const BELOW: f64 = 0.03;

impl Sky {
    /// A studio sky: a large soft key light, above and to the left of a viewer in the horizontal direction `viewer`, a
    /// weaker fill light to the right, a dim rest, and a glow at the horizon. An unshadowed white surface that faces
    /// straight up has a radiance of 1 cd/m^2 (`pi` lx). With a ground, no light comes from below.
    pub fn studio(viewer: DVec3, grounded: bool) -> Self {
        let viewer = DVec3::new(viewer.x, 0.0, viewer.z).try_normalize().unwrap_or(DVec3::Z);
        // Left as seen by the viewer, who looks towards the scene.
        let left = -DVec3::Y.cross(viewer);
        let towards = |softbox: &Softbox| {
            let (side, up) = (softbox.left.to_radians(), softbox.up.to_radians());
            up.cos() * (side.cos() * viewer + side.sin() * left) + up.sin() * DVec3::Y
        };
        let softboxes = SOFTBOXES.map(|softbox| (towards(&softbox), softbox.width.to_radians(), softbox.radiance));
        let radiance = |direction: DVec3| {
            if direction.y < 0.0 {
                return if grounded { 0.0 } else { BELOW };
            }
            let soft = |&(towards, width, radiance): &(DVec3, f64, f64)| {
                radiance * (-0.5 * (direction.angle_between(towards) / width).powi(2)).exp()
            };
            softboxes.iter().map(soft).sum::<f64>() + REST + GLOW * (-(direction.y / 0.2).powi(2)).exp()
        };
        let sky = Self::of(|direction| Vec3::splat(radiance(direction) as f32));
        let up = sky.received(DVec3::Y).x;
        Self::of(|direction| Vec3::splat((PI / up * radiance(direction)) as f32))
    }

    /// Fills the lower hemisphere with the radiance of an unshadowed ground under this sky.
    pub(super) fn continue_ground(&mut self) {
        let ground = self.received(DVec3::Y).as_vec3() * (GROUND_ALBEDO / std::f32::consts::PI);
        let below = self.texels.len() / 2;
        self.texels[below..].fill(ground);
    }

    /// A daylight sky over dark ground, without its sun, which is a separate light: 15 000 lx from above.
    pub fn day() -> Self {
        let radiance = |direction: DVec3| {
            let horizon = (-4.0 * direction.y.max(0.0)).exp();
            if direction.y < 0.0 { DVec3::splat(0.1) } else { DVec3::new(0.45, 0.65, 1.0).lerp(DVec3::ONE, horizon) }
        };
        let sky = Self::of(|direction| radiance(direction).as_vec3());
        let scale = 15_000.0 / sky.received(DVec3::Y).y;
        Self::of(|direction| (scale * radiance(direction)).as_vec3())
    }

    /// A clear sky over dark ground, with `illuminance` \[lx\] on level ground. Excludes the sun in the unit direction
    /// `sun`, which is a separate light. The luminance is that of ISO 15469, type 12, paler at the horizon and around
    /// the sun.
    pub fn clear(sun: DVec3, illuminance: f64) -> Self {
        let gradation = |height: f64| 1.0 - (-0.32 / height.max(0.01)).exp();
        let scattered = |angle: f64| {
            let peak = 10.0 * ((-3.0 * angle).exp() - (-1.5 * PI).exp());
            1.0 + peak + 0.45 * angle.cos().powi(2)
        };
        let radiance = |direction: DVec3| {
            if direction.y < 0.0 {
                return DVec3::splat(0.05);
            }
            let angle = direction.angle_between(sun);
            let pale = (0.75 * (-5.0 * direction.y).exp() + 0.8 * (-4.0 * angle).exp()).min(1.0);
            let color = DVec3::new(0.42, 0.68, 1.25).lerp(DVec3::new(0.93, 0.98, 1.06), pale);
            color * gradation(direction.y) * scattered(angle) * (luminance(DVec3::ONE) / luminance(color))
        };
        let sky = Self::of(|direction| radiance(direction).as_vec3());
        let scale = illuminance / luminance(sky.received(DVec3::Y));
        Self::of(|direction| (scale * radiance(direction)).as_vec3())
    }

    /// A grid of the radiance [cd/m^2] in each direction.
    fn of(radiance: impl Fn(DVec3) -> Vec3) -> Self {
        let [width, height] = GRID;
        let mut sky = Self::new(width, height, std::iter::repeat_n(Vec3::ZERO, (width * height) as usize), 0.0);
        sky.texels = (0..(width * height) as usize)
            .map(|texel| radiance(sky.direction(texel % width as usize, texel / width as usize)))
            .collect();
        sky
    }

    /// Illuminance \[lx\] of an unshadowed plane with this unit normal.
    pub fn received(&self, normal: DVec3) -> DVec3 {
        let texel = |index: usize| {
            let (column, row) = (index % self.width as usize, index / self.width as usize);
            let cosine = self.direction(column, row).dot(normal).max(0.0);
            cosine * self.solid_angle(row) * self.texels[index].as_dvec3()
        };
        (0..self.texels.len()).map(texel).sum()
    }
}

impl Scene {
    /// The radiance grid of the backdrop, if there is one.
    pub fn behind(&self) -> Option<Cow<'_, Sky>> {
        match self.backdrop {
            Backdrop::Sky => self.sky.as_ref().map(Sky::as_shown),
            Backdrop::Studio => Some(Cow::Owned(quiet(self.ground_radiance()))),
            Backdrop::Nothing => None,
        }
    }

    /// Whether the scene has a visible backdrop.
    pub(crate) fn has_backdrop(&self) -> bool {
        match self.backdrop {
            Backdrop::Sky => self.sky.is_some(),
            Backdrop::Studio => true,
            Backdrop::Nothing => false,
        }
    }

    /// Radiance [cd/m^2] of an unshadowed ground under the scene's sky and parallel lights. Without either, the other
    /// lights illuminate it from their distance to the scene's centre.
    fn ground_radiance(&self) -> Vec3 {
        let (low, high) = self.bounds().unwrap_or_default();
        let (centre, radius) = (0.5 * (low + high), 0.5 * low.distance(high));
        let is_parallel = |light: &&super::Light| light.kind == LightKind::Directional;
        let of_sky = self.sky.as_ref().map_or(0..0, |sky| sky.lights.clone());
        let lamps = || self.lights.iter().enumerate().filter(|(i, _)| !of_sky.contains(i)).map(|(_, light)| light);
        let parallel = lamps().filter(is_parallel).map(|l| l.color * l.intensity * (-l.direction.y).max(0.0));
        let mut light = parallel.sum::<Vec3>();
        light += self.sky.as_ref().map_or(Vec3::ZERO, |sky| sky.received(DVec3::Y).as_vec3());
        if light == Vec3::ZERO {
            let near = |l: &super::Light| l.position.distance_squared(centre).max(0.01 * radius * radius).max(1e-12);
            let others = lamps().filter(|light| !is_parallel(light));
            light = others.map(|l| l.color * (f64::from(l.intensity) / near(l)) as f32).sum();
        }
        light * (GROUND_ALBEDO / std::f32::consts::PI)
    }
}

/// The studio's backdrop: uniform below the horizon, falling to half above it.
fn quiet(ground: Vec3) -> Sky {
    Sky::of(|direction| {
        let up = (direction.y.max(0.0) as f32 / 0.8).min(1.0);
        ground * (1.0 - 0.5 * up * up * (3.0 - 2.0 * up))
    })
}

/// Maps the square from -1 to 1 to the unit disc: rings of squares to rings (Shirley and Chiu 1997). Triangles of a grid
/// stay compact everywhere, as interpolation along them needs.
fn on_disc(x: f32, z: f32) -> Vec3 {
    let radius = x.abs().max(z.abs());
    let octant = std::f32::consts::FRAC_PI_4;
    let (sine, cosine) = if radius == 0.0 {
        (0.0, 0.0)
    } else if x.abs() >= z.abs() {
        let (sine, cosine) = (octant * z / x).sin_cos();
        (sine * x.signum(), cosine * x.signum())
    } else {
        let (cosine, sine) = (octant * x / z).sin_cos();
        (sine * z.signum(), cosine * z.signum())
    };
    radius * Vec3::new(cosine, 0.0, sine)
}

/// Radius at which caches are placed for a radius of the ground, both as shares of the ground's. Outside the middle
/// their distance grows as the radius^1.5.
fn placing_radius(radius: f32) -> f32 {
    let middle = GROUND_MIDDLE;
    if radius <= middle { radius } else { middle * (3.0 - 2.0 * (middle / radius).sqrt()) }
}

/// Adds a ground under a scene with the given centre, radius and height \[m\]: a disc that faces up. Its caches are
/// dense near the scene, where it casts shadows, and may be farther apart than others, so that it takes few of them.
pub(super) fn put_ground(scene: &mut Scene, middle: DVec3, radius: f64, height: f64) {
    let area = super::tessellate::area(scene);
    let reach = GROUND_RADIUS * radius;
    let disc = patch([GROUND_POINTS; 2], [false; 2], |column, row| {
        let [z, x] = [column, row].map(|i| 2.0 * i as f32 / (GROUND_POINTS - 1) as f32 - 1.0);
        (on_disc(x, z), Vec3::Y)
    });
    let material = add_material(scene, phong("ground", [GROUND_ALBEDO; 3], [0.0; 3], 1.0));
    let mesh = add_mesh(scene, "ground", vec![(disc, material)]);
    let at = DVec3::new(middle.x, height, middle.z);
    place(
        scene,
        "ground",
        mesh,
        DAffine3::from_scale_rotation_translation(DVec3::splat(reach), Default::default(), at),
    );
    if area > 0.0 && PI * reach * reach > GROUND_SHARE * area {
        let full = f64::from(placing_radius(1.0)) * reach;
        let scale = (GROUND_SHARE * area / PI).sqrt() / full;
        let placed = |at: Vec3| at * (placing_radius(at.length()) / at.length().max(1e-6)) * scale.min(1.0) as f32;
        let mesh = &mut scene.meshes[mesh];
        mesh.placing = Some(mesh.vertices.iter().map(|v| placed(v.position)).collect());
    }
    if let Some((low, high)) = &mut scene.extent {
        *low = low.min(at - DVec3::new(reach, 0.0, reach));
        *high = high.max(at + DVec3::new(reach, 0.0, reach));
    }
}
