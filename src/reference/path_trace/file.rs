//! Stores samples in a file, so that an interrupted picture can continue and a finished one can be refined.
//!
//! Little-endian: magic, version, key, number of samples, the pixels' sums, and a blake3 hash of all of these.

use std::path::{Path, PathBuf};

use super::{PASS_SAMPLES, PathTrace, PathTraceSettings, Pixel};
use crate::scene::{Camera, Scene};
use crate::{files, kept};

const MAGIC: [u8; 8] = *b"LSKTRACE";

/// Version of format and algorithm: incremented when either changes the samples.
const VERSION: u32 = 8;

/// Magic, version, key, samples.
const HEADER: usize = 8 + 4 + 32 + 4;

/// Hash of everything that samples depend on.
pub(super) fn key(scene: &Scene, camera: &Camera, settings: &PathTraceSettings) -> [u8; 32] {
    let mut hasher = blake3::Hasher::new();
    hasher.update(scene.fingerprint().as_bytes());
    // The backdrop is not part of the scene's fingerprint.
    hasher.update(format!("{camera:?} {settings:?} {:?}", scene.backdrop).as_bytes());
    *hasher.finalize().as_bytes()
}

impl PathTrace<'_> {
    /// Restarts with another picture size of the same view.
    pub fn resize(&mut self, size: [u32; 2]) {
        self.settings.size = size;
        self.pixels = vec![Pixel::default(); size[0] as usize * size[1] as usize];
        self.key = key(self.world.scene(), self.camera, &self.settings);
        self.samples = 0;
    }

    /// Path of this picture's sample file in a folder.
    pub fn kept_in(&self, folder: &Path) -> PathBuf {
        folder.join(format!("{}.samples", blake3::Hash::from(self.key).to_hex()))
    }

    /// Writes the samples so far.
    ///
    /// # Errors
    /// Fails if the file cannot be written; no partial file is left behind.
    pub fn save(&self, path: &Path) -> std::io::Result<()> {
        let mut bytes = Vec::with_capacity(HEADER + size_of_val(self.pixels.as_slice()) + 32);
        bytes.extend_from_slice(&MAGIC);
        bytes.extend_from_slice(&VERSION.to_le_bytes());
        bytes.extend_from_slice(&self.key);
        bytes.extend_from_slice(&self.samples.to_le_bytes());
        let numbers: &[f64] = bytemuck::cast_slice(&self.pixels);
        numbers.iter().for_each(|number| bytes.extend_from_slice(&number.to_le_bytes()));
        bytes.extend_from_slice(blake3::hash(&bytes).as_bytes());
        kept::write(path, &bytes)
    }

    /// Loads the samples in a file if it exists, is intact and belongs to this picture; returns whether it did.
    pub fn resume(&mut self, path: &Path) -> bool {
        let Ok(bytes) = files::read(path) else { return false };
        let Some((content, hash)) = bytes.split_last_chunk::<32>() else { return false };
        let Some((header, numbers)) = content.split_at_checked(HEADER) else { return false };
        let samples = u32::from_le_bytes(header[HEADER - 4..].try_into().expect("four bytes"));
        let known = header[..8] == MAGIC && header[8..12] == VERSION.to_le_bytes() && header[12..44] == self.key;
        let sound = numbers.len() == size_of_val(self.pixels.as_slice())
            && samples.is_multiple_of(PASS_SAMPLES)
            && blake3::hash(content).as_bytes() == hash;
        let values: Vec<f64> =
            numbers.chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().expect("eight bytes"))).collect();
        // The hash proves that the bytes are complete, not that values are sound. Pictures are in single precision.
        let sane = values.iter().all(|value| (0.0..1e30).contains(value));
        if !known || !sound || !sane {
            log::debug!("{}: damaged or of another picture, starting over", path.display());
            return false;
        }
        self.pixels = bytemuck::cast_slice::<f64, Pixel>(&values).to_vec();
        self.samples = samples;
        true
    }
}
