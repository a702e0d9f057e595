// Whether two points lie on one surface. METHOD 13.
#ifndef SAME_SURFACE_GLSL
#define SAME_SURFACE_GLSL

// A surface at a point in a pixel.
struct Seen {
    float depth; // 0: none
    uint draw; // 0: unknown
    vec3 position;
    vec3 normal; // of its triangle
};

vec3 place(mat4 world_from_clip, vec2 ndc, float depth) {
    vec4 world = world_from_clip * vec4(ndc, depth, 1.0);
    return world.xyz / world.w;
}

// Side of a pixel at this depth [m]; 0 where there is no surface.
float pixel_side(mat4 world_from_clip, vec2 ndc, float depth, int width) {
    vec2 next = ndc + vec2(2.0 / float(width), 0.0);
    return depth > 0.0 ? distance(place(world_from_clip, ndc, depth), place(world_from_clip, next, depth)) : 0.0;
}

// Whether two points lie on one surface: same draw, within half a pixel of each other's planes, similar normals.
bool same_surface(Seen a, Seen b, float pixel) {
    if (a.depth == 0.0 || b.depth == 0.0) {
        return a.depth == b.depth;
    }
    vec3 d = b.position - a.position;
    float aside = max(abs(dot(d, a.normal)), abs(dot(d, b.normal)));
    return a.draw == b.draw && dot(a.normal, b.normal) > 0.9 && aside < 0.5 * pixel;
}

#endif
