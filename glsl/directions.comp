// Stage 6, after the gather: sorts the light of each live cache by direction, for short rays to look up. One workgroup
// per cache. METHOD 11.
// variant directions_shadowed.comp: SHADOWED (where indirect light is shadowed)
// variant directions_bounces.comp: BOUNCES (where caches light caches, too)
// variant directions_shadowed_bounces.comp: SHADOWED BOUNCES (both)
#include "shared.glsl"
#include "lib/directions.glsl"
#include "lib/form_factor.glsl"

const uint THREADS = 8u; // as many as have room for a map each
layout(local_size_x = THREADS) in;
layout(push_constant, scalar) uniform Push { DirectionsPush push; };
layout(binding = 0, scalar) readonly buffer Caches { Cache caches[]; };
layout(binding = 1, scalar) readonly buffer Live { uint live[]; };
layout(binding = 2, scalar) readonly buffer Args { LiveArgs args; };
layout(binding = 3, scalar) readonly buffer ValCount { uint val_count; };
layout(binding = 4, scalar) readonly buffer Vals { Val vals[]; };
layout(binding = 5, scalar) writeonly buffer Radiances { uint radiances[]; }; // DIRECTIONS values per cache [cd/m^2]
#ifdef BOUNCES
layout(binding = 6, scalar) readonly buffer CacheValCount { uint cache_val_count; };
layout(binding = 7, scalar) readonly buffer CacheVals { Val cache_vals[]; };
layout(binding = 8, scalar) readonly buffer Scales { float scales[]; };
#endif
#ifdef SHADOWED
layout(constant_id = 0) const uint IMAGES_AS_TEXELS = 1;
#ifdef BOUNCES
#define IMAGE_BINDING 9
#define IMAGE_WORDS_BINDING 10
#else
#define IMAGE_BINDING 6
#define IMAGE_WORDS_BINDING 7
#endif
#include "lib/sees.glsl"
#endif

// One map per thread.
shared float sums[3u * DIRECTIONS * THREADS];

// The workgroup's cache.
Cache c;
#ifdef SHADOWED
View seen_by;
#endif

// Adds a VAL's irradiance on a surface that faces it, with the given flux.
void add(Val val, vec3 flux) {
    vec3 d = val.position - c.position;
    float d2 = dot(d, d);
    float inverse = inversesqrt(max(d2, 1e-37));
    float cosine = -dot(val.normal, d) * inverse;
    float share = clamp((d2 - push.near_begin) * push.near_scale, 0.0, 1.0);
    if (cosine <= 0.0 || share <= 0.0 || dot(c.normal, d) <= 0.0) {
        return;
    }
#ifdef SHADOWED
    share *= sees(seen_by, d);
#endif
    vec3 e = flux * (share * cosine / max(max(val.area, PI * d2), 1e-37));
    uint at = direction_index(d * inverse) * 3u * THREADS + gl_LocalInvocationID.x;
    sums[at] += e.x;
    sums[at + THREADS] += e.y;
    sums[at + 2u * THREADS] += e.z;
}

void main() {
    uint slot = gl_WorkGroupID.y * DEPTH_IMAGE_ROW + gl_WorkGroupID.x;
    if (slot >= args.cache_count) {
        return;
    }
    uint thread = gl_LocalInvocationID.x;
    for (uint i = 0u; i < 3u * DIRECTIONS; ++i) {
        sums[i * THREADS + thread] = 0.0;
    }
    uint cache = live[slot];
    c = caches[cache];
#ifdef SHADOWED
    seen_by = view(slot, c.normal);
#endif
#ifdef BOUNCES
    for (uint i = thread; i < cache_val_count; i += THREADS) {
        Val val = cache_vals[i];
        add(val, val.flux * scales[slot]);
    }
#endif
    // Neighbours in an RSM lie in about the same direction and are merged. The list is padded with dark VALs.
    for (uint first = thread * push.together; first < val_count; first += THREADS * push.together) {
        Val val = vals[first];
        vec3 flux = val.flux;
        for (uint i = 1u; i < push.together; ++i) {
            flux += vals[first + i].flux;
        }
        add(val, flux);
    }
    barrier();
    for (uint direction = thread; direction < DIRECTIONS; direction += THREADS) {
        vec3 sum = vec3(0.0);
        for (uint i = 0u; i < THREADS; ++i) {
            uint at = direction * 3u * THREADS + i;
            sum += vec3(sums[at], sums[at + THREADS], sums[at + 2u * THREADS]);
        }
        radiances[cache * DIRECTIONS + direction] = pack_radiance(sum / direction_solid_angle(direction));
    }
}
