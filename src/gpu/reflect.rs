//! What a shader declares: bindings with their access, push-constant size, workgroup size. Read from the SPIR-V, so
//! that layouts, barrier checks and group counts follow the GLSL without being written twice.

use ash::vk;
use std::collections::HashMap;

/// One descriptor of a shader.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Binding {
    pub(crate) binding: u32,
    pub(crate) kind: vk::DescriptorType,
    pub(crate) reads: bool,
    pub(crate) writes: bool,
}

/// The interface of a shader.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Interface {
    pub(crate) bindings: Vec<Binding>,
    pub(crate) push_bytes: u32,
    pub(crate) group: [u32; 3],
}

#[derive(Clone, Debug)]
enum Type {
    Scalar(u32),
    Vector(u32, u32),
    Matrix(u32, u32),
    Array(u32, u32),
    Struct(Vec<u32>),
    Image { sampled: bool, buffer: bool },
    SampledImage,
    Pointer(u32),
}

const DECORATION_BLOCK_BUFFER: u32 = 3;
const DECORATION_NON_WRITABLE: u32 = 24;
const DECORATION_NON_READABLE: u32 = 25;
const DECORATION_BINDING: u32 = 33;
const DECORATION_OFFSET: u32 = 35;
const STORAGE_UNIFORM_CONSTANT: u32 = 0;
const STORAGE_UNIFORM: u32 = 2;
const STORAGE_PUSH: u32 = 9;
const STORAGE_BUFFER: u32 = 12;
const DIMENSION_BUFFER: u32 = 5;

/// Reads a module that glslang wrote. Panics on what it does not know: the modules are ours.
pub(crate) fn interface(spirv: &[u32]) -> Interface {
    let mut types: HashMap<u32, Type> = HashMap::new();
    let mut constants: HashMap<u32, u32> = HashMap::new();
    let mut composites: HashMap<u32, Vec<u32>> = HashMap::new();
    let mut decorations: HashMap<(u32, u32), u32> = HashMap::new();
    let mut member: HashMap<(u32, u32, u32), u32> = HashMap::new();
    let mut variables: Vec<(u32, u32, u32)> = Vec::new();
    let mut local_size = [1; 3];
    let mut local_size_ids: Option<[u32; 3]> = None;
    let mut at = 5;
    while at < spirv.len() {
        let (count, op) = ((spirv[at] >> 16) as usize, spirv[at] & 0xffff);
        let w = &spirv[at + 1..at + count];
        match op {
            16 if w[1] == 17 => local_size = [w[2], w[3], w[4]],
            331 if w[1] == 38 => local_size_ids = Some([w[2], w[3], w[4]]),
            71 => {
                decorations.insert((w[0], w[1]), w.get(2).copied().unwrap_or(1));
            }
            72 => {
                member.insert((w[0], w[1], w[2]), w.get(3).copied().unwrap_or(1));
            }
            21 | 22 => {
                types.insert(w[0], Type::Scalar(w[1] / 8));
            }
            23 => {
                types.insert(w[0], Type::Vector(w[1], w[2]));
            }
            24 => {
                types.insert(w[0], Type::Matrix(w[1], w[2]));
            }
            25 => {
                types.insert(w[0], Type::Image { sampled: w[6] == 1, buffer: w[2] == DIMENSION_BUFFER });
            }
            27 => {
                types.insert(w[0], Type::SampledImage);
            }
            28 => {
                types.insert(w[0], Type::Array(w[1], w[2]));
            }
            30 => {
                types.insert(w[0], Type::Struct(w[1..].to_vec()));
            }
            32 => {
                types.insert(w[0], Type::Pointer(w[2]));
            }
            43 | 50 => {
                constants.insert(w[1], w[2]);
            }
            44 | 51 => {
                composites.insert(w[1], w[2..].to_vec());
            }
            59 => variables.push((w[0], w[1], w[2])),
            _ => {}
        }
        at += count;
    }
    let group = local_size_ids.map_or(local_size, |ids| ids.map(|id| constants[&id]));
    let mut found = Interface { group, ..Interface::default() };
    // `layout(local_size_x = CONSTANT)` may also arrive as the decorated WorkgroupSize composite.
    for (id, parts) in &composites {
        if decorations.get(&(*id, 11)) == Some(&25) && parts.len() == 3 {
            found.group = [0, 1, 2].map(|i| constants[&parts[i]]);
        }
    }
    for (pointer, id, storage) in variables {
        let Some(Type::Pointer(pointee)) = types.get(&pointer) else { continue };
        if storage == STORAGE_PUSH {
            found.push_bytes = size_of(*pointee, &types, &constants, &member);
            continue;
        }
        let Some(&binding) = decorations.get(&(id, DECORATION_BINDING)) else { continue };
        let everywhere = |decoration| match types.get(pointee) {
            Some(Type::Struct(members)) => {
                decorations.contains_key(&(id, decoration))
                    || (0..members.len() as u32).all(|m| member.contains_key(&(*pointee, m, decoration)))
            }
            _ => decorations.contains_key(&(id, decoration)),
        };
        let kind = match (storage, types.get(pointee)) {
            (STORAGE_BUFFER, _) => vk::DescriptorType::STORAGE_BUFFER,
            (STORAGE_UNIFORM, _) if decorations.contains_key(&(*pointee, DECORATION_BLOCK_BUFFER)) => {
                vk::DescriptorType::STORAGE_BUFFER
            }
            (STORAGE_UNIFORM, _) => vk::DescriptorType::UNIFORM_BUFFER,
            (STORAGE_UNIFORM_CONSTANT, Some(Type::SampledImage)) => vk::DescriptorType::COMBINED_IMAGE_SAMPLER,
            (STORAGE_UNIFORM_CONSTANT, Some(Type::Image { buffer: true, .. })) => {
                vk::DescriptorType::UNIFORM_TEXEL_BUFFER
            }
            (STORAGE_UNIFORM_CONSTANT, Some(Type::Image { sampled: true, .. })) => vk::DescriptorType::SAMPLED_IMAGE,
            (STORAGE_UNIFORM_CONSTANT, Some(Type::Image { sampled: false, .. })) => vk::DescriptorType::STORAGE_IMAGE,
            other => unreachable!("binding {binding}: {other:?}"),
        };
        let storage_kind = matches!(kind, vk::DescriptorType::STORAGE_BUFFER | vk::DescriptorType::STORAGE_IMAGE);
        found.bindings.push(Binding {
            binding,
            kind,
            reads: !storage_kind || !everywhere(DECORATION_NON_READABLE),
            writes: storage_kind && !everywhere(DECORATION_NON_WRITABLE),
        });
    }
    found.bindings.sort_by_key(|b| b.binding);
    found
}

/// Bytes of a type laid out as declared.
fn size_of(
    id: u32,
    types: &HashMap<u32, Type>,
    constants: &HashMap<u32, u32>,
    member: &HashMap<(u32, u32, u32), u32>,
) -> u32 {
    let size = |id| size_of(id, types, constants, member);
    match &types[&id] {
        Type::Scalar(bytes) => *bytes,
        Type::Vector(element, count) | Type::Matrix(element, count) => size(*element) * count,
        Type::Array(element, count) => size(*element) * constants[count],
        Type::Struct(members) => {
            let end =
                |(m, t): (usize, &u32)| member.get(&(id, m as u32, DECORATION_OFFSET)).copied().unwrap_or(0) + size(*t);
            members.iter().enumerate().map(end).max().unwrap_or(0)
        }
        other => unreachable!("no size: {other:?}"),
    }
}
