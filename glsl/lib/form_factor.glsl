// Light of a VAL at a point. METHOD 2. Twin: src/reference/form_factor.rs.
#ifndef FORM_FACTOR_GLSL
#define FORM_FACTOR_GLSL

const float PI = 3.14159265358979;

// Geometry factor G [1/m^2] of a VAL: irradiance is flux times G. Lensing 2014, eq. 5.20, without its loss of near light.
// From the unnormalised vector to the light: both cosines carry 1/|d|.
// d = 0 for a receiver on the VAL itself: the numerator is 0 there, and the lower bound only avoids 0/0. It applies to
// the whole denominator because devices may flush the product of a small area and a small distance to zero.
float val_geometry_towards(vec3 d, vec3 light_normal, vec3 normal, float area) {
    float d2 = dot(d, d);
    return max(-dot(light_normal, d), 0.0) * max(dot(normal, d), 0.0) / max(d2 * max(area, PI * d2), 1e-37);
}

#endif
