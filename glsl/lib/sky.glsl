// Sky light as surfaces receive it. METHOD 12. Uses bindings SKY_BINDING and SKY_BINDING + 1. Twin:
// src/scene/sky_filter.rs.
#ifndef SKY_GLSL
#define SKY_GLSL

#include "lib/sky_grid.glsl"

layout(binding = SKY_BINDING + 1, scalar) readonly buffer SkyLevels { SkyLevel sky_levels[]; };

// Value of a grid in a unit direction.
vec3 sky_at(uint index, vec3 d) {
    return sky_value(sky_levels[index], d);
}

// Mean radiance [cd/m^2] of the sky about a unit direction, weighted by cos^k.
vec3 sky_lobe(vec3 d, float k) {
    float level = clamp(log2(SKY_EXPONENT / max(k, 1.0)), 0.0, float(SKY_LOBES));
    uint below = uint(level);
    vec3 narrow = sky_at(SKY_ITSELF + below, d);
    float part = level - float(below);
    return part == 0.0 ? narrow : mix(narrow, sky_at(SKY_ITSELF + min(below + 1u, SKY_LOBES), d), part);
}

#endif
