// Normalised modified Phong. Lensing 2014, 5.3.2. Twin: src/reference/phong.rs.
#ifndef PHONG_GLSL
#define PHONG_GLSL

// max(0, c)^k by exp2 and log2. The bound inside the logarithm is a 0 for all purposes from k = 1 on; a lobe below that keeps
// 1e-30^k behind it.
float cosine_power(float c, float k) {
    return exp2(k * log2(max(c, 1e-30)));
}

// BRDF [1/sr] of the glossy lobe per unit of rho_g; Lensing 2014, eq. 5.30.
float phong_lobe(float k, float cos_e) {
    return (k + 2.0) * (0.5 / 3.14159265358979) * cosine_power(cos_e, k);
}

// A direction made unit; where interpolation has cancelled it to nothing, `otherwise`.
vec3 unit_or(vec3 v, vec3 otherwise) {
    float d2 = dot(v, v);
    return d2 > 1e-30 ? v * inversesqrt(d2) : otherwise;
}

// The same of a vector however short: of the product of two small triangle sides, say.
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
