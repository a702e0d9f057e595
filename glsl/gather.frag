// Stage 6, fragment path: adds one tile of VALs to every live cache in float targets. METHOD 3-4, thesis listing 5.1.
// variant gather_diffuse.frag: DIFFUSE_ONLY (where nothing in the scene is glossy)
#extension GL_EXT_control_flow_attributes : require
#include "shared.glsl"
#include "lib/atlas.glsl"

layout(constant_id = 0) const uint SOURCE = VALS_TEXELS;
layout(constant_id = 1) const uint SPREAD = 0; // 1: stage 7 needs the distances of glossy VALs
layout(constant_id = 2) const uint BY_HAND = 0; // 1: the device is a CPU
layout(early_fragment_tests) in; // culling is the depth test
layout(push_constant, scalar) uniform Push { GatherPush push; };
layout(binding = 0, scalar) readonly buffer Caches { Cache caches[]; };
layout(binding = 1, scalar) readonly buffer ValCount { uint val_count; };
layout(binding = 2) uniform samplerBuffer val_texels;
layout(binding = 3, std430) readonly buffer Vals { vec4 vals[]; };

// For the texel's first cache, then its second: position and weight; irradiance and distance2; the same for the glossy
// lobe.
#ifdef DIFFUSE_ONLY
const uint GLOSSY = 0u;
layout(location = 0) out vec4 out_sums[TEXEL_CACHES * 2u];
#else
const uint GLOSSY = 1u;
layout(location = 0) out vec4 out_sums[TEXEL_CACHES * 4u];
#endif

#include "lib/gather.glsl"

// Groups of four VALs per round of the loop. On lavapipe one and four groups are slower.
const uint FOURS = 2u;

// One texel of a VAL, a third of it.
vec4 val_part(int at) {
    if (SOURCE == VALS_TEXELS) {
        return texelFetch(val_texels, at);
    }
    return vals[at];
}

void main() {
    uint first_cache = atlas_cache(ivec2(gl_FragCoord.xy), push.columns);
    Receiver receivers[TEXEL_CACHES];
    GatherSums sums[TEXEL_CACHES];
    [[unroll]] for (uint k = 0u; k < TEXEL_CACHES; ++k) {
        // Unused texels repeat the last cache: a branch around the loop would cost more.
        uint cache = min(first_cache + k, max(push.cache_count, 1u) - 1u);
        receivers[k] = receiver(caches[cache], push.eye);
        sums[k] = no_light();
    }
    uint end = min(push.first + push.tile, (val_count + VAL_TILE - 1u) / VAL_TILE * VAL_TILE);
    for (uint i = push.first; i < end; i += FOURS * AT_ONCE) {
        FourVals v[FOURS];
        [[unroll]] for (uint j = 0u; j < FOURS * AT_ONCE; ++j) {
            int at = int(3u * i) + int(3u * j);
            put(v[j / AT_ONCE], j % AT_ONCE, val_part(at), val_part(at + 1), val_part(at + 2));
        }
        [[unroll]] for (uint k = 0u; k < TEXEL_CACHES; ++k) {
            [[unroll]] for (uint f = 0u; f < FOURS; ++f) {
                accumulate(sums[k], receivers[k], v[f], vec4(1.0), vec4(1.0));
            }
        }
    }
    const uint VECTORS = GLOSSY != 0u ? 4u : 2u;
    [[unroll]] for (uint k = 0u; k < TEXEL_CACHES; ++k) {
        GatherSums s = sums[k];
        out_sums[k * VECTORS] = vec4(s.diffuse_position, s.diffuse_weight);
        out_sums[k * VECTORS + 1u] = vec4(s.diffuse_irradiance, s.distance2);
#ifndef DIFFUSE_ONLY
        out_sums[k * VECTORS + 2u] = vec4(s.glossy_position, s.glossy_weight);
        out_sums[k * VECTORS + 3u] = vec4(s.glossy_irradiance, s.glossy_distance2);
#endif
    }
}
