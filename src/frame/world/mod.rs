//! The scene and its caches on the device: merged vertices, textures, materials, instances, lights, references.
//!
//! Most data is written once; each frame rewrites only what has moved (`update.rs`). Positions are relative to the
//! scene's origin, the centre of its bounds. So a scene far from the world's origin is drawn and lit as precisely as a
//! near one.

mod albedo;
mod area_lights;
mod bodies;
mod cells;
pub(super) mod deform;
mod draws;
mod emitters;
mod enclosed;
mod filled;
pub mod lights;
mod model_caches;
mod movers;
pub mod rays;
mod sizes;
mod sky;
mod textures;
mod update;

pub use area_lights::AreaLight;
pub use bodies::BodyLight;
pub use cells::CellBuffers;
pub use deform::DeformBuffers;
pub use draws::Which;
pub(super) use draws::{ByKind, VERTEX, VERTEX_PLACE, VERTEX_PLAIN};
pub use filled::FilledBuffers;
pub(super) use lights::LightInfo;
pub use sky::{SkyBuffer, SkyLight};

use super::plan::{Features, Plan};
use super::revision::new_revision;
use super::settings::{Indirect, Settings};
use crate::bake::CacheSet;
use crate::error::{Error, Result};
use crate::gpu::{Buffer, Device, Gpu, Image};
use crate::scene::{Mesh, Scene, Vertex};
use crate::shared::{self, Corner, DrawRecord, InstanceCaches, ModelCache, NO_REFERENCES, RIGID};
use area_lights::AreaLights;
use bodies::Bodies;
use draws::{DrawItem, bounds_of};
use emitters::Patches;
use glam::{DVec3, Mat4, Vec3, Vec4};
use model_caches::{CacheSurface, place_caches, references_each};
use rays::{Placed, RayBuffers};
use std::cell::{Cell, OnceCell};
use std::sync::Arc;
use textures::{MaterialTextures, kinds, upload_textures};
use update::{Dynamic, InstanceLayout, PendingCopies, Revisions, Structure};

/// A scene with its caches on the device, shared by all its lights and pictures.
pub struct World {
    /// Centre of the scene in the world. Everything on the device is relative to it.
    pub origin: DVec3,
    /// Half of the bounds' diagonal \[m\].
    pub radius: f64,
    /// Half extent of the scene along each axis \[m\].
    half: DVec3,
    /// Lights, for shaders.
    pub light_buffer: Buffer,
    /// Views of lights.
    pub view_buffer: Buffer,
    /// The sky or backdrop that is visible without a surface.
    pub sky: Option<SkyBuffer>,
    /// The sky that lights caches.
    pub sky_light: Option<SkyLight>,
    /// Area lights: the largest flat emissive surfaces.
    pub areas: Vec<AreaLight>,
    /// Source of `areas`.
    area_lights: AreaLights,
    /// Small emissive bodies.
    pub bodies: Vec<BodyLight>,
    /// Source of `bodies`.
    body_lights: Bodies,
    /// The other emissive surfaces as VALs without weights: a square, or empty.
    pub emitters: Vec<shared::Val>,
    /// Source of `emitters`.
    patches: Patches,
    /// Data for posing, if meshes are deformed.
    pub(super) deform: Option<DeformBuffers>,
    /// Instances, for shaders.
    pub instances: Buffer,
    /// Caches of all instances in model space.
    pub model_caches: Buffer,
    /// Number of caches.
    pub cache_count: u32,
    /// References per vertex or cell.
    pub(super) references_each: usize,
    /// Albedos of the caches; created for further bounces.
    albedos: OnceCell<CacheAlbedos>,
    /// Ray tracing data; created on request.
    rays: OnceCell<RayBuffers>,
    /// Translucent bodies, if there are any.
    pub filled: Option<FilledBuffers>,
    /// The caches as baked.
    caches: Option<CacheSet>,
    /// Features that determine the stages.
    pub(super) features: Features,
    /// Changes with everything that resources are sized by: lights, emitters, caches, vertices.
    pub(super) layout: u64,
    /// References of all models' vertices or cells.
    pub references: Buffer,
    /// Location of each instance's caches, for rays.
    pub(super) instance_caches: Buffer,
    /// Records of the draws of `draw`, for passes that look up a visible triangle.
    pub draw_records: Buffer,
    /// Positions and normals of all vertices: those of all meshes, then the posed ones of all deformed instances.
    pub corners: Buffer,
    /// Cells in which pixels look up references.
    pub cells: Option<CellBuffers>,
    /// Number of vertices of all instances, or of cells of their surfaces.
    pub slot_count: u32,
    /// The state that the device has or is about to receive.
    dynamic: Dynamic,
    /// Scratch space for the next state.
    scratch: Dynamic,
    /// Parts of `dynamic` that the next frame copies.
    pending: Cell<PendingCopies>,
    /// Revisions of the contents.
    pub(super) revisions: Revisions,
    /// Caches as uploaded, and the surface of each.
    placed_caches: Vec<ModelCache>,
    cache_surfaces: Vec<CacheSurface>,
    /// Parts of the scene that must not change.
    structure: Structure,
    /// Constant data of each instance.
    layouts: Vec<InstanceLayout>,
    /// For each material, the light from inside that pixels reflect themselves.
    close_by: Vec<filled::CloseBy>,
    vertices: Buffer,
    indices: Buffer,
    materials: Buffer,
    texture_slots: Buffer,
    textures: Vec<Image>,
    /// Image and sampler of each texture, for each material.
    material_textures: MaterialTextures,
    /// Kinds of materials, for shaders.
    kinds: Vec<u32>,
    draws: Vec<DrawItem>,
}

/// Reflectance of caches.
struct CacheAlbedos {
    /// For shaders.
    buffer: Buffer,
    /// The values that the buffer has or will receive.
    albedos: Vec<Vec3>,
}

impl World {
    /// Uploads a scene. `caches` may be `None` if no caches are to be lit. Caches with cells are averaged at every
    /// pixel, caches without cells at vertices.
    ///
    /// # Errors
    /// Fails if the scene has no triangles, or more than shaders can number or the device can hold.
    pub fn new(gpu: &Device, scene: &Scene, caches: Option<&CacheSet>) -> Result<Self> {
        let (low, high) = scene.bounds().ok_or_else(|| Error::Nothing("the scene has no triangles".into()))?;
        let origin = (low + high) * 0.5;
        let mut half = (high - low) * 0.5;
        let radius = half.length().max(1e-12);
        half = half.max(DVec3::splat(1e-6 * radius));

        sizes::check(scene)?;
        let (mut vertices, mut indices) = (Vec::<Vertex>::new(), Vec::<u32>::new());
        let mut mesh_base = Vec::new();
        for mesh in &scene.meshes {
            mesh_base.push((vertices.len() as u64, indices.len() as u64));
            vertices.extend_from_slice(&mesh.vertices);
            indices.extend_from_slice(&mesh.indices);
        }
        // The vertices as they were when caches were placed.
        let mut first_rest = Vec::new();
        for (mesh, (first, _)) in scene.meshes.iter().zip(&mesh_base) {
            first_rest.push(if mesh.placing.is_some() { vertices.len() as u32 } else { *first as u32 });
            if let Some(placing) = &mesh.placing {
                vertices.extend(mesh.vertices.iter().zip(placing).map(|(v, at)| Vertex { position: *at, ..*v }));
            }
        }
        // Deformed instances have their own vertices, which start as those at rest.
        let mut first_posed = Vec::new();
        for instance in &scene.instances {
            let mesh = &scene.meshes[instance.mesh];
            first_posed.push(mesh.deform.as_ref().map(|_| vertices.len() as u32));
            if mesh.deform.is_some() {
                vertices.extend_from_slice(&mesh.vertices);
            }
        }
        let (area_lights, body_lights, patches) = Patches::new(scene);
        let (areas, bodies) = (area_lights.now(scene), body_lights.now(scene));
        // The transforms under which caches were placed, whatever the instances' are now.
        let layouts: Vec<InstanceLayout> = (scene.instances.iter().enumerate())
            .map(|(i, instance)| InstanceLayout {
                linear: match caches {
                    Some(caches) => caches.models[caches.instance_model[i]].linear,
                    None => instance.stretch(),
                },
                first_index: mesh_base[instance.mesh].1 as u32,
                first_vertex: first_posed[i].unwrap_or(RIGID),
                drawn_vertex: first_posed[i].unwrap_or(mesh_base[instance.mesh].0 as u32),
                pose_sizes: scene.meshes[instance.mesh].deform.as_ref().map_or((0, 0), deform::sizes),
                emits: patches.any_of(i) || area_lights.any_of(i) || body_lights.any_of(i),
            })
            .collect();
        let rays = rays::bytes(scene).max(size_of_val(&vertices[..]) as u64) <= gpu.most_buffer_bytes();
        let mut dynamic = Dynamic::default();
        let close_by = filled::close_by(scene, caches);
        dynamic.fill_surfaces(scene, origin, (&layouts, &close_by));
        dynamic.fill_lights(scene, (&areas, &bodies), origin, half);

        let mut references = Vec::<u16>::new();
        let mut reference_base = Vec::new();
        let cells = caches.and_then(|c| c.cells.as_ref());
        for (i, model) in caches.iter().flat_map(|c| &c.models).enumerate() {
            reference_base.push(u32::try_from(references.len() / 2).map_err(|_| too_many_references())?);
            references.extend_from_slice(cells.map_or(&model.references, |cells| &cells.models[i].references));
        }
        if references.len() % 2 == 1 {
            references.push(crate::bake::NO_CACHE);
        }

        let (kinds, kind_of) = kinds(scene);
        let bounds = |mesh: &Mesh| mesh.primitives.iter().map(|primitive| bounds_of(mesh, primitive)).collect();
        let bounds: Vec<Vec<_>> = scene.meshes.iter().map(bounds).collect();
        let (mut model_caches, mut cache_surfaces, mut draws, mut slot_count) =
            (Vec::new(), Vec::new(), Vec::new(), 0_u32);
        let mut instance_caches = Vec::<InstanceCaches>::new();
        for (i, instance) in scene.instances.iter().enumerate() {
            let cache_base = model_caches.len() as u32;
            instance_caches.push(InstanceCaches {
                reference_base: NO_REFERENCES,
                cache_base,
                grid: 0,
                first_rest: first_rest[instance.mesh],
            });
            let model = caches.map(|c| (c.instance_model[i], &c.models[c.instance_model[i]]));
            if let (Some((m, of_model)), Some(own)) = (model, instance_caches.last_mut()) {
                own.grid = m as u32;
                own.reference_base = if of_model.caches.is_empty() { NO_REFERENCES } else { reference_base[m] };
            }
            if let Some((_, model)) = model {
                let first = cache_surfaces.len();
                cache_surfaces.extend(CacheSurface::all(scene, instance.mesh, model));
                model_caches.extend(place_caches(scene, instance.mesh, model, i as u32, &cache_surfaces[first..]));
            }
            let mesh = &scene.meshes[instance.mesh];
            let first_vertex = first_posed[i].map_or(mesh_base[instance.mesh].0, u64::from);
            let first_slot = slot_count;
            let slots = match (cells, model) {
                (Some(cells), Some((m, _))) => cells.models[m].cells.len(),
                _ => mesh.vertices.len(),
            };
            slot_count = u32::try_from(slots)
                .ok()
                .and_then(|n| slot_count.checked_add(n))
                .ok_or_else(|| Error::TooLarge("more than 4 billion vertices or cells in all instances".into()))?;
            for (primitive, (bounds, runs)) in mesh.primitives.iter().zip(&bounds[instance.mesh]) {
                draws.push(DrawItem {
                    instance: i as u32,
                    material: primitive.material as u32,
                    kind: kind_of[primitive.material],
                    vertex_offset: first_vertex * size_of::<Vertex>() as u64,
                    first_rest: first_rest[instance.mesh],
                    index_offset: mesh_base[instance.mesh].1 * 4,
                    first_index: primitive.first_index,
                    index_count: primitive.index_count,
                    reference_base: model.map_or(0, |(m, _)| reference_base[m]),
                    cache_base,
                    grid: model.map_or(0, |(m, _)| m as u32),
                    first_slot,
                    masked: scene.materials[primitive.material].alpha_cutoff.is_some(),
                    seen_through: scene.materials[primitive.material].is_seen_through(),
                    has_caches: model.is_some_and(|(_, m)| !m.caches.is_empty()),
                    bounds: mesh.deform.is_none().then_some(*bounds),
                    runs: if mesh.deform.is_none() { runs.clone() } else { Arc::default() },
                });
            }
        }
        // Keeps draws of a material together, for few changes of pipelines and textures.
        draws.sort_by_key(|d| (d.material, d.instance, d.first_index));

        let (textures, material_textures) = upload_textures(gpu, scene)?;
        // Only interpolation reads corners, and only posing writes them.
        let corner = |v: &Vertex| Corner { position: v.position, normal: v.normal };
        let has_corners = caches.is_some() || first_posed.iter().any(Option::is_some);
        let corners: Vec<Corner> = vertices.iter().filter(|_| has_corners).map(corner).collect();
        Ok(Self {
            origin,
            radius,
            half,
            sky: scene.behind().map(|sky| SkyBuffer::new(gpu, &sky)).transpose()?,
            sky_light: scene.sky.as_ref().map(|sky| SkyLight::new(gpu, sky)).transpose()?,
            emitters: patches.vals(scene, origin),
            features: Features {
                rays,
                ..Features::new(scene, !areas.is_empty() || !bodies.is_empty(), !patches.is_empty())
            },
            areas,
            area_lights,
            bodies,
            body_lights,
            patches,
            light_buffer: gpu.buffer_from("scene.lights", &dynamic.lights)?,
            view_buffer: gpu.buffer_from("scene.light_views", &dynamic.views)?,
            instances: gpu.buffer_from("scene.instances", &dynamic.instances)?,
            deform: DeformBuffers::new(gpu, scene, &first_posed)?,
            filled: FilledBuffers::new(gpu, (scene, &layouts, &close_by), &draws, (&model_caches, &cache_surfaces))?,
            cache_count: model_caches.len() as u32,
            model_caches: gpu.buffer_from("scene.model_caches", &model_caches)?,
            placed_caches: model_caches,
            cache_surfaces,
            structure: Structure::new(scene),
            references_each: references_each(scene, caches),
            albedos: OnceCell::new(),
            rays: OnceCell::new(),
            caches: caches.cloned(),
            layout: new_revision(),
            references: gpu.buffer_from("scene.references", &references)?,
            instance_caches: gpu.buffer_from("scene.instance_caches", &instance_caches)?,
            draw_records: gpu.buffer_from("scene.draw_records", &draws.iter().map(record).collect::<Vec<_>>())?,
            corners: gpu.buffer_from("scene.corners", &corners)?,
            cells: cells.map(|cells| CellBuffers::new(gpu, cells)).transpose()?,
            slot_count,
            vertices: gpu.buffer_from("scene.vertices", &vertices)?,
            indices: gpu.buffer_from("scene.indices", &indices)?,
            materials: gpu.buffer_from("scene.materials", &dynamic.materials)?,
            texture_slots: gpu.buffer_from("scene.texture_slots", &dynamic.slots)?,
            textures,
            material_textures,
            kinds,
            draws,
            layouts,
            close_by,
            revisions: Revisions::new(dynamic.lights.len()),
            pending: Cell::new(PendingCopies::new(first_posed.iter().any(Option::is_some))),
            scratch: Dynamic::default(),
            dynamic,
        })
    }

    /// The caches as baked.
    pub(super) fn baked(&self) -> Option<&CacheSet> {
        self.caches.as_ref()
    }

    /// The caches as baked.
    pub(super) fn into_caches(self) -> Option<CacheSet> {
        self.caches
    }

    /// Computes the albedos of the caches, which further bounces need, on the first call.
    pub(super) fn make_albedos(&self, gpu: &Device, scene: &Scene) -> Result<()> {
        if let (None, Some(caches)) = (self.albedos.get(), &self.caches) {
            let albedos = albedo::of_all(scene, caches);
            let buffer = gpu.buffer_from("scene.cache_albedos", &albedos)?;
            self.albedos.get_or_init(|| CacheAlbedos { buffer, albedos });
        }
        Ok(())
    }

    /// Creates the ray tracing data on the first call.
    ///
    /// # Errors
    /// Fails if the device runs out of memory.
    pub fn make_rays(&self, gpu: &Device, scene: &Scene) -> Result<()> {
        if self.rays.get().is_none() {
            let moves = (0..scene.instances.len()).map(|i| scene.may_move(i)).collect();
            let made = self.rays_of(gpu, scene, &self.dynamic, moves)?;
            self.rays.get_or_init(|| made);
        }
        Ok(())
    }

    /// Whether all that is created on request and that these settings need is there.
    pub(super) fn is_ready_for(&self, settings: &Settings) -> bool {
        let plan = self.plan(settings);
        (!plan.rays() || self.rays.get().is_some()) && (plan.bounces == 0 || self.albedos.get().is_some())
    }

    /// Builds BVHs over the scene in the state `now`. The next frame refits those of deformed meshes.
    fn rays_of(&self, gpu: &Device, scene: &Scene, now: &Dynamic, moves: Vec<bool>) -> Result<RayBuffers> {
        let is_area = &self.area_lights.triangles().chain(self.body_lights.triangles()).collect();
        let placed = Placed { scene, origin: self.origin, layouts: &self.layouts, is_area, now };
        let made = RayBuffers::new(gpu, &placed, moves)?;
        self.pending.set(self.pending.get().with_poses(self.deform.is_some()));
        Ok(made)
    }

    /// The ray tracing data, if it has been requested.
    pub fn rays(&self) -> Option<&RayBuffers> {
        self.rays.get()
    }

    /// Distance between caches \[m\]; 0 without caches.
    pub fn spacing(&self) -> f64 {
        self.caches.as_ref().map_or(0.0, |caches| caches.spacing)
    }

    /// The stages of a frame of this world under these settings.
    pub fn plan(&self, settings: &Settings) -> Plan {
        match settings.indirect {
            Indirect::Caches(_) if self.caches.is_none() => {
                Plan::of(&self.features, &Settings { indirect: Indirect::Off, ..*settings })
            }
            _ => Plan::of(&self.features, settings),
        }
    }

    /// References per cell, if pixels look them up.
    pub(super) fn references_of_pixels(&self) -> Option<usize> {
        self.cells.as_ref().map(|cells| cells.row)
    }

    /// An image of a single texel of value 1.
    pub(super) fn white(&self) -> &Image {
        &self.textures[0]
    }

    /// The vertices of an instance as the last draws read them; empty for an instance without triangles. Waits for the
    /// device.
    ///
    /// # Errors
    /// Fails if the device is lost.
    pub fn read_vertices(&self, gpu: &Gpu, scene: &Scene, instance: usize) -> Result<Vec<Vertex>> {
        let Some(item) = self.draws.iter().find(|item| item.instance as usize == instance) else {
            return Ok(Vec::new());
        };
        let first = item.vertex_offset as usize / size_of::<Vertex>();
        let count = scene.meshes[scene.instances[instance].mesh].vertices.len();
        Ok(gpu.read::<Vertex>(&self.vertices)?[first..first + count].to_vec())
    }

    /// Albedos of the caches, if they have been requested.
    pub fn cache_albedos(&self) -> Option<&Buffer> {
        self.albedos.get().map(|albedos| &albedos.buffer)
    }

    /// Lights, for the host.
    pub fn lights(&self) -> &[LightInfo] {
        &self.dynamic.infos
    }

    /// The lights that represent the sky.
    pub(super) fn sky_lights(&self) -> std::ops::Range<u32> {
        let first = self.lights().iter().position(|light| light.of_sky).unwrap_or(0) as u32;
        first..first + self.lights().iter().filter(|light| light.of_sky).count() as u32
    }

    /// Eye of a view of a light, as in `LightInfo::eye`.
    pub(super) fn eye(&self, light: &LightInfo, view: u32) -> Vec4 {
        if light.is_area { self.dynamic.views[view as usize].position.extend(1.0) } else { light.eye }
    }

    /// Transform from the world to the clip space of a view of a light.
    pub fn clip_from_world(&self, view: u32) -> Mat4 {
        self.dynamic.views[view as usize].clip_from_world
    }

    /// Vertices as draws read them.
    pub(super) fn vertices(&self) -> &Buffer {
        &self.vertices
    }

    /// Indices of all triangles, by draw.
    pub fn indices(&self) -> &Buffer {
        &self.indices
    }
}

/// A draw in the form that shaders use.
fn record(draw: &DrawItem) -> DrawRecord {
    DrawRecord {
        first_index: (draw.index_offset / 4) as u32 + draw.first_index,
        first_vertex: (draw.vertex_offset / size_of::<Vertex>() as u64) as u32,
        first_slot: draw.first_slot,
        instance: draw.instance,
        reference_base: if draw.has_caches { draw.reference_base } else { NO_REFERENCES },
        cache_base: draw.cache_base,
        grid: draw.grid,
        first_rest: draw.first_rest,
    }
}

fn too_many_references() -> Error {
    Error::TooLarge("more than 8 billion cache references; use --refs 8 or render parts of the scene".into())
}
