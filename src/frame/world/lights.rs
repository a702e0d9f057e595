//! Lights in the form that shaders use: relative to the scene's origin, each with the frusta of its shadow map and RSM.

use super::area_lights::AreaLight;
use super::bodies::BodyLight;
use crate::scene::{Light, LightKind};
use crate::shared::{self, AREA_VIEWS, LightView};
use glam::{DMat4, DVec3, DVec4, Vec4};

/// Spots with a wider half angle than this \[rad\] use six faces, like point lights.
const WIDEST_FRUSTUM: f32 = 70.0 / 180.0 * std::f32::consts::PI;

/// Data of a light that the host needs to draw its maps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightInfo {
    /// First of its views.
    pub first_view: u32,
    /// 1 or 6; for an area light, 5 for each sample.
    pub views: u32,
    /// Number of RSMs of this size that together have the texels of one square: all views of a light, or of all lights
    /// of a sky. Area lights share a square by their power, and small bodies another one.
    pub sharing: f64,
    /// The unit direction towards a directional light and 0, or the position relative to the scene's origin and 1.
    pub eye: Vec4,
    /// Whether it is an area light.
    pub is_area: bool,
    /// Whether it has a size and therefore soft shadows.
    pub is_soft: bool,
    /// Whether it represents a part of the sky. If caches gather the sky's own light, this light is left out.
    pub of_sky: bool,
}

impl LightInfo {
    /// Side of each of its RSMs \[texels\].
    pub fn rsm_size(&self, n: u32) -> u32 {
        ((f64::from(n) / self.sharing.sqrt()).round() as u32).max(1)
    }

    /// Side of each tile of its shadow map \[texels\]. Six faces tile the map three by two; the samples of an area
    /// light are such tiles side by side.
    pub fn shadow_size(&self, n: u32) -> u32 {
        match self.views {
            1 => n,
            _ if self.is_area => (n / (3 * self.columns())).max(1),
            _ => (n / 3).max(1),
        }
    }

    /// Smallest visible size of a draw in a view with this many texels a side \[NDC\]: one texel for the coarse maps of
    /// area lights, else 0.
    pub fn least(&self, size: u32) -> f32 {
        if self.is_area { 2.0 / size as f32 } else { 0.0 }
    }

    /// Number of samples of an area light side by side in its shadow map. Each has three columns and two rows of faces.
    pub fn columns(&self) -> u32 {
        let samples = self.views / AREA_VIEWS;
        (1..=samples).find(|columns| 3 * columns >= 2 * samples.div_ceil(*columns)).unwrap_or(1)
    }

    /// Position of a view's tile in the shadow map \[tiles\].
    pub fn tile(&self, view: u32) -> [u32; 2] {
        let (sample, face) = if self.is_area { (view / AREA_VIEWS, view % AREA_VIEWS) } else { (0, view) };
        let columns = self.columns().max(1);
        [3 * (sample % columns) + face % 3, 2 * (sample / columns) + face / 3]
    }
}

/// All punctual lights of a scene and their views. The scene lies around `origin` with half extent `half` \[m\].
pub fn prepare(lights: &[Light], origin: DVec3, half: DVec3) -> (Vec<LightInfo>, Vec<shared::Light>, Vec<LightView>) {
    prepare_with(lights, (&[], &[]), origin, half, |_| false)
}

/// Prepares punctual lights, followed by area lights and small emissive bodies. Spots whose index satisfies `grows` get
/// six views, since their cones may widen.
pub(super) fn prepare_with(
    lights: &[Light],
    (areas, bodies): (&[AreaLight], &[BodyLight]),
    origin: DVec3,
    half: DVec3,
    grows: impl Fn(usize) -> bool,
) -> (Vec<LightInfo>, Vec<shared::Light>, Vec<LightView>) {
    let radius = half.length();
    let (mut infos, mut all, mut views) = (Vec::new(), Vec::new(), Vec::new());
    for (i, light) in lights.iter().enumerate() {
        let position = light.position - origin;
        let direction = light.direction.as_dvec3().normalize_or(DVec3::NEG_Y);
        let first_view = views.len() as u32;
        let (mut kind, mut cone) = (shared::LIGHT_POINT, [0.0; 2]);
        // Six faces along the world's axes, unless one frustum can hold the light.
        match light.kind {
            LightKind::Directional => {
                kind = shared::LIGHT_DIRECTIONAL;
                views.push(parallel_view(position, direction, half));
            }
            LightKind::Spot { inner, outer } => {
                kind = shared::LIGHT_SPOT;
                // The glTF extension's own bound keeps a sharp cone finite.
                let scale = 1.0 / (inner.cos() - outer.cos()).max(0.001);
                cone = [scale, -outer.cos() * scale];
                if outer <= WIDEST_FRUSTUM && !grows(i) {
                    let right = direction.any_orthonormal_vector();
                    views.push(perspective_view(
                        position,
                        right,
                        right.cross(direction),
                        direction,
                        f64::from(outer).tan(),
                        NEAREST * radius,
                    ));
                }
            }
            LightKind::Point => {}
        }
        if views.len() as u32 == first_view {
            views.extend(cube(position, [DVec3::X, DVec3::Y, DVec3::Z], radius));
        }
        let view_count = views.len() as u32 - first_view;
        let eye = match light.kind {
            LightKind::Directional => (-direction).extend(0.0),
            _ => position.extend(1.0),
        };
        let eye = eye.as_vec4();
        infos.push(LightInfo {
            first_view,
            views: view_count,
            sharing: view_count.into(),
            eye,
            is_area: false,
            is_soft: light.radius > 0.0,
            of_sky: false,
        });
        all.push(shared::Light {
            position: position.as_vec3(),
            kind,
            direction: direction.as_vec3(),
            range: light.range.unwrap_or(0.0),
            intensity: light.color * light.intensity,
            radius: if light.kind == LightKind::Directional { light.radius.tan() } else { light.radius },
            cone_scale: cone[0],
            cone_offset: cone[1],
            first_view,
            view_count,
            ..shared::Light::default()
        });
    }
    for area in areas {
        let (first_view, view_count) = (views.len() as u32, AREA_VIEWS * area.samples[0] * area.samples[1]);
        let x = area.right.normalize();
        let axes = [x, area.normal.cross(x), area.normal];
        // Slightly in front, so that the surface itself is behind.
        let front = 1e-3 * area.right.length().min(area.up.length()) * area.normal;
        for point in area.sample_points() {
            views.extend(cube(point + front - origin, axes, radius).into_iter().take(AREA_VIEWS as usize));
        }
        let position = area.middle - origin;
        let eye = position.extend(1.0).as_vec4();
        let sharing = f64::from(view_count) / area.share;
        infos.push(LightInfo {
            first_view,
            views: view_count,
            sharing,
            eye,
            is_area: true,
            is_soft: true,
            of_sky: false,
        });
        all.push(shared::Light {
            position: position.as_vec3(),
            kind: shared::LIGHT_AREA,
            direction: area.normal.as_vec3(),
            intensity: area.radiance.as_vec3(),
            first_view,
            view_count,
            right: area.right.as_vec3(),
            up: area.up.as_vec3(),
            columns: area.samples[0],
            rows: area.samples[1],
            ..shared::Light::default()
        });
    }
    for body in bodies {
        let (position, first_view) = (body.middle - origin, views.len() as u32);
        let [x, y, z] = [body.q.x_axis, body.q.y_axis, body.q.z_axis];
        // What lies within the body is in front of the near plane.
        views.extend(cube_from(position, [DVec3::X, DVec3::Y, DVec3::Z], body.clear));
        infos.push(LightInfo {
            first_view,
            views: 6,
            sharing: 6.0 / body.share,
            eye: position.extend(1.0).as_vec4(),
            is_area: false,
            is_soft: true,
            of_sky: false,
        });
        all.push(shared::Light {
            position: position.as_vec3(),
            kind: shared::LIGHT_BODY,
            right: DVec3::new(x.x, y.y, z.z).as_vec3(),
            up: (2.0 * DVec3::new(y.z, z.x, x.y)).as_vec3(),
            intensity: body.intensity.as_vec3(),
            first_view,
            view_count: 6,
            radius: body.radius as f32,
            lean: body.lean.as_vec3(),
            clear: body.clear as f32,
            ..shared::Light::default()
        });
    }
    (infos, all, views)
}

/// The six faces of a cube around a point, along these axes: +x -x +y -y +z -z.
fn cube(position: DVec3, axes: [DVec3; 3], radius: f64) -> [LightView; 6] {
    cube_from(position, axes, NEAREST * radius)
}

/// These faces, with this distance to the near plane.
fn cube_from(position: DVec3, [x, y, z]: [DVec3; 3], near: f64) -> [LightView; 6] {
    [(z, y, x), (-z, y, -x), (x, z, y), (x, -z, -y), (-x, y, z), (x, y, -z)]
        .map(|(right, up, forward)| perspective_view(position, right, up, forward, 1.0, near))
}

/// Near plane of lights and cameras, in radii of the scene. Reversed float depth loses no precision by it.
pub(in crate::frame) const NEAREST: f64 = 1e-7;

/// A square frustum with reversed depth and no far plane.
fn perspective_view(position: DVec3, right: DVec3, up: DVec3, forward: DVec3, tan_half: f64, near: f64) -> LightView {
    let rows = [
        (right / tan_half).extend(-right.dot(position) / tan_half),
        (-up / tan_half).extend(up.dot(position) / tan_half),
        DVec4::new(0.0, 0.0, 0.0, near),
        forward.extend(-forward.dot(position)),
    ];
    view(rows, position, right * tan_half, up * tan_half, forward)
}

/// A box around the scene, which is centred at the origin.
fn parallel_view(position: DVec3, forward: DVec3, half: DVec3) -> LightView {
    let right = forward.any_orthonormal_vector();
    let up = right.cross(forward);
    // Half extent of the scene's box along an axis, slightly enlarged so that nothing lies on the border.
    let reach = |axis: DVec3| 1.001 * axis.abs().dot(half);
    let (w, h, d) = (reach(right), reach(up), reach(forward));
    let rows = [(right / w).extend(0.0), (-up / h).extend(0.0), (-forward / (2.0 * d)).extend(0.5), DVec4::W];
    view(rows, position, right * w, up * h, forward)
}

fn view(rows: [DVec4; 4], position: DVec3, right: DVec3, up: DVec3, forward: DVec3) -> LightView {
    let clip_from_world = DMat4::from_cols(rows[0], rows[1], rows[2], rows[3]).transpose().as_mat4();
    let [right, up, forward, position] = [right, up, forward, position].map(DVec3::as_vec3);
    LightView { clip_from_world, right, up, forward, position }
}
