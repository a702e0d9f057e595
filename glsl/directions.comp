// Stage 6, after the gather: sorts the light of each live cache by direction, for short rays to look up. One workgroup per
// cache. METHOD 11.
// variant directions_shadowed.comp: SHADOWED (where indirect light is shadowed)
// variant directions_bounces.comp: BOUNCES (where caches light caches, too)
// variant directions_shadowed_traced.comp: SHADOWED TRACED (where they do so by rays)
#include "shared.glsl"
#include "lib/directions.glsl"
#include "lib/form_factor.glsl"
#include "lib/val_lobe.glsl"

const uint MAPS = 8u; // as many as shared memory has room for
layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint THREADS = 8u; // a multiple of MAPS
layout(constant_id = 1) const uint VALS_AS_TEXELS = 0; // 1: VALs are read as texels
layout(constant_id = 2) const uint LOBES = 0; // 1: VALs also send light in a lobe
layout(push_constant, scalar) uniform Push { DirectionsPush push; };
layout(binding = 0, scalar) readonly buffer Caches { Cache caches[]; };
layout(binding = 1, scalar) readonly buffer Live { uint live[]; };
layout(binding = 2, scalar) readonly buffer Args { LiveArgs args; };
layout(binding = 3, scalar) readonly buffer ValCount { uint val_count; };
layout(binding = 4, std430) readonly buffer Vals { vec4 vals[]; }; // three words each
layout(binding = 5) uniform samplerBuffer val_texels; // `vals` again
layout(binding = 6, scalar) writeonly buffer Radiances { uint radiances[]; }; // DIRECTIONS values per cache [cd/m^2]
#ifdef BOUNCES
layout(binding = 7, scalar) readonly buffer CacheValCount { uint cache_val_count; };
layout(binding = 8, std430) readonly buffer CacheVals { vec4 cache_vals[]; };
layout(binding = 9) uniform samplerBuffer cache_val_texels; // `cache_vals` again
layout(binding = 10, scalar) readonly buffer Scales { float scales[]; };
#endif
#ifdef TRACED
layout(binding = 9, scalar) readonly buffer CacheVals { Val cache_vals[]; };
layout(binding = 10, scalar) readonly buffer Met { uint met[]; }; // caches at hits of each cache's rays, as of exchange.comp
layout(binding = 11, scalar) readonly buffer Parts { GatherSums parts[]; }; // light from all these caches comes first
#endif
#ifdef SHADOWED
layout(constant_id = 3) const uint IMAGES_AS_TEXELS = 1;
#define PLANES 1u
#define IMAGE_BINDING 7
#define IMAGE_WORDS_BINDING 8
#include "lib/sees.glsl"
#endif

// A VAL from its three words.
Val val_from(vec4 place, vec4 facing, vec4 light) {
    return Val(place.xyz, place.w, facing.xyz, floatBitsToUint(facing.w), light.rgb, light.w);
}

Val val_at(uint i) {
    int at = int(3u * i);
    return VALS_AS_TEXELS != 0u
        ? val_from(texelFetch(val_texels, at), texelFetch(val_texels, at + 1), texelFetch(val_texels, at + 2))
        : val_from(vals[at], vals[at + 1], vals[at + 2]);
}

#ifdef BOUNCES
Val cache_val_at(uint i) {
    int at = int(3u * i);
    return VALS_AS_TEXELS != 0u
        ? val_from(texelFetch(cache_val_texels, at), texelFetch(cache_val_texels, at + 1), texelFetch(cache_val_texels, at + 2))
        : val_from(cache_vals[at], cache_vals[at + 1], cache_vals[at + 2]);
}
#endif

// Sums by direction. Threads with the same index modulo MAPS share a map.
shared float sums[3u * DIRECTIONS * MAPS];

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
    vec3 flux = val.flux;
    if (LOBES != 0u && val.kind != 0u) {
        vec3 n = val.normal;
        FourLobes lobe = unpacked_lobes(vec4(uintBitsToFloat(val.kind)), vec4(n.x), vec4(n.y), vec4(n.z));
        float sent = sent_towards(lobe, vec4(-dot(n, d)), vec4(d.x), vec4(d.y), vec4(d.z), vec4(d2)).x;
        flux += sent * unpacked_flux(val.weight);
    }
    beam.irradiance += g * flux;
    beam.d = g * at_cache > beam.most ? d : beam.d;
    beam.most = max(beam.most, g * at_cache);
}

// Adds a beam to the thread's map, if the cache sees where it comes from. All threads of the workgroup call it together:
// those that share a map take turns.
void add(Beam beam, float scale) {
    bool is_lit = beam.most > 0.0;
    vec3 e = beam.irradiance * scale;
    uint at = 0u;
    if (is_lit) {
#ifdef SHADOWED
        e *= sees(seen_by, beam.d);
#endif
        at = direction_index(normalize(beam.d)) * 3u * MAPS + gl_LocalInvocationID.x % MAPS;
    }
    for (uint turn = 0u; turn < THREADS / MAPS; ++turn) {
        if (is_lit && gl_LocalInvocationID.x / MAPS == turn) {
            sums[at] += e.x;
            sums[at + MAPS] += e.y;
            sums[at + 2u * MAPS] += e.z;
        }
        if (THREADS > MAPS) {
            barrier();
        }
    }
}

#ifdef TRACED
// Directions per side of a texel that stand for it.
const uint PER_SIDE = 3u;

// Mean radiance [cd/m^2] over a direction's texel, from the caches that this cache's rays hit. Where no cache is known,
// it is that of all directions.
vec3 from_caches(uint slot, uint direction, vec3 tangent, vec3 bitangent) {
    vec3 sum = vec3(0.0);
    float known = 0.0;
    for (uint i = 0u; i < PER_SIDE * PER_SIDE; ++i) {
        vec2 at = vec2(direction % DIRECTION_SIDE, direction / DIRECTION_SIDE);
        at += (vec2(i % PER_SIDE, i / PER_SIDE) + 0.5) / float(PER_SIDE);
        vec3 d = octahedral_decode(at * (2.0 / float(DIRECTION_SIDE)) - 1.0);
        uint cache = met[slot * DEPTH_IMAGE_TEXELS + image_texel(d, tangent, bitangent)];
        known += cache == UNKNOWN_CACHE ? 0.0 : 1.0;
        if (cache != UNKNOWN_CACHE && cache != NO_REFERENCES) {
            sum += cache_vals[cache].flux / max(cache_vals[cache].area, 1e-30);
        }
    }
    return (known > 0.0 ? sum / known : parts[slot].diffuse_irradiance) / PI;
}
#endif

void main() {
    uint slot = gl_WorkGroupID.y * DEPTH_IMAGE_ROW + gl_WorkGroupID.x;
    if (slot >= args.cache_count) {
        return;
    }
    uint thread = gl_LocalInvocationID.x;
    for (uint i = thread; i < 3u * DIRECTIONS * MAPS; i += THREADS) {
        sums[i] = 0.0;
    }
    barrier();
    uint cache = live[slot];
    c = caches[cache];
#ifdef SHADOWED
    seen_by = view(slot, c.normal);
#endif
#ifdef BOUNCES
    for (uint first = 0u; first < cache_val_count; first += THREADS) {
        Beam beam = Beam(vec3(0.0), vec3(0.0), 0.0);
        if (first + thread < cache_val_count) {
            take(beam, cache_val_at(first + thread));
        }
        add(beam, scales[slot]);
    }
#endif
    // Neighbours in an RSM lie in about the same direction and are merged. The list is padded with dark VALs.
    for (uint first = 0u; first < val_count; first += THREADS * push.together) {
        Beam beam = Beam(vec3(0.0), vec3(0.0), 0.0);
        uint own = first + thread * push.together;
        for (uint i = 0u; i < push.together && own < val_count; ++i) {
            take(beam, val_at(own + i));
        }
        add(beam, 1.0);
    }
    barrier();
#ifdef TRACED
    vec3 tangent, bitangent;
    tangents(c.normal, tangent, bitangent);
#endif
    for (uint direction = thread; direction < DIRECTIONS; direction += THREADS) {
        vec3 sum = vec3(0.0);
        for (uint i = 0u; i < MAPS; ++i) {
            uint at = direction * 3u * MAPS + i;
            sum += vec3(sums[at], sums[at + MAPS], sums[at + 2u * MAPS]);
        }
        sum /= direction_solid_angle(direction);
#ifdef TRACED
        sum += from_caches(slot, direction, tangent, bitangent);
#endif
        radiances[cache * DIRECTIONS + direction] = pack_radiance(sum);
    }
}
