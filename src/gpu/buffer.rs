//! Buffers that know their name and size and free themselves.

use super::device::Shared;
use super::graveyard::Remains;
use super::registry::ResourceKind;
use super::{Device, vulkan};
use crate::error::Result;
use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::Allocation;
use std::cell::OnceCell;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// A buffer. Device-local ones are filled once by upload or by shaders; host ones are written every frame or read back.
pub struct Buffer {
    pub(super) shared: Arc<Shared>,
    allocation: Option<Allocation>,
    pub(crate) handle: vk::Buffer,
    /// View of the buffer as RGBA32F texels, created when a shader first reads it that way.
    texels: OnceCell<vk::BufferView>,
    pub(crate) id: u64,
    /// `stage.thing`, as validation messages and captures show it.
    pub name: String,
    /// Size \[bytes\].
    pub size: u64,
    /// A private copy of `size`, on which unsafe code relies.
    pub(super) held: u64,
    /// Whether host-visible memory was requested. Some devices map all memory, but callers must not rely on that.
    host: bool,
    /// The last submission that uses it.
    used: AtomicU64,
}

/// All usages of buffers in one list, so that every buffer can be used in any way later.
const BUFFER_USAGE: vk::BufferUsageFlags = vk::BufferUsageFlags::from_raw(
    vk::BufferUsageFlags::STORAGE_BUFFER.as_raw()
        | vk::BufferUsageFlags::UNIFORM_BUFFER.as_raw()
        | vk::BufferUsageFlags::UNIFORM_TEXEL_BUFFER.as_raw()
        | vk::BufferUsageFlags::VERTEX_BUFFER.as_raw()
        | vk::BufferUsageFlags::INDEX_BUFFER.as_raw()
        | vk::BufferUsageFlags::INDIRECT_BUFFER.as_raw()
        | vk::BufferUsageFlags::TRANSFER_SRC.as_raw()
        | vk::BufferUsageFlags::TRANSFER_DST.as_raw(),
);

impl Device {
    /// A device-local buffer with undefined content.
    ///
    /// # Errors
    /// Fails if the size exceeds the device's limit or the device runs out of memory.
    pub fn buffer(&self, name: &str, size: u64) -> Result<Buffer> {
        self.make_buffer(name, size, MemoryLocation::GpuOnly)
    }

    /// A buffer that the CPU writes and the GPU reads.
    ///
    /// # Errors
    /// Fails if the size exceeds the device's limit or the device runs out of memory.
    pub fn host_buffer(&self, name: &str, size: u64) -> Result<Buffer> {
        self.make_buffer(name, size, MemoryLocation::CpuToGpu)
    }

    /// A buffer that the GPU writes and the CPU reads.
    ///
    /// # Errors
    /// Fails if the size exceeds the device's limit or the device runs out of memory.
    pub fn readback_buffer(&self, name: &str, size: u64) -> Result<Buffer> {
        self.make_buffer(name, size, MemoryLocation::GpuToCpu)
    }

    /// A device-local buffer with this content. It has at least 16 bytes, so that an empty list can be bound.
    ///
    /// # Errors
    /// Fails if the size exceeds the device's limit or the device runs out of memory.
    pub fn buffer_from<T: bytemuck::NoUninit>(&self, name: &str, data: &[T]) -> Result<Buffer> {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let buffer = self.buffer(name, bytes.len().max(16) as u64)?;
        if !bytes.is_empty() {
            self.upload_to_buffer(&buffer, bytes)?;
        }
        Ok(buffer)
    }

    fn make_buffer(&self, name: &str, size: u64, location: MemoryLocation) -> Result<Buffer> {
        if size > self.shared.max_buffer_size {
            return Err(self.too_large(format!("buffer {name} needs {size} bytes"), self.shared.max_buffer_size));
        }
        let (handle, allocation) = self.shared.raw_buffer(name, size.max(4), location)?;
        let buffer = Buffer {
            shared: self.shared.clone(),
            allocation: Some(allocation),
            handle,
            texels: OnceCell::new(),
            id: self.shared.new_id(),
            name: name.to_owned(),
            size: size.max(4),
            held: size.max(4),
            host: location != MemoryLocation::GpuOnly,
            used: AtomicU64::new(0),
        };
        let kind = if buffer.host { ResourceKind::HostBuffer } else { ResourceKind::Buffer };
        self.shared.register(buffer.id, name, kind, buffer.size);
        Ok(buffer)
    }

    /// View of the buffer as RGBA32F texels of 16 bytes: the whole buffer, or as much of it as the device allows.
    pub(crate) fn texels(&self, buffer: &Buffer, all: bool) -> Result<vk::BufferView> {
        let (limit, texels) = (self.most_texels(), buffer.held / 16);
        if all && texels > limit {
            return Err(self.too_large(format!("buffer {} needs {texels} texels", buffer.name), limit));
        }
        if let Some(view) = buffer.texels.get() {
            return Ok(*view);
        }
        assert!(texels > 0, "{}: too small to be read as texels", buffer.name);
        let info = vk::BufferViewCreateInfo::default()
            .buffer(buffer.handle)
            .format(vk::Format::R32G32B32A32_SFLOAT)
            .range(texels.min(limit) * 16);
        // SAFETY: the buffer is bound and made with texel usage; the view is destroyed before it, in `Drop`.
        let view = unsafe { self.shared.device.create_buffer_view(&info, None) }.map_err(vulkan("texel buffer"))?;
        self.shared.name(view, &buffer.name);
        Ok(*buffer.texels.get_or_init(|| view))
    }
}

impl Shared {
    /// A buffer with its memory, which the caller destroys.
    pub(super) fn raw_buffer(
        &self,
        name: &str,
        size: u64,
        location: MemoryLocation,
    ) -> Result<(vk::Buffer, Allocation)> {
        let what = || format!("buffer {name}, {size} bytes");
        let info = vk::BufferCreateInfo::default().size(size).usage(BUFFER_USAGE);
        // SAFETY: the device is alive.
        let handle = unsafe { self.device.create_buffer(&info, None) }.map_err(vulkan(what()))?;
        self.name(handle, name);
        // SAFETY: plain query of a live buffer.
        let requirements = unsafe { self.device.get_buffer_memory_requirements(handle) };
        let bound = self.allocate(name, requirements, location, true).and_then(|memory| {
            // SAFETY: fresh memory of the right kind and size; bound once.
            let bound = unsafe { self.device.bind_buffer_memory(handle, memory.memory(), memory.offset()) };
            match bound {
                Ok(()) => Ok(memory),
                Err(result) => {
                    self.free(Some(memory));
                    Err(vulkan(what())(result))
                }
            }
        });
        if bound.is_err() {
            // SAFETY: nothing has used the buffer.
            unsafe { self.device.destroy_buffer(handle, None) };
        }
        Ok((handle, bound?))
    }
}

impl Buffer {
    /// The bytes of a host-visible buffer. While they are borrowed, no command can be recorded that changes them:
    ///
    /// ```compile_fail,E0502
    /// # use lightskin::gpu::{Buffer, Cmd};
    /// fn changed_while_read(cmd: &Cmd<'_>, from: &Buffer, to: &mut Buffer) -> u8 {
    ///     let bytes = to.bytes();
    ///     cmd.copy_buffer(from, to, 16);
    ///     bytes[0]
    /// }
    /// ```
    ///
    /// # Panics
    /// Panics if the buffer is not host-visible, or the device still uses it.
    pub fn bytes(&mut self) -> &[u8] {
        self.assert_idle();
        let all = self.allocation.as_ref().and_then(Allocation::mapped_slice).expect("host-visible memory");
        &all[..self.held as usize]
    }

    /// Writes into a host-visible buffer, from this byte on.
    ///
    /// # Panics
    /// Panics if the buffer is not host-visible or too small, or the device still uses it.
    pub fn write<T: bytemuck::NoUninit>(&mut self, offset: u64, data: &[T]) {
        self.assert_idle();
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let all = self.allocation.as_mut().and_then(Allocation::mapped_slice_mut).expect("host-visible memory");
        all[..self.held as usize][offset as usize..][..bytes.len()].copy_from_slice(bytes);
    }

    /// Waits until no submission uses the buffer.
    ///
    /// # Panics
    /// Panics before commands that use it are submitted.
    pub(super) fn wait(&self) -> Result<()> {
        let used = self.used.load(Ordering::Relaxed);
        assert!(used <= self.shared.submitted.load(Ordering::SeqCst), "{}: its commands were not submitted", self.name);
        self.shared.wait_for(used)
    }

    /// Marks the buffer as used by the submission being recorded.
    pub(super) fn used(&self) {
        self.used.store(self.shared.submitted.load(Ordering::SeqCst) + 1, Ordering::Relaxed);
    }

    /// The CPU may access only host-visible buffers, and only while the device does not use them.
    fn assert_idle(&self) {
        assert!(self.host, "{}: not a host-visible buffer", self.name);
        let idle = self.used.load(Ordering::Relaxed) <= self.shared.done();
        assert!(idle, "{}: the device still uses it; wait for the frame", self.name);
    }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        self.shared.unregister(self.id);
        let (handle, texels, memory) = (self.handle, self.texels.take(), self.allocation.take());
        self.shared.bury(self.id, Remains::Buffer { handle, texels, memory });
    }
}
