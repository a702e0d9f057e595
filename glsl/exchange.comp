// Stage 6, further bounces with traced caches: each cache receives the light of the caches that its rays hit. All
// texels of a depth image have equal shares of irradiance. A hit without a cache counts as the mean of the others: as
// black, every bounce would lose light in rooms full of small things. One workgroup per cache. METHOD 9.
// variant exchange_far.comp: FAR (the light for pixels, as sums for proxies)
#include "shared.glsl"

layout(local_size_x = 64) in;
#ifdef FAR
layout(constant_id = 0) const uint IRRADIANCE_WEIGHTS = 1; // else form-factor weights
#endif
layout(push_constant, scalar) uniform Push { BouncePush push; };
layout(binding = 0, scalar) readonly buffer Met { uint met[]; }; // per texel: a cache, UNKNOWN_CACHE or NO_REFERENCES
layout(binding = 1, scalar) readonly buffer Vals { Val vals[]; }; // of the caches
layout(binding = 2, scalar) writeonly buffer Parts { GatherSums parts[]; };

shared vec4 sums[64]; // radiosity [lm/m^2], and the number of texels that count
#ifdef FAR
shared vec4 places[64]; // weighted sum of the caches' positions relative to the receiver, and the sum of weights
shared float distances2[64]; // weighted sum of their squared distances
#endif

void main() {
    uint i = gl_WorkGroupID.y * DEPTH_IMAGE_ROW + gl_WorkGroupID.x;
    if (i >= push.cache_count) {
        return;
    }
    uint thread = gl_LocalInvocationID.x;
    vec4 sum = vec4(0.0);
#ifdef FAR
    vec3 receiver = vals[i].position;
    vec4 place = vec4(0.0);
    float distance2 = 0.0;
#endif
    for (uint texel = thread; texel < DEPTH_IMAGE_TEXELS; texel += 64u) {
        vec2 p = (vec2(texel % DEPTH_IMAGE_SIDE, texel / DEPTH_IMAGE_SIDE) + 0.5) * (2.0 / float(DEPTH_IMAGE_SIDE)) - 1.0;
        if (dot(p, p) < 1.0) {
            uint cache = met[i * DEPTH_IMAGE_TEXELS + texel];
            sum.w += cache == UNKNOWN_CACHE ? 0.0 : 1.0;
            if (cache != UNKNOWN_CACHE && cache != NO_REFERENCES) {
                Val val = vals[cache];
                float per_area = 1.0 / max(val.area, 1e-30);
                sum.rgb += val.flux * per_area;
#ifdef FAR
                float weight = IRRADIANCE_WEIGHTS != 0u ? val.weight * per_area : 1.0;
                vec3 d = val.position - receiver;
                place += weight * vec4(d, 1.0);
                distance2 += weight * dot(d, d);
#endif
            }
        }
    }
    sums[thread] = sum;
#ifdef FAR
    places[thread] = place;
    distances2[thread] = distance2;
#endif
    for (uint half_ = 32u; half_ > 0u; half_ /= 2u) {
        barrier();
        if (thread < half_) {
            sums[thread] += sums[thread + half_];
#ifdef FAR
            places[thread] += places[thread + half_];
            distances2[thread] += distances2[thread + half_];
#endif
        }
    }
    if (thread == 0u) {
        float share = 1.0 / max(sums[0].w, 1.0);
        GatherSums all = GatherSums(vec3(0.0), 0.0, sums[0].rgb * share, 0.0, vec3(0.0), 0.0, vec3(0.0), 0.0);
#ifdef FAR
        all.diffuse_position = places[0].xyz * share;
        all.diffuse_weight = places[0].w * share;
        all.distance2 = distances2[0] * share;
#endif
        parts[i] = all;
    }
    // Light of emitting surfaces has used further parts.
    for (uint part = 1u + thread; part < push.cache_parts; part += 64u) {
        parts[part * push.cache_count + i] = GatherSums(vec3(0.0), 0.0, vec3(0.0), 0.0, vec3(0.0), 0.0, vec3(0.0), 0.0);
    }
}
