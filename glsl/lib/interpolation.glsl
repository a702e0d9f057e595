// Interpolation weights, all without a unit. METHOD 5. Twin: src/reference/interpolate.rs.
#ifndef INTERPOLATION_GLSL
#define INTERPOLATION_GLSL

// Faster kernel: decays like the square of the distance. `cosine` compares normals.
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

// Share of a proxy's facing irradiance that is left at another point: as the root of the mean squared distance of the
// VALs, which is `distance2` at the cache. A proxy that comes near brightens at most fourfold.
float falloff(float distance2, float from_cache2, float from_point2) {
    return min(sqrt(distance2 / max(max(distance2 - from_cache2, 0.0) + from_point2, 1e-30)), 4.0);
}

// Exponent of a lobe, as a share of the material's, by which facing irradiances are weighed at a vertex.
const float WEIGHED_SHARE = 0.1;

// Least cosine of a lobe at a vertex: weights stay above zero, and their quotients finite.
const float LEAST_LOBE_COSINE = 1e-2;

// Least share of a proxy in the averaged position: where every lobe looks elsewhere all count alike.
const float LEAST_PULL = 1e-12;

// Distance alone, where every weight above vanishes.
float distance_weight(float d, float d_max) {
    float t = d / d_max;
    return 1.0 / (t * t + 1e-3);
}

#endif
