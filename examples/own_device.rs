//! Draws on a Vulkan device that the application has created itself:
//! `cargo run --release --example own_device -- scene.glb`.
#![allow(unsafe_code, reason = "the application calls Vulkan itself")]

use ash::vk;
use lightskin::frame::engine::Loaded;
use lightskin::frame::{Engine, Look, Quality};
use lightskin::gpu::{Gpu, Host, Needs};
use lightskin::image::write_png;

/// Creates the first device with the extensions and features that the engine needs. An application adds its own.
fn open() -> Result<(ash::Entry, Host), Box<dyn std::error::Error>> {
    let Needs { api_version, extensions, mut v12, mut v13 } = Gpu::needs();
    let extensions: Vec<_> = extensions.iter().map(|name| name.as_ptr()).collect();
    // SAFETY: every structure outlives the call that reads it, and the handles come from the calls above.
    unsafe {
        let entry = ash::Entry::load()?;
        let application = vk::ApplicationInfo::default().api_version(api_version);
        let instance =
            entry.create_instance(&vk::InstanceCreateInfo::default().application_info(&application), None)?;
        let physical = *instance.enumerate_physical_devices()?.first().ok_or("no Vulkan device")?;
        let both = vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE;
        let families = instance.get_physical_device_queue_family_properties(physical);
        let family = families.iter().position(|f| f.queue_flags.contains(both)).ok_or("no queue that draws")? as u32;
        let geometry_shader = instance.get_physical_device_features(physical).geometry_shader == vk::TRUE;
        let features = vk::PhysicalDeviceFeatures::default().geometry_shader(geometry_shader);
        let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(family).queue_priorities(&[1.0])];
        let info = vk::DeviceCreateInfo::default()
            .queue_create_infos(&queues)
            .enabled_extension_names(&extensions)
            .enabled_features(&features)
            .push_next(&mut v12)
            .push_next(&mut v13);
        let device = instance.create_device(physical, &info, None)?;
        let host = Host {
            instance,
            physical,
            device,
            family,
            queue: 0,
            debug_utils: false,
            geometry_shader,
            subgroup_sizes: false,
            check_barriers: false,
        };
        Ok((entry, host))
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let file = std::env::args().nth(1).unwrap_or_else(|| "assets/cornell_glossy.glb".into());
    let size = [320, 180];
    let (_entry, host) = open()?;
    {
        // SAFETY: the handles are valid, and outlive everything that is made from them in this block.
        let gpu = unsafe { Gpu::from_raw(host.clone()) }?;
        let loaded = Loaded::open(file.as_ref(), Quality::High, &|_, _| {})?;
        let (camera, settings) = (loaded.scene.cameras[0].clone(), loaded.settings(Quality::High));
        let mut engine = Engine::new(&gpu, loaded, &settings)?;
        let mut picture = engine.picture(&gpu, size)?;
        let view = engine.view(&camera, size);
        gpu.run_once("frame", |cmd| engine.record(cmd, &mut [(view, &mut picture)], &Look::default()))?;
        write_png("own_device.png".as_ref(), size[0], size[1], &gpu.read_image(&picture.output.picture)?)?;
    }
    // SAFETY: everything that was made from these handles has been dropped.
    unsafe {
        host.device.destroy_device(None);
        host.instance.destroy_instance(None);
    }
    Ok(())
}
