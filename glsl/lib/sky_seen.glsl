// What the caches about a point see of the sky, averaged. METHOD 12. Includer declares `REFERENCES` and has the caches.
#ifndef SKY_SEEN_GLSL
#define SKY_SEEN_GLSL

#include "lib/interpolation.glsl"

struct SeenSum {
    vec3 seen;
    float weight;
};

// Adds a cache; where every weight vanishes they count by distance alone.
void take_seen(inout SeenSum sum, vec3 position, vec3 normal, float d_max, Cache c, vec3 seen, bool by_distance) {
    float d = distance(position, c.position);
    float w = by_distance ? distance_weight(d, d_max) : facing_weight(d, d_max, dot(normal, c.normal));
    if (by_distance || d < d_max) {
        sum.seen += w * seen;
        sum.weight += w;
    }
}

#endif
