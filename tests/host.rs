//! A host application that creates instance and device itself.
#![allow(unsafe_code, reason = "the host calls Vulkan itself")]

use crate::common::apart;
use crate::common::frames::{SPOT, baked, corner, shoot, small};
use ash::{ext, vk};
use lightskin::gpu::{Gpu, Host, Needs};
use std::ffi::{CStr, c_void};
use std::sync::Mutex;

/// Messages of the validation layer.
static MESSAGES: Mutex<Vec<String>> = Mutex::new(Vec::new());

unsafe extern "system" fn on_message(
    _severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    _kind: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    _user: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: the layer passes valid data for the time of the call.
    let text = unsafe { CStr::from_ptr((*data).p_message) }.to_string_lossy().into_owned();
    MESSAGES.lock().expect("messages").push(text);
    vk::FALSE
}

#[test]
fn a_host_brings_its_own_device() {
    let Needs { api_version, extensions, mut v12, mut v13 } = Gpu::needs();
    assert!(extensions.is_empty());
    if apart() {
        return;
    }
    // SAFETY: follows the specification step by step. Everything is destroyed at the end, after the `Gpu`.
    unsafe {
        let entry = ash::Entry::load().expect("a Vulkan loader");
        let app = vk::ApplicationInfo::default().api_version(api_version);
        let layers = [c"VK_LAYER_KHRONOS_validation".as_ptr()];
        let names = [ext::debug_utils::NAME.as_ptr()];
        let info = vk::InstanceCreateInfo::default()
            .application_info(&app)
            .enabled_layer_names(&layers)
            .enabled_extension_names(&names);
        let instance = entry.create_instance(&info, None).expect("an instance");
        let debug = ext::debug_utils::Instance::new(&entry, &instance);
        let info = vk::DebugUtilsMessengerCreateInfoEXT::default()
            .message_severity(
                vk::DebugUtilsMessageSeverityFlagsEXT::ERROR | vk::DebugUtilsMessageSeverityFlagsEXT::WARNING,
            )
            .message_type(vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION)
            .pfn_user_callback(Some(on_message));
        let messenger = debug.create_debug_utils_messenger(&info, None).expect("a messenger");
        let physical = instance.enumerate_physical_devices().expect("devices")[0];
        let families = instance.get_physical_device_queue_family_properties(physical);
        let both = vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE;
        let family = families.iter().position(|f| f.queue_flags.contains(both)).expect("a family") as u32;
        let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(family).queue_priorities(&[1.0])];
        let geometry_shader = instance.get_physical_device_features(physical).geometry_shader == vk::TRUE;
        let features = vk::PhysicalDeviceFeatures::default().geometry_shader(geometry_shader);
        let info = vk::DeviceCreateInfo::default()
            .queue_create_infos(&queues)
            .enabled_features(&features)
            .push_next(&mut v12)
            .push_next(&mut v13);
        let device = instance.create_device(physical, &info, None).expect("a device");

        let host = Host {
            instance: instance.clone(),
            physical,
            device: device.clone(),
            family,
            queue: 0,
            debug_utils: true,
            geometry_shader,
            subgroup_sizes: false,
            check_barriers: true,
        };
        // Two `Gpu`s in turn use the same device. The second draws whole frames.
        for frames in [false, true] {
            let gpu = Gpu::from_raw(host.clone()).expect("usable");
            assert_eq!(gpu.voting_threads(), None);
            let outliving = gpu.buffer_from("host.numbers", &[1_u32, 2, 3, 4]).expect("buffer");
            assert_eq!(gpu.read::<u32>(&outliving).expect("read"), [1, 2, 3, 4]);
            if frames {
                let scene = corner(&[SPOT], 40.0);
                let shot = shoot(&gpu, &scene, Some(&baked(&scene, 0.5, 8)), &small());
                assert!(shot.diffuse.iter().any(|p| p.length() > 0.0));
            }
            drop(gpu);
            drop(outliving);
        }
        device.destroy_device(None);
        debug.destroy_debug_utils_messenger(messenger, None);
        instance.destroy_instance(None);
    }
    assert_eq!(*MESSAGES.lock().expect("messages"), [""; 0]);
}
