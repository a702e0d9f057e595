// What short rays have found at a pixel, from the nearest pixels with rays. METHOD 11. Whoever includes this has the push
// constants of NearPush. Binding 12 is its own.
#ifndef NEAR_GLSL
#define NEAR_GLSL
#include "lib/near_alike.glsl"
#include "lib/octahedral.glsl"

layout(constant_id = 2) const uint EVERY = 2; // pixels and rows from one with rays to the next
layout(binding = 12, scalar) readonly buffer NearLights { NearLight near_lights[]; };

struct Near {
    vec3 irradiance; // of what rays met [lx]
    vec3 open; // share of the caches' light that comes along rays that met nothing
    vec3 glossy; // what a lobe takes of their light and the caches' [cd/m^2]
    float sky; // share of the sky's light that arrives at a lobe
};

// At a pixel, by the place of its surface and the unit normal of its triangle. Pixels on other surfaces count for next to
// nothing.
Near near_of(ivec2 pixel, vec3 position, vec3 geometric) {
    Near sum = Near(vec3(0.0), vec3(0.0), vec3(0.0), 0.0);
    float weights = 0.0;
    ivec2 first = pixel / int(EVERY);
    vec2 part = vec2(pixel % int(EVERY)) / float(EVERY);
    for (int j = 0; j < 4; ++j) {
        ivec2 offset = ivec2(j & 1, j >> 1);
        vec2 share = mix(1.0 - part, part, equal(offset, ivec2(1)));
        ivec2 other = min(first + offset, ivec2(push.width, push.height) - 1);
        if (share.x * share.y == 0.0) {
            continue;
        }
        NearLight p = near_lights[uint(other.y) * push.width + uint(other.x)];
        if (p.is_surface == 0u) {
            continue;
        }
        float weight = share.x * share.y * near_alike(position - p.position, geometric, p.normal);
        weights += weight;
        sum.irradiance += weight * p.irradiance;
        sum.open += weight * p.open;
        sum.glossy += weight * p.glossy;
        sum.sky += weight * p.sky;
    }
    if (weights == 0.0) {
        return Near(vec3(0.0), vec3(1.0), vec3(0.0), 1.0);
    }
    return Near(sum.irradiance / weights, sum.open / weights, sum.glossy / weights, sum.sky / weights);
}

#endif
