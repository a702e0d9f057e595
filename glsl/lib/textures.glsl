// Textures of the drawn material: samplers and their slots. Included by entry shaders that shade surfaces; uses
// bindings 1 to 14.
#ifndef TEXTURES_GLSL
#define TEXTURES_GLSL
#include "shared.glsl"

layout(constant_id = 0) const uint KIND = 0x6fffu; // KIND_* bits of the pipeline's materials

layout(binding = 1, scalar) readonly buffer Materials { Material materials[]; };
layout(binding = 2, scalar) readonly buffer TextureSlots { TextureSlot texture_slots[]; };
layout(binding = 3) uniform sampler2D base_color_texture;
layout(binding = 4) uniform sampler2D metallic_roughness_texture;
layout(binding = 5) uniform sampler2D normal_texture;
layout(binding = 6) uniform sampler2D emissive_texture;
layout(binding = 7) uniform sampler2D specular_texture;
layout(binding = 8) uniform sampler2D specular_color_texture;
layout(binding = 9) uniform sampler2D transmission_texture;
layout(binding = 10) uniform sampler2D thickness_texture;
layout(binding = 11) uniform sampler2D coat_texture;
layout(binding = 12) uniform sampler2D coat_roughness_texture;
layout(binding = 13) uniform sampler2D sheen_color_texture;
layout(binding = 14) uniform sampler2D sheen_roughness_texture;

// Texture coordinate for one texture of a material: selected set, transformed.
vec2 texture_uv(uint material, uint which, vec4 uv) {
    TextureSlot slot = texture_slots[material * TEXTURE_COUNT + which];
    vec2 t = slot.uv_set == 0u ? uv.xy : uv.zw;
    return slot.linear.xy * t.x + slot.linear.zw * t.y + slot.translation;
}

// Texture coordinates and their screen derivatives. Computed before any branch: inside a branch neighbours' values may
// be undefined, and so may the mip level.
struct Uv {
    vec4 at;
    vec4 dx;
    vec4 dy;
};

Uv uv_here(vec4 uv) {
    return Uv(uv, dFdx(uv), dFdy(uv));
}

// Samples one texture of a material at a point.
vec4 sample_texture(sampler2D image, uint material, uint which, Uv uv) {
    TextureSlot slot = texture_slots[material * TEXTURE_COUNT + which];
    mat2 linear = mat2(slot.linear.xy, slot.linear.zw);
    bool first = slot.uv_set == 0u;
    return textureGrad(image, texture_uv(material, which, uv.at), linear * (first ? uv.dx.xy : uv.dx.zw),
                       linear * (first ? uv.dy.xy : uv.dy.zw));
}

// Known at pipeline creation if all materials of the pipeline are alike; missing textures then cost nothing.
bool has_texture(uint material, uint which) {
    bool any = (KIND >> which & 1u) != 0u;
    return any && ((KIND & KIND_MIXED) == 0u || texture_slots[material * TEXTURE_COUNT + which].present != 0u);
}

// Whether parts of surfaces may be cut out. If not, the depth test may come before shading, since nothing is discarded.
bool has_holes() {
    return (KIND & KIND_MASKED) != 0u;
}

// Whether the material is one of the method's own Phong materials.
bool is_phong(uint material) {
    return (KIND & KIND_MIXED) == 0u ? (KIND & KIND_PHONG) != 0u : materials[material].phong_exponent >= 0.0;
}

#endif
