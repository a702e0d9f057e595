//! Windows: presents images by copying them pixel by pixel.

use super::device::{FRAMES_IN_FLIGHT, Gpu, Shared};
use super::faults::Call;
use super::instance::queue_family;
use super::{Image, Options, vulkan};
use crate::error::{Error, Result};
use ash::{khr, vk};
use raw_window_handle::{HasDisplayHandle, HasWindowHandle, RawDisplayHandle};
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::Ordering;

/// When a picture replaces the previous one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Present {
    /// At the display's next refresh, in order. No tearing; supported by every device.
    #[default]
    Fifo,
    /// At the next refresh; if several pictures are ready, the newest is shown.
    Mailbox,
    /// Immediately; pictures may tear.
    Immediate,
}

/// A window as the system provides it, kept alive as long as its surface.
pub trait Window: HasWindowHandle + HasDisplayHandle {}
impl<T: HasWindowHandle + HasDisplayHandle> Window for T {}

/// The images of a window. They are recreated when the window's size changes.
pub struct Swapchain {
    /// Keeps the device on this thread, since only one thread at a time may use its queue.
    gpu: Rc<Gpu>,
    surfaces: khr::surface::Instance,
    chains: khr::swapchain::Device,
    surface: vk::SurfaceKHR,
    /// `None` if the window has no pixels, or before the first picture.
    chain: Option<Chain>,
    /// The window has changed since the chain was created.
    stale: bool,
    slots: [Slot; FRAMES_IN_FLIGHT],
    next: usize,
    present: Present,
    /// Dropped last, since the surface belongs to the window.
    window: Arc<dyn Window>,
}

/// Limits, formats and present modes of a window.
type Supported = (vk::SurfaceCapabilitiesKHR, Vec<vk::SurfaceFormatKHR>, Vec<vk::PresentModeKHR>);

/// The images of a window at one size.
struct Chain {
    handle: vk::SwapchainKHR,
    images: Vec<vk::Image>,
    /// Per image: signals that it is filled and may be shown.
    filled: Vec<vk::Semaphore>,
    format: vk::Format,
    size: [u32; 2],
}

/// Resources of one picture on its way to the window.
struct Slot {
    commands: vk::CommandBuffer,
    /// Signals that the window has provided an image.
    acquired: vk::Semaphore,
    /// Timeline value at which the slot is free again.
    done: u64,
}

/// Formats with 8-bit display values. The first needs no swizzle.
const FORMATS: [vk::Format; 2] = [vk::Format::R8G8B8A8_UNORM, vk::Format::B8G8R8A8_UNORM];

/// How long to wait for an image of the window \[ns\]. After that the picture is skipped.
const PATIENCE: u64 = 100_000_000;

impl Gpu {
    /// Opens a device, as `new` does, that can present to this display.
    ///
    /// # Errors
    /// As `new`. Also fails if the display, the driver or the device cannot present.
    pub fn for_display(options: &Options, display: RawDisplayHandle) -> Result<Self> {
        let of_instance = ash_window::enumerate_required_extensions(display)
            .map_err(|_| Error::NoDevice("Vulkan does not support this window system".into()))?;
        Self::open(options, of_instance, &[khr::swapchain::NAME.as_ptr()])
    }

    /// Creates the images of a window.
    ///
    /// # Errors
    /// Fails if the device was not opened by `for_display` or cannot present to this window.
    pub fn swapchain(self: &Rc<Self>, window: Arc<dyn Window>, present: Present) -> Result<Swapchain> {
        let shared = &self.shared;
        let instance = &shared.instance;
        let entry = instance.entry.as_ref().expect("`for_display` has loaded Vulkan");
        let surfaces = khr::surface::Instance::new(entry, &instance.instance);
        let chains = khr::swapchain::Device::new(&instance.instance, &shared.device);
        let null = || Slot { commands: vk::CommandBuffer::null(), acquired: vk::Semaphore::null(), done: 0 };
        let mut made = Swapchain {
            gpu: self.clone(),
            surfaces,
            chains,
            surface: vk::SurfaceKHR::null(),
            chain: None,
            stale: false,
            slots: [null(), null()],
            next: 0,
            present,
            window,
        };
        made.make_surface()?;
        let count = FRAMES_IN_FLIGHT as u32;
        let info = vk::CommandBufferAllocateInfo::default().command_pool(shared.pool).command_buffer_count(count);
        // SAFETY: the pool is alive; the buffers are freed in `Drop`.
        let buffers = unsafe { shared.device.allocate_command_buffers(&info) }.map_err(vulkan("command buffers"))?;
        for (i, (slot, commands)) in made.slots.iter_mut().zip(buffers).enumerate() {
            slot.commands = commands;
            shared.name(commands, &format!("window.commands {i}"));
            slot.acquired = shared.semaphore(&format!("window.acquired {i}"))?;
        }
        Ok(made)
    }
}

impl Shared {
    fn semaphore(&self, name: &str) -> Result<vk::Semaphore> {
        // SAFETY: the device is alive; the caller destroys it.
        let made = unsafe { self.device.create_semaphore(&vk::SemaphoreCreateInfo::default(), None) };
        let made = made.map_err(vulkan("semaphore"))?;
        self.name(made, name);
        Ok(made)
    }
}

impl Swapchain {
    /// Creates the surface of the window.
    fn make_surface(&mut self) -> Result<()> {
        let shared = &self.gpu.shared;
        let refused = |what: &str| Error::NoDevice(format!("cannot draw to the window: {what}"));
        let display = self.window.display_handle().map_err(|e| refused(&e.to_string()))?;
        let window = self.window.window_handle().map_err(|e| refused(&e.to_string()))?;
        let entry = shared.instance.entry.as_ref().expect("`for_display` has loaded Vulkan");
        let instance = &shared.instance.instance;
        // SAFETY: window and display live as long as `self.window`, which is dropped after the surface.
        self.surface = unsafe { ash_window::create_surface(entry, instance, display.as_raw(), window.as_raw(), None) }
            .map_err(|r| refused(&r.to_string()))?;
        // The surface gets no name. It belongs to the instance, and some loaders crash when a device names it.
        // SAFETY: the surface was just created from this instance, to which the device belongs.
        let shows = queue_family(instance, shared.physical).map(|(family, _)| unsafe {
            self.surfaces.get_physical_device_surface_support(shared.physical, family, self.surface)
        });
        if shows != Some(Ok(true)) {
            return Err(Error::NoDevice("the device cannot present to this window; try another --device".into()));
        }
        Ok(())
    }

    /// Shows an image with format `R8G8B8A8_UNORM` at the window's top left corner. Returns whether it was shown: the
    /// window may have no pixels, or provide no image in time. Waits for the picture before the previous one, and as
    /// the present mode requires.
    ///
    /// # Errors
    /// Fails if the device is lost, or the window does not accept such pictures.
    ///
    /// # Panics
    /// Panics if the image has another format or belongs to another device, or a frame is being recorded.
    pub fn show(&mut self, image: &Image) -> Result<bool> {
        // A submission in between would complete what the frame uses too early.
        let recording = self.gpu.shared.recording.load(Ordering::SeqCst);
        assert!(!recording, "a frame is being recorded: nothing can be shown before it ends");
        assert!(Arc::ptr_eq(&self.gpu.shared, &image.shared), "{}: of another device", image.name);
        let copied = image.made.usage.contains(vk::ImageUsageFlags::TRANSFER_SRC);
        assert!(copied && image.made.format == FORMATS[0], "{}: cannot be presented", image.name);
        // A window that is being resized may change between two of these calls. The next attempt then finds it stable.
        for _ in 0..3 {
            let fits = self.chain.as_ref().is_some_and(|chain| chain.size == image.made.size);
            if (self.stale || !fits) && !self.make_chain(image.made.size)? {
                return Ok(false);
            }
            match self.try_show(image) {
                Ok(shown) => return Ok(shown),
                Err(vk::Result::ERROR_OUT_OF_DATE_KHR) => self.stale = true,
                Err(vk::Result::ERROR_SURFACE_LOST_KHR) => {
                    self.renew_surface()?;
                }
                Err(other) => return Err(vulkan("showing a picture")(other)),
            }
        }
        Ok(false)
    }

    /// What images the window can have.
    fn query(&self) -> std::result::Result<Supported, vk::Result> {
        self.gpu.shared.check_surface(Call::Query)?;
        let (physical, surface) = (self.gpu.shared.physical, self.surface);
        // SAFETY: the surface is alive, and the device was found to support it.
        unsafe {
            let capabilities = self.surfaces.get_physical_device_surface_capabilities(physical, surface)?;
            let formats = self.surfaces.get_physical_device_surface_formats(physical, surface)?;
            let modes = self.surfaces.get_physical_device_surface_present_modes(physical, surface)?;
            Ok((capabilities, formats, modes))
        }
    }

    /// Recreates the images at the window's size. Returns whether the window has pixels.
    fn make_chain(&mut self, wanted: [u32; 2]) -> Result<bool> {
        let found = match self.query() {
            Err(vk::Result::ERROR_SURFACE_LOST_KHR) => {
                self.renew_surface()?;
                self.query()
            }
            found => found,
        };
        let (can, formats, modes) = found.map_err(vulkan("querying the window"))?;
        let of_window = [can.current_extent.width, can.current_extent.height];
        let clamp = |i: usize, least: u32, most: u32| wanted[i].clamp(least, most.max(least));
        let size = if of_window == [u32::MAX; 2] {
            let (least, most) = (can.min_image_extent, can.max_image_extent);
            [clamp(0, least.width, most.width), clamp(1, least.height, most.height)]
        } else {
            of_window
        };
        if size.contains(&0) {
            self.drop_chain(None);
            return Ok(false);
        }
        let bytes = |format: &&vk::Format| {
            let same = |f: &vk::SurfaceFormatKHR| f.format == **format || f.format == vk::Format::UNDEFINED;
            formats.iter().any(|f| same(f) && f.color_space == vk::ColorSpaceKHR::SRGB_NONLINEAR)
        };
        let format = FORMATS.iter().find(bytes).copied();
        let usage = vk::ImageUsageFlags::TRANSFER_DST;
        let Some(format) = format.filter(|_| can.supported_usage_flags.contains(usage)) else {
            return Err(Error::NoDevice("the window does not accept 8-bit images; try another --device".into()));
        };
        let mode = match self.present {
            Present::Fifo => vk::PresentModeKHR::FIFO,
            Present::Mailbox => vk::PresentModeKHR::MAILBOX,
            Present::Immediate => vk::PresentModeKHR::IMMEDIATE,
        };
        let mode = if modes.contains(&mode) {
            mode
        } else {
            log::warn!("the window does not support present mode {:?}; using Fifo", self.present);
            self.present = Present::Fifo;
            vk::PresentModeKHR::FIFO
        };
        let opaque = can.supported_composite_alpha.contains(vk::CompositeAlphaFlagsKHR::OPAQUE);
        let alpha = if opaque { vk::CompositeAlphaFlagsKHR::OPAQUE } else { vk::CompositeAlphaFlagsKHR::INHERIT };
        let most = if can.max_image_count == 0 { u32::MAX } else { can.max_image_count };
        let info = vk::SwapchainCreateInfoKHR::default()
            .surface(self.surface)
            .min_image_count((can.min_image_count + 1).min(most))
            .image_format(format)
            .image_color_space(vk::ColorSpaceKHR::SRGB_NONLINEAR)
            .image_extent(vk::Extent2D { width: size[0], height: size[1] })
            .image_array_layers(1)
            .image_usage(usage)
            .pre_transform(can.current_transform)
            .composite_alpha(alpha)
            .present_mode(mode)
            .clipped(true)
            .old_swapchain(self.chain.as_ref().map_or(vk::SwapchainKHR::null(), |chain| chain.handle));
        // SAFETY: everything in `info` was found to be supported, and the old chain belongs to this surface.
        let handle = match unsafe { self.chains.create_swapchain(&info, None) } {
            // The next frame finds a new surface.
            Err(vk::Result::ERROR_SURFACE_LOST_KHR) => {
                self.renew_surface()?;
                return Ok(false);
            }
            made => made,
        };
        let handle = handle.map_err(vulkan(format!("images of the window, {}x{}", size[0], size[1])))?;
        self.gpu.shared.name(handle, "window.chain");
        self.drop_chain(Some(Chain { handle, images: Vec::new(), filled: Vec::new(), format, size }));
        self.stale = false;
        // SAFETY: the chain is alive.
        let images = unsafe { self.chains.get_swapchain_images(handle) }.map_err(vulkan("images of the window"))?;
        let mut filled = Vec::with_capacity(images.len());
        for (i, image) in images.iter().enumerate() {
            self.gpu.shared.name(*image, &format!("window.image {i}"));
            filled.push(self.gpu.shared.semaphore(&format!("window.filled {i}"))?);
        }
        if let Some(chain) = &mut self.chain {
            (chain.images, chain.filled) = (images, filled);
        }
        Ok(true)
    }

    /// Fills an image of the window and presents it.
    fn try_show(&mut self, image: &Image) -> std::result::Result<bool, vk::Result> {
        // New images may be dropped by another thread while this submission refers to them.
        struct Recording(Arc<Shared>);
        impl Drop for Recording {
            fn drop(&mut self) {
                self.0.end_recording();
            }
        }
        let recording = Recording(self.gpu.shared.clone());
        recording.0.begin_recording();
        self.fill_and_present(image)
    }

    fn fill_and_present(&mut self, image: &Image) -> std::result::Result<bool, vk::Result> {
        let Some(chain) = &self.chain else { return Ok(false) };
        let slot = &mut self.slots[self.next];
        self.gpu.shared.wait_for(slot.done).map_err(|_| vk::Result::ERROR_DEVICE_LOST)?;
        self.gpu.shared.check_lost(Call::Acquire)?;
        self.gpu.shared.check_surface(Call::Surface)?;
        // SAFETY: chain and semaphore are alive; the semaphore's last wait is done with its slot.
        let acquired =
            unsafe { self.chains.acquire_next_image(chain.handle, PATIENCE, slot.acquired, vk::Fence::null()) };
        let (index, suboptimal) = match acquired {
            Err(vk::Result::TIMEOUT | vk::Result::NOT_READY) => return Ok(false),
            other => other?,
        };
        self.next = (self.next + 1) % FRAMES_IN_FLIGHT;
        self.stale |= suboptimal;
        let filled = chain.filled[index as usize];
        let submitted = &self.gpu.shared.submitted;
        let value = submitted.load(Ordering::SeqCst) + 1;
        let fresh = self.gpu.shared.fresh();
        let transfer = vk::PipelineStageFlags2::ALL_TRANSFER;
        let semaphore = |semaphore, stage| vk::SemaphoreSubmitInfo::default().semaphore(semaphore).stage_mask(stage);
        let waits = [semaphore(slot.acquired, transfer)];
        let signals = [
            semaphore(filled, vk::PipelineStageFlags2::ALL_COMMANDS),
            semaphore(self.gpu.shared.timeline, vk::PipelineStageFlags2::ALL_COMMANDS).value(value),
        ];
        let commands = [vk::CommandBufferSubmitInfo::default().command_buffer(slot.commands)];
        let info = vk::SubmitInfo2::default()
            .wait_semaphore_infos(&waits)
            .command_buffer_infos(&commands)
            .signal_semaphore_infos(&signals);
        let (device, begin) = (&self.gpu.shared.device, vk::CommandBufferBeginInfo::default());
        // SAFETY: the slot's last submission is done, so its buffer may be recorded again. `copy` stays within both
        // images. The previous presentation of this image waited for `filled` and has ended, since the image was
        // acquired again.
        let filled_it = unsafe {
            let once = begin.flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
            device
                .begin_command_buffer(slot.commands, &once)
                .map(|()| copy(device, slot.commands, &fresh, image, chain, chain.images[index as usize]))
                .and_then(|()| device.end_command_buffer(slot.commands))
                .and_then(|()| self.gpu.shared.check_lost(Call::Submit))
                .and_then(|()| device.queue_submit2(self.gpu.queue, &[info], vk::Fence::null()))
        };
        // New images are forgotten if their submission fails; see `forgotten`.
        filled_it.map_err(|_| vk::Result::ERROR_DEVICE_LOST)?;
        submitted.store(value, Ordering::SeqCst);
        slot.done = value;
        let (chains, indices, filled) = ([chain.handle], [index], [filled]);
        let info = vk::PresentInfoKHR::default().wait_semaphores(&filled).swapchains(&chains).image_indices(&indices);
        self.gpu.shared.check_lost(Call::Present)?;
        // SAFETY: the image was acquired, and the submission above transitions it to the layout for presentation.
        match unsafe { self.chains.queue_present(self.gpu.queue, &info) } {
            Ok(suboptimal) => self.stale |= suboptimal,
            // The window was resized before the picture was presented.
            Err(vk::Result::ERROR_OUT_OF_DATE_KHR) => self.stale = true,
            Err(other) => return Err(other),
        }
        Ok(true)
    }

    /// Waits until nothing uses the chain, and replaces it.
    fn drop_chain(&mut self, new: Option<Chain>) {
        let Some(old) = std::mem::replace(&mut self.chain, new) else { return };
        self.gpu.shared.wait_to_drop();
        // SAFETY: once the queue is idle, nothing that was submitted refers to the images and semaphores.
        unsafe {
            if let Err(result) = self.gpu.shared.device.queue_wait_idle(self.gpu.queue) {
                log::debug!("waiting for a window: {result}");
            }
            for semaphore in old.filled {
                self.gpu.shared.device.destroy_semaphore(semaphore, None);
            }
            self.chains.destroy_swapchain(old.handle, None);
        }
    }

    /// Replaces a surface that was lost.
    fn renew_surface(&mut self) -> Result<()> {
        log::warn!("the window's surface was lost; lightskin continues on a new one");
        self.drop_surface();
        self.make_surface()
    }

    fn drop_surface(&mut self) {
        self.drop_chain(None);
        let surface = std::mem::replace(&mut self.surface, vk::SurfaceKHR::null());
        // SAFETY: its chain has been destroyed, and the instance is alive; null handles are ignored.
        unsafe { self.surfaces.destroy_surface(surface, None) };
    }
}

/// Records the copy of an image to one of the window, limited to the size of the smaller one.
///
/// # Safety
/// The buffer must be recording. Both images must be alive, the window's image must be acquired, and `fresh` may only
/// refer to live images.
unsafe fn copy(
    device: &ash::Device,
    commands: vk::CommandBuffer,
    fresh: &[vk::ImageMemoryBarrier2<'_>],
    image: &Image,
    chain: &Chain,
    to: vk::Image,
) {
    let (all, transfer) = (vk::PipelineStageFlags2::ALL_COMMANDS, vk::PipelineStageFlags2::ALL_TRANSFER);
    let (undefined, target) = (vk::ImageLayout::UNDEFINED, vk::ImageLayout::TRANSFER_DST_OPTIMAL);
    let range = vk::ImageSubresourceRange {
        aspect_mask: vk::ImageAspectFlags::COLOR,
        level_count: 1,
        layer_count: 1,
        ..Default::default()
    };
    let before = [vk::MemoryBarrier2::default()
        .src_stage_mask(all)
        .src_access_mask(vk::AccessFlags2::MEMORY_WRITE)
        .dst_stage_mask(transfer)
        .dst_access_mask(vk::AccessFlags2::TRANSFER_READ)];
    let change = |from, to_layout| {
        vk::ImageMemoryBarrier2::default()
            .image(to)
            .subresource_range(range)
            .src_stage_mask(transfer)
            .dst_stage_mask(transfer)
            .old_layout(from)
            .new_layout(to_layout)
    };
    let writes = vk::AccessFlags2::TRANSFER_WRITE;
    let mut images = fresh.to_vec();
    images.push(change(undefined, target).dst_access_mask(writes));
    let cleared = [change(target, target).src_access_mask(writes).dst_access_mask(writes)];
    let after = [change(target, vk::ImageLayout::PRESENT_SRC_KHR)
        .src_access_mask(writes)
        .dst_stage_mask(vk::PipelineStageFlags2::NONE)];
    let [width, height] = [0, 1].map(|i| image.made.size[i].min(chain.size[i]));
    let layers =
        vk::ImageSubresourceLayers { aspect_mask: vk::ImageAspectFlags::COLOR, layer_count: 1, ..Default::default() };
    let corner = vk::Offset3D { x: width as i32, y: height as i32, z: 1 };
    // SAFETY: see above; both images contain the region and are in the given layouts.
    unsafe {
        let info = vk::DependencyInfo::default().memory_barriers(&before).image_memory_barriers(&images);
        device.cmd_pipeline_barrier2(commands, &info);
        if [width, height] != chain.size {
            let black = vk::ClearColorValue { float32: [0.0, 0.0, 0.0, 1.0] };
            device.cmd_clear_color_image(commands, to, target, &black, &[range]);
            device.cmd_pipeline_barrier2(commands, &vk::DependencyInfo::default().image_memory_barriers(&cleared));
        }
        if chain.format == image.made.format {
            let region = vk::ImageCopy {
                src_subresource: layers,
                dst_subresource: layers,
                extent: vk::Extent3D { width, height, depth: 1 },
                ..Default::default()
            };
            let general = vk::ImageLayout::GENERAL;
            device.cmd_copy_image(commands, image.handle, general, to, target, &[region]);
        } else {
            // The sizes are equal, so only the order of the bytes changes.
            let region = vk::ImageBlit {
                src_subresource: layers,
                src_offsets: [vk::Offset3D::default(), corner],
                dst_subresource: layers,
                dst_offsets: [vk::Offset3D::default(), corner],
            };
            let (general, nearest) = (vk::ImageLayout::GENERAL, vk::Filter::NEAREST);
            device.cmd_blit_image(commands, image.handle, general, to, target, &[region], nearest);
        }
        device.cmd_pipeline_barrier2(commands, &vk::DependencyInfo::default().image_memory_barriers(&after));
    }
}

impl Drop for Swapchain {
    fn drop(&mut self) {
        self.gpu.shared.wait_to_drop();
        self.drop_surface();
        let device = &self.gpu.shared.device;
        let commands = self.slots.each_ref().map(|slot| slot.commands);
        // SAFETY: nothing is in use after the wait; null handles are ignored.
        unsafe {
            for slot in &self.slots {
                device.destroy_semaphore(slot.acquired, None);
            }
            device.free_command_buffers(self.gpu.shared.pool, &commands);
        }
    }
}
