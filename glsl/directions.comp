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
layout(binding = 5) uniform samplerBuffer val_texels; // `vals` again
layout(binding = 6, scalar) writeonly buffer Radiances { uint radiances[]; }; // DIRECTIONS values per cache [cd/m^2]
layout(constant_id = 0) const uint VALS_AS_TEXELS = 0; // 1: VALs are read as texels
#ifdef BOUNCES
layout(binding = 7, scalar) readonly buffer CacheValCount { uint cache_val_count; };
layout(binding = 8, scalar) readonly buffer CacheVals { Val cache_vals[]; };
layout(binding = 9) uniform samplerBuffer cache_val_texels; // `cache_vals` again
layout(binding = 10, scalar) readonly buffer Scales { float scales[]; };
#endif
#ifdef SHADOWED
layout(constant_id = 1) const uint IMAGES_AS_TEXELS = 1;
#ifdef BOUNCES
#define IMAGE_BINDING 11
#define IMAGE_WORDS_BINDING 12
#else
#define IMAGE_BINDING 7
#define IMAGE_WORDS_BINDING 8
#endif
#include "lib/sees.glsl"
#endif

// A VAL from three texels of a buffer of VALs.
Val val_from(samplerBuffer texels, uint i) {
    vec4 place = texelFetch(texels, int(3u * i));
    vec4 facing = texelFetch(texels, int(3u * i + 1u));
    vec4 light = texelFetch(texels, int(3u * i + 2u));
    return Val(place.xyz, place.w, facing.xyz, 0u, light.rgb, light.w);
}

// One map per thread.
shared float sums[3u * DIRECTIONS * THREADS];

// The workgroup's cache.
Cache c;
#ifdef SHADOWED
View seen_by;
#endif

// Irradiance of VALs on surfaces that face them, and the vector to the one that lights the cache most.
struct Beam {
    vec3 irradiance;
    vec3 d;
    float most;
};

// Adds a VAL.
void take(inout Beam beam, Val val) {
    vec3 d = val.position - c.position;
    float d2 = dot(d, d);
    float cosine = -dot(val.normal, d) * inversesqrt(max(d2, 1e-37));
    float g = clamp((d2 - push.near_begin) * push.near_scale, 0.0, 1.0) * max(cosine, 0.0) / max(max(val.area, PI * d2), 1e-37);
    float at_cache = dot(c.normal, d);
    g = at_cache > 0.0 ? g : 0.0;
    beam.irradiance += g * val.flux;
    beam.d = g * at_cache > beam.most ? d : beam.d;
    beam.most = max(beam.most, g * at_cache);
}

// Adds a beam to the thread's map, if the cache sees where it comes from.
void add(Beam beam, float scale) {
    if (beam.most <= 0.0) {
        return;
    }
    vec3 e = beam.irradiance * scale;
#ifdef SHADOWED
    e *= sees(seen_by, beam.d);
#endif
    uint at = direction_index(normalize(beam.d)) * 3u * THREADS + gl_LocalInvocationID.x;
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
        Beam beam = Beam(vec3(0.0), vec3(0.0), 0.0);
        if (VALS_AS_TEXELS != 0u) {
            take(beam, val_from(cache_val_texels, i));
        } else {
            take(beam, cache_vals[i]);
        }
        add(beam, scales[slot]);
    }
#endif
    // Neighbours in an RSM lie in about the same direction and are merged. The list is padded with dark VALs.
    for (uint first = thread * push.together; first < val_count; first += THREADS * push.together) {
        Beam beam = Beam(vec3(0.0), vec3(0.0), 0.0);
        for (uint i = 0u; i < push.together; ++i) {
            if (VALS_AS_TEXELS != 0u) {
                take(beam, val_from(val_texels, first + i));
            } else {
                take(beam, vals[first + i]);
            }
        }
        add(beam, 1.0);
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
