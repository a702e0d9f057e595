// Stage 6, further bounces: what the caches have received so far makes them VALs. METHOD 9, thesis 6.1.7.
// Every cache is live here, in order: a slot of the list is a cache.
// variant bounce_traced.comp: TRACED (where caches trace rays)
#include "shared.glsl"

layout(local_size_x = 64) in;
layout(constant_id = 0) const uint IRRADIANCE_WEIGHTS = 1; // else form-factor weights
layout(push_constant, scalar) uniform Push { BouncePush push; };
layout(binding = 0, scalar) readonly buffer Caches { Cache caches[]; };
layout(binding = 1, scalar) readonly buffer Albedos { vec3 albedos[]; };
layout(binding = 2, scalar) readonly buffer Args { LiveArgs args; };
layout(binding = 3, scalar) readonly buffer Parts { GatherSums parts[]; };
layout(binding = 4, scalar) buffer Scales { float scales[]; };
layout(binding = 5, scalar) writeonly buffer Vals { Val vals[]; };
#ifdef TRACED
layout(binding = 6, scalar) readonly buffer Closed { float closed[]; };

// What the exchange brings is the first part of what caches send; the gather of what is far is no more than caches see there.
const float MOST_SCALE = 4.0;
#endif

// Irradiance of parts [first, end) at a cache.
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
    vec3 flux = vec3(c.area); // the gather's sums of it are sums of form factors
    if (push.step != BOUNCE_AREAS) {
        vec3 first = received(i, push.cache_parts, push.cache_parts + args.groups_y);
#ifdef TRACED
        vec3 again = received(i, 0u, push.step == BOUNCE_AGAIN ? 1u : push.cache_parts);
#else
        vec3 again = received(i, 0u, push.cache_parts);
#endif
        if (push.step == BOUNCE_FIRST) {
#ifdef TRACED
            // Form factors are those of what rays meet.
            scales[i] = min(closed[i] / max(again.x, 1e-6), MOST_SCALE);
#else
            // Nobody sees more than a hemisphere.
            scales[i] = 1.0 / max(again.x, 1.0);
#endif
            again = vec3(0.0);
        } else if (push.step == BOUNCE_AGAIN) {
#ifndef TRACED
            again *= scales[i];
#endif
        } else {
            first = vec3(0.0);
        }
        flux *= albedos[i] * (first + again);
    }
    float weight = IRRADIANCE_WEIGHTS != 0u ? dot(flux, vec3(0.2126, 0.7152, 0.0722)) : c.area;
    vals[i] = Val(c.position, c.area, c.normal, 0u, flux, weight);
}
