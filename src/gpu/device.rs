//! Instance, device choice, queue, allocator, and the sink of validation messages.

use super::frames::Ring;
use super::timer::Clock;
use super::{pipeline::DescriptorCache, vulkan};
use crate::error::{Error, Result};
use ash::{ext, vk};
use gpu_allocator::vulkan::{Allocator, AllocatorCreateDesc};
use std::cell::RefCell;
use std::collections::HashMap;
use std::ffi::{CStr, c_char, c_void};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

/// Which checks the Khronos validation layer makes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Validation {
    /// No layer.
    #[default]
    Off,
    /// Core validation.
    Core,
    /// Core and synchronization validation; the engine's own barrier check runs too.
    Sync,
}

/// How to open a device.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Index or part of a name; the most capable device when `None`.
    pub device: Option<String>,
    /// Validation layer and barrier check.
    pub validation: Validation,
}

/// One line of `lightskin devices`.
#[derive(Clone, Debug)]
pub struct DeviceReport {
    /// Index for `--device`.
    pub index: usize,
    /// Name as the driver gives it.
    pub name: String,
    /// Driver name and version.
    pub driver: String,
    /// Vulkan version of the device.
    pub api: String,
    /// "discrete GPU", "software" ...
    pub kind: &'static str,
    /// What the engine needs and the device has not; empty for a usable device.
    pub missing: Vec<String>,
}

/// Collected messages of the validation layer; shared with its callback.
type Messages = Mutex<Vec<String>>;

/// The instance with its messenger; destroyed together, after the device.
struct Instance {
    instance: ash::Instance,
    debug: Option<(ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    messages: Box<Messages>,
    has_debug_utils: bool,
    entry: ash::Entry,
}

/// What every Vulkan object of ours needs to be made and destroyed.
pub(crate) struct Shared {
    pub(crate) device: ash::Device,
    pub(crate) allocator: Mutex<Option<Allocator>>,
    pub(crate) names: Option<ext::debug_utils::Device>,
    pub(crate) limits: vk::PhysicalDeviceLimits,
    pub(crate) max_buffer_size: u64,
    pub(crate) pool: vk::CommandPool,
    /// Counts submissions that are done.
    pub(crate) timeline: vk::Semaphore,
    /// Counts submissions.
    pub(crate) submitted: AtomicU64,
    next_id: AtomicU64,
    instance: Instance,
}

/// An open device: everything else is made from it. One thread records at a time (the type is not `Sync`).
pub struct Gpu {
    pub(crate) ring: Ring,
    pub(crate) descriptors: RefCell<DescriptorCache>,
    pub(crate) samplers: RefCell<HashMap<super::SamplerKind, vk::Sampler>>,
    pub(crate) queue: vk::Queue,
    pub(crate) clock: Clock,
    pub(crate) check_barriers: bool,
    numbers_triangles: bool,
    voting_threads: Option<u32>,
    report: DeviceReport,
    pub(crate) shared: Arc<Shared>,
}

/// Frames that may be under way at once: the CPU writes one while the GPU draws the other.
pub(crate) const FRAMES_IN_FLIGHT: usize = 2;

impl Shared {
    /// An identity for a resource that is never used again, unlike a handle.
    pub(crate) fn new_id(&self) -> u64 {
        self.next_id.fetch_add(1, Ordering::Relaxed)
    }

    /// Waits until everything submitted is done. Whatever is destroyed afterwards is not in use.
    pub(crate) fn wait(&self) -> Result<()> {
        self.wait_for(self.submitted.load(Ordering::SeqCst))
    }

    pub(crate) fn wait_for(&self, value: u64) -> Result<()> {
        let (semaphores, values) = ([self.timeline], [value]);
        let info = vk::SemaphoreWaitInfo::default().semaphores(&semaphores).values(&values);
        // SAFETY: the semaphore is alive and its value only grows.
        unsafe { self.device.wait_semaphores(&info, u64::MAX) }.map_err(vulkan("waiting for the device"))
    }

    /// `wait` for destructors: a lost device is done as well.
    pub(crate) fn wait_to_drop(&self) {
        if let Err(error) = self.wait() {
            log::debug!("{error}");
        }
    }

    /// Gives an object the name under which validation messages and captures show it.
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

/// All devices that the Vulkan loader finds, with what each lacks.
pub fn devices() -> Result<Vec<DeviceReport>> {
    let opened = open_instance(Validation::Off)?;
    // SAFETY: the instance is alive.
    unsafe { opened.instance.enumerate_physical_devices() }
        .map_err(vulkan("enumerating devices"))
        .map(|all| all.iter().enumerate().map(|(i, d)| inspect(&opened.instance, *d, i)).collect())
}

/// Loads the Vulkan library and makes an instance, with a messenger if there is validation.
fn open_instance(validation: Validation) -> Result<Instance> {
    // SAFETY: loading the system's Vulkan loader runs its initialisers, which we must trust like any library's.
    let entry = unsafe { ash::Entry::load() }.map_err(|e| {
        Error::NoDevice(format!("no Vulkan loader ({e}); install libvulkan1 and a driver (mesa-vulkan-drivers has one for machines without a GPU)"))
    })?;
    let layer = c"VK_LAYER_KHRONOS_validation";
    let mut layers: Vec<*const c_char> = Vec::new();
    let mut layer_settings = false;
    if validation != Validation::Off {
        // SAFETY: plain queries of the loader.
        let found = unsafe { entry.enumerate_instance_layer_properties() }.map_err(vulkan("listing layers"))?;
        if !found.iter().any(|l| l.layer_name_as_c_str() == Ok(layer)) {
            return Err(Error::NoDevice(
                "the validation layer is not installed; install vulkan-validationlayers or use --validation off".into(),
            ));
        }
        layers.push(layer.as_ptr());
        // SAFETY: plain query; the layer's name is a valid C string.
        let extensions = unsafe { entry.enumerate_instance_extension_properties(Some(layer)) };
        layer_settings =
            extensions.unwrap_or_default().iter().any(|e| e.extension_name_as_c_str() == Ok(ext::layer_settings::NAME));
    }
    // SAFETY: plain query of the loader.
    let available =
        unsafe { entry.enumerate_instance_extension_properties(None) }.map_err(vulkan("listing extensions"))?;
    let mut extensions: Vec<*const c_char> = Vec::new();
    let has_debug = validation != Validation::Off
        || available.iter().any(|e| e.extension_name_as_c_str() == Ok(ext::debug_utils::NAME));
    if has_debug {
        extensions.push(ext::debug_utils::NAME.as_ptr());
    }
    let app = vk::ApplicationInfo::default().application_name(c"lightskin").api_version(vk::API_VERSION_1_3);
    let mut info = vk::InstanceCreateInfo::default().application_info(&app).enabled_layer_names(&layers);

    // Two spellings of "check synchronization too": layer settings on new layers, validation features on old ones.
    // New layers also skip shader accesses unless asked.
    let on = [vk::TRUE];
    let settings = [c"validate_sync", c"syncval_shader_accesses_heuristic"].map(|name| {
        let mut setting =
            vk::LayerSettingEXT::default().layer_name(layer).setting_name(name).ty(vk::LayerSettingTypeEXT::BOOL32);
        setting.value_count = 1;
        setting.p_values = on.as_ptr().cast();
        setting
    });
    let mut new_style = vk::LayerSettingsCreateInfoEXT::default().settings(&settings);
    let enable = [vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION];
    let mut old_style = vk::ValidationFeaturesEXT::default().enabled_validation_features(&enable);
    if validation == Validation::Sync {
        if layer_settings {
            extensions.push(ext::layer_settings::NAME.as_ptr());
            info = info.push_next(&mut new_style);
        } else {
            info = info.push_next(&mut old_style);
        }
    }
    let info = info.enabled_extension_names(&extensions);
    // SAFETY: every pointer in `info` outlives the call.
    let instance = unsafe { entry.create_instance(&info, None) }.map_err(|r| {
        Error::NoDevice(format!("the Vulkan loader refused an instance ({r}); install a driver (mesa-vulkan-drivers has one for machines without a GPU)"))
    })?;
    let mut opened = Instance { instance, debug: None, messages: Box::default(), has_debug_utils: has_debug, entry };
    if validation != Validation::Off {
        let loader = ext::debug_utils::Instance::new(&opened.entry, &opened.instance);
        let info = vk::DebugUtilsMessengerCreateInfoEXT::default()
            .message_severity(
                vk::DebugUtilsMessageSeverityFlagsEXT::ERROR | vk::DebugUtilsMessageSeverityFlagsEXT::WARNING,
            )
            .message_type(vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION | vk::DebugUtilsMessageTypeFlagsEXT::GENERAL)
            .pfn_user_callback(Some(on_message))
            .user_data((&raw const *opened.messages).cast_mut().cast());
        // SAFETY: the callback's sink is boxed and outlives the messenger (see `Drop for Instance`).
        let messenger = unsafe { loader.create_debug_utils_messenger(&info, None) };
        opened.debug = Some((loader, messenger.map_err(vulkan("making the debug messenger"))?));
    }
    Ok(opened)
}

/// Properties of a device and what it lacks of what the engine needs.
fn inspect(instance: &ash::Instance, device: vk::PhysicalDevice, index: usize) -> DeviceReport {
    let mut driver = vk::PhysicalDeviceDriverProperties::default();
    let mut properties = vk::PhysicalDeviceProperties2::default().push_next(&mut driver);
    // SAFETY: the device comes from this instance; the chained struct is core in 1.2, ignored by older drivers.
    unsafe { instance.get_physical_device_properties2(device, &mut properties) };
    let p = properties.properties;
    let api = p.api_version;
    let version =
        format!("{}.{}.{}", vk::api_version_major(api), vk::api_version_minor(api), vk::api_version_patch(api));
    let text =
        |s: std::result::Result<&CStr, _>| s.map(|s: &CStr| s.to_string_lossy().into_owned()).unwrap_or_default();
    let mut missing = Vec::new();
    if api < vk::API_VERSION_1_3 {
        missing.push(format!("Vulkan 1.3 (it has {version}); update the driver"));
    } else {
        let mut v12 = vk::PhysicalDeviceVulkan12Features::default();
        let mut v13 = vk::PhysicalDeviceVulkan13Features::default();
        let mut features = vk::PhysicalDeviceFeatures2::default().push_next(&mut v12).push_next(&mut v13);
        // SAFETY: a 1.3 device knows these structs.
        unsafe { instance.get_physical_device_features2(device, &mut features) };
        for (has, name) in [
            (v12.scalar_block_layout, "scalarBlockLayout"),
            (v12.timeline_semaphore, "timelineSemaphore"),
            (v12.host_query_reset, "hostQueryReset"),
            (v13.dynamic_rendering, "dynamicRendering"),
            (v13.synchronization2, "synchronization2"),
            (v13.maintenance4, "maintenance4"),
        ] {
            if has == vk::FALSE {
                missing.push(format!("feature {name}"));
            }
        }
        // SAFETY: plain query.
        let sums = unsafe { instance.get_physical_device_format_properties(device, vk::Format::R32G32B32A32_SFLOAT) };
        if !sums.optimal_tiling_features.contains(vk::FormatFeatureFlags::COLOR_ATTACHMENT_BLEND) {
            missing.push("blending of R32G32B32A32_SFLOAT".into());
        }
    }
    if queue_family(instance, device).is_none() {
        missing.push("a queue with graphics and compute".into());
    }
    let kind = match p.device_type {
        vk::PhysicalDeviceType::DISCRETE_GPU => "discrete GPU",
        vk::PhysicalDeviceType::INTEGRATED_GPU => "integrated GPU",
        vk::PhysicalDeviceType::VIRTUAL_GPU => "virtual GPU",
        vk::PhysicalDeviceType::CPU => "software",
        _ => "other",
    };
    DeviceReport {
        index,
        name: text(p.device_name_as_c_str()),
        driver: format!("{} {}", text(driver.driver_name_as_c_str()), text(driver.driver_info_as_c_str()))
            .trim()
            .to_owned(),
        api: version,
        kind,
        missing,
    }
}

/// See `Gpu::voting_threads`.
fn voting_threads(instance: &ash::Instance, device: vk::PhysicalDevice) -> Option<u32> {
    let mut v13 = vk::PhysicalDeviceVulkan13Features::default();
    let mut features = vk::PhysicalDeviceFeatures2::default().push_next(&mut v13);
    // SAFETY: a 1.3 device knows this struct.
    unsafe { instance.get_physical_device_features2(device, &mut features) };
    let mut subgroups = vk::PhysicalDeviceSubgroupProperties::default();
    let mut sizes = vk::PhysicalDeviceSubgroupSizeControlProperties::default();
    let mut properties = vk::PhysicalDeviceProperties2::default().push_next(&mut subgroups).push_next(&mut sizes);
    // SAFETY: a 1.3 device knows these structs.
    unsafe { instance.get_physical_device_properties2(device, &mut properties) };
    let votes = subgroups.supported_operations.contains(vk::SubgroupFeatureFlags::VOTE)
        && subgroups.supported_stages.contains(vk::ShaderStageFlags::COMPUTE)
        && sizes.required_subgroup_size_stages.contains(vk::ShaderStageFlags::COMPUTE);
    let can = votes && v13.subgroup_size_control == vk::TRUE && v13.compute_full_subgroups == vk::TRUE;
    let range = sizes.min_subgroup_size..=sizes.max_subgroup_size;
    [32, 8].into_iter().find(|size| can && range.contains(size))
}

/// First queue family that draws and computes.
fn queue_family(instance: &ash::Instance, device: vk::PhysicalDevice) -> Option<(u32, u32)> {
    // SAFETY: plain query.
    let families = unsafe { instance.get_physical_device_queue_family_properties(device) };
    let wanted = vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE;
    families.iter().position(|f| f.queue_flags.contains(wanted)).map(|i| (i as u32, families[i].timestamp_valid_bits))
}

/// Keeps every message of the layer; `Gpu::messages` hands them out.
unsafe extern "system" fn on_message(
    severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    _kind: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    sink: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: the layer passes valid data for the time of the call; `sink` is the boxed `Messages` of `Shared`,
    // which lives until after the messenger is destroyed.
    let (text, sink) = unsafe {
        let message = (*data).p_message;
        let text =
            if message.is_null() { String::new() } else { CStr::from_ptr(message).to_string_lossy().into_owned() };
        (text, &*sink.cast::<Messages>())
    };
    let level = if severity.contains(vk::DebugUtilsMessageSeverityFlagsEXT::ERROR) {
        log::Level::Error
    } else {
        log::Level::Warn
    };
    if let Ok(mut messages) = sink.lock() {
        if !messages.contains(&text) {
            log::log!(level, "validation: {text}");
        }
        messages.push(text);
    }
    vk::FALSE
}

impl Gpu {
    /// Opens a device. With `Validation::Sync` the engine's own barrier check runs as well.
    pub fn new(options: &Options) -> Result<Self> {
        let opened = open_instance(options.validation)?;
        let instance = &opened.instance;
        let (physical, report) = pick(instance, options.device.as_deref())?;
        let (family, timestamp_bits) = queue_family(instance, physical).expect("inspected");
        let priorities = [1.0];
        let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(family).queue_priorities(&priorities)];
        let mut v12 = vk::PhysicalDeviceVulkan12Features::default()
            .scalar_block_layout(true)
            .timeline_semaphore(true)
            .host_query_reset(true);
        let voting_threads = voting_threads(instance, physical);
        let mut v13 = vk::PhysicalDeviceVulkan13Features::default()
            .dynamic_rendering(true)
            .synchronization2(true)
            .maintenance4(true)
            .subgroup_size_control(voting_threads.is_some())
            .compute_full_subgroups(voting_threads.is_some());
        // SAFETY: plain query.
        let has = unsafe { instance.get_physical_device_features(physical) };
        let features = vk::PhysicalDeviceFeatures::default().geometry_shader(has.geometry_shader == vk::TRUE);
        let info = vk::DeviceCreateInfo::default()
            .queue_create_infos(&queues)
            .enabled_features(&features)
            .push_next(&mut v12)
            .push_next(&mut v13);
        // SAFETY: the features were found by `inspect`, and every pointer outlives the call.
        let device = unsafe { instance.create_device(physical, &info, None) }
            .map_err(vulkan(format!("opening {}", report.name)))?;
        let mut sizes = vk::PhysicalDeviceMaintenance4Properties::default();
        let mut properties = vk::PhysicalDeviceProperties2::default().push_next(&mut sizes);
        // SAFETY: plain query; a 1.3 device knows the chained struct.
        unsafe { instance.get_physical_device_properties2(physical, &mut properties) };
        let limits = properties.properties.limits;
        // From here on `shared` destroys what was made, also when something below fails.
        let mut shared = Shared {
            names: opened.has_debug_utils.then(|| ext::debug_utils::Device::new(instance, &device)),
            allocator: Mutex::new(None),
            limits,
            max_buffer_size: sizes.max_buffer_size,
            pool: vk::CommandPool::null(),
            timeline: vk::Semaphore::null(),
            submitted: AtomicU64::new(0),
            next_id: AtomicU64::new(1),
            device,
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
        .map_err(|e| Error::Vulkan { what: "making the memory allocator".into(), result: e.to_string() })?;
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
        // SAFETY: the family was requested above.
        let queue = unsafe { shared.device.get_device_queue(family, 0) };
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
        Ok(Self {
            ring: Ring::new(&shared)?,
            descriptors: RefCell::default(),
            samplers: RefCell::default(),
            queue,
            clock: Clock { period_ns: f64::from(limits.timestamp_period), bits: timestamp_bits.min(64) },
            numbers_triangles: has.geometry_shader == vk::TRUE,
            voting_threads,
            check_barriers: options.validation == Validation::Sync,
            report,
            shared,
        })
    }

    /// The open device in words.
    pub fn report(&self) -> &DeviceReport {
        &self.report
    }

    /// Whether the device is the CPU: ratios mean something there, absolute times little.
    pub fn is_software(&self) -> bool {
        self.report.kind == "software"
    }

    /// Color targets that a fragment shader can write at a time.
    pub fn most_color_targets(&self) -> u32 {
        let limits = &self.shared.limits;
        let all = [limits.max_color_attachments, limits.max_fragment_output_attachments];
        all.into_iter().fold(limits.max_fragment_combined_output_resources, u32::min)
    }

    /// Whether fragment shaders know which triangle they belong to: Vulkan has that with geometry shaders, which all
    /// desktop devices and lavapipe have and SwiftShader has not.
    pub fn numbers_triangles(&self) -> bool {
        self.numbers_triangles
    }

    /// Threads of a compute subgroup, 32 or 8, if the device can be held to one of these sizes and lets its threads vote.
    pub fn voting_threads(&self) -> Option<u32> {
        self.voting_threads
    }

    /// The device as if its subgroups could not vote, which is so on some; tests use it.
    pub fn without_votes(mut self) -> Self {
        self.voting_threads = None;
        self
    }

    /// Whether the queue has timestamps; without them zones have no GPU time, and everything else works.
    pub fn has_timestamps(&self) -> bool {
        self.clock.bits > 0
    }

    /// The device as if its queue had no timestamps, which some have not; tests use it.
    pub fn without_timestamps(mut self) -> Self {
        self.clock.bits = 0;
        self
    }

    /// Messages of the validation layer so far, oldest first; empty is the only good answer.
    pub fn messages(&self) -> Vec<String> {
        self.shared.instance.messages.lock().expect("message sink").clone()
    }
}

/// The asked-for device, or the most capable one; refusals name what is missing.
fn pick(instance: &ash::Instance, wanted: Option<&str>) -> Result<(vk::PhysicalDevice, DeviceReport)> {
    // SAFETY: the instance is alive.
    let all = unsafe { instance.enumerate_physical_devices() }.map_err(vulkan("enumerating devices"))?;
    let mut reports: Vec<_> = all.iter().enumerate().map(|(i, d)| (*d, inspect(instance, *d, i))).collect();
    if reports.is_empty() {
        return Err(Error::NoDevice(
            "the Vulkan loader found none; install a driver (mesa-vulkan-drivers has one for machines without a GPU)"
                .into(),
        ));
    }
    if let Some(wanted) = wanted {
        let names: Vec<_> = reports.iter().map(|(_, r)| format!("{} {}", r.index, r.name)).collect();
        let index = wanted.parse::<usize>().ok();
        reports.retain(|(_, r)| match index {
            Some(i) => r.index == i,
            None => r.name.to_lowercase().contains(&wanted.to_lowercase()),
        });
        if reports.is_empty() {
            return Err(Error::NoDevice(format!("--device {wanted} matches none of: {}", names.join(", "))));
        }
    }
    let rank = |kind: &str| {
        ["discrete GPU", "integrated GPU", "virtual GPU", "other", "software"].iter().position(|k| *k == kind)
    };
    reports.sort_by_key(|(_, r)| (!r.missing.is_empty(), rank(r.kind)));
    let (device, best) = reports.swap_remove(0);
    if !best.missing.is_empty() {
        let mut refused = vec![format!("{} lacks {}", best.name, best.missing.join(", "))];
        refused.extend(reports.iter().map(|(_, r)| format!("{} lacks {}", r.name, r.missing.join(", "))));
        return Err(Error::NoDevice(format!(
            "{}; update the driver or choose another with --device",
            refused.join("; ")
        )));
    }
    for (_, refused) in reports.iter().filter(|(_, r)| !r.missing.is_empty()) {
        log::info!("device {} {} refused: lacks {}", refused.index, refused.name, refused.missing.join(", "));
    }
    Ok((device, best))
}

impl Drop for Gpu {
    fn drop(&mut self) {
        self.shared.wait_to_drop();
        // SAFETY: nothing is in use after the wait; samplers and descriptors are this device's.
        unsafe {
            for (_, sampler) in self.samplers.get_mut().drain() {
                self.shared.device.destroy_sampler(sampler, None);
            }
        }
        self.descriptors.get_mut().destroy(&self.shared.device);
    }
}

impl Drop for Shared {
    fn drop(&mut self) {
        drop(self.allocator.lock().map(|mut a| a.take()));
        // SAFETY: `Shared` is dropped when the last object made from the device has gone; null handles are ignored.
        unsafe {
            self.device.destroy_semaphore(self.timeline, None);
            self.device.destroy_command_pool(self.pool, None);
            self.device.destroy_device(None);
        }
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        // SAFETY: the device, if there was one, has gone; the sink of the messenger lives until this function ends.
        unsafe {
            if let Some((loader, messenger)) = self.debug.take() {
                loader.destroy_debug_utils_messenger(messenger, None);
            }
            self.instance.destroy_instance(None);
        }
    }
}
