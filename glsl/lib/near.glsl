// Results of short rays at a pixel, interpolated from the nearest pixels with rays. METHOD 11. The including shader has
// the push constants of NearPush. Uses bindings 12 and 13.
#ifndef NEAR_GLSL
#define NEAR_GLSL
#include "lib/near_alike.glsl"
#define NEAR_BINDING 12
#define NEAR_CONSTANT 2
#include "lib/near_lights.glsl"

struct Near {
    vec3 irradiance; // from the surfaces hit [lx]
    vec3 open; // share of the caches' light along rays that hit nothing
    vec3 glossy; // mean radiance over a lobe, from the surfaces hit and the caches [cd/m^2]
    float sky; // share of the sky's light that reaches a lobe
    vec3 open_sky; // share of the sky's light along rays that reach it
};

// Weighted sum over pixels with rays.
struct NearSum {
    Near near;
    float weights;
};

// Adds a pixel's result, weighted by the similarity of its surface.
void take_near(inout NearSum sum, ivec2 at, float share, vec3 position, vec3 geometric) {
    NearLight p = near_light(uint(at.y) * push.width + uint(at.x));
    if (p.geometric == 0.0) {
        return;
    }
    vec3 other = decoded_normal(p.geometric);
    float weight = share * near_alike(position - p.position, Facing(geometric, geometric), Facing(other, other));
    sum.weights += weight;
    sum.near.irradiance += weight * p.irradiance;
    sum.near.open += weight * p.open;
    sum.near.glossy += weight * p.glossy;
    sum.near.sky += weight * p.sky;
    sum.near.open_sky += weight * p.open_sky;
}

// Result at a pixel, from its surface's position and the unit normal of its triangle. Pixels on other surfaces hardly
// count.
Near near_of(ivec2 pixel, vec3 position, vec3 geometric) {
    NearSum sum = NearSum(Near(vec3(0.0), vec3(0.0), vec3(0.0), 0.0, vec3(0.0)), 0.0);
    ivec2 last = ivec2(push.width, push.height) - 1;
    int every = int(push.every);
    ivec2 first = pixel / every;
    vec2 part = vec2(pixel % every) / float(every);
    for (int j = 0; j < 4; ++j) {
        ivec2 offset = ivec2(j & 1, j >> 1);
        vec2 share = mix(1.0 - part, part, equal(offset, ivec2(1)));
        if (share.x * share.y > 0.0) {
            take_near(sum, min(first + offset, last), share.x * share.y, position, geometric);
        }
    }
    if (sum.weights < 0.01) {
        // No similar surface among the nearest pixels: the surface is a sliver here; search a wider neighbourhood.
        for (int j = 0; j < 16; ++j) {
            ivec2 offset = ivec2(j & 3, j >> 2) - 1;
            take_near(sum, clamp(first + offset, ivec2(0), last), 0.01, position, geometric);
        }
    }
    if (sum.weights == 0.0) {
        return Near(vec3(0.0), vec3(1.0), vec3(0.0), 1.0, vec3(1.0));
    }
    Near near = sum.near;
    return Near(near.irradiance / sum.weights, near.open / sum.weights, near.glossy / sum.weights, near.sky / sum.weights,
                near.open_sky / sum.weights);
}

#endif
