// Structs and constants of materials, shared by shaders and Rust: part of shared.glsl, same rules.
#ifndef SHARED_MATERIAL_GLSL
#define SHARED_MATERIAL_GLSL

// Textures of a material in binding order; each has a `TextureSlot`.
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

// Properties shared by all materials of one pipeline: bit i is set if they have texture i; the bits below come on top.
const uint KIND_PHONG = 0x1000u; // Phong materials of the method
const uint KIND_MASKED = 0x4000u; // alpha masks or blending cut some of the surface out
const uint KIND_MIXED = 0x2000u; // materials differ: bits say what any of them has, and shaders check each material

// glTF's metallic-roughness material, or the method's own Phong material.
struct Material {
    vec4 base_color;
    vec3 emissive; // [cd/m^2]
    float alpha_cutoff; // for light (shadows, RSMs, rays); negative: opaque
    float seen_cutoff; // for viewers; negative: opaque
    uint blend; // 1: alpha is the share of the background that is covered
    float transmission;
    vec3 attenuation; // inside the body behind the surface [1/m]
    float thickness; // of that body [model units]; 0: a thin sheet
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
    vec3 close_by; // share of the light entering a filled body that leaves it close to where it entered
    float inside_ior; // index of the medium; 0 where none fills the body
};

// Lookup of one texture of a material.
struct TextureSlot {
    vec4 linear; // columns of the 2x2 part of the texture transform
    vec2 translation;
    uint uv_set;
    uint present; // 0: no texture, only the factor counts
};

#endif
