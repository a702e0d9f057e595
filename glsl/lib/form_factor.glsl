// Form factor from a point to a disc. Lensing 2014, 5.2.2. Twin: src/reference/form_factor.rs.
#ifndef FORM_FACTOR_GLSL
#define FORM_FACTOR_GLSL

const float PI = 3.14159265358979;

// Geometry factor G [1/m^2] of a disc light: irradiance is flux times G. Lensing 2014, eq. 5.20.
float disc_geometry(float area, float cos_l, float cos_x, float d2) {
    return max(cos_l, 0.0) * max(cos_x, 0.0) / (area + PI * d2);
}

// Form factor from a point to a disc, exact on the disc's axis. Lensing 2014, eq. 5.7.
float disc_form_factor(float area, float cos_l, float cos_x, float d2) {
    return area * disc_geometry(area, cos_l, cos_x, d2);
}

// `disc_geometry` from the unnormalised vector to the light: both cosines carry 1/|d|.
// d = 0 for a receiver on the VAL itself: the numerator is 0 there, and the lower bound only avoids 0/0. It applies to
// the whole denominator because devices may flush the product of a small area and a small distance to zero.
float disc_geometry_towards(vec3 d, vec3 light_normal, vec3 normal, float area) {
    float d2 = dot(d, d);
    return max(-dot(light_normal, d), 0.0) * max(dot(normal, d), 0.0) / max(d2 * (area + PI * d2), 1e-37);
}

#endif
