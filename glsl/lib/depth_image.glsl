// Depth image of a cache: its view of the surfaces around it. Directions w map to the unit disc by
// Proj(w) = (w.T, w.B). METHOD 6, eq. 5.60. Twin: src/reference/depth_image.rs.
// Where rays trace it, a texel holds the plane of the surface that its ray hits: nothing behind the plane is visible in
// the texel's directions. Where it is drawn from the rectangles of caches, a texel holds the reciprocal of the distance
// beyond which nothing is visible [1/m]; 0 if unobstructed.
#ifndef DEPTH_IMAGE_GLSL
#define DEPTH_IMAGE_GLSL

#include "lib/octahedral.glsl"

// Distance behind a rectangle within which points still count as visible, in radii of the circle of its cache's area:
// surfaces are not flat, and their rectangles stick out.
const float DEPTH_IMAGE_MARGIN = 2.0;

// Smallest distance of a cache from a rectangle's plane for the rectangle to occlude it, in the same unit. At least one
// of the two caches must also lie this far in front of the other's plane.
const float DEPTH_IMAGE_PLANE = 0.15;

// Lower bound of the cosine at the cache for a texel's slope, which is infinite at the horizon.
const float DEPTH_IMAGE_LEAST_Z = 0.2;

// Builds an orthonormal frame about a unit normal. Duff et al. 2017.
void tangents(vec3 n, out vec3 tangent, out vec3 bitangent) {
    float side = n.z >= 0.0 ? 1.0 : -1.0;
    float a = -1.0 / (side + n.z);
    float b = n.x * n.y * a;
    tangent = vec3(1.0 + side * n.x * n.x * a, side * b, -side * n.x);
    bitangent = vec3(b, side + n.y * n.y * a, -n.y);
}

// Texel that contains a direction about the normal. For directions below the horizon: mirrored above it.
uint image_texel(vec3 direction, vec3 tangent, vec3 bitangent) {
    const float HALF = 0.5 * float(DEPTH_IMAGE_SIDE);
    // Up to this radius all texels have their centres on the unit disc.
    const float LAST = 1.0 - 0.7071068 / HALF;
    vec2 p = vec2(dot(tangent, direction), dot(bitangent, direction));
    p *= min(1.0, LAST / max(length(p), 1e-30));
    uvec2 texel = uvec2(p * HALF + HALF);
    return texel.y * DEPTH_IMAGE_SIDE + texel.x;
}

// Unit direction through a texel's middle; if that lies outside the unit disc, just above the horizon.
vec3 texel_direction(uint texel, vec3 tangent, vec3 bitangent, vec3 normal) {
    vec2 p = (vec2(texel % DEPTH_IMAGE_SIDE, texel / DEPTH_IMAGE_SIDE) + 0.5) * (2.0 / float(DEPTH_IMAGE_SIDE)) - 1.0;
    p *= min(1.0, 0.9995 * inversesqrt(dot(p, p)));
    return tangent * p.x + bitangent * p.y + normal * sqrt(1.0 - dot(p, p));
}

// Whether a texel covers any part of the unit disc.
bool is_on_disc(uint texel) {
    const float HALF = 0.5 * float(DEPTH_IMAGE_SIDE);
    vec2 nearest = max(abs(vec2(texel % DEPTH_IMAGE_SIDE, texel / DEPTH_IMAGE_SIDE) + 0.5 - HALF) - 0.5, vec2(0.0));
    return dot(nearest, nearest) < HALF * HALF;
}

// A texel of a traced image: plane at a distance [m] from the cache along its unit normal, which points away from it.
uvec2 plane_texel(vec3 normal, float distance) {
    return uvec2(packSnorm2x16(octahedral_encode(normal)), floatBitsToUint(1.0 / max(distance, 1e-37)));
}

// Texel of a direction without a surface.
const uvec2 NO_PLANE = uvec2(0u);

// Of a vector from the cache: how many times as far as a texel's plane it reaches.
float reaches(uvec2 texel, vec3 d) {
    return dot(octahedral_decode(unpackSnorm2x16(texel.x)), d) * uintBitsToFloat(texel.y);
}

#endif
