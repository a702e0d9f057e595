//! Everything that may change from frame to frame: transforms, poses, lights, materials. `World::update` compares it
//! with the device's state, and the next frame copies the differences. Revisions tell the stages which inputs have
//! changed.

use super::filled::CloseBy;
use super::lights::{self, LightInfo};
use super::{AreaLight, BodyLight, SkyBuffer, SkyLight, World, albedo, textures};
use crate::error::{Error, Result};
use crate::frame::plan::Features;
use crate::frame::revision::new_revision;
use crate::gpu::{Cmd, Device, Use};
use crate::scene::animation::Quantity;
use crate::scene::medium::Subsurface;
use crate::scene::{Instance, Material, Sampler, Scene};
use crate::shared::{self, Joint, LightView, RIGID, TEXTURE_COUNT, TextureSlot};
use glam::{DMat3, DMat4, DVec3, Mat4};
use std::cell::OnceCell;

/// Revisions of the contents.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(in crate::frame) struct Revisions {
    /// Transforms, poses and materials.
    pub(in crate::frame) surfaces: u64,
    /// Each light.
    pub(in crate::frame) lights: Vec<u64>,
    /// The sky.
    pub(in crate::frame) sky: u64,
}

impl Revisions {
    pub(super) fn new(lights: usize) -> Self {
        Self { surfaces: new_revision(), lights: (0..lights).map(|_| new_revision()).collect(), sky: new_revision() }
    }
}

/// Data to be copied to the device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct PendingCopies {
    instances: bool,
    poses: bool,
    lights: bool,
    materials: bool,
    albedos: bool,
    caches: bool,
    rays: bool,
}

impl PendingCopies {
    /// For a newly uploaded scene, in which only poses are missing.
    pub(super) fn new(bends: bool) -> Self {
        Self { poses: bends, ..Self::default() }
    }

    /// Adds the poses if any mesh is deformed (`bends`).
    pub(super) fn with_poses(self, bends: bool) -> Self {
        Self { poses: self.poses || bends, ..self }
    }
}

/// Data of an instance that does not change when it moves.
#[derive(Clone, Copy, Debug)]
pub(super) struct InstanceLayout {
    /// The transform under which its caches were placed.
    pub(super) linear: DMat3,
    /// First of its mesh's indices among all.
    pub(super) first_index: u32,
    /// First of its posed vertices among all, or `RIGID`.
    pub(super) first_vertex: u32,
    /// First of the vertices that are drawn.
    pub(super) drawn_vertex: u32,
    /// Number of joints and morph targets.
    pub(super) pose_sizes: (u32, u32),
    /// Whether it has emissive parts.
    pub(super) emits: bool,
}

/// Parts of a scene that must stay the same, since drawing depends on them.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Structure {
    /// Mesh of each instance.
    meshes: Vec<usize>,
    materials: Vec<MaterialStructure>,
}

#[derive(Clone, Debug, PartialEq)]
struct MaterialStructure {
    /// Whether it has an alpha mask.
    masked: bool,
    /// Whether it is transparent.
    seen_through: bool,
    /// Whether it is glass that bends light.
    bends_light: bool,
    /// Whether it has a coat or sheen.
    coated: bool,
    /// Its scattering medium.
    inside: Option<Subsurface>,
    /// Whether it may emit.
    emits: bool,
    textures: [Option<(usize, Sampler)>; TEXTURE_COUNT as usize],
}

impl MaterialStructure {
    fn new(scene: &Scene, (index, material): (usize, &Material)) -> Self {
        let textures = textures::used(material).map(|(texture, _)| texture.map(|t| (t.image, t.sampler)));
        Self {
            masked: material.alpha_cutoff.is_some(),
            seen_through: material.is_seen_through(),
            bends_light: material.is_solid(),
            coated: material.is_coated(),
            inside: material.subsurface,
            emits: scene.emission(index).is_some(),
            textures,
        }
    }
}

impl Structure {
    pub(super) fn new(scene: &Scene) -> Self {
        Self {
            meshes: scene.instances.iter().map(|instance| instance.mesh).collect(),
            materials: scene.materials.iter().enumerate().map(|m| MaterialStructure::new(scene, m)).collect(),
        }
    }

    /// Whether a scene has the same instances of the same models.
    fn has_models_of(&self, scene: &Scene) -> bool {
        self.meshes.iter().copied().eq(scene.instances.iter().map(|instance| instance.mesh))
    }

    /// Whether a scene's materials have the same textures, alpha masks and media, and the same ones may emit.
    fn has_materials_of(&self, scene: &Scene) -> bool {
        scene.materials.len() == self.materials.len()
            && (scene.materials.iter().enumerate().zip(&self.materials))
                .all(|(m, fixed)| MaterialStructure::new(scene, m) == *fixed)
    }
}

/// The host's copy of the state.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Dynamic {
    pub(super) instances: Vec<shared::Instance>,
    pub(super) mirrored: Vec<bool>,
    pub(super) hidden: Vec<bool>,
    pub(super) joints: Vec<Joint>,
    pub(super) weights: Vec<f32>,
    pub(super) infos: Vec<LightInfo>,
    pub(super) lights: Vec<shared::Light>,
    pub(super) views: Vec<LightView>,
    pub(super) materials: Vec<shared::Material>,
    pub(super) slots: Vec<TextureSlot>,
}

impl Dynamic {
    /// Sets the state of a scene's surfaces, relative to `origin`. `layouts` holds the constant data of each
    /// instance, `close_by` that of each material.
    pub(super) fn fill_surfaces(
        &mut self,
        scene: &Scene,
        origin: DVec3,
        (layouts, close_by): (&[InstanceLayout], &[CloseBy]),
    ) {
        self.instances.clear();
        self.mirrored.clear();
        self.hidden.clear();
        self.joints.clear();
        self.weights.clear();
        for (instance, layout) in scene.instances.iter().zip(layouts) {
            self.place(instance, origin, layout);
            self.pose(instance, layout.pose_sizes);
        }
        self.materials.clear();
        self.materials.extend(scene.materials.iter().zip(close_by).map(textures::material));
        self.slots.clear();
        self.slots.extend(scene.materials.iter().flat_map(textures::slots));
    }

    /// Sets the state of its lights, relative to `origin`, for a scene with half extent `half` \[m\].
    pub(super) fn fill_lights(
        &mut self,
        scene: &Scene,
        emissive: (&[AreaLight], &[BodyLight]),
        origin: DVec3,
        half: DVec3,
    ) {
        let grows = |i| scene.animates(&[Quantity::Cone], i);
        (self.infos, self.lights, self.views) = lights::prepare_with(&scene.lights, emissive, origin, half, grows);
        if let Some(sky) = &scene.sky {
            for light in &mut self.infos[sky.lights.clone()] {
                (light.sharing, light.of_sky) = (sky.lights.len() as f64, true);
            }
        }
    }

    fn place(&mut self, instance: &Instance, origin: DVec3, layout: &InstanceLayout) {
        let mut now = instance.world_from_model;
        now.translation -= origin;
        let (normals, size) = normal_matrix(now.matrix3);
        let (_, placed_size) = normal_matrix(layout.linear);
        let change = now.matrix3 * layout.linear.inverse();
        let growth = largest_stretch(change);
        self.mirrored.push(now.matrix3.determinant() < 0.0);
        self.hidden.push(instance.hidden);
        self.instances.push(shared::Instance {
            world_from_model: DMat4::from(now).as_mat4(),
            growth: if growth.is_finite() { growth as f32 } else { 1.0 },
            world_from_normal: Mat4::from_mat3(normals.as_mat3()),
            // Areas on deformed meshes come from the posed triangles.
            area_scale: match (instance.hidden, layout.first_vertex) {
                (true, _) => 0.0,
                (false, RIGID) => (size / placed_size) as f32,
                (false, _) => 1.0,
            },
            first_index: layout.first_index,
            first_vertex: layout.first_vertex,
            drawn_vertex: layout.drawn_vertex,
        });
    }

    fn pose(&mut self, instance: &Instance, (joints, weights): (u32, u32)) {
        let pose = instance.pose.as_ref();
        for i in 0..joints as usize {
            let matrix = pose.and_then(|pose| pose.joints.get(i)).copied().unwrap_or_default();
            let rows = DMat4::from(matrix).transpose();
            self.joints.push(Joint { x: rows.x_axis.as_vec4(), y: rows.y_axis.as_vec4(), z: rows.z_axis.as_vec4() });
        }
        for i in 0..weights as usize {
            self.weights.push(pose.and_then(|pose| pose.weights.get(i)).copied().unwrap_or(0.0));
        }
    }
}

/// Largest factor by which a linear map stretches a vector, by power iteration on the squared map.
fn largest_stretch(map: DMat3) -> f64 {
    let mut v = DVec3::new(1.0, 1.1, 1.2).normalize();
    let lengths = map.transpose() * map;
    for _ in 0..24 {
        v = (lengths * v).normalize_or(v);
    }
    (map * v).length()
}

/// The inverse transpose of a linear map up to a factor, and that factor [square of the map's unit]. It uses cofactors,
/// divided by the largest of them, so that flat maps need no special case.
pub(super) fn normal_matrix(linear: DMat3) -> (DMat3, f64) {
    let cofactors = DMat3::from_cols(
        linear.y_axis.cross(linear.z_axis),
        linear.z_axis.cross(linear.x_axis),
        linear.x_axis.cross(linear.y_axis),
    ) * linear.determinant().signum();
    let size = cofactors.to_cols_array().iter().fold(0.0_f64, |m, v| m.max(v.abs())).max(1e-300);
    (cofactors * (1.0 / size), size)
}

impl World {
    /// Whether materials differ so much from the uploaded ones that all of the scene must be uploaded again.
    fn needs_upload(&self, scene: &Scene) -> bool {
        let Features { areas, emits, rays, .. } = self.features;
        !self.structure.has_materials_of(scene)
            || self.features != Features { rays, ..Features::new(scene, areas, emits) }
    }

    /// Whether `update` only rewrites what the scene has on the device. Otherwise it uploads the scene again, or builds
    /// BVHs anew because an instance is hidden or shown for the first time.
    pub(in crate::frame) fn updates_in_place(&self, scene: &Scene) -> bool {
        let is_known = |rays: &super::RayBuffers| {
            let hidden = scene.instances.iter().map(|instance| instance.hidden).zip(&self.dynamic.hidden);
            hidden.zip(rays.moves()).all(|((now, before), moves)| now == *before || *moves)
        };
        !self.needs_upload(scene) && self.rays.get().is_none_or(is_known)
    }

    /// Takes over the current state of the scene. Frames recorded from now on show it. The cost depends on the changes:
    ///
    /// - Transforms, poses, light values and material values: each kind that has changed is copied.
    /// - With ray tracing, the first move of an instance rebuilds the BVHs, unless `Scene::may_move` has announced it.
    /// - Another number or other kinds of lights recreate the lights' buffers; fit lights and pictures afterwards
    ///   (`Light::fit`).
    /// - Other textures, alpha masks or lobes recreate the whole world; fit afterwards as well.
    ///
    /// The scene's centre and bounds stay those of the upload.
    ///
    /// # Errors
    /// Fails if models or instances differ from the uploaded ones: they need other caches and therefore a new world.
    pub fn update(&mut self, gpu: &Device, scene: &Scene) -> Result<()> {
        if !self.structure.has_models_of(scene) {
            return Err(Error::Nothing(
                "the scene's models differ from the uploaded ones: bake and load it again".into(),
            ));
        }
        if self.needs_upload(scene) {
            let caches = self.caches.take();
            let made = Self::new(gpu, scene, caches.as_ref());
            self.caches = caches;
            *self = made?;
            return Ok(());
        }
        let mut now = std::mem::take(&mut self.scratch);
        now.fill_surfaces(scene, self.origin, (&self.layouts, &self.close_by));
        let old = &self.dynamic;
        let mut pending = self.pending.get();
        let instances = now.instances != old.instances;
        let poses = now.joints != old.joints || now.weights != old.weights;
        let materials = now.materials != old.materials || now.slots != old.slots;
        let surfaces = instances || poses || materials || now.mirrored != old.mirrored || now.hidden != old.hidden;
        pending.instances |= instances;
        pending.poses |= poses;
        pending.materials |= materials;
        if surfaces {
            self.revisions.surfaces = new_revision();
            let moved = |i: usize| now.instances[i] != old.instances[i] || now.hidden[i] != old.hidden[i];
            if let Some(rays) = self.rays.get() {
                let moves: Vec<bool> = rays.moves().iter().enumerate().map(|(i, moves)| *moves || moved(i)).collect();
                if moves != rays.moves() {
                    // This is the first move of an instance. From now on it is treated as movable.
                    let made = self.rays_of(gpu, scene, &now, moves)?;
                    if made.constants(gpu) != rays.constants(gpu) {
                        self.layout = new_revision();
                    }
                    pending = pending.with_poses(self.deform.is_some());
                    self.rays = OnceCell::from(made);
                } else if let (true, Some(rays)) = (instances || poses || now.hidden != old.hidden, self.rays.get_mut())
                {
                    rays.place(&now);
                    pending.rays = true;
                }
            }
            let moved =
                |(i, layout): (usize, &InstanceLayout)| layout.emits && (poses || now.instances[i] != old.instances[i]);
            if self.features.emits_at_all() && (materials || self.layouts.iter().enumerate().any(moved)) {
                self.emitters = self.patches.vals(scene, self.origin);
                self.areas = self.area_lights.now(scene);
                self.bodies = self.body_lights.now(scene);
            }
        }
        let before = new_revision();
        now.fill_lights(scene, (&self.areas, &self.bodies), self.origin, self.half);
        let old = &self.dynamic;
        let same_lights = now.infos.len() == old.infos.len()
            && (now.infos.iter().zip(&old.infos)).all(|(a, b)| (a.views, a.sharing) == (b.views, b.sharing));
        if !same_lights {
            self.light_buffer = gpu.buffer_from("scene.lights", &now.lights)?;
            self.view_buffer = gpu.buffer_from("scene.light_views", &now.views)?;
            self.revisions.lights = now.infos.iter().map(|_| new_revision()).collect();
            self.layout = new_revision();
        }
        for (i, info) in now.infos.iter().enumerate().filter(|_| same_lights) {
            let views = info.first_view as usize..(info.first_view + info.views) as usize;
            if now.lights[i] != old.lights[i] || now.views[views.clone()] != old.views[views] {
                pending.lights = true;
                self.revisions.lights[i] = new_revision();
            }
        }
        // A change of the sky changes the lights that represent it.
        let differs = |(now, info): (usize, &LightInfo)| info.of_sky && self.revisions.lights[now] > before;
        if now.infos.iter().enumerate().any(differs) {
            self.sky = scene.behind().map(|sky| SkyBuffer::new(gpu, &sky)).transpose()?;
            self.sky_light = scene.sky.as_ref().map(|sky| SkyLight::new(gpu, sky)).transpose()?;
            self.revisions.sky = new_revision();
        }
        if materials {
            for (cache, surface) in self.placed_caches.iter_mut().zip(&self.cache_surfaces) {
                let exponent = surface.exponent(scene);
                pending.caches |= { cache.exponent } != exponent;
                cache.exponent = exponent;
            }
        }
        if let (true, Some(of_caches), Some(caches)) = (materials, self.albedos.get_mut(), &self.caches) {
            of_caches.albedos = albedo::of_all(scene, caches);
            pending.albedos = true;
        }
        self.pending.set(pending);
        self.scratch = std::mem::replace(&mut self.dynamic, now);
        Ok(())
    }

    /// Instance and material of a draw, counted from 1 as in the G-buffer's elements.
    pub fn drawn(&self, draw: u32) -> Option<(usize, usize)> {
        let item = self.draws.get((draw as usize).checked_sub(1)?)?;
        Some((item.instance as usize, item.material as usize))
    }

    /// Records the copies of all changes. Returns whether poses changed.
    pub(in crate::frame) fn record_changes(&self, cmd: &Cmd<'_>) -> bool {
        let pending = self.pending.take();
        let poses = pending.poses;
        if pending == PendingCopies::default() {
            return false;
        }
        let _zone = cmd.zone("update");
        let now = &self.dynamic;
        if pending.instances {
            cmd.update(&self.instances, 0, &now.instances);
        }
        if let (true, Some(deform)) = (poses, &self.deform) {
            cmd.update(&deform.joints, 0, &now.joints);
            cmd.update(&deform.weights, 0, &now.weights);
        }
        if pending.lights {
            cmd.update(&self.light_buffer, 0, &now.lights);
            cmd.update(&self.view_buffer, 0, &now.views);
        }
        if pending.materials {
            cmd.update(&self.materials, 0, &now.materials);
            cmd.update(&self.texture_slots, 0, &now.slots);
        }
        if let (true, Some(of_caches)) = (pending.albedos, self.albedos.get()) {
            cmd.update(&of_caches.buffer, 0, &of_caches.albedos);
        }
        if pending.caches {
            cmd.update(&self.model_caches, 0, &self.placed_caches);
        }
        if let (true, Some(rays)) = (pending.rays, self.rays.get()) {
            rays.record_top(cmd);
        }
        let to = Use::VertexRead | Use::FragmentRead | Use::ComputeRead | Use::ComputeWrite;
        cmd.barrier(Use::CopyWrite, to);
        poses
    }
}
