// Overlap of squares on a cache's unit disc: a proxy light against the discs that occlude it. METHOD 6, thesis 5.4.
// Twin: src/reference/occlude.rs.
#ifndef OVERLAP_GLSL
#define OVERLAP_GLSL

// Area of a square relative to its form factor. The print has 1, the unit disc requires pi; 2 gave the lowest overall
// error.
const float SQUARE = 2.0;

// Distance in front of a light from which a disc occludes it fully, in radii of the light's sphere; 1 in print.
const float FADE = 2.0;

// Squared side of a disc's square, for the vector to the disc; discs occlude with both sides. The cosines carry 1/|d|;
// the lower bound avoids 0/0 for a cache on a disc, where the numerator is 0.
float disc_side2(vec3 d, vec3 disc_normal, vec3 normal, float area) {
    float d2 = dot(d, d);
    float cosines = abs(dot(disc_normal, d)) * max(dot(normal, d), 0.0);
    return SQUARE * area * cosines / max(d2 * (area + 3.14159265358979 * d2), 1e-37);
}

// Form factor from a point to a sphere, taken as a disc that faces the point; Lensing 2014, eq. 5.59.
float sphere_form_factor(float radius2, float cosine, float d2) {
    return radius2 * max(cosine, 0.0) / max(radius2 + d2, 1e-37);
}

// Overlap of two squares: lower and upper corner. Empty unless the lower corner is below the upper one.
vec4 overlap(vec2 centre, float half_side, vec2 other, float other_half_side) {
    return vec4(max(centre - half_side, other - other_half_side), min(centre + half_side, other + other_half_side));
}

// Area of an `overlap` result.
float overlap_area(vec4 corners) {
    vec2 size = max(corners.zw - corners.xy, vec2(0.0));
    return size.x * size.y;
}

// Occluding share of a disc at the distance `along` [m] in front of the light; 1 from `reach` on. Eq. 5.61.
float fade(float along, float reach) {
    return clamp(along / reach, 0.0, 1.0);
}

// A tangent of a surface: +X, rotated by the shortest rotation from +Y to the normal.
vec3 surface_tangent(vec3 normal) {
    float scale = 1.0 + normal.y;
    if (scale < 1e-6) {
        return vec3(1.0, 0.0, 0.0);
    }
    return vec3(1.0, 0.0, 0.0) - normal.x / scale * (normal + vec3(0.0, 1.0, 0.0));
}

// Tangent along the unit direction to the light; near the normal, a smooth fallback.
vec3 tangent_towards(vec3 direction, vec3 normal) {
    vec3 aside = direction - dot(normal, direction) * normal;
    float sine2 = dot(aside, aside);
    return sine2 > 1e-6 ? aside * inversesqrt(sine2) : surface_tangent(normal);
}

#endif
