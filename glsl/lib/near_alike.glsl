// Similarity of the surfaces of two pixels: how far the rays of one are valid for the other. METHOD 11.
#ifndef NEAR_ALIKE_GLSL
#define NEAR_ALIKE_GLSL

// Weight from 1 down to almost 0; `d` is the vector between the points, with their unit normals. The tolerance grows
// with the angle between the normals because curved surfaces leave each other's tangent planes.
float near_alike(vec3 d, vec3 normal, vec3 other) {
    float aside = max(abs(dot(d, other)), abs(dot(d, normal))) * inversesqrt(max(dot(d, d), 1e-30));
    aside -= 0.25 * distance(other, normal);
    return (1.0 - smoothstep(0.05, 0.2, aside)) * smoothstep(0.5, 0.9, dot(other, normal)) + 1e-4;
}

// Squared distance between the points that two lobes look at, in units of the lobes' width. `d`: from one surface to the
// other; `turned`: from one axis to the other; `width`: of the lobes [rad]; `nearness`: reciprocal distance of the
// mirrored surfaces [1/m].
float lobes_apart(vec3 d, vec3 turned, float nearness, float width) {
    vec3 apart = (d * nearness + turned) / max(width, 1e-9);
    return min(dot(apart, apart), 1e9);
}

#endif
