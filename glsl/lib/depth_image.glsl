// A cache's view of the rectangles that stand for the surfaces around it: on the unit disc, at Proj(w) = (w.T, w.B) of a unit
// direction w, the reciprocal of the distance beyond which nothing is seen [1/m]; 0 where nothing is in the way.
// METHOD 6, eq. 5.60. Twin: src/reference/depth_image.rs.
#ifndef DEPTH_IMAGE_GLSL
#define DEPTH_IMAGE_GLSL

// How far behind a rectangle things are still seen, in radii of the circle of its cache's area: surfaces are not flat, and
// their rectangles stick out.
const float DEPTH_IMAGE_MARGIN = 2.0;

// How far out of a rectangle's plane a cache must lie for it to be in the way, in the same unit; and how far before the other's
// plane one of the two caches must lie.
const float DEPTH_IMAGE_PLANE = 0.15;

// Cosine at the cache below which a texel's slope is taken from here: at its horizon it has no end.
const float DEPTH_IMAGE_LEAST_Z = 0.2;

// A frame about a unit normal. Duff et al. 2017.
void tangents(vec3 n, out vec3 tangent, out vec3 bitangent) {
    float side = n.z >= 0.0 ? 1.0 : -1.0;
    float a = -1.0 / (side + n.z);
    float b = n.x * n.y * a;
    tangent = vec3(1.0 + side * n.x * n.x * a, side * b, -side * n.x);
    bitangent = vec3(b, side + n.y * n.y * a, -n.y);
}

#endif
