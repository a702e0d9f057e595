// Reflectance of the surface at a fragment, from its material's textures.
#ifndef SURFACE_GLSL
#define SURFACE_GLSL
#include "lib/material.glsl"
#include "lib/textures.glsl"

// Base colour and alpha: factor, texture and vertex colour.
vec4 base_color(uint material, Uv uv, vec4 color) {
    vec4 base = materials[material].base_color * color;
    if (has_texture(material, TEXTURE_BASE_COLOR)) {
        base *= sample_texture(base_color_texture, material, TEXTURE_BASE_COLOR, uv);
    }
    return base;
}

// Reflectance for a base colour at a point and a viewer at this cosine.
Reflectance reflectance(uint material, vec3 base, Uv uv, float cosine) {
    Material m = materials[material];
    if (is_phong(material)) {
        return Reflectance(base, m.phong_specular, m.phong_exponent);
    }
    float metallic = m.metallic;
    float roughness = m.roughness;
    if (has_texture(material, TEXTURE_METALLIC_ROUGHNESS)) {
        vec4 t = sample_texture(metallic_roughness_texture, material, TEXTURE_METALLIC_ROUGHNESS, uv);
        metallic *= t.b;
        roughness *= t.g;
    }
    float specular = m.specular;
    if (has_texture(material, TEXTURE_SPECULAR)) {
        specular *= sample_texture(specular_texture, material, TEXTURE_SPECULAR, uv).a;
    }
    vec3 specular_color = m.specular_color;
    if (has_texture(material, TEXTURE_SPECULAR_COLOR)) {
        specular_color *= sample_texture(specular_color_texture, material, TEXTURE_SPECULAR_COLOR, uv).rgb;
    }
    return metallic_roughness(base, metallic, roughness, m.ior, specular, specular_color, cosine);
}

#endif
