// Punctual lights as KHR_lights_punctual defines them. Twin: src/reference/light.rs.
#ifndef LIGHT_GLSL
#define LIGHT_GLSL

// Angular falloff of a spot light: squared linear ramp between the cones.
float spot_falloff(float cos_direction, float cone_scale, float cone_offset) {
    float ramp = clamp(cos_direction * cone_scale + cone_offset, 0.0, 1.0);
    return ramp * ramp;
}

// Factor on the intensity of a small emissive body in the unit direction `d`: an ellipsoid, of which a part may be missing.
// `squares` and `products`: its squared silhouette; `lean`: larger on the side that shines more. METHOD 2.
float body_falloff(vec3 d, vec3 squares, vec3 products, vec3 lean) {
    return max(sqrt(max(dot(squares, d * d) + dot(products, d.yzx * d.zxy), 0.0)) + dot(lean, d), 0.0);
}

// Window that fades a light to zero at its range; 1 for infinite range (0).
float range_window(float d2, float range) {
    if (range <= 0.0) {
        return 1.0;
    }
    float r2 = d2 / (range * range);
    return clamp(1.0 - r2 * r2, 0.0, 1.0);
}

// Solid angle [sr] of the triangle with unit directions a, b, c. Differences keep small triangles precise.
float triangle_solid_angle(vec3 a, vec3 b, vec3 c) {
    float volume = abs(dot(a, cross(b - a, c - a)));
    return 2.0 * atan(volume, 1.0 + dot(a, b) + dot(b, c) + dot(c, a));
}

// Solid angle [sr] of a texel: the planar quad with corner directions a, b, c, d in order.
float solid_angle(vec3 a, vec3 b, vec3 c, vec3 d) {
    a = normalize(a);
    b = normalize(b);
    c = normalize(c);
    d = normalize(d);
    return triangle_solid_angle(a, b, c) + triangle_solid_angle(a, c, d);
}

// Face of a six-view light for a direction: +x -x +y -y +z -z.
uint cube_face(vec3 d) {
    vec3 a = abs(d);
    if (a.x >= a.y && a.x >= a.z) {
        return d.x >= 0.0 ? 0u : 1u;
    }
    if (a.y >= a.z) {
        return d.y >= 0.0 ? 2u : 3u;
    }
    return d.z >= 0.0 ? 4u : 5u;
}

#endif
