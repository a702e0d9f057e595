// Stage 6, fragment path: one tile of VALs onto every live cache, added to float targets. METHOD 3-4, thesis listing 5.1.
#extension GL_EXT_control_flow_attributes : require
#include "shared.glsl"
#include "lib/atlas.glsl"
#include "lib/gather.glsl"

layout(constant_id = 0) const uint SOURCE = VALS_TEXELS;
layout(constant_id = 1) const uint SPREAD = 0; // 1: stage 7 asks for it
layout(push_constant, scalar) uniform Push { GatherPush push; };
layout(binding = 0, scalar) readonly buffer Caches { Cache caches[]; };
layout(binding = 1, scalar) readonly buffer ValCount { uint val_count; };
layout(binding = 2) uniform samplerBuffer val_texels;
layout(binding = 3, std430) readonly buffer Vals { vec4 vals[]; };

layout(location = 0) out vec4 out_diffuse_position; // position and weight
layout(location = 1) out vec4 out_diffuse_irradiance; // irradiance and distance2
#ifdef DIFFUSE_ONLY
const bool GLOSSY = false;
#else
const bool GLOSSY = true;
layout(location = 2) out vec4 out_glossy_position;
layout(location = 3) out vec4 out_glossy_irradiance;
#endif

// VALs of one round of the loop.
const uint AT_ONCE = 16u;

void main() {
    uint index = atlas_cache(ivec2(gl_FragCoord.xy), push.columns);
    GatherSums s = no_light();
    // Texels that are left over repeat the last cache: a branch around the loop costs more than they do.
    Receiver c = receiver(caches[min(index, max(push.cache_count, 1u) - 1u)], push.eye);
    uint end = min(push.first + push.tile, (val_count + VAL_TILE - 1u) / VAL_TILE * VAL_TILE);
    for (uint i = push.first; i < end; i += AT_ONCE) {
        [[unroll]] for (uint j = 0u; j < AT_ONCE; ++j) {
            int at = int(3u * i) + int(3u * j);
            if (SOURCE == VALS_TEXELS) {
                accumulate(s, c, texelFetch(val_texels, at), texelFetch(val_texels, at + 1), texelFetch(val_texels, at + 2),
                           GLOSSY, SPREAD != 0u);
            } else {
                accumulate(s, c, vals[at], vals[at + 1], vals[at + 2], GLOSSY, SPREAD != 0u);
            }
        }
    }
    out_diffuse_position = vec4(s.diffuse_position, s.diffuse_weight);
    out_diffuse_irradiance = vec4(s.diffuse_irradiance, s.distance2);
#ifndef DIFFUSE_ONLY
    out_glossy_position = vec4(s.glossy_position, s.glossy_weight);
    out_glossy_irradiance = vec4(s.glossy_irradiance, s.glossy_distance2);
#endif
}
