// Normalised modified Phong. Lensing 2014, 5.3.2. Twin: src/reference/phong.rs.
#ifndef PHONG_GLSL
#define PHONG_GLSL

// max(0, c)^k by exp2 and log2. The lower bound inside the logarithm gives practically 0 for k >= 1; for smaller k the
// result is at least 1e-30^k.
float cosine_power(float c, float k) {
    return exp2(k * log2(max(c, 1e-30)));
}

// Phong BRDF [1/sr] per unit of rho_g; Lensing 2014, eq. 5.30.
float phong_lobe(float k, float cos_e) {
    return (k + 2.0) * (0.5 / 3.14159265358979) * cosine_power(cos_e, k);
}

// Normalises a vector; returns `otherwise` if interpolation has cancelled it to zero.
vec3 unit_or(vec3 v, vec3 otherwise) {
    float d2 = dot(v, v);
    return d2 > 1e-30 ? v * inversesqrt(d2) : otherwise;
}

// The same for vectors of any length, e.g. the product of two short triangle edges.
vec3 unit_of_any_or(vec3 v, vec3 otherwise) {
    float largest = max(abs(v.x), max(abs(v.y), abs(v.z)));
    return largest > 0.0 ? normalize(v / largest) : otherwise;
}

// Unit vector from the viewer to a point; `eye` is a position and 1, or the direction towards the viewer and 0.
vec3 view_direction(vec4 eye, vec3 position) {
    vec3 d = eye.w > 0.0 ? position - eye.xyz : -eye.xyz;
    return d * inversesqrt(max(dot(d, d), 1e-30));
}

#endif
