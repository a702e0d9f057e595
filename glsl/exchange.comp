// Stage 6, further bounces with traced caches: each cache receives the light of the caches that its rays hit. All
// texels of a depth image have equal shares of irradiance. A hit without a cache counts as the mean of the others: as
// black, every bounce would lose light in rooms full of small things. One workgroup per cache. METHOD 9.
#include "shared.glsl"

layout(local_size_x = 64) in;
layout(push_constant, scalar) uniform Push { BouncePush push; };
layout(binding = 0, scalar) readonly buffer Met { uint met[]; }; // per texel: a cache, UNKNOWN_CACHE or NO_REFERENCES
layout(binding = 1, scalar) readonly buffer Vals { Val vals[]; }; // of the caches
layout(binding = 2, scalar) writeonly buffer Parts { GatherSums parts[]; };

shared vec4 sums[64]; // radiosity [lm/m^2], and the number of texels that count

void main() {
    uint i = gl_WorkGroupID.y * DEPTH_IMAGE_ROW + gl_WorkGroupID.x;
    if (i >= push.cache_count) {
        return;
    }
    vec4 sum = vec4(0.0);
    for (uint texel = gl_LocalInvocationID.x; texel < DEPTH_IMAGE_TEXELS; texel += 64u) {
        vec2 p = (vec2(texel % DEPTH_IMAGE_SIDE, texel / DEPTH_IMAGE_SIDE) + 0.5) * (2.0 / float(DEPTH_IMAGE_SIDE)) - 1.0;
        if (dot(p, p) < 1.0) {
            uint cache = met[i * DEPTH_IMAGE_TEXELS + texel];
            sum.w += cache == UNKNOWN_CACHE ? 0.0 : 1.0;
            sum.rgb += cache == UNKNOWN_CACHE || cache == NO_REFERENCES ? vec3(0.0) : vals[cache].flux / max(vals[cache].area, 1e-30);
        }
    }
    sums[gl_LocalInvocationID.x] = sum;
    for (uint half_ = 32u; half_ > 0u; half_ /= 2u) {
        barrier();
        if (gl_LocalInvocationID.x < half_) {
            sums[gl_LocalInvocationID.x] += sums[gl_LocalInvocationID.x + half_];
        }
    }
    if (gl_LocalInvocationID.x == 0u) {
        parts[i].diffuse_irradiance = sums[0].rgb / max(sums[0].w, 1.0);
    }
}
