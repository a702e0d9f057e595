//! Keeps a bake in a file, so that the next start is instant.
//!
//! Little-endian: magic, version, key, length of the payload, its blake3 hash, payload. The file name is the key, a
//! hash of everything that the result depends on. Files are never overwritten with other content and never cleaned up;
//! each takes a few hundred KiB per scene and settings.

use super::{BakeSettings, Cache, CacheSet, Coverage, Density, ModelCaches, NO_CACHE, bake};
use crate::error::Result;
use crate::scene::Scene;
use crate::{files, kept};
use glam::DMat3;
use std::path::Path;

const MAGIC: [u8; 8] = *b"LSKCACHE";

/// Version of the format and of the algorithm; incremented when either changes the result of a bake.
const VERSION: u32 = 10;

/// Magic, version, key, length, hash.
const HEADER: usize = 8 + 4 + 32 + 8 + 32;

/// [`bake`], or the kept result of an earlier bake; the flag tells whether the result was kept. Files are in
/// [`kept::folder`]; without a folder, nothing is kept.
///
/// # Errors
/// As `bake`. A kept file that cannot be read or written is no error.
pub fn bake_cached(
    scene: &Scene,
    settings: &BakeSettings,
    progress: &(dyn Fn(f32, &str) + Sync),
) -> Result<(CacheSet, bool)> {
    match kept::folder() {
        Some(folder) => bake_kept_in(&folder, scene, settings, progress),
        None => {
            log::debug!("no folder for kept files is known: the bake will not be kept");
            Ok((bake(scene, settings, progress)?, false))
        }
    }
}

/// [`bake_cached`] with a given folder. If the file is missing, damaged or of another version, the scene is baked
/// again. If it cannot be written, a warning is logged.
///
/// # Errors
/// As `bake`. A kept file that cannot be read or written is no error.
pub fn bake_kept_in(
    folder: &Path,
    scene: &Scene,
    settings: &BakeSettings,
    progress: &(dyn Fn(f32, &str) + Sync),
) -> Result<(CacheSet, bool)> {
    let key = key(scene, settings);
    let path = folder.join(format!("{}.caches", blake3::Hash::from(key).to_hex()));
    match files::read(&path) {
        Ok(bytes) => match read(&bytes, &key, scene, settings) {
            Some(set) => return Ok((set, true)),
            None => log::debug!("{}: damaged or of another version, baking again", path.display()),
        },
        Err(reason) => log::debug!("{}: {reason}; baking", path.display()),
    }
    let set = bake(scene, settings, progress)?;
    if let Err(error) = kept::write(&path, &write(&set, &key)) {
        log::warn!(
            "{}: cannot keep the bake, so the next start will bake again: {error}; make the folder writable or point \
             XDG_CACHE_HOME to one that is",
            path.display()
        );
    }
    Ok((set, false))
}

/// Hash of everything that a bake depends on.
fn key(scene: &Scene, settings: &BakeSettings) -> [u8; 32] {
    let mut hasher = blake3::Hasher::new();
    let mut number = |value: u64| {
        hasher.update(&value.to_le_bytes());
    };
    number(u64::from(VERSION));
    match settings.density {
        Density::Count(count) => [0, count as u64].into_iter().for_each(&mut number),
        Density::Spacing(spacing) => [1, spacing.to_bits()].into_iter().for_each(&mut number),
    }
    number(u64::from(settings.angle.to_bits()));
    number(settings.references as u64);
    number(scene.instances.len() as u64);
    for instance in &scene.instances {
        number(instance.mesh as u64);
        instance.stretch().to_cols_array().iter().for_each(|element| number(element.to_bits()));
    }
    // Static instances can close off caches, so their relative placement counts.
    let mut origin = None;
    for (index, instance) in scene.instances.iter().enumerate() {
        let still = !scene.may_move(index) && !instance.hidden;
        number(u64::from(still));
        if still {
            let place = instance.world_from_model;
            let from = *origin.get_or_insert(place.translation);
            let relative = (place.translation - from).to_array().map(|x| x + 0.0);
            place.matrix3.to_cols_array().iter().chain(&relative).for_each(|element| number(element.to_bits()));
        }
    }
    for material in scene.materials.iter() {
        number(u64::from(material.double_sided));
    }
    number(scene.meshes.len() as u64);
    for mesh in &scene.meshes {
        // Hashed in large chunks, for speed.
        hasher.update(&(mesh.vertices.len() as u64).to_le_bytes());
        let mut bytes = Vec::with_capacity(24 * 1024);
        for vertices in mesh.vertices.chunks(1024) {
            bytes.clear();
            for vertex in vertices {
                vertex.position.to_array().iter().for_each(|x| bytes.extend_from_slice(&x.to_le_bytes()));
                vertex.normal.to_array().iter().for_each(|x| bytes.extend_from_slice(&x.to_le_bytes()));
            }
            hasher.update(&bytes);
        }
        if mesh.deform.is_some() {
            hasher.update(b"bends");
        }
        if let Some(placing) = &mesh.placing {
            hasher.update(b"placing");
            hasher.update(bytemuck::cast_slice(placing));
        }
        hasher.update(&(mesh.indices.len() as u64).to_le_bytes());
        for indices in mesh.indices.chunks(4096) {
            bytes.clear();
            indices.iter().for_each(|index| bytes.extend_from_slice(&index.to_le_bytes()));
            hasher.update(&bytes);
        }
    }
    *hasher.finalize().as_bytes()
}

fn write(set: &CacheSet, key: &[u8; 32]) -> Vec<u8> {
    let mut payload = Vec::new();
    let number = |payload: &mut Vec<u8>, value: usize| payload.extend_from_slice(&(value as u64).to_le_bytes());
    payload.extend_from_slice(&set.spacing.to_le_bytes());
    number(&mut payload, set.instance_model.len());
    set.instance_model.iter().for_each(|&model| number(&mut payload, model));
    number(&mut payload, set.models.len());
    for model in &set.models {
        number(&mut payload, model.mesh);
        model.linear.to_cols_array().iter().for_each(|x| payload.extend_from_slice(&x.to_le_bytes()));
        payload.extend_from_slice(&model.coverage.distance.to_le_bytes());
        payload.extend_from_slice(&model.coverage.angle.to_le_bytes());
        number(&mut payload, model.caches.len());
        for cache in &model.caches {
            let [x, y, z] = cache.position.to_array();
            let [nx, ny, nz] = cache.normal.to_array();
            let [mx, my, mz] = cache.middle.to_array();
            let [ax, ay, az] = cache.axis.to_array();
            let [second, third] = cache.barycentric;
            for value in [x, y, z, nx, ny, nz, cache.area, mx, my, mz, ax, ay, az, cache.breadth, second, third] {
                payload.extend_from_slice(&value.to_le_bytes());
            }
            payload.extend_from_slice(&cache.triangle.to_le_bytes());
        }
        number(&mut payload, model.references.len());
        model.references.iter().for_each(|reference| payload.extend_from_slice(&reference.to_le_bytes()));
    }
    let mut bytes = Vec::with_capacity(HEADER + payload.len());
    bytes.extend_from_slice(&MAGIC);
    bytes.extend_from_slice(&VERSION.to_le_bytes());
    bytes.extend_from_slice(key);
    number(&mut bytes, payload.len());
    bytes.extend_from_slice(blake3::hash(&payload).as_bytes());
    bytes.extend_from_slice(&payload);
    bytes
}

/// Bytes not yet read. A read beyond the end returns `None`.
struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    fn bytes(&mut self, count: usize) -> Option<&'a [u8]> {
        let (bytes, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(bytes)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.bytes(N)?.try_into().ok()
    }

    fn number(&mut self) -> Option<usize> {
        u64::from_le_bytes(self.array()?).try_into().ok()
    }

    fn f32(&mut self) -> Option<f32> {
        Some(f32::from_le_bytes(self.array()?))
    }

    fn f64(&mut self) -> Option<f64> {
        Some(f64::from_le_bytes(self.array()?))
    }

    /// A count followed by that many records of `size` bytes; `None` if they are incomplete.
    fn records(&mut self, size: usize) -> Option<Reader<'a>> {
        let count = self.number()?;
        Some(Reader(self.bytes(count.checked_mul(size)?)?))
    }

    /// Reads records until the bytes run out; `None` if a record is invalid.
    fn all<T>(mut self, read: impl Fn(&mut Self) -> Option<T>) -> Option<Vec<T>> {
        let mut items = Vec::new();
        while !self.0.is_empty() {
            items.push(read(&mut self)?);
        }
        Some(items)
    }
}

fn is_finite(cache: &Cache) -> bool {
    let Cache { position, normal, area, middle, axis, breadth, triangle: _, barycentric } = cache;
    let vectors = [position, normal, middle, axis].iter().all(|vector| vector.is_finite());
    vectors && [*area, *breadth, barycentric[0], barycentric[1]].iter().all(|value| value.is_finite())
}

/// Parses a file's bytes; `None` unless they are intact, belong to this key, and are consistent with the scene.
fn read(bytes: &[u8], key: &[u8; 32], scene: &Scene, settings: &BakeSettings) -> Option<CacheSet> {
    let mut reader = Reader(bytes);
    let known = reader.array()? == MAGIC && u32::from_le_bytes(reader.array()?) == VERSION;
    if !known || reader.array()? != *key {
        return None;
    }
    let length = reader.number()?;
    let hash: [u8; 32] = reader.array()?;
    if reader.0.len() != length || *blake3::hash(reader.0).as_bytes() != hash {
        return None;
    }
    let spacing = reader.f64()?;
    let instance_model = reader.records(8)?.all(Reader::number)?;
    let count = reader.number()?;
    let mut models = Vec::new();
    for _ in 0..count {
        models.push(read_model(&mut reader, scene, settings)?);
    }
    // The hash proves that the bytes are intact, not that they are valid: an index out of range would crash later.
    let sound = reader.0.is_empty()
        && spacing > 0.0
        && instance_model.len() == scene.instances.len()
        && (instance_model.iter().zip(&scene.instances))
            .all(|(&model, instance)| models.get(model).is_some_and(|m: &ModelCaches| m.mesh == instance.mesh));
    sound.then_some(CacheSet { spacing, models, instance_model, cells: None })
}

fn read_model(reader: &mut Reader, scene: &Scene, settings: &BakeSettings) -> Option<ModelCaches> {
    let index = reader.number()?;
    let mesh = scene.meshes.get(index)?;
    let mut linear = [0.0; 9];
    for element in &mut linear {
        *element = reader.f64()?;
    }
    let linear = DMat3::from_cols_array(&linear);
    let coverage = Coverage { distance: reader.f64()?, angle: reader.f64()? };
    let caches = reader.records(68)?.all(|reader| {
        let mut values = [0.0; 16];
        for value in &mut values {
            *value = reader.f32()?;
        }
        let [x, y, z, nx, ny, nz, area, mx, my, mz, ax, ay, az, breadth, second, third] = values;
        Some(Cache {
            position: [x, y, z].into(),
            normal: [nx, ny, nz].into(),
            area,
            middle: [mx, my, mz].into(),
            axis: [ax, ay, az].into(),
            breadth,
            triangle: u32::from_le_bytes(reader.array()?),
            barycentric: [second, third],
        })
    })?;
    let references = reader.records(2)?.all(|reader| Some(u16::from_le_bytes(reader.array()?)))?;
    let sound = linear.is_finite()
        && caches.len() < usize::from(NO_CACHE)
        && caches.iter().all(|cache| (cache.triangle as usize) < mesh.triangle_count() && is_finite(cache))
        && references.len() == mesh.vertices.len() * settings.references
        && references.iter().all(|&reference| reference == NO_CACHE || usize::from(reference) < caches.len());
    sound.then_some(ModelCaches { mesh: index, linear, caches, references, coverage })
}
