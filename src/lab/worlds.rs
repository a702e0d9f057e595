//! Small worlds for measurements and tests.

use crate::bake::{self, Cache, CacheSet, Coverage, Density, ModelCaches, NO_CACHE};
use crate::error::Result;
use crate::scene::build::{Surface, quad, sphere};
use crate::scene::{Camera, Instance, Light, LightKind, Material, Mesh, Phong, Primitive, Projection, Scene};
use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3, dvec3, vec3};
use std::f32::consts::FRAC_PI_2;

/// A material with an exact Phong lobe.
pub fn phong(diffuse: [f32; 3], specular: [f32; 3], exponent: f32) -> Material {
    let phong = Some(Phong { specular: specular.into(), exponent });
    Material { base_color: Vec3::from(diffuse).extend(1.0), metallic: 0.0, phong, ..Material::default() }
}

/// Adds a mesh with one surface and places it in the world.
pub fn add(scene: &mut Scene, surface: Surface, material: Material, world_from_model: DAffine3) {
    let primitives =
        vec![Primitive { first_index: 0, index_count: surface.indices.len() as u32, material: scene.materials.len() }];
    scene.materials.push(material);
    let name = format!("mesh {}", scene.meshes.len());
    scene.instances.push(Instance {
        name: name.clone(),
        mesh: scene.meshes.len(),
        world_from_model,
        ..Instance::default()
    });
    scene.meshes.push(Mesh {
        name,
        vertices: surface.vertices,
        indices: surface.indices,
        primitives,
        ..Mesh::default()
    });
}

/// A light of one kind for the worlds below.
pub fn lamp(kind: LightKind) -> Light {
    let (position, target) = match kind {
        LightKind::Point => (dvec3(0.6, 1.3, 0.6), DVec3::ZERO),
        _ => (dvec3(1.0, 1.7, 0.4), dvec3(-0.6, 0.2, -0.1)),
    };
    let intensity = if kind == LightKind::Directional { 300.0 } else { 500.0 };
    let direction = (target - position).as_vec3().normalize();
    Light {
        name: "lamp".into(),
        kind,
        color: vec3(1.0, 0.8, 0.5),
        intensity,
        range: None,
        radius: 0.0,
        position,
        direction,
    }
}

/// A spot light with half angles of 23 and 34 degrees.
pub const SPOT: LightKind = LightKind::Spot { inner: 0.4, outer: 0.6 };

/// A camera at `eye` that looks at `target`, with +Y up in the picture.
pub fn camera(eye: DVec3, target: DVec3, yfov: f32) -> Camera {
    let back = (eye - target).normalize();
    let right = if back.cross(DVec3::Y).length() < 1e-9 { DVec3::X } else { DVec3::Y.cross(back).normalize() };
    let rotation = DMat3::from_cols(right, back.cross(right), back);
    Camera {
        name: "camera".into(),
        world_from_camera: DAffine3::from_mat3_translation(rotation, eye),
        projection: Projection::Perspective { yfov },
    }
}

/// A floor and a wall of 2 m, and above the floor a ball whose instance rotates and stretches it unevenly. All glossy
/// lobes have this exponent.
pub fn corner(lights: &[LightKind], exponent: f32) -> Scene {
    let (x, y, z) = (Vec3::X * 2.0, Vec3::Y * 2.0, Vec3::Z * 2.0);
    let low = vec3(-1.0, 0.0, -1.0);
    let mut scene = Scene { name: "corner".into(), ..Scene::default() };
    add(&mut scene, quad(low, z, x, 0.25), phong([0.7, 0.5, 0.3], [0.2, 0.3, 0.1], exponent), DAffine3::IDENTITY);
    add(&mut scene, quad(low, y, z, 0.25), phong([0.2, 0.6, 0.8], [0.3, 0.1, 0.1], exponent), DAffine3::IDENTITY);
    let turn = DQuat::from_axis_angle(dvec3(1.0, 2.0, 0.5).normalize(), 0.7);
    let stretch = DAffine3::from_scale_rotation_translation(dvec3(0.3, 0.4, 0.25), turn, dvec3(0.1, 0.5, -0.1));
    add(&mut scene, sphere(1.0, 8), phong([0.6, 0.6, 0.2], [0.1, 0.3, 0.2], exponent), stretch);
    scene.lights = lights.iter().copied().map(lamp).collect();
    scene.cameras.push(camera(dvec3(1.4, 1.5, 2.0), dvec3(-0.3, 0.5, -0.1), 0.8));
    scene
}

/// Bakes caches with this spacing \[m\].
///
/// # Errors
/// As `bake::bake`.
pub fn baked(scene: &Scene, spacing: f64, references: usize) -> Result<CacheSet> {
    let settings = bake::BakeSettings { density: Density::Spacing(spacing), angle: 0.5 * FRAC_PI_2, references };
    bake::bake(scene, &settings, &|_, _| ())
}

/// The scene, scaled about the world's origin and then moved; light intensities scale with the square.
pub fn placed(scene: &Scene, scale: f64, shift: DVec3) -> Scene {
    let mut scene = scene.clone();
    let world = DAffine3::from_scale_rotation_translation(DVec3::splat(scale), DQuat::IDENTITY, shift);
    for instance in &mut scene.instances {
        instance.world_from_model = world * instance.world_from_model;
    }
    for light in &mut scene.lights {
        light.position = world.transform_point3(light.position);
        light.range = light.range.map(|range| range * scale as f32);
        if light.kind != LightKind::Directional {
            light.intensity *= (scale * scale) as f32;
            light.radius *= scale as f32;
        }
    }
    for camera in &mut scene.cameras {
        let eye = &mut camera.world_from_camera.translation;
        *eye = world.transform_point3(*eye);
        if let Projection::Orthographic { ymag } = &mut camera.projection {
            *ymag *= scale as f32;
        }
    }
    scene
}

/// One cache on the first mesh, none on the others.
pub fn one_cache(scene: &Scene, references: usize, position: Vec3, normal: Vec3) -> CacheSet {
    let cache = Cache { position, normal, area: 1.0, barycentric: [0.3, 0.3], ..Cache::default() };
    let model = |mesh: usize| {
        let caches = if mesh == 0 { vec![cache] } else { Vec::new() };
        let mut row = vec![NO_CACHE; references];
        row[0] = if mesh == 0 { 0 } else { NO_CACHE };
        let references = row.repeat(scene.meshes[mesh].vertices.len());
        ModelCaches { mesh, linear: DMat3::IDENTITY, caches, references, coverage: Coverage::default() }
    };
    let models = (0..scene.meshes.len()).map(model).collect();
    let instance_model = scene.instances.iter().map(|i| i.mesh).collect();
    CacheSet { spacing: 1.0, models, instance_model, cells: None }
}
