// What short rays have found around a pixel, of its own and its neighbours'. METHOD 11. Whoever includes this has the push
// constants of NearPush. Binding 12 is its own. Twin: src/reference/near.rs.
#ifndef NEAR_GLSL
#define NEAR_GLSL
#include "lib/octahedral.glsl"

layout(constant_id = 2) const uint EVERY = 2; // pixels and rows from one with rays to the next
layout(binding = 12, scalar) readonly buffer NearPixels { NearPixel near_pixels[]; };

// A pixel's surface.
struct NearPlace {
    ivec2 pixel;
    vec3 position;
    vec3 geometric; // unit normal of the triangle
};

struct Near {
    vec3 irradiance; // of what rays met [lx]
    vec3 open; // share of the caches' light that comes along rays that met nothing
#ifndef DIFFUSE_ONLY
    vec3 glossy; // of a narrow lobe's rays [cd/m^2]
#endif
};

// Pixels with rays around one, along a side: NEAR_SIDE, and a ramp at either end.
const int NEAR_WINDOW = int(NEAR_SIDE) + 2;

// What the rays of the pixels around one found; any NEAR_SIDE^2 of these in a square have all directions. The window is as wide
// as that with soft ends, so that all directions count alike. Pixels on other surfaces count for next to nothing.
Near near_of(NearPlace at) {
    Near sum;
    sum.irradiance = vec3(0.0);
    vec3 far = vec3(0.0);
    vec3 all = vec3(0.0);
    float open = 0.0;
    float weights = 0.0;
#ifndef DIFFUSE_ONLY
    sum.glossy = vec3(0.0);
    float shares[NEAR_WINDOW * NEAR_WINDOW]; // of each pixel
    float blur = 0.0;
    float blurred = 0.0;
#endif
    ivec2 first = at.pixel / int(EVERY) - NEAR_WINDOW / 2 + 1;
    for (int j = 0; j < NEAR_WINDOW * NEAR_WINDOW; ++j) {
        ivec2 other = first + ivec2(j % NEAR_WINDOW, j / NEAR_WINDOW);
#ifndef DIFFUSE_ONLY
        shares[j] = 0.0;
#endif
        if (any(lessThan(other, ivec2(0))) || any(greaterThanEqual(other, ivec2(push.width, push.height)))) {
            continue;
        }
        NearPixel p = near_pixels[uint(other.y) * push.width + uint(other.x)];
        if (p.is_surface == 0u) {
            continue;
        }
        // Surfaces that bend are a little out of each other's planes.
        vec3 d = at.position - p.position;
        float d2 = dot(d, d);
        float aside = max(abs(dot(d, p.normal)), abs(dot(d, at.geometric))) * inversesqrt(max(d2, 1e-30));
        aside -= 0.25 * distance(p.normal, at.geometric);
        vec2 ramp = clamp(0.5 * float(NEAR_WINDOW) - abs(vec2(other) - vec2(at.pixel) / float(EVERY)), 0.0, 2.0);
        float alike = (1.0 - smoothstep(0.05, 0.2, aside)) * smoothstep(0.5, 0.9, dot(p.normal, at.geometric));
        float weight = ramp.x * ramp.y * (alike + 1e-4);
        weights += weight;
        sum.irradiance += weight * p.irradiance;
#ifndef DIFFUSE_ONLY
        shares[j] = p.is_sharp != 0u ? weight : 0.0;
        blur += shares[j] * p.blur;
        blurred += shares[j];
#endif
        far += weight * p.far;
        all += weight * p.all;
        open += weight * p.open;
    }
    sum.irradiance /= max(weights, 1e-30);
    // Where the nearest caches have no light the others' comes from anywhere.
    sum.open = mix(vec3(open / max(weights, 1e-30)), far / max(all, 1e-30), greaterThan(all, vec3(0.0)));
#ifndef DIFFUSE_ONLY
    // Each pixel has one direction of the lobe: all are taken alike, as far away as what is mirrored looks the same.
    blur /= max(blurred, 1e-30);
    float lobe_weights = 0.0;
    for (int j = 0; j < NEAR_WINDOW * NEAR_WINDOW; ++j) {
        if (shares[j] > 0.0) {
            ivec2 other = first + ivec2(j % NEAR_WINDOW, j / NEAR_WINDOW);
            NearPixel p = near_pixels[uint(other.y) * push.width + uint(other.x)];
            vec3 d = at.position - p.position;
            float of_blur = dot(d, d) / max(blur * blur, 1e-30);
            float share = shares[j] / (1.0 + of_blur * of_blur);
            lobe_weights += share;
            sum.glossy += share * p.glossy;
        }
    }
    sum.glossy /= max(lobe_weights, 1e-37);
#endif
    return sum;
}

#endif
