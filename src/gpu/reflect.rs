//! Interface of a shader: bindings with their access, push-constant size, workgroup size. It is read from the SPIR-V,
//! so layouts, barrier checks and group counts follow the GLSL without duplication.

use super::spirv::{HEADER, IMAGE_FORMATS, MAGIC, built_in, decoration, dim, mode, op, sampled, storage};
use ash::vk;
use std::collections::HashMap;

/// One descriptor of a shader.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Binding {
    pub(crate) binding: u32,
    pub(crate) kind: vk::DescriptorType,
    /// Required view type of an image, and whether it has many samples per texel.
    pub(crate) view: Option<(vk::ImageViewType, bool)>,
    /// Format of a storage image.
    pub(crate) format: Option<vk::Format>,
    pub(crate) reads: bool,
    pub(crate) writes: bool,
}

/// The interface of a shader.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Interface {
    pub(crate) bindings: Vec<Binding>,
    pub(crate) push_bytes: u32,
    pub(crate) group: [u32; 3],
    /// Locations that it reads from vertices or from the stage before, with the formats of their types; ascending.
    pub(crate) inputs: Vec<(u32, vk::Format)>,
    /// Locations that it writes, likewise.
    pub(crate) outputs: Vec<(u32, vk::Format)>,
}

#[derive(Clone, Debug)]
enum Type {
    Int(u32),
    Float(u32),
    Vector(u32, u32),
    Matrix(u32, u32),
    Array(u32, u32),
    Struct(Vec<u32>),
    Image(Image),
    SampledImage(u32),
    Pointer(u32),
}

#[derive(Clone, Copy, Debug)]
struct Image {
    dim: u32,
    arrayed: bool,
    many: bool,
    sampled: bool,
    format: u32,
}

impl Image {
    fn view(self) -> Option<(vk::ImageViewType, bool)> {
        let view = match (self.dim, self.arrayed) {
            (dim::TWO, false) => vk::ImageViewType::TYPE_2D,
            (dim::TWO, true) => vk::ImageViewType::TYPE_2D_ARRAY,
            (dim::THREE, _) => vk::ImageViewType::TYPE_3D,
            _ => return None,
        };
        Some((view, self.many))
    }

    /// Format as a storage image.
    fn texels(self) -> vk::Format {
        let known = IMAGE_FORMATS.iter().find(|(number, _)| *number == self.format);
        known.unwrap_or_else(|| panic!("storage images of SPIR-V format {} are not supported", self.format)).1
    }
}

/// Data collected from a module.
#[derive(Default)]
struct Module {
    types: HashMap<u32, Type>,
    constants: HashMap<u32, u32>,
    composites: HashMap<u32, Vec<u32>>,
    /// By identity and decoration.
    decorations: HashMap<(u32, u32), u32>,
    /// By identity of the struct, index of the member and decoration.
    members: HashMap<(u32, u32, u32), u32>,
    /// Type, identity and storage class.
    variables: Vec<(u32, u32, u32)>,
}

/// Whether this may be a module: it has the header, and instructions fill the rest up to the end of a function.
pub(crate) fn is_module(spirv: &[u32]) -> bool {
    let (mut at, mut last) = (HEADER, 0);
    while let Some(word) = spirv.get(at) {
        match (word >> 16) as usize {
            0 => return false,
            count => at += count,
        }
        last = word & 0xffff;
    }
    at == spirv.len() && spirv[0] == MAGIC && last == op::FUNCTION_END
}

/// Reads a module written by glslang, with these specialisation constants. Panics on unknown constructs, since all
/// modules are ours.
pub(crate) fn interface(spirv: &[u32], specialised: &[u32]) -> Interface {
    let mut module = Module::default();
    let mut local_size = [1; 3];
    let mut local_size_ids: Option<[u32; 3]> = None;
    let mut at = HEADER;
    while at < spirv.len() {
        let (count, op) = ((spirv[at] >> 16) as usize, spirv[at] & 0xffff);
        let w = &spirv[at + 1..at + count];
        let of_type = match op {
            op::TYPE_INT => Some(Type::Int(w[1] / 8)),
            op::TYPE_FLOAT => Some(Type::Float(w[1] / 8)),
            op::TYPE_VECTOR => Some(Type::Vector(w[1], w[2])),
            op::TYPE_MATRIX => Some(Type::Matrix(w[1], w[2])),
            op::TYPE_IMAGE => Some(Type::Image(Image {
                dim: w[2],
                arrayed: w[4] == 1,
                many: w[5] == 1,
                sampled: w[6] == sampled::WITH_SAMPLER,
                format: w[7],
            })),
            op::TYPE_SAMPLED_IMAGE => Some(Type::SampledImage(w[1])),
            op::TYPE_ARRAY => Some(Type::Array(w[1], w[2])),
            op::TYPE_STRUCT => Some(Type::Struct(w[1..].to_vec())),
            op::TYPE_POINTER => Some(Type::Pointer(w[2])),
            _ => None,
        };
        match op {
            _ if of_type.is_some() => module.types.extend(of_type.map(|of_type| (w[0], of_type))),
            op::EXECUTION_MODE if w[1] == mode::LOCAL_SIZE => local_size = [w[2], w[3], w[4]],
            op::EXECUTION_MODE_ID if w[1] == mode::LOCAL_SIZE_ID => local_size_ids = Some([w[2], w[3], w[4]]),
            op::DECORATE => {
                module.decorations.insert((w[0], w[1]), w.get(2).copied().unwrap_or(1));
            }
            op::MEMBER_DECORATE => {
                module.members.insert((w[0], w[1], w[2]), w.get(3).copied().unwrap_or(1));
            }
            op::CONSTANT => {
                module.constants.insert(w[1], w[2]);
            }
            op::SPEC_CONSTANT => {
                let number = module.decorations.get(&(w[1], decoration::SPEC_ID));
                let value = number.and_then(|number| specialised.get(*number as usize)).copied();
                module.constants.insert(w[1], value.unwrap_or(w[2]));
            }
            op::CONSTANT_COMPOSITE | op::SPEC_CONSTANT_COMPOSITE => {
                module.composites.insert(w[1], w[2..].to_vec());
            }
            op::VARIABLE => module.variables.push((w[0], w[1], w[2])),
            _ => {}
        }
        at += count;
    }
    let group = local_size_ids.map_or(local_size, |ids| ids.map(|id| module.constants[&id]));
    let mut found = Interface { group, ..Interface::default() };
    // `layout(local_size_x = CONSTANT)` may also appear as the decorated WorkgroupSize composite.
    for (id, parts) in &module.composites {
        let built_in = module.decorations.get(&(*id, decoration::BUILT_IN));
        if built_in == Some(&built_in::WORKGROUP_SIZE) && parts.len() == 3 {
            found.group = [0, 1, 2].map(|i| module.constants[&parts[i]]);
        }
    }
    for (pointer, id, class) in &module.variables {
        let Some(Type::Pointer(pointee)) = module.types.get(pointer) else { continue };
        if *class == storage::PUSH_CONSTANT {
            found.push_bytes = module.size_of(*pointee);
        } else if let Some(binding) = module.decorations.get(&(*id, decoration::BINDING)) {
            found.bindings.push(module.binding(*binding, *id, *class, *pointee));
        } else if let Some(location) = module.decorations.get(&(*id, decoration::LOCATION)) {
            let list = if *class == storage::INPUT { &mut found.inputs } else { &mut found.outputs };
            list.extend(module.locations(*location, *pointee));
        }
    }
    found.bindings.sort_by_key(|b| b.binding);
    found.inputs.sort_by_key(|(location, _)| *location);
    found.outputs.sort_by_key(|(location, _)| *location);
    found
}

impl Module {
    fn binding(&self, binding: u32, id: u32, class: u32, pointee: u32) -> Binding {
        let everywhere = |decoration| match self.types.get(&pointee) {
            Some(Type::Struct(members)) => {
                self.decorations.contains_key(&(id, decoration))
                    || (0..members.len() as u32).all(|m| self.members.contains_key(&(pointee, m, decoration)))
            }
            _ => self.decorations.contains_key(&(id, decoration)),
        };
        let image = match self.types.get(&pointee) {
            Some(Type::Image(image)) => Some(*image),
            Some(Type::SampledImage(of)) => match self.types.get(of) {
                Some(Type::Image(image)) => Some(*image),
                _ => None,
            },
            _ => None,
        };
        let kind = match (class, self.types.get(&pointee)) {
            (storage::STORAGE_BUFFER, _) => vk::DescriptorType::STORAGE_BUFFER,
            (storage::UNIFORM, _) if self.decorations.contains_key(&(pointee, decoration::BUFFER_BLOCK)) => {
                vk::DescriptorType::STORAGE_BUFFER
            }
            (storage::UNIFORM, _) => vk::DescriptorType::UNIFORM_BUFFER,
            // A `samplerBuffer` is a sampled image of a buffer here, and needs no sampler in Vulkan.
            (storage::UNIFORM_CONSTANT, Some(Type::SampledImage(_) | Type::Image(Image { sampled: true, .. })))
                if image.is_some_and(|image| image.dim == dim::BUFFER) =>
            {
                vk::DescriptorType::UNIFORM_TEXEL_BUFFER
            }
            (storage::UNIFORM_CONSTANT, Some(Type::SampledImage(_))) => vk::DescriptorType::COMBINED_IMAGE_SAMPLER,
            (storage::UNIFORM_CONSTANT, Some(Type::Image(Image { sampled: true, .. }))) => {
                vk::DescriptorType::SAMPLED_IMAGE
            }
            (storage::UNIFORM_CONSTANT, Some(Type::Image(image))) if image.view().is_some() => {
                vk::DescriptorType::STORAGE_IMAGE
            }
            other => unreachable!("binding {binding}: {other:?}"),
        };
        let storage_kind = matches!(kind, vk::DescriptorType::STORAGE_BUFFER | vk::DescriptorType::STORAGE_IMAGE);
        Binding {
            binding,
            kind,
            view: image.and_then(Image::view),
            format: image.filter(|_| kind == vk::DescriptorType::STORAGE_IMAGE).map(Image::texels),
            reads: !storage_kind || !everywhere(decoration::NON_READABLE),
            writes: storage_kind && !everywhere(decoration::NON_WRITABLE),
        }
    }

    /// The locations that a variable takes, with their formats.
    fn locations(&self, first: u32, of_type: u32) -> Vec<(u32, vk::Format)> {
        if let Type::Array(element, count) = self.types[&of_type] {
            return (0..self.constants[&count]).flat_map(|i| self.locations(first + i, element)).collect();
        }
        let (element, count) = match self.types[&of_type] {
            Type::Vector(element, count) => (element, count),
            _ => (of_type, 1),
        };
        let format = match (&self.types[&element], count) {
            (Type::Int(4), 1) => vk::Format::R32_UINT,
            (Type::Int(4), 2) => vk::Format::R32G32_UINT,
            (Type::Int(4), 4) => vk::Format::R32G32B32A32_UINT,
            (Type::Float(4), 1) => vk::Format::R32_SFLOAT,
            (Type::Float(4), 2) => vk::Format::R32G32_SFLOAT,
            (Type::Float(4), 3) => vk::Format::R32G32B32_SFLOAT,
            (Type::Float(4), 4) => vk::Format::R32G32B32A32_SFLOAT,
            other => unreachable!("location {first}: {other:?}"),
        };
        vec![(first, format)]
    }

    /// Size of a type with its declared layout \[bytes\].
    fn size_of(&self, id: u32) -> u32 {
        match &self.types[&id] {
            Type::Int(bytes) | Type::Float(bytes) => *bytes,
            Type::Vector(element, count) | Type::Matrix(element, count) => self.size_of(*element) * count,
            Type::Array(element, count) => self.size_of(*element) * self.constants[count],
            Type::Struct(members) => {
                let offset = |m: usize| self.members.get(&(id, m as u32, decoration::OFFSET)).copied().unwrap_or(0);
                members.iter().enumerate().map(|(m, t)| offset(m) + self.size_of(*t)).max().unwrap_or(0)
            }
            other => unreachable!("no size: {other:?}"),
        }
    }
}
