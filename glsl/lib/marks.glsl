// Marks of the window's debug views.
#ifndef MARKS_GLSL
#define MARKS_GLSL

// Vertex of a mark that is not drawn: outside the view.
const vec4 NOWHERE = vec4(2.0, 2.0, 0.0, 1.0);

// Whether the front of a surface faces the viewer; `eye` as in MarkPush.
bool faces(vec3 position, vec3 normal, vec4 eye) {
    return dot(normal, eye.xyz - position * eye.w) > 0.0;
}

// A corner of a triangle around the unit disc.
vec2 around_disc(uint corner) {
    float angle = 2.0943951 * float(corner);
    return 2.0 * vec2(cos(angle), sin(angle));
}

// The point `at` of a disc's plane, in its radii from its centre.
vec3 on_disc(vec3 centre, vec3 normal, float radius, vec2 at) {
    vec3 across = abs(normal.x) < 0.7 ? vec3(1.0, 0.0, 0.0) : vec3(0.0, 1.0, 0.0);
    vec3 right = normalize(cross(normal, across));
    return centre + radius * (at.x * right + at.y * cross(normal, right));
}

// Display colour with the hue of a light, as bright as the display allows.
vec3 hue_of(vec3 light) {
    return srgb_from_linear(light / max(light.r, max(light.g, light.b)));
}

#endif
