// Structs and constants of both sides that materials need: a part of shared.glsl, under the same rules.
#ifndef SHARED_MATERIAL_GLSL
#define SHARED_MATERIAL_GLSL

// Textures of a material, in binding order; each has its `TextureSlot`.
const uint TEXTURE_BASE_COLOR = 0u;
const uint TEXTURE_METALLIC_ROUGHNESS = 1u;
const uint TEXTURE_NORMAL = 2u;
const uint TEXTURE_EMISSIVE = 3u;
const uint TEXTURE_SPECULAR = 4u;
const uint TEXTURE_SPECULAR_COLOR = 5u;
const uint TEXTURE_TRANSMISSION = 6u;
const uint TEXTURE_THICKNESS = 7u;
const uint TEXTURE_COAT = 8u;
const uint TEXTURE_COAT_ROUGHNESS = 9u;
const uint TEXTURE_SHEEN_COLOR = 10u;
const uint TEXTURE_SHEEN_ROUGHNESS = 11u;
const uint TEXTURE_COUNT = 12u;

// What the materials that one pipeline draws have in common: bit i where they have texture i, and these.
const uint KIND_PHONG = 0x1000u; // they are the method's own
const uint KIND_MIXED = 0x2000u; // they differ: bits say what any of them has, and each has to be asked

// glTF's metallic-roughness material, or the method's own Phong material.
struct Material {
    vec4 base_color;
    vec3 emissive; // [cd/m^2]
    float alpha_cutoff; // of light; negative: opaque
    float seen_cutoff; // of viewers, likewise
    uint blend; // 1: alpha is how much of what is behind is covered
    float transmission;
    vec3 optical_depth; // of what is behind the surface
    vec3 specular_color;
    float specular;
    vec3 phong_specular;
    float phong_exponent; // negative: metallic-roughness
    float metallic;
    float roughness;
    float ior;
    float normal_scale;
    float coat; // share of the surface that is coated
    float coat_roughness;
    vec3 sheen_color;
    float sheen_roughness;
    uint is_filled; // 1: what is not reflected goes on inside
};

// How one texture of a material is looked up.
struct TextureSlot {
    vec4 linear; // columns of the transform's 2x2 part
    vec2 translation;
    uint uv_set;
    uint present; // 0: the factor stands alone
};

#endif
