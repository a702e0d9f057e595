// Stage 8, second: the light of the surfaces that short rays hit. METHOD 11.
// variant near_hits_lit.comp: LIT (where surfaces hit also reflect the light of caches)
// variant near_hits_sky.comp: SKY (where caches see a sky)
// variant near_hits_lit_sky.comp: LIT SKY (both)
#extension GL_EXT_control_flow_attributes : require
#include "lib/hit_light.glsl"

layout(local_size_x = 64) in;
layout(push_constant, scalar) uniform Push { NearHitsPush push; };
#if defined(LIT) || defined(SKY)
layout(constant_id = 4) const uint REFERENCES = 8;
layout(constant_id = 5) const uint BY_CELLS = 0; // 1: references are stored per cell
layout(binding = 18, scalar) readonly buffer Caches { Cache caches[]; };
#define REFERENCE_BINDINGS 19
#include "lib/hit_caches.glsl"
#endif
#ifdef LIT
layout(binding = 26, scalar) readonly buffer CacheVals { Val cache_vals[]; };
#endif
#ifdef SKY
layout(binding = 27, scalar) readonly buffer Seen { SkySeen seen[]; }; // per cache
#define SKY_BINDING 29
#include "lib/sky.glsl"
#endif
#if defined(LIT) && defined(SKY)
layout(binding = 31, scalar) readonly buffer Albedos { vec3 albedos[]; }; // of the caches
#endif
layout(binding = 32, scalar) buffer Rays { NearRay near_rays[]; };
layout(binding = 33, scalar) readonly buffer Lists { uint lists[]; }; // indices of rays with a hit to light, per workgroup
layout(binding = 34, scalar) readonly buffer Counts { uint counts[]; }; // their number

#if defined(LIT) || defined(SKY)
// Radiance [cd/m^2] that a point reflects of the light its caches receive: of their bounced light if LIT, of the sky if
// SKY and `with_sky`. With `first` one cache is enough, as for one of many rays that are averaged.
vec3 cache_radiance(Hit hit, HitSurface s, vec3 direction, bool first, bool with_sky) {
    uvec3 v = corners_hit(hit, direction) - hit_instances[hit.instance].drawn_vertex;
    vec3 w = vec3(1.0 - hit.weights.x - hit.weights.y, hit.weights);
    vec3 shares;
    uvec3 at = caches_about(hit.instance, v, w, 1u, s.position, s.normal, push.cache_reach, shares);
    if (at.x == NO_REFERENCES) {
        return vec3(0.0);
    }
    shares = seen_weights(at, shares, s.position, s.geometric, push.seen_lift, push.root, first);
    vec3 sum = vec3(0.0);
    for (uint i = 0u; i < 3u; ++i) {
        if (shares[i] == 0.0) {
            continue;
        }
        vec3 own = vec3(0.0);
#ifdef LIT
        Val val = cache_vals[at[i]];
        own += val.flux / max(PI * val.area, 1e-30);
#endif
#ifdef SKY
        vec3 albedo = with_sky ? s.diffuse : vec3(0.0);
#ifdef LIT
        // This flux includes the sky's light, reflected with the cache's albedo.
        albedo -= albedos[at[i]];
#endif
        own += push.reflects != 0u ? albedo / PI * seen[at[i]].irradiance : vec3(0.0);
#endif
        sum += shares[i] * max(own, vec3(0.0));
    }
    return sum;
}
#endif

#ifdef SKY
// The ray to the sky in one direction, chosen with cosine density. The mean over many rays knows what is close to the
// point, such as a wall that stands there; caches do not.
LightRay ray_to_sky(HitSurface s, vec2 chance) {
    float z = 1.0 - 2.0 * chance.x;
    float angle = TWO_PI * chance.y;
    vec3 way = unit_or(s.normal + vec3(sqrt(max(1.0 - z * z, 0.0)) * vec2(cos(angle), sin(angle)), z), s.normal);
    bool above = dot(way, s.geometric) > 0.0;
    return LightRay(way, 3e38, 0u, above ? s.diffuse * sky_at(SKY_OF_CACHES, way) : vec3(0.0));
}
#endif

void light_hit(uint at) {
    NearRay ray = near_rays[at];
    bool endless = ray.spread < 0.0;
    Hit hit = Hit(ray.distance, ray.weights, ray.triangle, ray.instance);
    HitSurface s = surface_at(hit, ray.start, ray.direction, abs(ray.spread));
    vec3 radiance = s.emission;
    if (push.reflects != 0u) {
        // The number selects the light. A part of the picture begins at a multiple of ALL workgroups. Each view of a
        // supersampled picture has other numbers.
        const uint ALL = NEAR_SIDE * NEAR_SIDE;
        uint i = at / gl_WorkGroupSize.x % push.slots;
        uint of_pixel = i < push.rays ? i : i < push.guided ? i - push.rays : i - push.guided;
        float number = float(of_pixel * ALL + gl_WorkGroupID.x % ALL) + 13.0 / TWO_PI * push.turn;
        vec3 chance = fract(0.5 + number * vec3(0.8191725134, 0.6710436067, 0.5497004779));
        LightRay to_light =
            ray_to_some(s, ray.direction, push.light_count, push.first_sky_light, push.sky_light_count, chance);
#ifdef SKY
        // Each square of pixels has other directions.
        uint square = at % gl_WorkGroupSize.x;
        vec2 place = fract(0.5 + number * vec2(0.7548776662, 0.5698402910) + float(square) * vec2(0.3247179572, 0.2451223338));
        // Too few endless rays of lobes are averaged for a single direction. Both rays share the code of a loop.
        uint count = endless ? 1u : 2u;
        [[dont_unroll]] for (uint k = 0u; k < count; ++k) {
            if (k > 0u) {
                to_light = ray_to_sky(s, place);
            }
            radiance += reflected_along(to_light, s, push.root);
        }
#else
        radiance += reflected_along(to_light, s, push.root);
#endif
    }
#if defined(LIT) || defined(SKY)
    radiance += cache_radiance(hit, s, ray.direction, !endless, endless);
#endif
    near_rays[at].start = radiance;
}

void main() {
    // A list has the hits of a workgroup of near_rays.comp.
    uint first = gl_WorkGroupID.x * push.slots * gl_WorkGroupSize.x;
    uint count = counts[gl_WorkGroupID.x];
    uint step_ = gl_NumWorkGroups.y * gl_WorkGroupSize.x;
    for (uint i = gl_WorkGroupID.y * gl_WorkGroupSize.x + gl_LocalInvocationID.x; i < count; i += step_) {
        light_hit(lists[first + i]);
    }
}
