// The pixel's position in its visible triangle and, with BY_CELLS, the point at which a pixel averages caches. METHOD
// 5.
// The including shader has the push constants clip_from_world, eye and reach. Compute shaders define HERE, the middle of
// their pixel, first. Uses bindings 0 and 3, and with BY_CELLS
// 4 to 7.
#ifndef HERE_GLSL
#define HERE_GLSL
#include "lib/triangle.glsl"

#ifndef HERE
#define HERE gl_FragCoord.xy
#endif

layout(binding = 0) uniform usampler2D element_image;
layout(binding = 3, scalar) readonly buffer Indices { uint indices[]; };
#ifdef BY_CELLS
#include "lib/average.glsl"
layout(binding = 4, scalar) readonly buffer Instances { Instance instances[]; };
layout(binding = 5, scalar) readonly buffer Corners { Corner corners[]; };
layout(binding = 6, scalar) readonly buffer Rows { uint rows[]; };
layout(binding = 7, scalar) readonly buffer Caches { Cache caches[]; };
#endif

// Barycentric weights of this pixel in a triangle.
vec3 weights_here(vec4 a, vec4 b, vec4 c) {
    return weights_at(HERE / vec2(textureSize(element_image, 0)) * 2.0 - 1.0, a, b, c);
}

#ifdef BY_CELLS
// This pixel's row of references; NO_REFERENCES if it has none.
uint row_here() {
    ivec2 pixel = ivec2(HERE);
    return rows[pixel.y * textureSize(element_image, 0).x + pixel.x];
}

// The point on a triangle that this pixel shows.
Point point_here(DrawRecord draw, uint first_index) {
    Instance instance = instances[draw.instance];
    vec3 place[3], facing[3];
    vec4 clip[3];
    vec3 posed[3];
    for (uint i = 0u; i < 3u; ++i) {
        Corner corner = corners[draw.first_vertex + indices[first_index + i]];
        place[i] = (instance.world_from_model * vec4(corner.position, 1.0)).xyz;
        facing[i] = unit_or(mat3(instance.world_from_normal) * corner.normal, vec3(0.0, 1.0, 0.0));
        clip[i] = push.clip_from_world * vec4(place[i], 1.0);
        posed[i] = corner.position;
    }
    // A stretched surface moves its caches apart.
    float growth = instance.growth;
    if (draw.first_rest != draw.first_vertex) {
        float most = 0.0;
        for (uint i = 0u; i < 3u; ++i) {
            vec3 a = corners[draw.first_rest + indices[first_index + i]].position;
            vec3 b = corners[draw.first_rest + indices[first_index + (i + 1u) % 3u]].position;
            // Skip edges that had no length at rest.
            if (distance(a, b) > 0.0) {
                most = max(most, distance(posed[i], posed[(i + 1u) % 3u]) / distance(a, b));
            }
        }
        growth *= most > 0.0 ? most : 1.0;
    }
    vec3 w = weights_here(clip[0], clip[1], clip[2]);
    Point x;
    x.position = w.x * place[0] + w.y * place[1] + w.z * place[2];
    x.normal = unit_or(w.x * facing[0] + w.y * facing[1] + w.z * facing[2], facing[0]);
    x.mirrored = reflect(view_direction(push.eye, x.position), x.normal);
    x.eye = push.eye;
    x.d_max = push.reach * growth;
    return x;
}
#endif

#endif
