// Share of a light that arrives at a pixel, from the rays of the pixel and its neighbours. METHOD 14. Uses binding 1.
#ifndef ARRIVING_GLSL
#define ARRIVING_GLSL
#include "shared.glsl"

layout(binding = 1, scalar) readonly buffer Arrivals { Arriving arrivals[]; };

vec2 share(vec2 open, vec2 all) {
    return open / max(all, vec2(1e-30));
}

// Share of a light that arrives at a pixel by the pixel's own rays: for the diffuse and the glossy lobe.
vec2 arriving_alone(int at) {
    return share(arrivals[at].open, arrivals[at].all);
}

// The same for a light with a size. `slope` [NDC per NDC] is the slope of the surface's plane. Wide penumbrae use the
// combined rays of the 5 x 5 pixels around. The outermost pixels count half, so that all points of the light have equal
// weight.
vec2 arriving(sampler2D depth_image, ivec2 pixel, float depth, vec2 slope) {
    ivec2 size = textureSize(depth_image, 0);
    Arriving own = arrivals[pixel.y * size.x + pixel.x];
    vec2 alone = share(own.open, own.all);
    if (own.penumbra < 0.0) {
        return alone;
    }
    const int REACH = int(LIGHT_SIDE) / 2;
    vec2 open = vec2(0.0);
    vec2 all = vec2(0.0);
    float penumbra = 0.0;
    for (int y = -REACH; y <= REACH; ++y) {
        for (int x = -REACH; x <= REACH; ++x) {
            ivec2 at = pixel + ivec2(x, y);
            if (any(lessThan(at, ivec2(0))) || any(greaterThanEqual(at, size))) {
                continue;
            }
            // Skip pixels without a surface (their entries are old or were never written) and pixels off this surface's
            // plane.
            float step_ = dot(slope, vec2(x, y) * 2.0 / vec2(size));
            float there = texelFetch(depth_image, at, 0).r;
            if (there <= 0.0 || abs(there - depth - step_) > 0.1 * abs(step_) + 0.001 * depth) {
                continue;
            }
            Arriving other = arrivals[at.y * size.x + at.x];
            float weight = (abs(x) == REACH ? 0.5 : 1.0) * (abs(y) == REACH ? 0.5 : 1.0);
            open += weight * other.open;
            all += weight * other.all;
            penumbra = max(penumbra, other.penumbra);
        }
    }
    // The pixel's own rays suffice for penumbrae about as sharp as the picture, if any of their points is above the
    // horizon.
    float together = own.all.x > 0.0 ? smoothstep(PENUMBRA_NARROW, PENUMBRA_WIDE, penumbra) : 1.0;
    return mix(alone, share(open, all), together);
}

#endif
