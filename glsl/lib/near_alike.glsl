// Whether surfaces of pixels are so much alike that rays of one say something of the other. METHOD 11.
#ifndef NEAR_ALIKE_GLSL
#define NEAR_ALIKE_GLSL

// From 1 to next to nothing; `d`: from one to the other, with their unit normals. Surfaces that bend are a little out of each
// other's planes.
float near_alike(vec3 d, vec3 normal, vec3 other) {
    float aside = max(abs(dot(d, other)), abs(dot(d, normal))) * inversesqrt(max(dot(d, d), 1e-30));
    aside -= 0.25 * distance(other, normal);
    return (1.0 - smoothstep(0.05, 0.2, aside)) * smoothstep(0.5, 0.9, dot(other, normal)) + 1e-4;
}

// How far apart two lobes look at what they mirror, squared, in units of their width: `d` from one surface to the other, `turned`
// from one axis to the other, their width [rad], and one over the distance of what they mirror [1/m].
float lobes_apart(vec3 d, vec3 turned, float nearness, float width) {
    vec3 apart = (d * nearness + turned) / max(width, 1e-9);
    return min(dot(apart, apart), 1e9);
}

#endif
