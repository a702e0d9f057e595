//! Instance, selection of a device, and collection of validation messages.

use super::vulkan;
use crate::error::{Error, Result};
use ash::{ext, vk};
use std::ffi::{CStr, c_char, c_void};
use std::sync::Mutex;
use std::thread::{self, ThreadId};

/// Checks of the Khronos validation layer.
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

/// One line of `lightskin devices`.
#[derive(Clone, Debug)]
pub struct DeviceReport {
    /// Index for `--device`.
    pub index: usize,
    /// Name reported by the driver.
    pub name: String,
    /// Driver name and version.
    pub driver: String,
    /// Vulkan version of the device.
    pub api: String,
    /// "discrete GPU", "software" ...
    pub kind: &'static str,
    /// Requirements that the device lacks; empty for a usable device.
    pub missing: Vec<String>,
}

/// Collected messages of the validation layer, shared with its callback.
type Messages = Mutex<Vec<String>>;

/// The instance with its messenger. Both are destroyed together, after the device.
pub(super) struct Instance {
    pub(super) instance: ash::Instance,
    pub(super) debug: Option<(ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    pub(super) messages: Box<Messages>,
    pub(super) has_debug_utils: bool,
    /// Whether the instance and its device are ours to destroy.
    pub(super) owned: bool,
    /// The loader's library, if we loaded it.
    pub(super) entry: Option<ash::Entry>,
    opened_on: ThreadId,
}

impl Instance {
    /// Wraps an instance that the host has created and destroys.
    pub(super) fn of_host(instance: ash::Instance, has_debug_utils: bool) -> Self {
        Self {
            instance,
            debug: None,
            messages: Box::default(),
            has_debug_utils,
            owned: false,
            entry: None,
            opened_on: thread::current().id(),
        }
    }
}

/// All devices that the Vulkan loader finds, and the requirements that each lacks.
///
/// # Errors
/// Fails if there is no Vulkan loader, or it finds no driver.
pub fn devices() -> Result<Vec<DeviceReport>> {
    let opened = open_instance(Validation::Off, &[])?;
    // SAFETY: the instance is alive.
    unsafe { opened.instance.enumerate_physical_devices() }
        .map_err(vulkan("enumerating devices"))
        .map(|all| all.iter().enumerate().map(|(i, d)| inspect(&opened.instance, *d, i)).collect())
}

/// Loads the Vulkan library and creates an instance with these extensions, and a messenger if validation is on.
pub(super) fn open_instance(validation: Validation, wanted: &[*const c_char]) -> Result<Instance> {
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
    let mut extensions: Vec<*const c_char> = wanted.to_vec();
    let has_debug = validation != Validation::Off
        || available.iter().any(|e| e.extension_name_as_c_str() == Ok(ext::debug_utils::NAME));
    if has_debug {
        extensions.push(ext::debug_utils::NAME.as_ptr());
    }
    let app = vk::ApplicationInfo::default().application_name(c"lightskin").api_version(vk::API_VERSION_1_3);
    let mut info = vk::InstanceCreateInfo::default().application_info(&app).enabled_layer_names(&layers);

    // Synchronization validation is enabled by layer settings on new layers, by validation features on old ones. New
    // layers also skip shader accesses unless told otherwise.
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
        if r == vk::Result::ERROR_EXTENSION_NOT_PRESENT && !wanted.is_empty() {
            return Error::NoDevice(
                "no Vulkan driver here can show pictures in windows; install another driver, or write them to files with \
                 `lightskin render`"
                    .into(),
            );
        }
        Error::NoDevice(format!("the Vulkan loader could not create an instance ({r}); install a driver (mesa-vulkan-drivers has one for machines without a GPU)"))
    })?;
    let loader = ext::debug_utils::Instance::new(&entry, &instance);
    let mut opened = Instance {
        instance,
        debug: None,
        messages: Box::default(),
        has_debug_utils: has_debug,
        owned: true,
        entry: Some(entry),
        opened_on: thread::current().id(),
    };
    if validation != Validation::Off {
        let info = vk::DebugUtilsMessengerCreateInfoEXT::default()
            .message_severity(
                vk::DebugUtilsMessageSeverityFlagsEXT::ERROR | vk::DebugUtilsMessageSeverityFlagsEXT::WARNING,
            )
            .message_type(vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION | vk::DebugUtilsMessageTypeFlagsEXT::GENERAL)
            .pfn_user_callback(Some(on_message))
            .user_data((&raw const *opened.messages).cast_mut().cast());
        // SAFETY: the callback's sink is boxed and outlives the messenger (see `Drop for Instance`).
        let messenger = unsafe { loader.create_debug_utils_messenger(&info, None) };
        opened.debug = Some((loader, messenger.map_err(vulkan("creating the debug messenger"))?));
    }
    Ok(opened)
}

/// Everything that hosts must enable on a device and its instance if they open them themselves.
#[derive(Clone, Copy, Debug)]
pub struct Needs {
    /// Vulkan version of instance and device.
    pub api_version: u32,
    /// Device extensions.
    pub extensions: &'static [&'static CStr],
    /// Required features of Vulkan 1.2.
    pub v12: vk::PhysicalDeviceVulkan12Features<'static>,
    /// Required features of Vulkan 1.3.
    pub v13: vk::PhysicalDeviceVulkan13Features<'static>,
}

/// See `Gpu::needs`.
pub(super) fn needs() -> Needs {
    Needs {
        api_version: vk::API_VERSION_1_3,
        extensions: &[],
        v12: vk::PhysicalDeviceVulkan12Features::default()
            .scalar_block_layout(true)
            .timeline_semaphore(true)
            .host_query_reset(true),
        v13: vk::PhysicalDeviceVulkan13Features::default()
            .dynamic_rendering(true)
            .synchronization2(true)
            .maintenance4(true),
    }
}

/// Whether each feature of `needs` is set, with its name.
fn required(
    v12: &vk::PhysicalDeviceVulkan12Features<'_>,
    v13: &vk::PhysicalDeviceVulkan13Features<'_>,
) -> [(vk::Bool32, &'static str); 6] {
    [
        (v12.scalar_block_layout, "scalarBlockLayout"),
        (v12.timeline_semaphore, "timelineSemaphore"),
        (v12.host_query_reset, "hostQueryReset"),
        (v13.dynamic_rendering, "dynamicRendering"),
        (v13.synchronization2, "synchronization2"),
        (v13.maintenance4, "maintenance4"),
    ]
}

/// Properties of a device and the requirements that it lacks.
pub(super) fn inspect(instance: &ash::Instance, device: vk::PhysicalDevice, index: usize) -> DeviceReport {
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
        missing.extend(
            required(&v12, &v13).iter().filter(|(has, _)| *has == vk::FALSE).map(|(_, f)| format!("feature {f}")),
        );
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
pub(super) fn voting_threads(instance: &ash::Instance, device: vk::PhysicalDevice) -> Option<u32> {
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

/// First queue family with graphics and compute.
pub(super) fn queue_family(instance: &ash::Instance, device: vk::PhysicalDevice) -> Option<(u32, u32)> {
    // SAFETY: plain query.
    let families = unsafe { instance.get_physical_device_queue_family_properties(device) };
    let wanted = vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE;
    families.iter().position(|f| f.queue_flags.contains(wanted)).map(|i| (i as u32, families[i].timestamp_valid_bits))
}

/// Collects messages of the layer for `Gpu::messages`.
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

/// The requested device, or the most capable one. Errors name the missing requirements.
pub(super) fn pick(instance: &ash::Instance, wanted: Option<&str>) -> Result<(vk::PhysicalDevice, DeviceReport)> {
    // SAFETY: the instance is alive.
    let all = unsafe { instance.enumerate_physical_devices() }.map_err(vulkan("enumerating devices"))?;
    let mut reports: Vec<_> = all.iter().enumerate().map(|(i, d)| (*d, inspect(instance, *d, i))).collect();
    if reports.is_empty() {
        return Err(Error::NoDevice(
            "the Vulkan loader found no device; install a driver (mesa-vulkan-drivers has one for machines without a GPU)"
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
        return Err(Error::NoDevice(format!("{}; update the driver or use another --device", refused.join("; "))));
    }
    for (_, refused) in reports.iter().filter(|(_, r)| !r.missing.is_empty()) {
        log::info!("device {} {} rejected: lacks {}", refused.index, refused.name, refused.missing.join(", "));
    }
    Ok((device, best))
}

impl Drop for Instance {
    fn drop(&mut self) {
        // SAFETY: the device, if there was one, has been destroyed; the sink of the messenger lives until this function
        // ends.
        unsafe {
            if let Some((loader, messenger)) = self.debug.take() {
                loader.destroy_debug_utils_messenger(messenger, None);
            }
            // The loader unloads the driver along with the instance. NVIDIA's driver registers what it runs when a thread
            // ends, for all threads that have called it: ends of other threads would then run unloaded code. So if this
            // is another thread, both stay until the process ends.
            if self.owned && self.opened_on == thread::current().id() {
                self.instance.destroy_instance(None);
            } else {
                std::mem::forget(self.entry.take());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_needed_is_what_is_asked_for() {
        let Needs { v12, v13, .. } = needs();
        assert!(required(&v12, &v13).iter().all(|(has, _)| *has == vk::TRUE));
    }
}
