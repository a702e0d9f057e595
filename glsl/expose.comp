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

void main() {
    uint pixels = push.width * push.height;
    uint stride = max(1u, (pixels + 256u * ROUNDS - 1u) / (256u * ROUNDS));
    vec2 sum = vec2(0.0);
    for (uint i = gl_LocalInvocationID.x * stride; i < pixels; i += 256u * stride) {
        ivec2 at = ivec2(i % push.width, i / push.width);
        vec3 c = texelFetch(direct_image, at, 0).rgb;
        if (DIFFUSE != 0u) {
            c += texelFetch(diffuse_image, at, 0).rgb;
        }
        if (GLOSSY != 0u) {
            c += texelFetch(glossy_image, at, 0).rgb;
        }
        float luminance = dot(c, vec3(0.2126, 0.7152, 0.0722));
        if (luminance > 0.0) {
            sum += vec2(log2(luminance), 1.0);
        }
    }
    sums[gl_LocalInvocationID.x] = sum;
    barrier();
    for (uint half_count = 128u; half_count > 0u; half_count /= 2u) {
        if (gl_LocalInvocationID.x < half_count) {
            sums[gl_LocalInvocationID.x] += sums[gl_LocalInvocationID.x + half_count];
        }
        barrier();
    }
    if (gl_LocalInvocationID.x == 0u) {
        // The average becomes middle grey: exposure is 1 / (1.2 * 2^EV), and 0.18 of that is wanted.
        float mean = sums[0].y > 0.0 ? sums[0].x / sums[0].y : 0.0;
        ev = mean - log2(1.2 * 0.18);
    }
}
