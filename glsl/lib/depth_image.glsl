// Depth image of a cache: its view of the rectangles that represent the surfaces around it. Directions w map to the
// unit disc by Proj(w) = (w.T, w.B). A texel holds the reciprocal of the distance beyond which nothing is visible
// [1/m]; 0 if unobstructed. METHOD 6, eq. 5.60. Twin: src/reference/depth_image.rs.
#ifndef DEPTH_IMAGE_GLSL
#define DEPTH_IMAGE_GLSL

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

#endif
