// Stage 8, first: short rays from visible surfaces, one cache spacing long. Where caches disagree on far light, and with
// ENDLESS, rays have no end. A pixel has few rays. A square of NEAR_SIDE^2 pixels has all directions, which a later pass
// combines. Some further rays follow the light of the caches, and some a glossy lobe. METHOD 11.
//
// Rays, the light of what they hit, and its sum are three passes: a ray's path through the hierarchy needs few
// registers, and a hit's light many. They take a part of the picture in turn, because all rays together need much memory.
// variant near_rays_glossy.comp: GLOSSY (where a material has a glossy lobe)
// variant near_rays_sky.comp: SKY (where caches see a sky)
// variant near_rays_glossy_sky.comp: GLOSSY SKY (both)
#extension GL_EXT_control_flow_attributes : require
#include "lib/hit.glsl"
layout(local_size_x = 64) in;
#include "lib/near_rays.glsl"
layout(binding = 32, scalar) writeonly buffer Rays { NearRay near_rays[]; };
layout(binding = 33, scalar) writeonly buffer Lists { uint lists[]; }; // indices of rays with a hit to light, per workgroup
layout(binding = 34, scalar) writeonly buffer Counts { uint counts[]; }; // their number

shared uint hit_count;

void keep(uint i, vec3 start, float spread, vec3 direction, Hit hit) {
    near_rays[ray_slot(i)] = NearRay(start, spread, direction, hit.distance, hit.weights, hit.triangle, hit.instance);
}

void main() {
    if (gl_LocalInvocationIndex == 0u) {
        hit_count = 0u;
    }
    barrier();
    uint subset;
    uvec2 at = traced_pixel(subset);
    NearSurface s;
    bool shown = surface_shown(at, s);
    uint count = shown ? RAYS + GUIDED : 0u;
    // In a corner the start may also lie on another surface. Rays begin at the distance `lift`, so they do not hit it.
    float lift = shown ? lift_at(s.position, s.from_eye) : 0.0;
    vec3 start = s.position + s.geometric * lift;
    vec3 shares;
    uvec3 around = uvec3(NO_REFERENCES);
    if (shown) {
        around = caches_about(s.instance, s.corners, s.weights, 3u, s.position, s.normal, push.cache_reach, shares);
    }
#ifdef GLOSSY
    NearLobe l;
    l.rays = 0u;
    if (shown) {
        l = lobe_shown(s);
        count += l.rays;
    }
#endif
    // All rays share the code of one loop: twice that code is slow to compile.
    for (uint i = 0u; i < count; ++i) {
        vec3 direction = direction_about(s.normal, min(i, RAYS - 1u), subset);
        // The ray represents a cone: its projected solid angle is pi over the number of rays combined.
        float spread = 2.0 * inversesqrt(float(RAYS * ALL));
        float reach = push.reach;
        bool below = false;
        if (i >= RAYS && i < RAYS + GUIDED) {
            direction = guided_direction(around, shares, i - RAYS, subset, at / NEAR_SIDE);
            below = dot(direction, s.normal) <= 0.0 || dot(direction, s.geometric) <= 0.0;
        }
#ifdef GLOSSY
        if (i >= RAYS + GUIDED) {
            // Some of the lobe's directions. Neighbouring pixels have the others.
            uint number = (i - RAYS - GUIDED) * ALL + subset;
            // Each block turns the directions of a metal: the same ones everywhere would make whole walls too bright or dark.
            float turn = push.turn;
            turn += l.rays > 1u ? 2.0 * PI * fract(dot(vec2(at / NEAR_SIDE), vec2(0.7548776662, 0.5698402910))) : 0.0;
            direction = lobe_direction(l.lobe, vec2((float(number) + 0.5) / float(l.rays * ALL), float(number) * 2.39996323 + turn));
            bool endless = l.narrow > 0.0;
            spread = (endless ? -0.25 : 0.25) * l.width * sqrt(1.0 / float(l.rays));
            reach = endless ? 3e38 : push.reach;
            below = dot(direction, s.geometric) <= 0.0;
        }
#endif
        if (below) {
            keep(i, vec3(0.0), 0.0, vec3(0.0), Hit(0.0, vec2(0.0), NO_HIT, NO_HIT));
            continue;
        }
        // Where caches disagree, the ray decides.
        reach = far_light(around, shares, direction).unsure ? 3e38 : reach;
        // Rays below the triangle's plane are mirrored above it.
        float above = dot(direction, s.geometric);
        direction -= above < 0.0 ? 2.0 * above * s.geometric : vec3(0.0);
#ifdef SKY
        float to = ray_decides(sky_open(around, shares, direction)) ? 3e38 : reach;
#else
        float to = reach;
#endif
        Hit hit = trace(start, direction, lift, to, push.root, 0u, false);
        keep(i, start, spread, direction, hit);
        if (hit.triangle != NO_HIT && hit.distance < reach) {
            lists[gl_WorkGroupID.x * SLOTS * gl_WorkGroupSize.x + atomicAdd(hit_count, 1u)] = ray_slot(i);
        }
    }
    barrier();
    if (gl_LocalInvocationIndex == 0u) {
        counts[gl_WorkGroupID.x] = hit_count;
    }
}
