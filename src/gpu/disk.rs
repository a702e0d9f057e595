//! A cache of compiled pipelines on disk, kept between runs. Files that are damaged or belong to another device or
//! driver are ignored.

use super::device::Shared;
use crate::{files, kept};
use ash::vk;
use std::path::{Path, PathBuf};

/// The driver's pipeline cache and the file that stores it.
pub(super) struct Disk {
    /// Null if the driver cannot create one. Vulkan accepts a null cache.
    pub(super) cache: vk::PipelineCache,
    file: Option<PathBuf>,
    loaded: blake3::Hash,
}

/// Device and driver that the pipelines belong to, as in the header of the driver's data.
#[derive(Clone, Copy)]
struct Owner {
    vendor: u32,
    device: u32,
    uuid: [u8; vk::UUID_SIZE],
}

/// Start of each file. It differs between versions of the file format.
const MAGIC: &[u8; 8] = b"lspipes1";

/// Maximum size of the stored data \[bytes\].
const MOST: usize = 64 << 20;

/// Bytes before the driver's data: `MAGIC` and a checksum.
const HEAD: usize = MAGIC.len() + blake3::OUT_LEN;

impl Disk {
    /// Opens the stored cache for this device and driver, or an empty one.
    pub(super) fn open(shared: &Shared, properties: &vk::PhysicalDeviceProperties) -> Self {
        let owner =
            Owner { vendor: properties.vendor_id, device: properties.device_id, uuid: properties.pipeline_cache_uuid };
        let file = file(properties);
        let bytes = file.as_deref().and_then(read).unwrap_or_default();
        let data = unwrap(&bytes, owner).unwrap_or_default();
        if let Some(file) = file.as_ref().filter(|_| !bytes.is_empty()) {
            log::debug!("{}: {} bytes of stored pipelines", file.display(), data.len());
        }
        let make = |data| {
            let info = vk::PipelineCacheCreateInfo::default().initial_data(data);
            // SAFETY: the device is alive; checksum and identity show that its driver returned this data.
            unsafe { shared.device.create_pipeline_cache(&info, None) }
        };
        let cache = make(data).or_else(|_| make(&[])).unwrap_or_else(|result| {
            log::debug!("no pipeline cache: {result}");
            vk::PipelineCache::null()
        });
        if cache != vk::PipelineCache::null() {
            shared.name(cache, "gpu.pipelines");
        }
        Self { cache, file, loaded: blake3::hash(data) }
    }

    /// Stores the cache if something was added, and destroys it.
    pub(super) fn close(&mut self, shared: &Shared, pipelines_made: u64) {
        let cache = std::mem::take(&mut self.cache);
        if cache == vk::PipelineCache::null() {
            return;
        }
        if let Some(file) = self.file.as_ref().filter(|_| pipelines_made > 0) {
            // SAFETY: the cache is alive, and no other thread uses it.
            let data = unsafe { shared.device.get_pipeline_cache_data(cache) }.unwrap_or_default();
            if !data.is_empty()
                && data.len() <= MOST
                && blake3::hash(&data) != self.loaded
                && let Err(error) = kept::write(file, &wrap(&data))
            {
                log::debug!("{}: {error}; the pipelines are not stored", file.display());
            }
        }
        // SAFETY: the cache belongs to this device; pipelines created with it do not need it.
        unsafe { shared.device.destroy_pipeline_cache(cache, None) };
    }
}

/// One file per device and driver.
fn file(properties: &vk::PhysicalDeviceProperties) -> Option<PathBuf> {
    let mut hash = blake3::Hasher::new();
    hash.update(properties.device_name_as_c_str().unwrap_or_default().to_bytes());
    hash.update(&properties.driver_version.to_le_bytes()).update(&properties.pipeline_cache_uuid);
    Some(kept::folder()?.join(format!("pipelines-{}.bin", &hash.finalize().to_hex()[..32])))
}

/// Reads the file, unless it is too long to be valid.
fn read(file: &Path) -> Option<Vec<u8>> {
    let length = std::fs::metadata(file).ok()?.len();
    if length > (HEAD + MOST) as u64 {
        return None;
    }
    files::read(file).ok()
}

fn wrap(data: &[u8]) -> Vec<u8> {
    [&MAGIC[..], blake3::hash(data).as_bytes(), data].concat()
}

/// The driver's data in a file, if it is complete and from this device and driver.
fn unwrap(bytes: &[u8], owner: Owner) -> Option<&[u8]> {
    let (head, data) = bytes.split_at_checked(HEAD)?;
    let (magic, sum) = head.split_at(MAGIC.len());
    // Length of the driver's header, version 1, vendor, device and UUID.
    let mut expected = Vec::from(32_u32.to_le_bytes());
    for word in [vk::PipelineCacheHeaderVersion::ONE.as_raw().cast_unsigned(), owner.vendor, owner.device] {
        expected.extend(word.to_le_bytes());
    }
    expected.extend(owner.uuid);
    let whole = magic == MAGIC && sum == blake3::hash(data).as_bytes();
    (whole && data.starts_with(&expected)).then_some(data)
}

#[cfg(test)]
mod tests {
    use super::*;

    const OWNER: Owner = Owner { vendor: 0x1234, device: 7, uuid: [9; vk::UUID_SIZE] };

    /// Data as a driver returns it.
    fn data(owner: Owner) -> Vec<u8> {
        let words = [32, 1, owner.vendor, owner.device];
        let mut data: Vec<u8> = words.into_iter().flat_map(u32::to_le_bytes).collect();
        data.extend(owner.uuid);
        data.extend([1, 2, 3, 4, 5]);
        data
    }

    #[test]
    fn what_was_written_is_read() {
        assert_eq!(unwrap(&wrap(&data(OWNER)), OWNER), Some(&data(OWNER)[..]));
    }

    #[test]
    fn damaged_files_count_as_none() {
        let whole = wrap(&data(OWNER));
        for length in 0..whole.len() {
            assert_eq!(unwrap(&whole[..length], OWNER), None, "{length} bytes of it");
        }
        for byte in 0..whole.len() {
            let mut damaged = whole.clone();
            damaged[byte] ^= 0x10;
            assert_eq!(unwrap(&damaged, OWNER), None, "byte {byte}");
        }
        assert_eq!(unwrap(&[whole, vec![0]].concat(), OWNER), None, "a byte too many");
    }

    #[test]
    fn foreign_files_count_as_none() {
        let file = wrap(&data(OWNER));
        for other in
            [Owner { vendor: 1, ..OWNER }, Owner { device: 8, ..OWNER }, Owner { uuid: [8; vk::UUID_SIZE], ..OWNER }]
        {
            assert_eq!(unwrap(&file, other), None);
        }
        // A correct checksum with another length or version in the driver's header.
        for word in [0, 4] {
            let mut data = data(OWNER);
            data[word] += 1;
            assert_eq!(unwrap(&wrap(&data), OWNER), None);
        }
    }
}
