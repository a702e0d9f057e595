// Where pixels lie in the triangles that they show.
#ifndef TRIANGLE_GLSL
#define TRIANGLE_GLSL

// Where the pixel's ray meets the triangle, as weights of its corners: areas of the triangle as the pixel sees it. Corners
// count from the pixel, else small triangles far from the picture's middle would be lost in rounding.
vec3 weights_at(vec2 pixel, vec4 a, vec4 b, vec4 c) {
    vec2 pa = a.xy - pixel * a.w;
    vec2 pb = b.xy - pixel * b.w;
    vec2 pc = c.xy - pixel * c.w;
    vec3 areas = vec3(pb.x * pc.y - pb.y * pc.x, pc.x * pa.y - pc.y * pa.x, pa.x * pb.y - pa.y * pb.x);
    // Seen from either side; a centre that rounding puts outside counts as one on the edge.
    areas = max(areas * sign(areas.x + areas.y + areas.z), vec3(0.0));
    float all = areas.x + areas.y + areas.z;
    return all > 0.0 ? areas / all : vec3(1.0 / 3.0);
}

#endif
