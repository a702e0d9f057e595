// Similarity of the surfaces of two pixels: how far the rays of one are valid for the other. METHOD 11.
#ifndef NEAR_ALIKE_GLSL
#define NEAR_ALIKE_GLSL
#include "lib/octahedral.glsl"

// The unit normals of a pixel's surface.
struct Facing {
    vec3 vertex; // interpolated between the vertices
    vec3 geometric; // of the triangle
};

// `geometric` is as of coded_normal.
Facing facing_of(vec3 vertex, float geometric) {
    return Facing(vertex, decoded_normal(geometric));
}

// Weight from 1 down to almost 0; `d` is the vector between the points. Surfaces are alike where each lies in the plane of
// the other's triangle. The tolerance grows with the angle between the vertex normals, because curved surfaces leave each
// other's planes. Where triangles turn more than the vertex normals, their edge stands for a round surface and does not
// separate.
float near_alike(vec3 d, Facing a, Facing b) {
    float aside = max(abs(dot(d, a.geometric)), abs(dot(d, b.geometric))) * inversesqrt(max(dot(d, d), 1e-30));
    float turned = distance(a.vertex, b.vertex);
    aside -= 0.25 * turned + max(distance(a.geometric, b.geometric) - turned, 0.0);
    float cosine = min(dot(a.vertex, b.vertex), dot(a.geometric, b.geometric));
    return (1.0 - smoothstep(0.05, 0.2, aside)) * smoothstep(0.5, 0.9, cosine) + 1e-4;
}

// Squared distance between the points that two lobes look at, in units of the lobes' width. `d`: from one surface to the
// other; `turned`: from one axis to the other; `width`: of the lobes [rad]; `nearness`: reciprocal distance of the
// mirrored surfaces [1/m].
float lobes_apart(vec3 d, vec3 turned, float nearness, float width) {
    vec3 apart = (d * nearness + turned) / max(width, 1e-9);
    return min(dot(apart, apart), 1e9);
}

#endif
