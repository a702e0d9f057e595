// Reflectance of the surface at a fragment, from its material's textures.
#ifndef SURFACE_GLSL
#define SURFACE_GLSL
#include "lib/material.glsl"
#include "lib/samples.glsl"
#include "lib/textures.glsl"

// Normal of a triangle on the viewer's side, from the differences of positions to the next pixels.
vec3 facing_normal(vec3 px, vec3 py, vec3 normal, vec3 towards_viewer) {
    // If neighbouring positions are equal in f32, the differences vanish; use the vertex normal then.
    vec3 geometric = cross(unit_or(px, vec3(0.0)), unit_or(py, vec3(0.0)));
    geometric = unit_or(geometric, unit_or(normal, towards_viewer));
    return dot(geometric, towards_viewer) < 0.0 ? -geometric : geometric;
}

// Place of a multisampled pixel's sample on a texture, of which it covers a quarter of the pixel.
Uv uv_at_sample(Uv middle, uint i) {
    vec2 offset = STANDARD_SAMPLES[i];
    return Uv(middle.at + middle.dx * offset.x + middle.dy * offset.y, 0.5 * middle.dx, 0.5 * middle.dy);
}

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
