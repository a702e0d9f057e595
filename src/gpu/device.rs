//! An open device: queue, allocator, and the state shared by everything created from it.

use super::descriptors::Descriptors;
use super::disk::Disk;
use super::faults::{Call, Lost};
use super::frames::Ring;
use super::graveyard::{Graveyard, lock};
use super::instance::{
    DeviceReport, Instance, Needs, Validation, inspect, needs, open_instance, pick, queue_family, voting_threads,
};
use super::layout::Layouts;
use super::pipeline::Pipelines;
use super::registry::Registry;
use super::timer::Clock;
use super::vulkan;
use crate::error::{Error, Result};
use ash::{ext, vk};
use gpu_allocator::vulkan::{Allocator, AllocatorCreateDesc};
use std::cell::Cell;
use std::collections::HashMap;
use std::ffi::c_char;
use std::ops::Deref;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// How to open a device.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Index or part of a name; `None` selects the most capable device.
    pub device: Option<String>,
    /// Validation layer and barrier check.
    pub validation: Validation,
}

/// Instance and device that a host has opened itself: see `Gpu::from_raw`.
#[derive(Clone)]
pub struct Host {
    /// The instance.
    pub instance: ash::Instance,
    /// The physical device.
    pub physical: vk::PhysicalDevice,
    /// The device.
    pub device: ash::Device,
    /// A queue family with graphics and compute.
    pub family: u32,
    /// Index of the queue in its family.
    pub queue: u32,
    /// Whether the instance has the extension VK_EXT_debug_utils. If so, all objects get names.
    pub debug_utils: bool,
    /// Whether the feature geometryShader is enabled. With it, fragment shaders know the index of their triangle.
    /// Without it, vertex shaders count, which costs more.
    pub geometry_shader: bool,
    /// Whether the features subgroupSizeControl and computeFullSubgroups are enabled. They make clusters faster.
    pub subgroup_sizes: bool,
    /// Whether the engine's own barrier check runs.
    pub check_barriers: bool,
}

/// State of an open device, besides the handles.
struct Open {
    physical: vk::PhysicalDevice,
    family: u32,
    queue: u32,
    geometry_shader: bool,
    voting_threads: Option<u32>,
    check_barriers: bool,
}

/// State that every Vulkan object needs for its creation and destruction.
pub(crate) struct Shared {
    pub(crate) device: ash::Device,
    pub(crate) allocator: Mutex<Option<Allocator>>,
    pub(crate) names: Option<ext::debug_utils::Device>,
    pub(crate) limits: vk::PhysicalDeviceLimits,
    pub(crate) max_buffer_size: u64,
    pub(crate) pool: vk::CommandPool,
    /// Counts completed submissions.
    pub(crate) timeline: vk::Semaphore,
    /// Counts submissions.
    pub(crate) submitted: AtomicU64,
    /// Whether commands for the next submission are being recorded.
    pub(super) recording: AtomicBool,
    pub(super) graveyard: Mutex<Graveyard>,
    pub(super) descriptors: Mutex<Descriptors>,
    pub(super) registry: Mutex<Registry>,
    /// Reserved memory, and how much may be reserved \[bytes\].
    pub(super) memory: AtomicU64,
    pub(super) most_memory: AtomicU64,
    pub(super) lost: Mutex<Lost>,
    next_id: AtomicU64,
    pub(super) physical: vk::PhysicalDevice,
    pub(super) instance: Instance,
}

/// An open device, from which buffers, images and pipelines are created: on any thread, also while another one records
/// a frame.
pub struct Device {
    pub(super) pipelines: Mutex<Pipelines>,
    pub(super) layouts: Mutex<Layouts>,
    pub(super) disk: Disk,
    pub(crate) samplers: Mutex<HashMap<super::SamplerKind, vk::Sampler>>,
    numbers_triangles: bool,
    most_texels: u64,
    voting_threads: Option<u32>,
    report: DeviceReport,
    pub(crate) shared: Arc<Shared>,
}

/// A device with its queue and its frames. One thread records at a time (the type is not `Sync`).
pub struct Gpu {
    pub(crate) ring: Ring,
    pub(super) times_shaders: Cell<bool>,
    pub(crate) queue: vk::Queue,
    pub(crate) clock: Clock,
    pub(crate) check_barriers: bool,
    device: Arc<Device>,
}

/// Maximum number of frames in flight: the CPU writes one while the GPU draws the other.
pub(crate) const FRAMES_IN_FLIGHT: usize = 2;

impl Shared {
    /// A new identity for a resource. Unlike a handle, it is never reused.
    pub(crate) fn new_id(&self) -> u64 {
        self.next_id.fetch_add(1, Ordering::Relaxed)
    }

    /// Called before commands are recorded: they may refer to resources that are dropped from here on.
    pub(super) fn begin_recording(&self) {
        self.recording.store(true, Ordering::SeqCst);
    }

    /// Called after the submission of recorded commands has been counted, so that resources dropped in between are kept
    /// long enough.
    pub(super) fn end_recording(&self) {
        self.recording.store(false, Ordering::SeqCst);
    }

    /// Waits until all submissions are complete. Objects destroyed afterwards are not in use.
    pub(crate) fn wait(&self) -> Result<()> {
        self.wait_for(self.submitted.load(Ordering::SeqCst))
    }

    /// Waits for a submission, by its number.
    pub(crate) fn wait_for(&self, value: u64) -> Result<()> {
        let (semaphores, values) = ([self.timeline], [value]);
        let info = vk::SemaphoreWaitInfo::default().semaphores(&semaphores).values(&values);
        // SAFETY: the semaphore is alive and its value only grows.
        let waited = unsafe { self.device.wait_semaphores(&info, u64::MAX) };
        waited.and_then(|()| self.check_lost(Call::Wait)).map_err(vulkan("waiting for the device"))
    }

    /// `wait` for destructors. A lost device counts as done.
    pub(crate) fn wait_to_drop(&self) {
        if let Err(error) = self.wait() {
            log::debug!("{error}");
        }
    }

    /// Names an object for validation messages and captures.
    pub(crate) fn name<H: vk::Handle>(&self, handle: H, name: &str) {
        if let Some(names) = &self.names {
            let name = std::ffi::CString::new(name.replace('\0', "?")).unwrap_or_default();
            let info = vk::DebugUtilsObjectNameInfoEXT::default().object_handle(handle).object_name(&name);
            // SAFETY: the handle was just made from this device and the name lives until the call returns.
            if let Err(result) = unsafe { names.set_debug_utils_object_name(&info) } {
                log::debug!("object name: {result}");
            }
        }
    }
}

impl Gpu {
    /// Opens a device. With `Validation::Sync` the engine's own barrier check runs as well.
    ///
    /// # Errors
    /// Fails if there is no Vulkan, no device that can run the engine (the error says what each lacks), or the device
    /// cannot be opened.
    pub fn new(options: &Options) -> Result<Self> {
        Self::open(options, &[], &[])
    }

    /// Opens a device with these instance and device extensions.
    pub(super) fn open(options: &Options, of_instance: &[*const c_char], of_device: &[*const c_char]) -> Result<Self> {
        let opened = open_instance(options.validation, of_instance)?;
        let instance = &opened.instance;
        let (physical, report) = pick(instance, options.device.as_deref())?;
        let (family, _) = queue_family(instance, physical).expect("inspected");
        let priorities = [1.0];
        let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(family).queue_priorities(&priorities)];
        let voting_threads = voting_threads(instance, physical);
        let Needs { mut v12, v13, .. } = needs();
        let mut v13 =
            v13.subgroup_size_control(voting_threads.is_some()).compute_full_subgroups(voting_threads.is_some());
        // SAFETY: plain query.
        let has = unsafe { instance.get_physical_device_features(physical) };
        let geometry_shader = has.geometry_shader == vk::TRUE;
        let features = vk::PhysicalDeviceFeatures::default().geometry_shader(geometry_shader);
        let info = vk::DeviceCreateInfo::default()
            .queue_create_infos(&queues)
            .enabled_features(&features)
            .enabled_extension_names(of_device)
            .push_next(&mut v12)
            .push_next(&mut v13);
        // SAFETY: the features were found by `inspect`, and every pointer outlives the call.
        let device = unsafe { instance.create_device(physical, &info, None) }
            .map_err(vulkan(format!("opening {}", report.name)))?;
        let check_barriers = options.validation == Validation::Sync;
        Self::of(
            opened,
            device,
            report,
            Open { physical, family, queue: 0, geometry_shader, voting_threads, check_barriers },
        )
    }

    /// Everything that a host must enable if it opens the device itself.
    pub fn needs() -> Needs {
        needs()
    }

    /// Uses an instance and a device that the host has opened, such as an XR runtime or an application. Both remain the
    /// host's; nothing here destroys them.
    ///
    /// # Errors
    /// Fails if the device lacks a requirement, or memory for the first objects.
    ///
    /// # Safety
    /// All statements in `host` must be true. Instance and device must have been created with everything that `needs`
    /// lists, and outlive the `Gpu` and everything created from it. During that time no other thread may use the queue
    /// at the same time.
    pub unsafe fn from_raw(host: Host) -> Result<Self> {
        let Host {
            instance,
            physical,
            device,
            family,
            queue,
            debug_utils,
            geometry_shader,
            subgroup_sizes,
            check_barriers,
        } = host;
        let report = inspect(&instance, physical, 0);
        if !report.missing.is_empty() {
            return Err(Error::NoDevice(format!("{} lacks {}", report.name, report.missing.join(", "))));
        }
        let voting_threads = voting_threads(&instance, physical).filter(|_| subgroup_sizes);
        let opened = Instance::of_host(instance, debug_utils);
        Self::of(
            opened,
            device,
            report,
            Open { physical, family, queue, geometry_shader, voting_threads, check_barriers },
        )
    }

    /// Wraps a device that is already open.
    fn of(opened: Instance, device: ash::Device, report: DeviceReport, open: Open) -> Result<Self> {
        let instance = &opened.instance;
        let Open { physical, family, queue, geometry_shader, voting_threads, check_barriers } = open;
        let mut sizes = vk::PhysicalDeviceMaintenance4Properties::default();
        let mut properties = vk::PhysicalDeviceProperties2::default().push_next(&mut sizes);
        // SAFETY: plain query; a 1.3 device knows the chained struct.
        unsafe { instance.get_physical_device_properties2(physical, &mut properties) };
        let properties = properties.properties;
        let limits = properties.limits;
        // SAFETY: plain query.
        let families = unsafe { instance.get_physical_device_queue_family_properties(physical) };
        let timestamp_bits = families[family as usize].timestamp_valid_bits;
        // From here on, `shared` destroys everything created so far, even if something below fails.
        let mut shared = Shared {
            names: opened.has_debug_utils.then(|| ext::debug_utils::Device::new(instance, &device)),
            allocator: Mutex::new(None),
            limits,
            max_buffer_size: sizes.max_buffer_size,
            pool: vk::CommandPool::null(),
            timeline: vk::Semaphore::null(),
            submitted: AtomicU64::new(0),
            recording: AtomicBool::new(false),
            graveyard: Mutex::default(),
            descriptors: Mutex::default(),
            registry: Mutex::default(),
            memory: AtomicU64::new(0),
            most_memory: AtomicU64::new(u64::MAX),
            lost: Mutex::default(),
            next_id: AtomicU64::new(1),
            device,
            physical,
            instance: opened,
        };
        let allocator = Allocator::new(&AllocatorCreateDesc {
            instance: shared.instance.instance.clone(),
            device: shared.device.clone(),
            physical_device: physical,
            debug_settings: Default::default(),
            buffer_device_address: false,
            allocation_sizes: Default::default(),
        })
        .map_err(|e| Error::Vulkan { what: "creating the memory allocator".into(), result: e.to_string() })?;
        shared.allocator = Mutex::new(Some(allocator));
        let pool = vk::CommandPoolCreateInfo::default()
            .queue_family_index(family)
            .flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER);
        // SAFETY: the device is alive and the family its own.
        shared.pool = unsafe { shared.device.create_command_pool(&pool, None) }.map_err(vulkan("command pool"))?;
        shared.name(shared.pool, "gpu.commands");
        let mut kind = vk::SemaphoreTypeCreateInfo::default().semaphore_type(vk::SemaphoreType::TIMELINE);
        let timeline = vk::SemaphoreCreateInfo::default().push_next(&mut kind);
        // SAFETY: timelineSemaphore is enabled.
        shared.timeline = unsafe { shared.device.create_semaphore(&timeline, None) }.map_err(vulkan("timeline"))?;
        shared.name(shared.timeline, "gpu.timeline");
        // SAFETY: the device was opened with this queue.
        let queue = unsafe { shared.device.get_device_queue(family, queue) };
        let shared = Arc::new(shared);
        shared.name(queue, "gpu.queue");
        log::info!(
            "device {}: {} ({}, {}, Vulkan {})",
            report.index,
            report.name,
            report.kind,
            report.driver,
            report.api
        );
        let device = Device {
            pipelines: Mutex::default(),
            layouts: Mutex::default(),
            disk: Disk::open(&shared, &properties),
            samplers: Mutex::default(),
            numbers_triangles: geometry_shader,
            most_texels: limits.max_texel_buffer_elements.into(),
            voting_threads,
            report,
            shared: shared.clone(),
        };
        Ok(Self {
            ring: Ring::new(&shared)?,
            times_shaders: Cell::new(false),
            queue,
            clock: Clock { period_ns: f64::from(limits.timestamp_period), bits: timestamp_bits.min(64) },
            check_barriers,
            device: Arc::new(device),
        })
    }

    /// The device, for another thread that creates resources.
    pub fn device(&self) -> &Arc<Device> {
        &self.device
    }

    /// The device before anything was created from it, for tests that take abilities away.
    fn untouched(&mut self) -> &mut Device {
        Arc::get_mut(&mut self.device).expect("no other thread has the device yet")
    }

    /// Makes the device act as if its fragment shaders did not know their triangle; for tests.
    pub fn without_triangle_numbers(mut self) -> Self {
        self.untouched().numbers_triangles = false;
        self
    }

    /// Gives every dispatch its own zone from now on, named after its shader. Not in frames whose zones are submitted
    /// separately.
    pub fn time_shaders(&self) {
        self.times_shaders.set(true);
    }

    /// Limits texel buffers to the size that every device allows; for tests.
    pub fn with_few_texels(mut self) -> Self {
        self.untouched().most_texels = 65_536;
        self
    }

    /// Makes the device act as if its subgroups could not vote, as on some devices; for tests.
    pub fn without_votes(mut self) -> Self {
        self.untouched().voting_threads = None;
        self
    }

    /// Whether the queue has timestamps. Without them zones have no GPU time; everything else works.
    pub fn has_timestamps(&self) -> bool {
        self.clock.bits > 0
    }

    /// Makes the device act as if its queue had no timestamps, as on some devices; for tests.
    pub fn without_timestamps(mut self) -> Self {
        self.clock.bits = 0;
        self
    }
}

impl Deref for Gpu {
    type Target = Device;

    fn deref(&self) -> &Device {
        &self.device
    }
}

impl Device {
    /// Description of the open device.
    pub fn report(&self) -> &DeviceReport {
        &self.report
    }

    /// Whether the device is the CPU. There, ratios of times are meaningful but absolute times are not.
    pub fn is_software(&self) -> bool {
        self.report.kind == "software"
    }

    /// Maximum size of a buffer that shaders can access at once \[bytes\].
    pub fn most_buffer_bytes(&self) -> u64 {
        self.shared.limits.max_storage_buffer_range.into()
    }

    /// Maximum number of colour targets that a fragment shader can write at a time.
    pub fn most_color_targets(&self) -> u32 {
        let limits = &self.shared.limits;
        let all = [limits.max_color_attachments, limits.max_fragment_output_attachments];
        all.into_iter().fold(limits.max_fragment_combined_output_resources, u32::min)
    }

    /// Whether fragment shaders know which triangle they belong to. Vulkan provides this with geometry shaders, which
    /// desktop devices and lavapipe have, but MoltenVK and SwiftShader lack.
    pub fn numbers_triangles(&self) -> bool {
        self.numbers_triangles
    }

    /// Number of positions along a pixel's side to which the rasteriser moves vertices: 16 to 256. Drawn surfaces are
    /// off their triangles by up to such a step. `None` on llvmpipe, which draws from exact positions.
    pub fn subpixels(&self) -> Option<u32> {
        let exact = self.report.name.starts_with("llvmpipe");
        (!exact).then(|| 1 << self.shared.limits.sub_pixel_precision_bits)
    }

    /// Maximum number of texels of a texel buffer: 65 536 on some devices, millions on most.
    pub fn most_texels(&self) -> u64 {
        self.most_texels
    }

    /// Whether shaders should read buffers of this size \[bytes\] as texels. Software devices load buffers word by word,
    /// but texels of four words at once.
    pub(crate) fn reads_texels(&self, bytes: u64) -> bool {
        self.is_software() && bytes / 16 <= self.most_texels
    }

    /// Threads of a compute subgroup, 32 or 8, if the device supports a fixed size of these and voting within
    /// subgroups.
    pub fn voting_threads(&self) -> Option<u32> {
        self.voting_threads
    }

    /// Messages of the validation layer so far, oldest first. There should be none.
    pub fn messages(&self) -> Vec<String> {
        self.shared.instance.messages.lock().expect("message sink").clone()
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        let pipelines = self.pipelines.get_mut().unwrap_or_else(PoisonError::into_inner);
        self.disk.close(&self.shared, pipelines.made());
        pipelines.clear();
        self.shared.wait_to_drop();
        self.shared.collect();
        // SAFETY: nothing is in use after the wait; the samplers are this device's.
        unsafe {
            for (_, sampler) in self.samplers.get_mut().unwrap_or_else(PoisonError::into_inner).drain() {
                self.shared.device.destroy_sampler(sampler, None);
            }
        }
    }
}

impl Drop for Shared {
    fn drop(&mut self) {
        self.collect_all();
        lock(&self.descriptors).destroy(&self.device);
        drop(lock(&self.allocator).take());
        // SAFETY: `Shared` is dropped when the last object created from the device has been dropped; null handles are
        // ignored.
        unsafe {
            self.device.destroy_semaphore(self.timeline, None);
            self.device.destroy_command_pool(self.pool, None);
            if self.instance.owned {
                self.device.destroy_device(None);
            }
        }
    }
}
