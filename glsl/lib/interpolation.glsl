// Interpolation weights, all without a unit. METHOD 5. Twin: src/reference/interpolate.rs.
#ifndef INTERPOLATION_GLSL
#define INTERPOLATION_GLSL

// Faster kernel: decays like the square of the distance. `cosine` compares normals, or mirrored view vectors.
float facing_weight(float d, float d_max, float cosine) {
    float t = d / d_max;
    float a = 1.0 - t;
    float c = max(cosine, 0.0);
    float c2 = c * c;
    return a * a * c2 * c2 / (t * t + 1e-3);
}

// The thesis's kernel; Lensing 2014, eq. 5.50 and 5.51.
float printed_weight(float d, float d_max, float cosine) {
    return (1.0 - d / d_max) * sqrt(max(cosine, 0.0));
}

// Distance alone, where every weight above vanishes.
float distance_weight(float d, float d_max) {
    float t = d / d_max;
    return 1.0 / (t * t + 1e-3);
}

#endif
