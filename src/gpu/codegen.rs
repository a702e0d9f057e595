//! Reports how a driver compiles shaders: registers, spills, occupancy, instructions. Needs
//! VK_KHR_pipeline_executable_properties but runs nothing, so drivers without hardware will do.

use super::instance::{self, Instance, Needs, needs, open_instance, pick, queue_family};
use super::pipeline::{check_group, shader_names, specialization, spirv};
use super::{DeviceReport, Validation, reflect, vulkan};
use crate::error::{Error, Result};
use ash::{khr, vk};

/// A device that compiles shaders and reports the results.
pub struct Codegen {
    device: ash::Device,
    ask: khr::pipeline_executable_properties::Device,
    limits: vk::PhysicalDeviceLimits,
    /// Description of the device.
    pub report: DeviceReport,
    _instance: Instance,
}

/// Compilation result of one shader.
#[derive(Clone, Debug, Default)]
pub struct Compiled {
    /// Statistics by the driver's names.
    pub numbers: Vec<(String, f64)>,
    /// Machine code as text, if the driver provides it.
    pub assembly: Option<String>,
}

impl Compiled {
    /// A statistic by its name.
    pub fn number(&self, name: &str) -> Option<f64> {
        self.numbers.iter().find(|(of, _)| of == name).map(|(_, number)| *number)
    }
}

/// Text stored in a fixed-size Vulkan array.
fn text(bytes: &[std::ffi::c_char]) -> String {
    bytes.iter().take_while(|c| **c != 0).map(|c| char::from(*c as u8)).collect()
}

impl Codegen {
    /// Opens a device only for compiling.
    ///
    /// # Errors
    /// Fails if there is no such device, or its driver does not report compilation results.
    pub fn new(wanted: Option<&str>) -> Result<Self> {
        let opened = open_instance(Validation::Off, &[])?;
        let instance = &opened.instance;
        let (physical, report) = pick(instance, wanted)?;
        let name = khr::pipeline_executable_properties::NAME;
        // SAFETY: plain query.
        let extensions = unsafe { instance.enumerate_device_extension_properties(physical) }.unwrap_or_default();
        if !extensions.iter().any(|e| e.extension_name_as_c_str() == Ok(name)) {
            let device = &report.name;
            return Err(Error::NoDevice(format!(
                "{device} does not report how it compiles shaders (VK_KHR_pipeline_executable_properties); use another --device"
            )));
        }
        let (family, _) = queue_family(instance, physical).expect("inspected");
        let priorities = [1.0];
        let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(family).queue_priorities(&priorities)];
        let voting = instance::voting_threads(instance, physical).is_some();
        let Needs { mut v12, v13, .. } = needs();
        let mut v13 = v13.subgroup_size_control(voting).compute_full_subgroups(voting);
        let mut told =
            vk::PhysicalDevicePipelineExecutablePropertiesFeaturesKHR::default().pipeline_executable_info(true);
        let names = [name.as_ptr()];
        let info = vk::DeviceCreateInfo::default()
            .queue_create_infos(&queues)
            .enabled_extension_names(&names)
            .push_next(&mut v12)
            .push_next(&mut v13)
            .push_next(&mut told);
        // SAFETY: `pick` checked the features, the extension is available and includes its own feature, and every
        // pointer outlives the call.
        let device = unsafe { instance.create_device(physical, &info, None) }
            .map_err(vulkan(format!("opening {}", report.name)))?;
        let ask = khr::pipeline_executable_properties::Device::new(instance, &device);
        // SAFETY: plain query.
        let limits = unsafe { instance.get_physical_device_properties(physical) }.limits;
        Ok(Self { device, ask, limits, report, _instance: opened })
    }

    /// Names of all compute shaders.
    pub fn shaders() -> impl Iterator<Item = &'static str> {
        shader_names().filter(|name| name.ends_with(".comp"))
    }

    /// Compiles the compute shader `glsl/NAME` with specialisation constants 0, 1, ... Constants that are not given
    /// keep their defaults.
    ///
    /// # Errors
    /// Fails if the driver rejects the shader.
    pub fn compute(&self, name: &str, constants: &[u32]) -> Result<Compiled> {
        let failed = |result| vulkan(format!("compiling {name}"))(result);
        let code = spirv(name, ".comp");
        let interface = reflect::interface(&code, constants);
        check_group(name, interface.group, &self.limits)?;
        let bindings: Vec<_> = (interface.bindings.iter())
            .map(|b| {
                vk::DescriptorSetLayoutBinding::default()
                    .binding(b.binding)
                    .descriptor_type(b.kind)
                    .descriptor_count(1)
                    .stage_flags(vk::ShaderStageFlags::COMPUTE)
            })
            .collect();
        let device = &self.device;
        let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
        // SAFETY: the device is alive, as in all calls below; each object is destroyed after the pipeline has been
        // queried.
        let set = unsafe { device.create_descriptor_set_layout(&info, None) }.map_err(failed)?;
        let sets = [set];
        let range =
            vk::PushConstantRange::default().stage_flags(vk::ShaderStageFlags::COMPUTE).size(interface.push_bytes);
        let ranges = [range];
        let ranges = if interface.push_bytes > 0 { &ranges[..] } else { &[] };
        let info = vk::PipelineLayoutCreateInfo::default().set_layouts(&sets).push_constant_ranges(ranges);
        // SAFETY: as above.
        let layout = unsafe { device.create_pipeline_layout(&info, None) }.map_err(failed)?;
        let info = vk::ShaderModuleCreateInfo::default().code(&code);
        // SAFETY: as above; the code comes from the compiler.
        let module = unsafe { device.create_shader_module(&info, None) }.map_err(failed)?;
        let (entries, bytes) = specialization(constants);
        let special = vk::SpecializationInfo::default().map_entries(&entries).data(&bytes);
        let stage = vk::PipelineShaderStageCreateInfo::default()
            .stage(vk::ShaderStageFlags::COMPUTE)
            .module(module)
            .name(c"main")
            .specialization_info(&special);
        let flags = vk::PipelineCreateFlags::CAPTURE_STATISTICS_KHR
            | vk::PipelineCreateFlags::CAPTURE_INTERNAL_REPRESENTATIONS_KHR;
        let info = vk::ComputePipelineCreateInfo::default().flags(flags).stage(stage).layout(layout);
        // SAFETY: module and layout are alive.
        let made = unsafe { device.create_compute_pipelines(vk::PipelineCache::null(), &[info], None) };
        let told = made.map_err(|(_, result)| failed(result)).and_then(|made| {
            let told = self.told(made[0]).map_err(failed);
            // SAFETY: nothing uses it.
            unsafe { device.destroy_pipeline(made[0], None) };
            told
        });
        // SAFETY: nothing uses them any more.
        unsafe {
            device.destroy_shader_module(module, None);
            device.destroy_pipeline_layout(layout, None);
            device.destroy_descriptor_set_layout(set, None);
        }
        told
    }

    /// The driver's statistics of a pipeline's only stage.
    fn told(&self, pipeline: vk::Pipeline) -> std::result::Result<Compiled, vk::Result> {
        let info = vk::PipelineExecutableInfoKHR::default().pipeline(pipeline).executable_index(0);
        // SAFETY: the pipeline was created with statistics enabled, and has one stage.
        let statistics = unsafe { self.ask.get_pipeline_executable_statistics(&info) }?;
        let number = |s: &vk::PipelineExecutableStatisticKHR<'_>| {
            // SAFETY: the format tells which member is valid.
            unsafe {
                match s.format {
                    vk::PipelineExecutableStatisticFormatKHR::BOOL32 => f64::from(s.value.b32),
                    vk::PipelineExecutableStatisticFormatKHR::INT64 => s.value.i64 as f64,
                    vk::PipelineExecutableStatisticFormatKHR::UINT64 => s.value.u64 as f64,
                    _ => s.value.f64,
                }
            }
        };
        let numbers = statistics.iter().map(|s| (text(&s.name), number(s))).collect();
        let ask = self.ask.fp().get_pipeline_executable_internal_representations_khr;
        let (handle, mut count) = (self.device.handle(), 0);
        // SAFETY: the first call asks how many there are, the second how large each is, the third for the text.
        let shown = unsafe {
            ask(handle, &info, &mut count, std::ptr::null_mut()).result()?;
            let mut all = vec![vk::PipelineExecutableInternalRepresentationKHR::default(); count as usize];
            ask(handle, &info, &mut count, all.as_mut_ptr()).result()?;
            let mut texts: Vec<Vec<u8>> = all.iter().map(|of| vec![0; of.data_size]).collect();
            for (of, bytes) in all.iter_mut().zip(&mut texts) {
                of.p_data = bytes.as_mut_ptr().cast();
            }
            ask(handle, &info, &mut count, all.as_mut_ptr()).result()?;
            let is_code = |of: &vk::PipelineExecutableInternalRepresentationKHR<'_>| {
                of.is_text == vk::TRUE && text(&of.name).to_lowercase().contains("assembly")
            };
            let last = all.iter().zip(texts).rfind(|(of, _)| is_code(of));
            last.map(|(_, bytes)| String::from_utf8_lossy(&bytes).trim_end_matches('\0').to_owned())
        };
        Ok(Compiled { numbers, assembly: shown })
    }
}

impl Drop for Codegen {
    fn drop(&mut self) {
        // SAFETY: everything created from the device has been destroyed.
        unsafe { self.device.destroy_device(None) };
    }
}
