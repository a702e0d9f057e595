// What short rays have found around a pixel, of its own and its neighbours'. METHOD 11. Whoever includes this has the push
// constants of NearPush. Bindings 12 and 13 are its own. Twin: src/reference/near.rs.
#ifndef NEAR_GLSL
#define NEAR_GLSL
#include "lib/depth_image.glsl"
#include "lib/octahedral.glsl"

layout(constant_id = 2) const uint RAYS = 8; // of a pixel with rays
layout(constant_id = 3) const uint EVERY = 2; // pixels and rows from one with rays to the next
layout(binding = 12, scalar) readonly buffer NearPixels { NearPixel near_pixels[]; };
layout(binding = 13, scalar) readonly buffer Directions { vec3 directions[]; }; // about +z, by cosine

#ifdef DIFFUSE_ONLY
const uint ASKED = 1u;
#else
const uint ASKED = 3u;
#endif

// A pixel's surface.
struct NearPlace {
    ivec2 pixel;
    vec3 position;
    vec3 geometric; // unit normal of the triangle
};

struct Near {
    vec3 irradiance; // of what rays met [lx]
    float open_all; // share of all rays that met nothing
    float open[ASKED]; // the same about directions
};

// Rays within a lobe about a direction say whether it is open: cos^4.
float near_lobe(float c) {
    c = max(c, 0.0);
    c *= c;
    return c * c;
}

// What the rays of the nearest NEAR_SIDE^2 pixels with rays found; each of these has other directions. Those on other surfaces
// count for next to nothing.
Near near_of(NearPlace at, vec3 asked[ASKED]) {
    Near sum;
    sum.irradiance = vec3(0.0);
    sum.open_all = 0.0;
    float met[ASKED], all[ASKED];
    for (uint k = 0u; k < ASKED; ++k) {
        met[k] = 0.0;
        all[k] = 0.0;
    }
    float weights = 0.0;
    ivec2 first = (at.pixel + int(EVERY) / 2) / int(EVERY) - int(NEAR_SIDE) / 2;
    for (int j = 0; j < int(NEAR_SIDE * NEAR_SIDE); ++j) {
        ivec2 other = first + ivec2(j % int(NEAR_SIDE), j / int(NEAR_SIDE));
        if (any(lessThan(other, ivec2(0))) || any(greaterThanEqual(other, ivec2(push.width, push.height)))) {
            continue;
        }
        NearPixel p = near_pixels[uint(other.y) * push.width + uint(other.x)];
        if (p.is_surface == 0u) {
            continue;
        }
        vec3 d = at.position - p.position;
        float aside = abs(dot(d, p.normal)) + abs(dot(d, at.geometric));
        float flat_ = 1.0 - smoothstep(0.05, 0.25, aside * inversesqrt(max(dot(d, d), 1e-30)));
        float weight = flat_ * smoothstep(0.5, 0.9, dot(p.normal, at.geometric)) + 1e-4;
        weights += weight;
        sum.irradiance += weight * p.irradiance;
        sum.open_all += weight * float(bitCount(p.open)) / float(RAYS);
        vec3 tangent, bitangent;
        tangents(p.normal, tangent, bitangent);
        vec3 local[ASKED];
        for (uint k = 0u; k < ASKED; ++k) {
            local[k] = vec3(dot(asked[k], tangent), dot(asked[k], bitangent), dot(asked[k], p.normal));
        }
        uint subset = uint(other.y) % NEAR_SIDE * NEAR_SIDE + uint(other.x) % NEAR_SIDE;
        for (uint i = 0u; i < RAYS; ++i) {
            vec3 direction = directions[i * NEAR_SIDE * NEAR_SIDE + subset];
            float open = (p.open >> i & 1u) != 0u ? weight : 0.0;
            for (uint k = 0u; k < ASKED; ++k) {
                float lobe = near_lobe(dot(direction, local[k]));
                met[k] += open * lobe;
                all[k] += weight * lobe;
            }
        }
    }
    sum.irradiance /= max(weights, 1e-30);
    sum.open_all /= max(weights, 1e-30);
    for (uint k = 0u; k < ASKED; ++k) {
        sum.open[k] = all[k] > 0.0 ? met[k] / all[k] : 1.0;
    }
    return sum;
}

#endif
