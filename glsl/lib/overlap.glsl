// Squares on a cache's unit disc: the light that a proxy is, and the discs in its way. METHOD 6, thesis 5.4.
// Twin: src/reference/occlude.rs.
#ifndef OVERLAP_GLSL
#define OVERLAP_GLSL

// Area of a square over its form factor. The print has 1, the unit disc pi; in between the whole comes out best.
const float SQUARE = 2.0;

// How far in front of a light a disc is in the way in full, in radii of the light's sphere; 1 in print.
const float FADE = 2.0;

// Squared side of a disc's square, from the vector to the disc; it is in the way with both sides. The cosines carry
// 1/|d|, and the bound keeps 0/0 away where a cache lies on a disc: the numerator is 0 there.
float disc_side2(vec3 d, vec3 disc_normal, vec3 normal, float area) {
    float d2 = dot(d, d);
    float cosines = abs(dot(disc_normal, d)) * max(dot(normal, d), 0.0);
    return SQUARE * area * cosines / max(d2 * (area + 3.14159265358979 * d2), 1e-37);
}

// Form factor of a sphere from a point, as a disc that faces it; Lensing 2014, eq. 5.59.
float sphere_form_factor(float radius2, float cosine, float d2) {
    return radius2 * max(cosine, 0.0) / max(radius2 + d2, 1e-37);
}

// Where two squares overlap: lower and upper corner. They do where the lower one is below.
vec4 overlap(vec2 centre, float half_side, vec2 other, float other_half_side) {
    return vec4(max(centre - half_side, other - other_half_side), min(centre + half_side, other + other_half_side));
}

// Area of what `overlap` gives.
float overlap_area(vec4 corners) {
    vec2 size = max(corners.zw - corners.xy, vec2(0.0));
    return size.x * size.y;
}

// Share of a disc that is in the way, `along` [m] in front of the light, where all of it is from `reach` on; eq. 5.61.
float fade(float along, float reach) {
    return clamp(along / reach, 0.0, 1.0);
}

// A tangent of a surface: +X, turned the shortest way from +Y to the normal.
vec3 surface_tangent(vec3 normal) {
    float scale = 1.0 + normal.y;
    if (scale < 1e-6) {
        return vec3(1.0, 0.0, 0.0);
    }
    return vec3(1.0, 0.0, 0.0) - normal.x / scale * (normal + vec3(0.0, 1.0, 0.0));
}

// Along the unit direction to the light, on the surface; where that is the normal, any that is smooth.
vec3 tangent_towards(vec3 direction, vec3 normal) {
    vec3 aside = direction - dot(normal, direction) * normal;
    float sine2 = dot(aside, aside);
    return sine2 > 1e-6 ? aside * inversesqrt(sine2) : surface_tangent(normal);
}

#endif
