//! The default scene: a courtyard between two storeys of arcades in the afternoon sun, under a clear sky.

mod building;
mod nets;
mod noise;
mod solids;
mod statue;
mod textures;
mod things;

use super::{add_material, camera, rough};
use crate::scene::sky::Sky;
use crate::scene::{Image, Light, LightKind, Material, Sampler, Scene, Texture};
use glam::{Affine2, DVec3, Vec2, Vec3, Vec4};
use rayon::prelude::*;
use textures::Paint;

/// Vector towards the sun, not normalised.
const SUN: DVec3 = DVec3::new(0.42, 0.88, 0.21);

/// Number of directional lights that represent the sky where caches cannot.
const SKY_LIGHTS: usize = 16;

/// Resolution of the showpiece.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fineness {
    /// Side of the largest textures \[texels\], a multiple of two.
    pub texels: u32,
    /// Side of the cells of the statue's surface nets \[m\].
    pub cell: f32,
}

impl Default for Fineness {
    fn default() -> Self {
        Self { texels: 1024, cell: 0.0115 }
    }
}

struct Palette {
    ashlar: usize,
    slabs: usize,
    plaster: usize,
    cloths: [usize; 3],
    wood: usize,
    brass: usize,
    bronze: usize,
    copper: usize,
    clay: usize,
    clay_tiles: usize,
    marble: usize,
    statue: usize,
    mosaic: usize,
    water: usize,
    leaf: usize,
}

/// The default scene: a courtyard of 9 m by 12 m between two storeys of arcades with galleries behind them, in the
/// afternoon sun under a clear sky. It contains a fountain with a winged victory, metal vessels, plants, curtains,
/// banners and a polished floor.
///
/// Code paints the textures of ten kinds of surface: base colour, normals and roughness. The sun (directional) and the
/// sky are in absolute units. Cameras: "Court", "Gallery" and "Statue".
pub fn showpiece(fineness: Fineness) -> Scene {
    let mut scene = Scene { name: "showpiece".into(), ..Scene::default() };
    let palette = palette(&mut scene, fineness.texels);
    building::build(&mut scene, &palette);
    things::furnish(&mut scene, &palette, fineness.cell);
    let sun = SUN.normalize();
    scene.lights.push(Light {
        name: "sun".into(),
        kind: LightKind::Directional,
        color: Vec3::new(1.0, 0.91, 0.78),
        intensity: 75_000.0,
        range: None,
        radius: Light::SUN_RADIUS,
        position: DVec3::ZERO,
        direction: -sun.as_vec3(),
    });
    Sky::clear(sun, 17_000.0).put_over(&mut scene, SKY_LIGHTS);
    for (name, eye, target, yfov) in [
        ("Court", [-0.42, 1.7, 7.75], [-0.05, 2.62, 0.0], 54.0_f32),
        ("Gallery", [-6.35, 1.7, 6.9], [-5.3, 1.85, 0.0], 54.0),
        ("Statue", [-3.0, 1.3, 4.9], [-0.95, 1.6, 0.8], 48.0),
    ] {
        scene.cameras.push(camera(name, DVec3::from(eye), DVec3::from(target), yfov.to_radians()));
    }
    scene
}

/// Paints the textures and creates the materials.
fn palette(scene: &mut Scene, texels: u32) -> Palette {
    let painted: Vec<[Image; 3]> = Paint::ALL.par_iter().map(|paint| paint.images(texels)).collect();
    scene.images = painted.into_iter().flatten().collect();
    let textured = |paint: Paint, material: Material| {
        let first = 3 * Paint::ALL.iter().position(|p| *p == paint).expect("all are painted");
        let transform = Affine2::from_scale(Vec2::splat(1.0 / paint.size()));
        let texture = |k: usize| Some(Texture { image: first + k, uv_set: 0, transform, sampler: Sampler::default() });
        Material {
            base_color_texture: texture(0),
            normal_texture: texture(1),
            metallic_roughness_texture: texture(2),
            ..material
        }
    };
    let stone = |name: &str, paint: Paint| textured(paint, rough(name, [1.0; 3], 0.0, 1.0));
    let metal =
        |name: &str, color: [f32; 3], roughness: f32| textured(Paint::Hammered, rough(name, color, 1.0, roughness));
    let cloth = |name: &str, color: [f32; 3]| Material {
        double_sided: true,
        specular: 0.4,
        ..textured(Paint::Cloth, rough(name, color, 0.0, 1.0))
    };
    let materials = [
        stone("ashlar", Paint::Ashlar),
        stone("polished slabs", Paint::Slabs),
        stone("plaster", Paint::Plaster),
        cloth("red cloth", [0.46, 0.014, 0.018]),
        cloth("teal cloth", [0.010, 0.15, 0.17]),
        cloth("ochre cloth", [0.72, 0.33, 0.03]),
        stone("oak", Paint::Wood),
        metal("brass", [0.90, 0.66, 0.30], 0.75),
        metal("bronze", [0.55, 0.36, 0.20], 1.0),
        metal("copper", [0.93, 0.50, 0.36], 0.85),
        stone("fired clay", Paint::Clay),
        stone("clay tiles", Paint::ClayTiles),
        stone("marble", Paint::Marble),
        Material { base_color: Vec4::new(0.92, 0.91, 0.89, 1.0), ..stone("statue marble", Paint::Marble) },
        stone("mosaic", Paint::Mosaic),
        Material { ior: 1.33, ..rough("water", [0.012, 0.035, 0.040], 0.0, 0.03) },
        Material { double_sided: true, ..rough("leaf", [0.065, 0.16, 0.030], 0.0, 0.5) },
    ];
    let materials = materials.map(|material| add_material(scene, material));
    let [ashlar, slabs, plaster, red, teal, ochre, wood, brass, bronze, copper, clay, clay_tiles, marble, statue, ..] =
        materials;
    let [.., mosaic, water, leaf] = materials;
    let cloths = [red, teal, ochre];
    Palette {
        ashlar,
        slabs,
        plaster,
        cloths,
        wood,
        brass,
        bronze,
        copper,
        clay,
        clay_tiles,
        marble,
        statue,
        mosaic,
        water,
        leaf,
    }
}
