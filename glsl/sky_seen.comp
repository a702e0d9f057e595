// Stage 6, first: visibility of the sky from each cache, by rays: the arriving share of the light on an open surface,
// and the openness of each direction that short rays look up. METHOD 12. Twin: src/reference/sky.rs.
// variant sky_seen_met.comp: MET (where caches light caches: their depth images have traced the same rays)
#extension GL_EXT_control_flow_attributes : require
#ifdef MET
#include "shared.glsl"
#else
#include "lib/hit.glsl"
#endif
#include "lib/depth_image.glsl"
#include "lib/directions.glsl"

layout(local_size_x = 64) in;
layout(push_constant, scalar) uniform Push { SkySeenPush push; };
layout(binding = 12, scalar) readonly buffer Caches { Cache caches[]; };
#define SKY_BINDING 13
#include "lib/sky.glsl"
layout(binding = 15, scalar) writeonly buffer Seen { SkySeen seen[]; }; // per cache
layout(binding = 16, scalar) writeonly buffer Open { uint open_parts[]; }; // per cache: openness by direction, 8 bits each

#ifdef MET
layout(binding = 17, scalar) readonly buffer Met { uint met[]; }; // of each cache, as of trace_images.comp
layout(binding = 18, scalar) readonly buffer FarMet { uint far_met[]; };
#endif

const uint THREADS = gl_WorkGroupSize.x;
const float HALF = 0.5 * float(DEPTH_IMAGE_SIDE);

shared uint is_open[DEPTH_IMAGE_TEXELS];
shared vec3 arriving[THREADS]; // without occluders beyond those left to short rays
shared vec3 in_all[THREADS]; // without any occluders
shared vec3 from_all[THREADS];
shared vec2 counts[THREADS]; // open texels, all texels on the disc

void main() {
    uint cache = gl_WorkGroupID.y * DEPTH_IMAGE_ROW + gl_WorkGroupID.x;
    if (cache >= push.cache_count) {
        return;
    }
    uint thread = gl_LocalInvocationID.x;
    Cache c = caches[cache];
    vec3 tangent, bitangent;
    tangents(c.normal, tangent, bitangent);
#ifndef MET
    float lift = lift_at(c.position, 0.0);
    vec3 start = c.position + c.normal * lift;
#endif
    vec3 open = vec3(0.0);
    vec3 lit = vec3(0.0);
    vec3 all = vec3(0.0);
    vec2 count = vec2(0.0);
    // All texels of the unit disc have equal shares of irradiance.
    for (uint texel = thread; texel < DEPTH_IMAGE_TEXELS; texel += THREADS) {
        vec2 p = (vec2(texel % DEPTH_IMAGE_SIDE, texel / DEPTH_IMAGE_SIDE) + 0.5) / HALF - 1.0;
        float z2 = 1.0 - dot(p, p);
        uint found = 0u;
        if (z2 > 0.0) {
            vec3 direction = tangent * p.x + bitangent * p.y + c.normal * sqrt(z2);
#ifdef MET
            bool is_lit = met[cache * DEPTH_IMAGE_TEXELS + texel] == NO_REFERENCES;
            found = far_met[cache * DEPTH_IMAGE_TEXELS + texel] == NO_REFERENCES ? 1u : 0u;
#else
            Hit hit = trace(start, direction, lift, 3e38, push.root, 0u, false);
            bool is_lit = hit.triangle == NO_HIT;
            if (!is_lit && hit.distance < push.reach) {
                hit = trace(start, direction, push.reach, 3e38, push.root, 0u, true);
            }
            found = hit.triangle == NO_HIT ? 1u : 0u;
#endif
            vec3 radiance = sky_at(SKY_OF_CACHES, direction);
            all += radiance;
            lit += is_lit ? radiance : vec3(0.0);
            open += float(found) * radiance;
            count += vec2(found, 1.0);
        }
        is_open[texel] = found;
    }
    arriving[thread] = open;
    in_all[thread] = lit;
    from_all[thread] = all;
    counts[thread] = count;
    barrier();
    if (thread == 0u) {
        for (uint i = 1u; i < THREADS; ++i) {
            open += arriving[i];
            lit += in_all[i];
            all += from_all[i];
            count += counts[i];
        }
        // A surface that faces a dark sky gets the open share of its directions.
        float least = push.least * count.y / 3.14159265;
        vec3 share = (open + least * count.x / count.y) / max(all + least, 1e-37);
        bool is_hidden = c.normal == vec3(0.0);
        vec3 irradiance = is_hidden ? vec3(0.0) : sky_at(SKY_IRRADIANCE, c.normal) * lit / max(all, 1e-37);
        seen[cache] = SkySeen(share, irradiance);
    }
    // Four sub-directions per direction, four directions per word.
    for (uint four = thread; four < DIRECTIONS / 4u; four += THREADS) {
        uint numbers = 0u;
        for (uint i = 0u; i < 16u; ++i) {
            uint direction = 4u * four + i / 4u;
            vec2 at = vec2(direction % DIRECTION_SIDE, direction / DIRECTION_SIDE) + 0.25 + 0.5 * vec2(i & 1u, i >> 1 & 1u);
            vec3 d = octahedral_decode(at * (2.0 / float(DIRECTION_SIDE)) - 1.0);
            // Below the horizon nothing is known: directions there are as open as those mirrored above it.
            uint found = is_open[image_texel(d, tangent, bitangent)];
            numbers += found << (8u * (i / 4u));
        }
        open_parts[cache * (DIRECTIONS / 4u) + four] = numbers;
    }
}
