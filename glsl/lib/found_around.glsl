// Which pixel around has the light of a point on neither of its own pixel's surfaces. METHOD 13.
#ifndef FOUND_AROUND_GLSL
#define FOUND_AROUND_GLSL
#extension GL_EXT_control_flow_attributes : require
#include "lib/points.glsl"
#include "lib/same_surface.glsl"

// Whether the first surface of a pixel, of this depth, contains the point. The including shader defines it.
bool shows(ivec2 other, float depth, Seen here, float pixel);

// Code of the nearest of the 8 pixels around whose first surface contains a point at this offset from the centre.
uint found_around(Seen here, sampler2D first_depth, ivec2 at, vec2 offset, float pixel) {
    ivec2 size = textureSize(first_depth, 0);
    uint found = SHOWS_ANOTHER;
    float nearest = 1e9;
    // Not unrolled: the loop ends once no thread needs it, but software devices execute unrolled rounds for all
    // threads.
    [[dont_unroll]] for (uint i = 0u; i < 8u; i++) {
        ivec2 other = at + pixel_around(i);
        vec2 d = vec2(pixel_around(i)) - offset;
        if (any(lessThan(other, ivec2(0))) || any(greaterThanEqual(other, size)) || dot(d, d) >= nearest) {
            continue;
        }
        float depth = texelFetch(first_depth, other, 0).r;
        bool is_it = depth == 0.0 && here.depth == 0.0;
        if (depth > 0.0 && here.depth > 0.0) {
            is_it = shows(other, depth, here, pixel);
        }
        if (is_it) {
            found = SHOWS_AROUND + i;
            nearest = dot(d, d);
        }
    }
    return found;
}

#endif
