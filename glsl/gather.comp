// Stage 6, compute path: adds one part of the VALs to the live caches, several caches per thread. METHOD 3-4, thesis
// 5.3.
// A part is short enough to keep its sums accurate, and does not depend on which caches are live. The thread that
// finishes a cache's last part sums all parts in a fixed order and writes the proxies: a separate pass would cost a
// software device as much as a thousand VALs. With bounces the parts are left to later passes (SUMS_ALONE).
// variant gather_sums.comp: SUMS_ALONE (the sums alone)
// variant gather_shadowed.comp: SHADOWED (where indirect light is shadowed)
// variant gather_shadowed_sums.comp: SHADOWED SUMS_ALONE (both)
// variant gather_eyes.comp: TWO_EYES (for two views at once, where a material has a glossy lobe)
// variant gather_shadowed_eyes.comp: SHADOWED TWO_EYES (both)
#extension GL_EXT_control_flow_attributes : require
#include "shared.glsl"

layout(local_size_x = GATHER_THREADS) in;
layout(constant_id = 0) const uint GLOSSY = 1;
layout(constant_id = 1) const uint SOURCE = VALS_TEXELS;
layout(constant_id = 2) const uint CACHES = 4; // per thread
layout(constant_id = 3) const uint SPREAD = 0; // 1: stage 7 needs the distances of glossy VALs
layout(constant_id = 4) const uint BY_HAND = 0; // 1: the device is a CPU
layout(constant_id = 5) const uint NEAR = 0; // 1: nearby VALs are left to short rays
layout(constant_id = 6) const uint LOBES = 0; // 1: VALs also send light in a lobe; only with NEAR
#ifdef SHADOWED
layout(constant_id = 7) const uint TOGETHER = 1; // VALs per visibility test: 1 or all of a round
layout(constant_id = 8) const uint IMAGES_AS_TEXELS = 1;
#endif
layout(push_constant, scalar) uniform Push { GatherPush push; };
layout(binding = 0, scalar) readonly buffer Caches { Cache caches[]; };
layout(binding = 1, scalar) readonly buffer Live { uint live[]; };
layout(binding = 2, scalar) readonly buffer Args { LiveArgs args; };
layout(binding = 3, scalar) readonly buffer ValCount { uint val_count; };
layout(binding = 4) uniform samplerBuffer val_texels;
layout(binding = 5, std430) readonly buffer Vals { vec4 vals[]; };
#ifdef SUMS_ALONE
layout(binding = 6, scalar) writeonly buffer Parts { GatherSums parts[]; };
#else
layout(binding = 6, scalar) coherent buffer Parts { GatherSums parts[]; };
layout(binding = 7, scalar) writeonly buffer Proxies { Proxy proxies[]; };
layout(binding = 8, scalar) coherent buffer Arrived { uint arrived[]; }; // finished parts of each thread's caches
#endif

#ifdef TWO_EYES
layout(binding = 10, scalar) coherent buffer SecondParts { GlossySums second_parts[]; };
#endif

#include "lib/gather.glsl"
#include "lib/val_lobe.glsl"
#ifdef SHADOWED
#define PLANES NEAR // rays trace the images exactly where they also find nearby light
#define IMAGE_BINDING 9
#define IMAGE_WORDS_BINDING 11
#include "lib/sees.glsl"
#endif
#ifndef SUMS_ALONE
#include "lib/proxy.glsl"
#endif

// VALs in shared memory at a time.
const uint STAGED = GATHER_THREADS;
shared vec4 staged[3u * STAGED];

Receiver receivers[CACHES];
GatherSums sums[CACHES];
#ifdef TWO_EYES
GlossySums second_sums[CACHES];
#endif

FourVals from_memory(uint first) {
    FourVals v;
    [[unroll]] for (uint i = 0u; i < AT_ONCE; ++i) {
        // Offsets are added last: they become constants in the unrolled loop.
        int at = int(3u * first) + int(3u * i);
        if (SOURCE == VALS_TEXELS) {
            put(v, i, texelFetch(val_texels, at), texelFetch(val_texels, at + 1), texelFetch(val_texels, at + 2));
        } else {
            put(v, i, vals[at], vals[at + 1], vals[at + 2]);
        }
    }
    return v;
}

#ifdef SHADOWED
View views[CACHES];
#endif

// Direction to the VAL that would light a cache most: where a surface curves, the others may face away.
vec3 most_lit(Receiver c, FourVals v) {
    vec4 x = v.x - c.position.x;
    vec4 y = v.y - c.position.y;
    vec4 z = v.z - c.position.z;
    vec4 g = form_factors(c, v, x, y, z, x * x + y * y + z * z);
    bool second = g.y > g.x;
    bool last = g.w > g.z;
    bool later = max(g.z, g.w) > max(g.x, g.y);
    vec3 early = second ? vec3(x.y, y.y, z.y) : vec3(x.x, y.x, z.x);
    vec3 late = last ? vec3(x.w, y.w, z.w) : vec3(x.z, y.z, z.z);
    return later ? late : early;
}

// Adds VALs to one cache after another, so that its sums stay in registers.
void add(FourVals v) {
    FourLobes lobes;
    vec3 lobe_flux[AT_ONCE];
    if (LOBES != 0u) {
        lobes = unpacked_lobes(v.lobe, v.normal_x, v.normal_y, v.normal_z);
        [[unroll]] for (uint i = 0u; i < AT_ONCE; ++i) {
            lobe_flux[i] = v.lobe[i] != 0.0 ? unpacked_flux(v.weight[i]) : vec3(0.0);
        }
    }
    FourVals all = v; // what they send to a cache
    [[unroll]] for (uint j = 0u; j < CACHES; ++j) {
        vec4 seen = vec4(1.0);
#ifdef SHADOWED
        if (TOGETHER == 1u) {
            [[unroll]] for (uint i = 0u; i < AT_ONCE; ++i) {
                seen[i] = sees(views[j], vec3(v.x[i], v.y[i], v.z[i]) - receivers[j].position);
            }
        } else {
            seen = vec4(sees(views[j], most_lit(receivers[j], v)));
        }
#endif
        vec4 far = vec4(1.0);
        if (NEAR != 0u) {
            vec4 x = v.x - receivers[j].position.x;
            vec4 y = v.y - receivers[j].position.y;
            vec4 z = v.z - receivers[j].position.z;
            vec4 d2 = x * x + y * y + z * z;
            far = clamp((d2 - push.near_begin) * push.near_scale, 0.0, 1.0);
            if (LOBES != 0u) {
                vec4 facing = -(v.normal_x * x + v.normal_y * y + v.normal_z * z);
                vec4 sent = sent_towards(lobes, facing, x, y, z, d2);
                [[unroll]] for (uint i = 0u; i < AT_ONCE; ++i) {
                    all.flux[i] = v.flux[i] + sent[i] * lobe_flux[i];
                    all.weight[i] = dot(all.flux[i], vec3(0.2126, 0.7152, 0.0722));
                }
            }
        }
        GatherSums s = sums[j];
#ifdef TWO_EYES
        GlossySums second = second_sums[j];
        accumulate(s, second, receivers[j], all, seen, far);
        second_sums[j] = second;
#else
        accumulate(s, receivers[j], all, seen, far);
#endif
        sums[j] = s;
    }
}

#ifndef SUMS_ALONE
// Writes the proxies of a thread's caches, in the thread that finishes their last part.
void resolve(uint first_slot) {
    uint counter = gl_GlobalInvocationID.x;
    memoryBarrierBuffer();
    if (atomicAdd(arrived[counter], 1u) + 1u < args.groups_y) {
        return;
    }
    memoryBarrierBuffer();
    arrived[counter] = 0u; // reset for the next frame
    for (uint slot = first_slot; slot < min(first_slot + CACHES, args.cache_count); ++slot) {
        GatherSums s = no_light();
        for (uint part = 0u; part < args.groups_y; ++part) {
            add_part(s, parts[part * push.cache_count + slot], GLOSSY != 0u);
        }
        uint cache = live[slot];
        proxies[push.first_proxy + cache] = proxy_of(caches[cache], s, push.eye, GLOSSY != 0u, SPREAD != 0u);
#ifdef TWO_EYES
        s.glossy_position = vec3(0.0);
        s.glossy_weight = 0.0;
        s.glossy_irradiance = vec3(0.0);
        s.glossy_distance2 = 0.0;
        for (uint part = 0u; part < args.groups_y; ++part) {
            GlossySums of_part = second_parts[part * push.cache_count + slot];
            s.glossy_position += of_part.position;
            s.glossy_weight += of_part.weight;
            s.glossy_irradiance += of_part.irradiance;
            s.glossy_distance2 += of_part.distance2;
        }
        proxies[push.second_proxy + cache] = proxy_of(caches[cache], s, push.second_eye, GLOSSY != 0u, SPREAD != 0u);
#endif
    }
}
#endif

void main() {
    uint first_slot = gl_GlobalInvocationID.x * CACHES;
    // Threads that stage VALs for others must not return.
    if (SOURCE != VALS_SHARED && first_slot >= args.cache_count) {
        return;
    }
    [[unroll]] for (uint j = 0u; j < CACHES; ++j) {
        uint slot = min(first_slot + j, args.cache_count - 1u);
#ifdef TWO_EYES
        receivers[j] = receiver(caches[live[slot]], push.eye, push.second_eye);
        second_sums[j] = GlossySums(vec3(0.0), 0.0, vec3(0.0), 0.0);
#else
        receivers[j] = receiver(caches[live[slot]], push.eye);
#endif
#ifdef SHADOWED
        views[j] = view(slot, -receivers[j].against);
#endif
        sums[j] = no_light();
    }
    // Whole tiles: the list is padded with dark VALs.
    uint first = gl_WorkGroupID.y * push.split;
    uint end = min(first + push.split, (val_count + VAL_TILE - 1u) / VAL_TILE * VAL_TILE);
    if (SOURCE == VALS_SHARED) {
        for (uint tile = first; tile < end; tile += STAGED) {
            barrier();
            uint at = 3u * gl_LocalInvocationID.x;
            [[unroll]] for (uint part = 0u; part < 3u; ++part) {
                staged[at + part] = vals[3u * tile + at + part];
            }
            barrier();
            for (uint i = 0u; i < STAGED; i += AT_ONCE) {
                FourVals v;
                [[unroll]] for (uint j = 0u; j < AT_ONCE; ++j) {
                    uint from = 3u * (i + j);
                    put(v, j, staged[from], staged[from + 1u], staged[from + 2u]);
                }
                add(v);
            }
        }
    } else {
        for (uint i = first; i < end; i += AT_ONCE) {
            add(from_memory(i));
        }
    }
    [[unroll]] for (uint j = 0u; j < CACHES; ++j) {
        if (first_slot + j < args.cache_count) {
            parts[(push.cache_parts + gl_WorkGroupID.y) * push.cache_count + first_slot + j] = sums[j];
#ifdef TWO_EYES
            second_parts[gl_WorkGroupID.y * push.cache_count + first_slot + j] = second_sums[j];
#endif
        }
    }
#ifndef SUMS_ALONE
    if (first_slot < args.cache_count) {
        resolve(first_slot);
    }
#endif
}
