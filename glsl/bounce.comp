// Stage 6, further bounces: turns the light that caches have received so far into VALs. METHOD 9, thesis 6.1.7.
// All caches are live here, in order, so that list slots equal cache indices.
// variant bounce_sky.comp: SKY (where caches see a sky)
// variant bounce_traced.comp: TRACED (where caches trace rays)
// variant bounce_traced_sky.comp: TRACED SKY (both)
#include "shared.glsl"

layout(local_size_x = 64) in;
layout(constant_id = 0) const uint IRRADIANCE_WEIGHTS = 1; // else form-factor weights
layout(push_constant, scalar) uniform Push { BouncePush push; };
layout(binding = 0, scalar) readonly buffer Caches { Cache caches[]; };
layout(binding = 1, scalar) readonly buffer Albedos { vec3 albedos[]; };
layout(binding = 2, scalar) readonly buffer Args { LiveArgs args; };
layout(binding = 3, scalar) readonly buffer Parts { GatherSums parts[]; };
layout(binding = 4, scalar) writeonly buffer Vals { Val vals[]; };
#ifdef TRACED
#define SKY_BINDING 5
#else
layout(binding = 5, scalar) buffer Scales { float scales[]; };
#define SKY_BINDING 6
#endif
#ifdef SKY
layout(binding = SKY_BINDING, scalar) readonly buffer Seen { SkySeen seen[]; };
#endif

// Irradiance at a cache from parts [first, end).
vec3 received(uint cache, uint first, uint end) {
    vec3 sum = vec3(0.0);
    for (uint part = first; part < end; ++part) {
        sum += parts[part * push.cache_count + cache].diffuse_irradiance;
    }
    return sum;
}

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= push.cache_count) {
        return;
    }
    Cache c = caches[i];
    vec3 flux = vec3(c.area); // gathered, these fluxes yield sums of form factors
    if (push.step != BOUNCE_AREAS) {
        vec3 first = received(i, push.cache_parts, push.cache_parts + args.groups_y);
        vec3 again = received(i, 0u, push.cache_parts);
#ifndef TRACED
        // No cache sees more than a hemisphere.
        if (push.step == BOUNCE_FIRST || push.step == BOUNCE_SKY) {
            scales[i] = 1.0 / max(again.x, 1.0);
        } else if (push.step == BOUNCE_AGAIN) {
            again *= scales[i];
        }
#endif
        again = push.step == BOUNCE_FIRST || push.step == BOUNCE_SKY ? vec3(0.0) : again;
        first = push.step == BOUNCE_EMITTED || push.step == BOUNCE_SKY ? vec3(0.0) : first;
        vec3 sky = vec3(0.0);
#ifdef SKY
        sky = seen[i].irradiance;
#endif
        flux *= albedos[i] * (sky + first + again);
    }
    float weight = IRRADIANCE_WEIGHTS != 0u ? dot(flux, vec3(0.2126, 0.7152, 0.0722)) : c.area;
    vals[i] = Val(c.position, c.area, c.normal, 0u, flux, weight);
}
