//! Constants of the SPIR-V specification, by their names there. Only those that `reflect` reads.

use ash::vk;

/// First word of every module.
pub(super) const MAGIC: u32 = 0x0723_0203;

/// Words before the first instruction.
pub(super) const HEADER: usize = 5;

/// Instructions.
pub(super) mod op {
    pub(crate) const EXECUTION_MODE: u32 = 16;
    pub(crate) const TYPE_INT: u32 = 21;
    pub(crate) const TYPE_FLOAT: u32 = 22;
    pub(crate) const TYPE_VECTOR: u32 = 23;
    pub(crate) const TYPE_MATRIX: u32 = 24;
    pub(crate) const TYPE_IMAGE: u32 = 25;
    pub(crate) const TYPE_SAMPLED_IMAGE: u32 = 27;
    pub(crate) const TYPE_ARRAY: u32 = 28;
    pub(crate) const TYPE_STRUCT: u32 = 30;
    pub(crate) const TYPE_POINTER: u32 = 32;
    pub(crate) const CONSTANT: u32 = 43;
    pub(crate) const CONSTANT_COMPOSITE: u32 = 44;
    pub(crate) const SPEC_CONSTANT: u32 = 50;
    pub(crate) const SPEC_CONSTANT_COMPOSITE: u32 = 51;
    pub(crate) const FUNCTION_END: u32 = 56;
    pub(crate) const VARIABLE: u32 = 59;
    pub(crate) const DECORATE: u32 = 71;
    pub(crate) const MEMBER_DECORATE: u32 = 72;
    pub(crate) const EXECUTION_MODE_ID: u32 = 331;
}

/// Execution modes of an entry point.
pub(super) mod mode {
    pub(crate) const LOCAL_SIZE: u32 = 17;
    pub(crate) const LOCAL_SIZE_ID: u32 = 38;
}

/// Decorations of identities and of members.
pub(super) mod decoration {
    pub(crate) const SPEC_ID: u32 = 1;
    pub(crate) const BUFFER_BLOCK: u32 = 3;
    pub(crate) const BUILT_IN: u32 = 11;
    pub(crate) const NON_WRITABLE: u32 = 24;
    pub(crate) const NON_READABLE: u32 = 25;
    pub(crate) const LOCATION: u32 = 30;
    pub(crate) const BINDING: u32 = 33;
    pub(crate) const OFFSET: u32 = 35;
}

/// Values of the decoration `BUILT_IN`.
pub(super) mod built_in {
    pub(crate) const WORKGROUP_SIZE: u32 = 25;
}

/// Storage classes of variables.
pub(super) mod storage {
    pub(crate) const UNIFORM_CONSTANT: u32 = 0;
    pub(crate) const INPUT: u32 = 1;
    pub(crate) const UNIFORM: u32 = 2;
    pub(crate) const PUSH_CONSTANT: u32 = 9;
    pub(crate) const STORAGE_BUFFER: u32 = 12;
}

/// Dimensions of images.
pub(super) mod dim {
    pub(crate) const TWO: u32 = 1;
    pub(crate) const THREE: u32 = 2;
    pub(crate) const BUFFER: u32 = 5;
}

/// Whether an image is read through a sampler or as storage.
pub(super) mod sampled {
    pub(crate) const WITH_SAMPLER: u32 = 1;
}

/// Texel formats of storage images, with Vulkan's names.
pub(super) const IMAGE_FORMATS: [(u32, vk::Format); 9] = [
    (1, vk::Format::R32G32B32A32_SFLOAT),
    (2, vk::Format::R16G16B16A16_SFLOAT),
    (3, vk::Format::R32_SFLOAT),
    (4, vk::Format::R8G8B8A8_UNORM),
    (6, vk::Format::R32G32_SFLOAT),
    (7, vk::Format::R16G16_SFLOAT),
    (30, vk::Format::R32G32B32A32_UINT),
    (33, vk::Format::R32_UINT),
    (35, vk::Format::R32G32_UINT),
];
