//! A camera and a light for scenes that come without. Rays from the centre of the scene tell an object from a room.
//! Everything scales with the scene: files are in metres, millimetres or none.

use std::f64::consts::PI;

use glam::{DAffine3, DMat3, DVec3, Vec3};
use rayon::prelude::*;

use super::{Camera, Light, LightKind, Projection, Scene};

/// Vertical field of view \[rad\] of a camera outside, and the aspect ratio that it is placed for.
const OUTSIDE_YFOV: f64 = 40.0 * PI / 180.0;
const ASPECT: f64 = 16.0 / 9.0;

/// Vertical field of view \[rad\] of a camera inside a room.
const INSIDE_YFOV: f64 = 60.0 * PI / 180.0;

/// Horizontal directions in the order in which an open side is looked for: the front first.
const SIDES: [DVec3; 4] = [DVec3::Z, DVec3::NEG_Z, DVec3::X, DVec3::NEG_X];

/// Adds a camera to a scene without one, and a punctual light to a scene that has neither one nor a surface that emits, and
/// notes what it added. Scenes without triangles stay as they are.
pub fn complete(scene: &mut Scene) {
    if !scene.cameras.is_empty() && !scene.lights.is_empty() {
        return;
    }
    let Some((low, high)) = scene.bounds() else { return };
    let space = Space::around(scene, low, high);
    if scene.cameras.is_empty() {
        let camera = space.camera(scene);
        scene.notes.push(describe_camera(&camera));
        scene.cameras.push(camera);
    }
    if scene.lights.is_empty() && scene.emits() {
        scene.notes.push("The scene has no light but its emissive surfaces.".into());
    } else if scene.lights.is_empty() {
        let (light, why) = space.light(scene);
        scene.notes.push(describe_light(&light, why));
        scene.lights.push(light);
    }
}

/// What surrounds the centre of the scene.
struct Space {
    low: DVec3,
    high: DVec3,
    centre: DVec3,
    /// Most directions lead out.
    is_object: bool,
    /// The side of a room that one can look in through.
    open_side: Option<DVec3>,
    has_sky: bool,
    /// Free distances from the centre; to the bounds where nothing is in the way.
    up: f64,
    down: f64,
}

impl Space {
    fn around(scene: &Scene, low: DVec3, high: DVec3) -> Self {
        let centre = 0.5 * (low + high);
        let step = |digit: usize| [-1.0, 0.0, 1.0][digit % 3];
        let directions: Vec<DVec3> =
            (0..27).filter_map(|i| DVec3::new(step(i), step(i / 3), step(i / 9)).try_normalize()).collect();
        let hits = cast(scene, centre, &directions);
        let hit = |direction: DVec3| directions.iter().position(|&d| d == direction).map_or(Hit::NONE, |i| hits[i]);
        let is_object = 2 * hits.iter().filter(|hit| hit.escapes()).count() > hits.len();
        let open_side = SIDES.into_iter().find(|&side| hit(side).escapes());
        Self {
            low,
            high,
            centre,
            is_object,
            open_side,
            has_sky: hit(DVec3::Y).escapes(),
            up: hit(DVec3::Y).any.min(high.y - centre.y),
            down: hit(DVec3::NEG_Y).any.min(centre.y - low.y),
        }
    }

    fn camera(&self, scene: &Scene) -> Camera {
        let front = DVec3::new(0.5, 0.35, 1.0).normalize();
        if self.is_object {
            return outside("added: three-quarter view", self, front);
        }
        if let Some(side) = self.open_side {
            return outside("added: view through the open side", self, side);
        }
        // Eye height in a hall, not its middle.
        let height = self.centre.y - self.down + 0.15 * (self.up + self.down);
        let middle = DVec3::new(self.centre.x, height, self.centre.z);
        let hits = cast(scene, middle, &SIDES);
        let free: Vec<f64> = SIDES
            .iter()
            .zip(&hits)
            .map(|(&side, hit)| hit.any.min(side.dot(self.high - middle).max(side.dot(self.low - middle))))
            .collect();
        let along_z = free[0] + free[1] > free[2] + free[3];
        let (one, other) = if along_z { (0, 1) } else { (2, 3) };
        let side = if free[one] >= free[other] { one } else { other };
        let eye = middle + 0.7 * free[side] * SIDES[side];
        Camera {
            name: "added: view along the room".into(),
            world_from_camera: look(eye, SIDES[side]),
            projection: Projection::Perspective { yfov: INSIDE_YFOV as f32 },
        }
    }

    fn light(&self, scene: &Scene) -> (Light, &'static str) {
        let light = |name: &str, kind, intensity: f64, position, direction: DVec3| Light {
            name: format!("added: {name}"),
            kind,
            color: Vec3::ONE,
            intensity: intensity as f32,
            range: None,
            position,
            direction: direction.as_vec3(),
        };
        if self.is_object {
            // Above and to the left of whoever looks at it.
            let camera = scene.cameras.first().map_or(DAffine3::IDENTITY, |camera| camera.world_from_camera);
            let radius = 0.5 * (self.high - self.low).length();
            let towards_eye = camera.translation - self.centre;
            let m = camera.matrix3;
            let direction = if towards_eye.length() > radius { towards_eye.normalize() } else { m.z_axis };
            let direction = (direction + 0.7 * m.y_axis - 0.7 * m.x_axis).try_normalize().unwrap_or(DVec3::Y);
            let distance = 2.5 * radius;
            let half_angle = (radius / distance).asin() as f32;
            let kind = LightKind::Spot { inner: half_angle, outer: 1.1 * half_angle };
            let position = self.centre + distance * direction;
            let intensity = 1000.0 * distance * distance;
            return (light("spot", kind, intensity, position, -direction), "1000 lx at the centre");
        }
        if self.has_sky {
            let size = self.high - self.low;
            let axis = if size.x >= size.z { DVec3::X } else { DVec3::Z };
            let floor = self.centre - 0.999 * self.down * DVec3::Y;
            let towards = |degrees: f64| degrees.to_radians().sin() * axis + degrees.to_radians().cos() * DVec3::Y;
            let tilts = [25.0, -25.0, 15.0, -15.0, 5.0, -5.0, 0.0].map(towards);
            let hits = cast(scene, floor, &tilts);
            let sun =
                tilts.into_iter().zip(hits).find(|(_, hit)| hit.any.is_infinite()).map_or(tilts[0], |(tilt, _)| tilt);
            let position = self.centre + self.up * sun;
            return (light("sun", LightKind::Directional, 1e5, position, -sun), "100000 lx through the open top");
        }
        let position = self.centre + 0.8 * self.up * DVec3::Y;
        let height = self.down + 0.8 * self.up;
        let lamp = light("lamp", LightKind::Point, 500.0 * height * height, position, DVec3::NEG_Y);
        (lamp, "500 lx on the floor below")
    }
}

/// Camera in `direction` of the centre, looking at it, so far away that the bounds fit the picture.
fn outside(name: &str, space: &Space, direction: DVec3) -> Camera {
    let frame = look(DVec3::ZERO, direction).matrix3;
    let half = 0.5 * (space.high - space.low);
    let slope = (0.5 * OUTSIDE_YFOV).tan();
    let distance = (0..8)
        .map(|corner| {
            let sign = |axis: u32| if corner >> axis & 1 == 0 { -1.0 } else { 1.0 };
            let c = frame.transpose() * (half * DVec3::new(sign(0), sign(1), sign(2)));
            c.z + (c.y.abs() / slope).max(c.x.abs() / (slope * ASPECT))
        })
        .fold(0.0, f64::max);
    Camera {
        name: name.into(),
        world_from_camera: look(space.centre + 1.08 * distance * direction, direction),
        projection: Projection::Perspective { yfov: OUTSIDE_YFOV as f32 },
    }
}

/// Camera at `eye` that looks against the unit vector `back`, upright.
fn look(eye: DVec3, back: DVec3) -> DAffine3 {
    let right = DVec3::Y.cross(back).try_normalize().unwrap_or(DVec3::X);
    DAffine3::from_mat3_translation(DMat3::from_cols(right, back.cross(right), back), eye)
}

/// Distances along a ray [lengths of its direction].
#[derive(Clone, Copy, Debug, PartialEq)]
struct Hit {
    /// To the first triangle.
    any: f64,
    /// To the first triangle that shows its front.
    front: f64,
}

impl Hit {
    const NONE: Self = Self { any: f64::INFINITY, front: f64::INFINITY };

    /// Leads out of the scene, or out of the solid that the ray starts in: its surface shows its back from inside.
    fn escapes(self) -> bool {
        self.any.is_infinite() || self.any < (1.0 - 1e-6) * self.front
    }

    fn nearest(self, other: Self) -> Self {
        Self { any: self.any.min(other.any), front: self.front.min(other.front) }
    }
}

/// First hits of rays from one point, by brute force: a few rays do not pay for a hierarchy.
fn cast(scene: &Scene, origin: DVec3, directions: &[DVec3]) -> Vec<Hit> {
    let nothing = || vec![Hit::NONE; directions.len()];
    let nearer = |mut a: Vec<Hit>, b: Vec<Hit>| {
        a.iter_mut().zip(b).for_each(|(a, b)| *a = a.nearest(b));
        a
    };
    scene
        .instances
        .par_iter()
        .map(|instance| {
            let mesh = &scene.meshes[instance.mesh];
            let side = instance.world_from_model.matrix3.determinant().signum();
            (0..mesh.triangle_count())
                .into_par_iter()
                .with_min_len(4096)
                .fold(nothing, |mut hits, triangle| {
                    let [a, b, c] = mesh.triangle(triangle).map(|corner| {
                        let position = mesh.vertices[corner].position.as_dvec3();
                        instance.world_from_model.transform_point3(position) - origin
                    });
                    for (hit, &direction) in hits.iter_mut().zip(directions) {
                        *hit = hit.nearest(intersect(a, b - a, c - a, direction, side));
                    }
                    hits
                })
                .reduce(nothing, nearer)
        })
        .reduce(nothing, nearer)
}

/// Moeller-Trumbore from the origin. The triangle is a little larger than it is: axis-parallel rays like to meet the
/// diagonals of walls.
fn intersect(a: DVec3, edge1: DVec3, edge2: DVec3, direction: DVec3, side: f64) -> Hit {
    const EDGE: f64 = 1e-6;
    let p = direction.cross(edge2);
    let determinant = edge1.dot(p);
    let (u, q) = (-a.dot(p) / determinant, edge1.cross(a));
    let (v, t) = (direction.dot(q) / determinant, edge2.dot(q) / determinant);
    // Comparisons with NaN are false: triangles seen from their edge are missed.
    if u >= -EDGE && v >= -EDGE && u + v <= 1.0 + EDGE && t > 0.0 {
        let is_front = determinant * side > 0.0;
        return Hit { any: t, front: if is_front { t } else { f64::INFINITY } };
    }
    Hit::NONE
}

fn shown(v: DVec3) -> String {
    format!("({:.4}, {:.4}, {:.4})", v.x, v.y, v.z)
}

fn describe_camera(camera: &Camera) -> String {
    let (eye, back) = (camera.world_from_camera.translation, camera.world_from_camera.matrix3.z_axis);
    let yfov = match camera.projection {
        Projection::Perspective { yfov } => f64::from(yfov).to_degrees(),
        Projection::Orthographic { .. } => 0.0,
    };
    let (eye, view) = (shown(eye), shown(-back));
    format!(
        "The scene has no camera; one was {} from {eye} along {view}, vertical field of view {yfov:.0} degrees.",
        camera.name
    )
}

fn describe_light(light: &Light, why: &str) -> String {
    let (position, direction) = (shown(light.position), shown(light.direction.as_dvec3()));
    let (intensity, name) = (light.intensity, &light.name);
    let color = shown(light.color.as_dvec3());
    let what = match light.kind {
        LightKind::Directional => format!("direction {direction}, {intensity} lx"),
        LightKind::Point => format!("at {position}, {intensity} cd"),
        LightKind::Spot { inner, outer } => format!(
            "at {position}, direction {direction}, half angles {:.1} and {:.1} degrees, {intensity} cd",
            inner.to_degrees(),
            outer.to_degrees()
        ),
    };
    format!("The scene has no light; one was {name} {what}, colour {color} ({why}).")
}
