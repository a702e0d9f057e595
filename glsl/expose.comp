// Stage 11: log-average luminance of the lit pixels. One workgroup and a fixed order: the same every time.
#include "shared.glsl"

layout(local_size_x = 256) in;
layout(constant_id = 0) const uint DIFFUSE = 1;
layout(constant_id = 1) const uint GLOSSY = 1;
layout(push_constant, scalar) uniform Push { CompositePush push; };
layout(binding = 0) uniform sampler2D direct_image;
layout(binding = 1) uniform sampler2D diffuse_image;
layout(binding = 2) uniform sampler2D glossy_image;
layout(binding = 3, scalar) writeonly buffer Exposure { float ev; };

shared vec2 sums[256];

// At most this many samples a thread: an exposure needs no more, and some drivers stop a loop at 65 535 rounds.
const uint ROUNDS = 4096u;

// Darker than this share of the mean counts as this share: what is nearly black shall not wash out the rest.
const float DARKEST = 1.0 / 32.0;

float luminance(uint pixel) {
    ivec2 at = ivec2(pixel % push.width, pixel / push.width);
    vec3 c = texelFetch(direct_image, at, 0).rgb;
    if (DIFFUSE != 0u) {
        c += texelFetch(diffuse_image, at, 0).rgb;
    }
    if (GLOSSY != 0u) {
        c += texelFetch(glossy_image, at, 0).rgb;
    }
    return dot(c, vec3(0.2126, 0.7152, 0.0722));
}

// Sum over all threads, in a fixed order; every thread gets it.
vec2 total(vec2 sum) {
    barrier();
    sums[gl_LocalInvocationID.x] = sum;
    barrier();
    for (uint half_count = 128u; half_count > 0u; half_count /= 2u) {
        if (gl_LocalInvocationID.x < half_count) {
            sums[gl_LocalInvocationID.x] += sums[gl_LocalInvocationID.x + half_count];
        }
        barrier();
    }
    return sums[0];
}

void main() {
    uint pixels = push.width * push.height;
    uint stride = max(1u, (pixels + 256u * ROUNDS - 1u) / (256u * ROUNDS));
    uint first = gl_LocalInvocationID.x * stride;
    vec2 sum = vec2(0.0);
    for (uint i = first; i < pixels; i += 256u * stride) {
        float l = luminance(i);
        sum += l > 0.0 ? vec2(l, 1.0) : vec2(0.0);
    }
    sum = total(sum);
    float darkest = DARKEST * sum.x / max(sum.y, 1.0);
    sum = vec2(0.0);
    for (uint i = first; i < pixels; i += 256u * stride) {
        float l = luminance(i);
        sum += l > 0.0 ? vec2(log2(max(l, darkest)), 1.0) : vec2(0.0);
    }
    sum = total(sum);
    if (gl_LocalInvocationID.x == 0u) {
        // The average becomes middle grey: exposure is 1 / (1.2 * 2^EV), and 0.18 of that is wanted.
        ev = sum.y > 0.0 ? sum.x / sum.y - log2(1.2 * 0.18) : 0.0;
    }
}
