// Positions of pixels in their visible triangles.
#ifndef TRIANGLE_GLSL
#define TRIANGLE_GLSL

// Barycentric weights of the point where the pixel's ray meets the triangle: signed areas as seen from the pixel.
// Corners are taken relative to the pixel; otherwise small triangles far from the picture's centre would be lost to
// rounding.
vec3 weights_at(vec2 pixel, vec4 a, vec4 b, vec4 c) {
    vec2 pa = a.xy - pixel * a.w;
    vec2 pb = b.xy - pixel * b.w;
    vec2 pc = c.xy - pixel * c.w;
    vec3 areas = vec3(pb.x * pc.y - pb.y * pc.x, pc.x * pa.y - pc.y * pa.x, pa.x * pb.y - pa.y * pb.x);
    // Either side may face the viewer; a centre that rounding moves outside counts as on the edge.
    areas = max(areas * sign(areas.x + areas.y + areas.z), vec3(0.0));
    float all = areas.x + areas.y + areas.z;
    return all > 0.0 ? areas / all : vec3(1.0 / 3.0);
}

#endif
