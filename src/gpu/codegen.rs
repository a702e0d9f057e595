//! Reports how a driver compiles shaders: registers, spills, occupancy, instructions. Needs
//! VK_KHR_pipeline_executable_properties but runs nothing, so drivers without hardware will do.

use super::instance::{self, Instance, Needs, needs, open_instance, pick, queue_family};
use super::pipeline::{check_group, shader_names, specialization, spirv, stages_of};
use super::raster::{Attribute, Blend, Cull, Depth, Raster, Shape, Stream, with_state};
use super::{DeviceReport, Validation, reflect, vulkan};
use crate::error::{Error, Result};
use ash::{khr, vk};

/// Asks the driver to keep its results.
const FLAGS: vk::PipelineCreateFlags = vk::PipelineCreateFlags::from_raw(
    vk::PipelineCreateFlags::CAPTURE_STATISTICS_KHR.as_raw()
        | vk::PipelineCreateFlags::CAPTURE_INTERNAL_REPRESENTATIONS_KHR.as_raw(),
);

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
        // SAFETY: plain query.
        let has = unsafe { instance.get_physical_device_features(physical) };
        let features = vk::PhysicalDeviceFeatures::default().geometry_shader(has.geometry_shader == vk::TRUE);
        let info = vk::DeviceCreateInfo::default()
            .queue_create_infos(&queues)
            .enabled_features(&features)
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

    /// Names of all shaders whose names end so.
    pub fn shaders(stage: &str) -> impl Iterator<Item = &'static str> {
        shader_names().filter(move |name| name.ends_with(stage))
    }

    /// The vertex shader that gives a fragment shader what it reads, and as little else as possible.
    ///
    /// # Panics
    /// Panics if there is none.
    pub fn vertex_shader_of(fragment: &str) -> &'static str {
        let read = reflect::interface(&spirv(fragment, ".frag"), &[]).inputs;
        if read.is_empty() {
            return "screen.vert";
        }
        let written = |name: &str| reflect::interface(&spirv(name, ".vert"), &[]).outputs;
        Self::shaders(".vert")
            .filter(|name| read.iter().all(|input| written(name).contains(input)))
            .min_by_key(|name| written(name).len())
            .unwrap_or_else(|| panic!("no vertex shader writes what {fragment} reads"))
    }

    /// Compiles the compute shader `glsl/NAME` with specialisation constants 0, 1, ... Constants that are not given
    /// keep their defaults.
    ///
    /// # Errors
    /// Fails if the driver rejects the shader.
    pub fn compute(&self, name: &str, constants: &[u32]) -> Result<Compiled> {
        let shader = (vk::ShaderStageFlags::COMPUTE, spirv(name, ".comp"));
        let told = self.compile(name, &[shader], constants, |stages, layout| {
            let info = vk::ComputePipelineCreateInfo::default().flags(FLAGS).stage(stages[0]).layout(layout);
            // SAFETY: the device, the module and the layout are alive.
            unsafe { self.device.create_compute_pipelines(vk::PipelineCache::null(), &[info], None) }
        })?;
        Ok(told.into_iter().next().map(|(_, compiled)| compiled).unwrap_or_default())
    }

    /// Compiles a vertex shader together with a fragment shader, or alone. Attributes and targets are assumed to have
    /// 32 bits per channel. Returns the results of both.
    ///
    /// # Errors
    /// Fails if the driver rejects the shaders.
    pub fn raster(&self, vertex: &'static str, fragment: Option<&'static str>) -> Result<[Compiled; 2]> {
        let mut shaders = vec![(vk::ShaderStageFlags::VERTEX, spirv(vertex, ".vert"))];
        shaders.extend(fragment.map(|name| (vk::ShaderStageFlags::FRAGMENT, spirv(name, ".frag"))));
        let interfaces: Vec<_> = shaders.iter().map(|(_, code)| reflect::interface(code, &[])).collect();
        let attributes: Vec<Attribute> =
            (interfaces[0].inputs.iter().enumerate()).map(|(i, &(at, format))| (at, format, 16 * i as u32)).collect();
        let stream = Stream { stride: 16 * attributes.len() as u32, attributes: &attributes };
        let colors: Vec<_> = interfaces.get(1).into_iter().flat_map(|of| of.outputs.iter().map(|o| o.1)).collect();
        let raster = Raster {
            vertex,
            fragment,
            shape: Shape::Triangles,
            streams: if attributes.is_empty() { &[] } else { std::slice::from_ref(&stream) },
            colors: &colors,
            blend: Blend::Replace,
            depth: Depth::Nearest,
            cull: Cull::Back,
            multisampled: false,
            constants: &[],
        };
        let told = self.compile(fragment.unwrap_or(vertex), &shaders, &[], |stages, layout| {
            with_state(&raster, stages, layout, FLAGS, |info| {
                // SAFETY: the device, the modules and the layout are alive.
                unsafe { self.device.create_graphics_pipelines(vk::PipelineCache::null(), &[*info], None) }
            })
        })?;
        let mut both = [Compiled::default(), Compiled::default()];
        for (stage, compiled) in told {
            both[usize::from(stage.contains(vk::ShaderStageFlags::FRAGMENT))] = compiled;
        }
        Ok(both)
    }

    /// Creates a pipeline of these shaders by `make`, and asks the driver about its stages.
    fn compile(
        &self,
        name: &str,
        shaders: &[(vk::ShaderStageFlags, Vec<u32>)],
        constants: &[u32],
        make: impl FnOnce(
            &[vk::PipelineShaderStageCreateInfo<'_>],
            vk::PipelineLayout,
        ) -> std::result::Result<Vec<vk::Pipeline>, (Vec<vk::Pipeline>, vk::Result)>,
    ) -> Result<Vec<(vk::ShaderStageFlags, Compiled)>> {
        let failed = |result| vulkan(format!("compiling {name}"))(result);
        let device = &self.device;
        let mut bindings: Vec<vk::DescriptorSetLayoutBinding<'_>> = Vec::new();
        let (mut push_bytes, mut push_stages) = (0, vk::ShaderStageFlags::empty());
        for (stage, code) in shaders {
            let interface = reflect::interface(code, constants);
            if *stage == vk::ShaderStageFlags::COMPUTE {
                check_group(name, interface.group, &self.limits)?;
            }
            for b in interface.bindings {
                match bindings.iter_mut().find(|of| of.binding == b.binding) {
                    Some(shared) => shared.stage_flags |= *stage,
                    None => bindings.push(
                        vk::DescriptorSetLayoutBinding::default()
                            .binding(b.binding)
                            .descriptor_type(b.kind)
                            .descriptor_count(1)
                            .stage_flags(*stage),
                    ),
                }
            }
            if interface.push_bytes > 0 {
                push_bytes = interface.push_bytes.max(push_bytes);
                push_stages |= *stage;
            }
        }
        let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
        // SAFETY: the device is alive, as in all calls below; each object is destroyed after the pipeline has been
        // queried.
        let set = unsafe { device.create_descriptor_set_layout(&info, None) }.map_err(failed)?;
        let sets = [set];
        let ranges = [vk::PushConstantRange::default().stage_flags(push_stages).size(push_bytes)];
        let ranges = if push_bytes > 0 { &ranges[..] } else { &[] };
        let info = vk::PipelineLayoutCreateInfo::default().set_layouts(&sets).push_constant_ranges(ranges);
        // SAFETY: as above.
        let layout = unsafe { device.create_pipeline_layout(&info, None) }.map_err(failed)?;
        let module = |(stage, code): &(vk::ShaderStageFlags, Vec<u32>)| {
            let info = vk::ShaderModuleCreateInfo::default().code(code);
            // SAFETY: as above; the code comes from the compiler.
            Ok((*stage, unsafe { device.create_shader_module(&info, None) }.map_err(failed)?))
        };
        let modules = shaders.iter().map(module).collect::<Result<Vec<_>>>()?;
        let (entries, bytes) = specialization(constants);
        let special = vk::SpecializationInfo::default().map_entries(&entries).data(&bytes);
        let stages = stages_of(&modules, &special);
        let told = make(&stages, layout).map_err(|(_, result)| failed(result)).and_then(|made| {
            let told = self.told(made[0]).map_err(failed);
            // SAFETY: nothing uses it.
            unsafe { device.destroy_pipeline(made[0], None) };
            told
        });
        // SAFETY: nothing uses them any more.
        unsafe {
            for (_, module) in modules {
                device.destroy_shader_module(module, None);
            }
            device.destroy_pipeline_layout(layout, None);
            device.destroy_descriptor_set_layout(set, None);
        }
        told
    }

    /// The driver's results for each stage of a pipeline.
    fn told(&self, pipeline: vk::Pipeline) -> std::result::Result<Vec<(vk::ShaderStageFlags, Compiled)>, vk::Result> {
        let info = vk::PipelineInfoKHR::default().pipeline(pipeline);
        // SAFETY: the pipeline was created with statistics enabled.
        let stages = unsafe { self.ask.get_pipeline_executable_properties(&info) }?;
        (stages.iter().enumerate()).map(|(i, of)| Ok((of.stages, self.told_of(pipeline, i as u32)?))).collect()
    }

    /// The driver's results for one of a pipeline's executables.
    fn told_of(&self, pipeline: vk::Pipeline, index: u32) -> std::result::Result<Compiled, vk::Result> {
        let info = vk::PipelineExecutableInfoKHR::default().pipeline(pipeline).executable_index(index);
        // SAFETY: the pipeline was created with statistics enabled, and has this executable.
        let statistics = unsafe { self.ask.get_pipeline_executable_statistics(&info) }?;
        let number = |s: &vk::PipelineExecutableStatisticKHR<'_>| {
            // SAFETY: the format tells which member is valid.
            unsafe {
                match s.format {
                    vk::PipelineExecutableStatisticFormatKHR::BOOL32 => f64::from(s.value.b32),
                    vk::PipelineExecutableStatisticFormatKHR::INT64 => s.value.i64 as f64,
                    // NVIDIA's driver writes the lower half only.
                    vk::PipelineExecutableStatisticFormatKHR::UINT64 => (s.value.u64 & 0xffff_ffff) as f64,
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
