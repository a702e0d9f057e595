//! A scene as plain data in SI units: meshes, materials, images, instances, lights, cameras.
//!
//! Right-handed, Y up, metres, linear Rec.709 (glTF's conventions). World transforms are f64, so that a scene far from
//! the origin loses no precision before the engine moves it to its own origin.

mod accessor;
pub mod animation;
pub mod build;
pub mod defaults;
pub mod deform;
mod fingerprint;
pub mod ggx;
pub mod gltf;
mod json;
pub mod material;
pub mod medium;
pub mod rays;
pub mod sheen;
pub mod sky;
pub mod sky_filter;
pub mod studio;
pub mod tessellate;
pub mod write;

use std::ops::Range;

use glam::{Affine2, DAffine3, DMat3, DVec3, Vec2, Vec3, Vec4};

/// A complete scene: surfaces, materials, lights and cameras.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// Name for messages: the file's stem, or the name of the generated scene.
    pub name: String,
    /// Surfaces in their own model space, shared between instances.
    pub meshes: Vec<Mesh>,
    /// Materials; primitives index them.
    pub materials: Vec<Material>,
    /// Decoded images, 8 bits per channel; textures index them.
    pub images: Vec<Image>,
    /// Meshes placed in the world.
    pub instances: Vec<Instance>,
    /// Groups of instances, from the file's node tree.
    pub groups: Vec<Group>,
    /// Punctual lights, including the lights of the sky.
    pub lights: Vec<Light>,
    /// The sky that some of the lights represent.
    pub sky: Option<sky::Sky>,
    /// What is shown where there is no surface.
    pub backdrop: studio::Backdrop,
    /// Cameras, in the file's order.
    pub cameras: Vec<Camera>,
    /// Bounds of all motion: smallest and largest world coordinates. `None`: `bounds` computes them from the instances.
    pub extent: Option<(DVec3, DVec3)>,
    /// Animation data, if the scene is animated; see [`Scene::pose`].
    pub rig: Option<animation::Rig>,
    /// Notes for the user: what the loader decided or left out, one sentence each.
    pub notes: Vec<String>,
}

/// A surface: triangles over shared vertices. Triangles of a double-sided material are stored twice, once per side.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// glTF's name, or a generated one.
    pub name: String,
    /// Vertices of all primitives.
    pub vertices: Vec<Vertex>,
    /// Vertex indices, three per triangle, counter-clockwise seen from the front.
    pub indices: Vec<u32>,
    /// Runs of `indices` that share a material, in order, together covering it.
    pub primitives: Vec<Primitive>,
    /// Skins and morph targets of a deforming mesh; `vertices` are then the rest pose.
    pub deform: Option<deform::Deform>,
    /// For each vertex, its position while caches are placed; `None`: its own. Where these positions are closer together
    /// than the vertices, caches are farther apart. Only for rigid meshes.
    pub placing: Option<Vec<Vec3>>,
}

/// One vertex as the vertex shaders read it; model space.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Vertex {
    /// Position [m in model space].
    pub position: Vec3,
    /// Unit shading normal.
    pub normal: Vec3,
    /// Unit tangent and bitangent sign. Zero length if the file gives no tangent: the shader then derives the frame and
    /// reverses it if the sign is negative (`Vertex::SECOND_SIDE`).
    pub tangent: [f32; 4],
    /// First texture coordinate.
    pub uv0: Vec2,
    /// Second texture coordinate.
    pub uv1: Vec2,
    /// Linear vertex colour that multiplies the base colour, RGBA8 unorm; white where the file gives none.
    pub color: [u8; 4],
}

impl Vertex {
    /// Tangent of a second side if the file gives none.
    pub const SECOND_SIDE: [f32; 4] = [0.0, 0.0, 0.0, -1.0];
}

/// A run of triangles with one material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Primitive {
    /// First element of `Mesh::indices`.
    pub first_index: u32,
    /// Number of indices, a multiple of three.
    pub index_count: u32,
    /// Index into `Scene::materials`.
    pub material: usize,
}

/// A mesh placed in the world.
#[derive(Clone, Debug, Default)]
pub struct Instance {
    /// glTF's node name, or a generated one.
    pub name: String,
    /// Index into `Scene::meshes`.
    pub mesh: usize,
    /// Model space to world space; may mirror or scale unevenly.
    pub world_from_model: DAffine3,
    /// Pose of a deforming mesh.
    pub pose: Option<deform::Pose>,
    /// Hidden: not drawn, and casts no shadow.
    pub hidden: bool,
    /// Announces that edits will move, hide or show this instance, so that ray structures are prepared for that from
    /// the start. Not needed for animated instances.
    pub moves: bool,
}

/// A node of the file with several instances in and below it. Groups are nested, outer ones first. A node that holds
/// exactly the instances of another group, or all of the scene, is not listed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Group {
    /// glTF's node name, or a generated one.
    pub name: String,
    /// Indices into `Scene::instances`.
    pub instances: Range<usize>,
}

/// Metallic-roughness material of glTF, with the extensions the method can use.
#[derive(Clone, Debug)]
pub struct Material {
    /// glTF's name, or a generated one.
    pub name: String,
    /// Base colour and alpha, linear.
    pub base_color: Vec4,
    /// Multiplies `base_color`; sRGB image, alpha linear.
    pub base_color_texture: Option<Texture>,
    /// Metalness in [0, 1].
    pub metallic: f32,
    /// Perceptual roughness in [0, 1]; alpha is its square.
    pub roughness: f32,
    /// Green multiplies `roughness`, blue `metallic`; linear image.
    pub metallic_roughness_texture: Option<Texture>,
    /// Tangent-space normals; linear image.
    pub normal_texture: Option<Texture>,
    /// Scales the normal texture's x and y.
    pub normal_scale: f32,
    /// Emitted radiance [cd/m^2], strength included.
    pub emissive: Vec3,
    /// Multiplies `emissive`; sRGB image.
    pub emissive_texture: Option<Texture>,
    /// Alpha below this value is a hole; `None` for opaque materials. A see-through material uses it only for light:
    /// its surface blocks light where alpha reaches the cutoff, and an infinite cutoff blocks none.
    pub alpha_cutoff: Option<f32>,
    /// glTF's BLEND mode: alpha is the covered share of the background.
    pub blend: bool,
    /// Share of the light below the surface that is transmitted instead of scattered; KHR_materials_transmission.
    pub transmission: f32,
    /// Red multiplies `transmission`; linear image.
    pub transmission_texture: Option<Texture>,
    /// Thickness of the body below a transmitting surface \[model units\]; 0 for a thin sheet. Bodies bend light, sheets
    /// do not; KHR_materials_volume.
    pub thickness: f32,
    /// Absorption inside such a body, by channel \[1/m\]; KHR_materials_volume.
    pub attenuation: Vec3,
    /// Where its green is 0, the surface is a thin sheet; linear image.
    pub thickness_texture: Option<Texture>,
    /// Whether the file declared the material double-sided (the loader has already added the second side).
    pub double_sided: bool,
    /// KHR_materials_ior; 1.5 is glTF's default.
    pub ior: f32,
    /// KHR_materials_specular factor.
    pub specular: f32,
    /// Alpha multiplies `specular`; linear image.
    pub specular_texture: Option<Texture>,
    /// KHR_materials_specular colour.
    pub specular_color: Vec3,
    /// Multiplies `specular_color`; sRGB image.
    pub specular_color_texture: Option<Texture>,
    /// Share of the surface covered by a clear coat; KHR_materials_clearcoat.
    pub coat: f32,
    /// Red multiplies `coat`; linear image.
    pub coat_texture: Option<Texture>,
    /// Perceptual roughness of the coat.
    pub coat_roughness: f32,
    /// Green multiplies `coat_roughness`; linear image.
    pub coat_roughness_texture: Option<Texture>,
    /// Sheen colour, black for none; KHR_materials_sheen.
    pub sheen_color: Vec3,
    /// Multiplies `sheen_color`; sRGB image.
    pub sheen_color_texture: Option<Texture>,
    /// Perceptual roughness of the sheen.
    pub sheen_roughness: f32,
    /// Alpha multiplies `sheen_roughness`; linear image.
    pub sheen_roughness_texture: Option<Texture>,
    /// The method's own material, from `extras.lightskin.phong`. Replaces everything except base colour, normal, coat
    /// and sheen.
    pub phong: Option<Phong>,
    /// Medium inside the body, if light enters it. The base colour is then the total share of light that leaves it
    /// again.
    pub subsurface: Option<medium::Subsurface>,
}

/// A normalised modified Phong lobe with exact parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Phong {
    /// Glossy albedo `rho_g`.
    pub specular: Vec3,
    /// Exponent `k`.
    pub exponent: f32,
}

impl Default for Material {
    /// glTF's default material.
    fn default() -> Self {
        Self {
            name: "default".into(),
            base_color: Vec4::ONE,
            base_color_texture: None,
            metallic: 1.0,
            roughness: 1.0,
            metallic_roughness_texture: None,
            normal_texture: None,
            normal_scale: 1.0,
            emissive: Vec3::ZERO,
            emissive_texture: None,
            alpha_cutoff: None,
            blend: false,
            transmission: 0.0,
            transmission_texture: None,
            thickness: 0.0,
            attenuation: Vec3::ZERO,
            thickness_texture: None,
            double_sided: false,
            ior: 1.5,
            specular: 1.0,
            specular_texture: None,
            specular_color: Vec3::ONE,
            specular_color_texture: None,
            coat: 0.0,
            coat_texture: None,
            coat_roughness: 0.0,
            coat_roughness_texture: None,
            sheen_color: Vec3::ZERO,
            sheen_color_texture: None,
            sheen_roughness: 0.0,
            sheen_roughness_texture: None,
            phong: None,
            subsurface: None,
        }
    }
}

/// How a material looks up an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Texture {
    /// Index into `Scene::images`.
    pub image: usize,
    /// Index of the vertex's texture coordinate, 0 or 1.
    pub uv_set: u8,
    /// KHR_texture_transform, applied to the coordinate first.
    pub transform: Affine2,
    /// Wrapping and filtering.
    pub sampler: Sampler,
}

/// Wrapping per axis and magnification filter. Minification is trilinear unless the file asks for nearest.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Sampler {
    /// Along u.
    pub wrap_u: Wrap,
    /// Along v.
    pub wrap_v: Wrap,
    /// Texels stay square when magnified.
    pub nearest: bool,
}

/// How coordinates outside [0, 1] are looked up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Wrap {
    /// The image repeats.
    #[default]
    Repeat,
    /// The image repeats, every other copy mirrored.
    Mirror,
    /// The edge texel repeats.
    Clamp,
}

/// A decoded image: RGBA, 8 bits, rows from the top.
#[derive(Clone, Debug, Default)]
pub struct Image {
    /// File name or glTF name, for messages.
    pub name: String,
    /// Width \[texels\].
    pub width: u32,
    /// Height \[texels\].
    pub height: u32,
    /// `width * height * 4` bytes.
    pub rgba: Vec<u8>,
}

/// A punctual light as KHR_lights_punctual defines it.
#[derive(Clone, Debug, PartialEq)]
pub struct Light {
    /// glTF's name, or a generated one.
    pub name: String,
    /// Shape of the emission.
    pub kind: LightKind,
    /// Linear colour.
    pub color: Vec3,
    /// Luminous intensity [cd = lm/sr] of point and spot lights, illuminance \[lx\] of directional ones.
    pub intensity: f32,
    /// Distance \[m\] at which the light is windowed to zero; `None` for infinite.
    pub range: Option<f32>,
    /// Size of the source. Lamps: radius of the emitting ball \[m\]. Directional lights: half of the sun's angle in the
    /// sky \[rad\]. Affects shadows, not highlights. 0: sharp shadows.
    pub radius: f32,
    /// World position; meaningless for directional lights.
    pub position: DVec3,
    /// Unit direction in which the light shines; meaningless for point lights.
    pub direction: Vec3,
}

/// Shape of a punctual light's emission.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LightKind {
    /// Parallel light from infinitely far.
    Directional,
    /// Same intensity in all directions.
    Point,
    /// A cone: full intensity inside `inner`, none outside `outer` [rad, half angles].
    Spot {
        /// Half angle up to which the intensity is full.
        inner: f32,
        /// Half angle beyond which the intensity is zero.
        outer: f32,
    },
}

/// A camera: looks along its own -Z, +Y up.
#[derive(Clone, Debug)]
pub struct Camera {
    /// glTF's name, or a generated one.
    pub name: String,
    /// Camera space to world space, rotation and translation only.
    pub world_from_camera: DAffine3,
    /// How the image is formed.
    pub projection: Projection,
}

/// How a camera forms its image; the aspect ratio comes from the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// Pinhole.
    Perspective {
        /// Vertical field of view \[rad\].
        yfov: f32,
    },
    /// Parallel.
    Orthographic {
        /// Half of the picture's height \[m\].
        ymag: f32,
    },
}

impl Instance {
    /// Linear part of `world_from_model`, used to measure surfaces and place caches. Identity for an instance without
    /// volume, which an animation may give a volume later.
    pub fn stretch(&self) -> DMat3 {
        let linear = self.world_from_model.matrix3;
        let is_flat = linear.is_finite() && !linear.inverse().is_finite();
        if is_flat { DMat3::IDENTITY } else { linear }
    }
}

impl Light {
    /// Largest value accepted for a light, far above any real lamp. Up to it, products with colours and inverse squared
    /// distances fit single precision.
    pub(crate) const BRIGHTEST: f64 = 1e15;

    /// Half of the sun's angle \[rad\] in the Earth's sky.
    pub const SUN_RADIUS: f32 = 0.004_65;

    /// Largest half angle \[rad\] of a directional light.
    pub const WIDEST_SUN: f32 = 0.5;
}

impl Mesh {
    /// Position of a vertex while caches are placed.
    pub fn placing_at(&self, vertex: usize) -> Vec3 {
        self.placing.as_ref().map_or(self.vertices[vertex].position, |placing| placing[vertex])
    }

    /// Lets caches be farther apart by a factor.
    pub fn place_apart(&mut self, factor: f32) {
        self.placing = Some(self.vertices.iter().map(|v| v.position / factor).collect());
    }

    /// Vertex indices of a triangle's corners.
    pub fn triangle(&self, triangle: usize) -> [usize; 3] {
        [0, 1, 2].map(|corner| self.indices[3 * triangle + corner] as usize)
    }

    /// Whether two triangles are the two sides of a surface: with the same corners, in opposite order. The loader puts
    /// the second side behind the first.
    pub fn are_twins(&self, [a, b, c]: [u32; 3], other: [u32; 3]) -> bool {
        [a, c, b].iter().zip(other).all(|(i, j)| {
            let [i, j] = [*i, j].map(|index| self.vertices[index as usize].position);
            i == j
        })
    }

    /// Number of triangles of all primitives.
    pub fn triangle_count(&self) -> usize {
        self.indices.len() / 3
    }

    /// Material of each triangle, in triangle order.
    pub fn triangle_materials(&self) -> Vec<usize> {
        self.primitives.iter().flat_map(|p| std::iter::repeat_n(p.material, p.index_count as usize / 3)).collect()
    }
}

impl Scene {
    /// Smallest and largest world coordinates of all instances' vertices at any time; `None` if nothing is drawn.
    pub fn bounds(&self) -> Option<(DVec3, DVec3)> {
        if self.extent.is_some() {
            return self.extent;
        }
        self.instances.iter().fold(None, |bounds, instance| self.grown(bounds, instance))
    }

    /// Whether any surface emits light, or may do so by an animation.
    pub fn emits(&self) -> bool {
        let shines: Vec<bool> = (0..self.materials.len()).map(|m| self.emission(m).is_some()).collect();
        let drawn =
            |i: &Instance| self.meshes[i.mesh].primitives.iter().any(|p| shines[p.material] && p.index_count > 0);
        self.instances.iter().any(drawn)
    }

    /// Number of triangles over all instances.
    pub fn triangle_count(&self) -> usize {
        self.instances.iter().map(|i| self.meshes[i.mesh].triangle_count()).sum()
    }
}

/// Luminance of a linear Rec.709 colour.
pub fn luminance(color: DVec3) -> f64 {
    color.dot(DVec3::new(0.2126, 0.7152, 0.0722))
}
