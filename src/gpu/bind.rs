//! Shader resources in the order of their bindings, and push constants.

use super::cmd::Cmd;
use super::graveyard::lock;
use super::layout::DescriptorSlot;
use super::pipeline::Made;
use super::raster::Depth;
use super::sampler::SamplerKind;
use super::{Buffer, Image, Pipeline};
use crate::error::Result;
use ash::vk;

/// A resource for one binding of a shader, in binding order.
#[derive(Clone, Copy)]
pub enum Bind<'a> {
    /// A whole buffer.
    Buffer(&'a Buffer),
    /// Part of a buffer: offset and size \[bytes\].
    Slice(&'a Buffer, u64, u64),
    /// A buffer read as RGBA32F texels.
    Texels(&'a Buffer),
    /// As `Texels`, but only the first `Gpu::most_texels`, for shaders that read larger buffers in another way.
    SomeTexels(&'a Buffer),
    /// An image read texel by texel, or a storage image if the shader declares it so.
    Image(&'a Image),
    /// A filtered texture.
    Texture(&'a Image, SamplerKind),
}

impl<'a> From<&'a Buffer> for Bind<'a> {
    fn from(buffer: &'a Buffer) -> Self {
        Bind::Buffer(buffer)
    }
}

impl<'a> From<&'a Image> for Bind<'a> {
    fn from(image: &'a Image) -> Self {
        Bind::Image(image)
    }
}

/// Data copied from the bound pipeline, so that its lifetime does not spread into the stages. The handles live until
/// the submission being recorded is done, even if the pipeline is dropped earlier.
#[derive(Clone, Copy)]
pub(super) struct Bound {
    pub(super) name: &'static str,
    pub(super) compute: bool,
    pub(super) group: [u32; 3],
    layout: vk::PipelineLayout,
    push_bytes: u32,
    push_stages: vk::ShaderStageFlags,
}

/// Identity of a resource.
fn id(resource: &Bind<'_>) -> u64 {
    match resource {
        Bind::Buffer(b) | Bind::Slice(b, ..) | Bind::Texels(b) | Bind::SomeTexels(b) => b.id,
        Bind::Image(i) | Bind::Texture(i, _) => i.id,
    }
}

impl Cmd<'_> {
    /// Binds a pipeline and its resources, in the order of the shader's bindings.
    pub fn bind(&self, pipeline: &Pipeline, resources: &[Bind<'_>]) {
        if self.failed() {
            return;
        }
        let of = pipeline;
        let pipeline = &*of.0;
        let (name, count) = (pipeline.name, pipeline.slots.len());
        assert_eq!(resources.len(), count, "{name}: its shaders declare {count} bindings");
        self.own(&pipeline.shared, name);
        self.check_scope(pipeline);
        for (slot, resource) in pipeline.slots.iter().zip(resources) {
            self.check(name, slot, resource);
        }
        let mut key = self.key.borrow_mut();
        key.clear();
        key.push(pipeline.layout.id);
        for (slot, resource) in pipeline.slots.iter().zip(resources) {
            key.push(id(resource));
            key.extend(match *resource {
                Bind::Buffer(buffer) => [0, buffer.held],
                Bind::Slice(_, offset, size) => [offset, size],
                Bind::Texels(_) | Bind::SomeTexels(_) => [4, 0],
                Bind::Image(_) => [1, 0],
                Bind::Texture(_, kind) => {
                    let wrap = kind.wrap.map(|w| w.as_raw() as u64);
                    [2 + u64::from(kind.nearest), wrap[0] << 32 | wrap[1]]
                }
            });
            for how in &slot.uses {
                match resource {
                    Bind::Buffer(b) | Bind::Slice(b, ..) | Bind::Texels(b) | Bind::SomeTexels(b) => {
                        self.touch_buffer(b, *how)
                    }
                    Bind::Image(i) | Bind::Texture(i, _) => self.touch_image(i, *how),
                }
            }
        }
        let shared = &self.gpu.shared;
        let (point, layout) = (pipeline.point(), pipeline.layout.handle);
        // SAFETY: the buffer is recording; the pipeline lives until its submission is done (see `graveyard`).
        unsafe { shared.device.cmd_bind_pipeline(self.buffer, point, pipeline.handle) };
        if !resources.is_empty() {
            let names = || std::iter::once(pipeline.layout.id).chain(resources.iter().map(id)).collect();
            let write = |set| self.write_set(set, pipeline, resources);
            let set = lock(&shared.descriptors).get(shared, &key, (name, pipeline.layout.set_layout), names, write);
            match set {
                // SAFETY: the set has this layout; it is freed with the objects it refers to, which live until the
                // submission is done.
                Ok(set) => unsafe {
                    shared.device.cmd_bind_descriptor_sets(self.buffer, point, layout, 0, &[set], &[]);
                },
                Err(error) => {
                    self.error.borrow_mut().get_or_insert(error);
                    return;
                }
            }
        }
        let Made { group, push_bytes, push_stages, .. } = *pipeline;
        let compute = pipeline.raster.is_none();
        self.bound.set(Some(Bound { name, compute, group, layout, push_bytes, push_stages }));
        if let Some(scope) = self.scope.borrow_mut().as_mut() {
            scope.pipeline = Some(of.clone());
        }
    }

    /// Graphics pipelines are bound inside rendering scopes, compute pipelines outside.
    fn check_scope(&self, pipeline: &Made) {
        let (name, scope) = (pipeline.name, self.scope.borrow());
        match (&pipeline.raster, &*scope) {
            (None, None) => {}
            (Some(state), Some(scope)) => {
                let depth = state.depth != Depth::None;
                assert!(
                    state.colors == scope.colors && depth == scope.depth && state.multisampled == scope.multisampled,
                    "{name}: made for {:?}{}{}, not for these attachments: {:?}{}{}",
                    state.colors,
                    if depth { " and depth" } else { "" },
                    if state.multisampled { ", multisampled" } else { "" },
                    scope.colors,
                    if scope.depth { " and depth" } else { "" },
                    if scope.multisampled { ", multisampled" } else { "" },
                );
                let writes = state.depth.is_written();
                assert!(!(writes && scope.read_only), "{name}: writes the depth, which this scope only reads");
            }
            (None, Some(_)) => panic!("{name}: a compute pipeline, bound inside a rendering scope"),
            (Some(_), None) => panic!("{name}: a graphics pipeline, bound outside a rendering scope"),
        }
    }

    /// Checks that a resource fits a binding.
    fn check(&self, name: &str, slot: &DescriptorSlot, resource: &Bind<'_>) {
        let (of, shared) = match resource {
            Bind::Buffer(b) | Bind::Slice(b, ..) | Bind::Texels(b) | Bind::SomeTexels(b) => (&b.name, &b.shared),
            Bind::Image(i) | Bind::Texture(i, _) => (&i.name, &i.shared),
        };
        self.own(shared, of);
        let limits = &self.gpu.shared.limits;
        let fits = match (slot.kind, *resource) {
            (vk::DescriptorType::STORAGE_BUFFER | vk::DescriptorType::UNIFORM_BUFFER, Bind::Buffer(_))
            | (vk::DescriptorType::UNIFORM_TEXEL_BUFFER, Bind::Texels(_) | Bind::SomeTexels(_)) => true,
            (
                kind @ (vk::DescriptorType::STORAGE_BUFFER | vk::DescriptorType::UNIFORM_BUFFER),
                Bind::Slice(b, at, n),
            ) => {
                let storage = kind == vk::DescriptorType::STORAGE_BUFFER;
                let (storage_step, uniform_step) =
                    (limits.min_storage_buffer_offset_alignment, limits.min_uniform_buffer_offset_alignment);
                let step = if storage { storage_step } else { uniform_step };
                let inside = n > 0 && at.checked_add(n).is_some_and(|end| end <= b.held);
                assert!(inside, "{name}: {n} bytes at {at} of {of}, which has {}", b.held);
                assert!(at.is_multiple_of(step), "{name}: byte {at} of {of}; slices begin at multiples of {step}");
                true
            }
            (vk::DescriptorType::COMBINED_IMAGE_SAMPLER, Bind::Image(i) | Bind::Texture(i, _)) => {
                slot.image.0 == Some(i.made.seen())
            }
            (vk::DescriptorType::STORAGE_IMAGE, Bind::Image(i)) => {
                assert!(i.made.usage.contains(vk::ImageUsageFlags::STORAGE), "{name}: {of} was not made as storage");
                slot.image == (Some(i.made.seen()), Some(i.made.format))
            }
            _ => false,
        };
        assert!(fits, "{name}: {of} does not fit binding {}, a {:?} {:?}", slot.binding, slot.kind, slot.image);
    }

    /// Checks the device's limit on the size of a binding.
    fn check_range(&self, kind: vk::DescriptorType, name: &str, bytes: u64) -> Result<()> {
        let limits = &self.gpu.shared.limits;
        let storage = kind == vk::DescriptorType::STORAGE_BUFFER;
        let limit = if storage { limits.max_storage_buffer_range } else { limits.max_uniform_buffer_range };
        if bytes > limit.into() {
            return Err(self.gpu.too_large(format!("buffer {name} needs {bytes} bytes"), limit.into()));
        }
        Ok(())
    }

    fn write_set(&self, set: vk::DescriptorSet, pipeline: &Made, resources: &[Bind<'_>]) -> Result<()> {
        let nearest = SamplerKind { wrap: [vk::SamplerAddressMode::CLAMP_TO_EDGE; 2], nearest: true };
        for (slot, resource) in pipeline.slots.iter().zip(resources) {
            let write =
                vk::WriteDescriptorSet::default().dst_set(set).dst_binding(slot.binding).descriptor_type(slot.kind);
            let (buffer, image, texels);
            let write = match *resource {
                Bind::Buffer(b) => {
                    self.check_range(slot.kind, &b.name, b.held)?;
                    buffer = [vk::DescriptorBufferInfo { buffer: b.handle, offset: 0, range: vk::WHOLE_SIZE }];
                    write.buffer_info(&buffer)
                }
                Bind::Slice(b, offset, range) => {
                    self.check_range(slot.kind, &b.name, range)?;
                    buffer = [vk::DescriptorBufferInfo { buffer: b.handle, offset, range }];
                    write.buffer_info(&buffer)
                }
                Bind::Texels(b) | Bind::SomeTexels(b) => {
                    texels = [self.gpu.texels(b, matches!(resource, Bind::Texels(_)))?];
                    write.texel_buffer_view(&texels)
                }
                Bind::Image(i) | Bind::Texture(i, _) => {
                    let kind = if let Bind::Texture(_, kind) = resource { *kind } else { nearest };
                    let storage = slot.kind == vk::DescriptorType::STORAGE_IMAGE;
                    let linear = vk::FormatFeatureFlags::SAMPLED_IMAGE_FILTER_LINEAR;
                    let filters =
                        kind.nearest || self.gpu.uses_of(i.made.format).optimal_tiling_features.contains(linear);
                    assert!(filters, "{}: the device does not filter {:?}", i.name, i.made.format);
                    let sampler = if storage { vk::Sampler::null() } else { self.gpu.sampler(kind)? };
                    image = [vk::DescriptorImageInfo {
                        sampler,
                        image_view: i.view,
                        image_layout: vk::ImageLayout::GENERAL,
                    }];
                    write.image_info(&image)
                }
            };
            // SAFETY: the set is new and not in use; the infos live to the end of the call.
            unsafe { self.gpu.shared.device.update_descriptor_sets(&[write], &[]) };
        }
        Ok(())
    }

    /// Sets the push constants of the bound pipeline.
    pub fn push<T: bytemuck::NoUninit>(&self, constants: &T) {
        if self.failed() {
            return;
        }
        let bound = self.bound.get().expect("bind before push");
        let bytes = bytemuck::bytes_of(constants);
        assert_eq!(bytes.len() as u32, bound.push_bytes, "{}: size of its push constants", bound.name);
        // SAFETY: size and stages are those of the layout.
        unsafe { self.gpu.shared.device.cmd_push_constants(self.buffer, bound.layout, bound.push_stages, 0, bytes) };
        self.pushed.set((bound.push_bytes, bound.push_stages));
    }

    /// Asserts that the bound pipeline's push constants are set. They stay set for other pipelines that declare the same.
    pub(super) fn check_pushed(&self, bound: &Bound) {
        let pushed = bound.push_bytes == 0 || self.pushed.get() == (bound.push_bytes, bound.push_stages);
        assert!(pushed, "{}: push constants first", bound.name);
    }
}
