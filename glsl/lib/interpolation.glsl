// Interpolation weights, all dimensionless. METHOD 5. Twin: src/reference/interpolate.rs.
#ifndef INTERPOLATION_GLSL
#define INTERPOLATION_GLSL

// Default kernel: falls off with the squared distance. `cosine` is between the normals.
float facing_weight(float d, float d_max, float cosine) {
    float t = d / d_max;
    float a = 1.0 - t;
    float c = max(cosine, 0.0);
    float c2 = c * c;
    return a * a * c2 * c2 / (t * t + 1e-3);
}

// The thesis's kernel: Lensing 2014, eq. 5.50 and 5.51.
float printed_weight(float d, float d_max, float cosine) {
    return (1.0 - d / d_max) * sqrt(max(cosine, 0.0));
}

// Scales a proxy's facing irradiance from its cache to another point: falls off as the root mean square distance of the
// VALs (`distance2` is its square at the cache). A proxy that comes nearer brightens at most fourfold.
float falloff(float distance2, float from_cache2, float from_point2) {
    return min(sqrt(distance2 / max(max(distance2 - from_cache2, 0.0) + from_point2, 1e-30)), 4.0);
}

// Share of a material's Phong exponent with which facing irradiances are weighted at a vertex.
const float WEIGHED_SHARE = 0.1;

// Lower bound of a lobe's cosine at a vertex: keeps weights positive and quotients finite.
const float LEAST_LOBE_COSINE = 1e-2;

// Lower bound of a proxy's weight in the averaged position: if no lobe sees its proxy, all count equally.
const float LEAST_PULL = 1e-12;

// Weight by distance alone, for points where every kernel weight is 0.
float distance_weight(float d, float d_max) {
    float t = d / d_max;
    return 1.0 / (t * t + 1e-3);
}

#endif
