// Average share of the sky visible to the caches about a point. METHOD 12. The including shader declares `REFERENCES`
// and the caches.
#ifndef SKY_SEEN_GLSL
#define SKY_SEEN_GLSL

#include "lib/interpolation.glsl"

struct SeenSum {
    vec3 seen;
    float weight;
};

// Adds a cache; `by_distance` weights it by distance alone, for points where every weight is 0.
void take_seen(inout SeenSum sum, vec3 position, vec3 normal, float d_max, Cache c, vec3 seen, bool by_distance) {
    float d = distance(position, c.position);
    float w = by_distance ? distance_weight(d, d_max) : facing_weight(d, d_max, dot(normal, c.normal));
    if (by_distance || d < d_max) {
        sum.seen += w * seen;
        sum.weight += w;
    }
}

#endif
