// Stages 1 and 4, and shadow maps: transforms a model's vertex to the world and into a view.
// variant mesh_pulled.vert: PULLED (stage 1 where fragment shaders do not know which triangle they belong to)
// variant mesh_depth.vert: DEPTH (shadow maps of surfaces without holes: positions only)
// variant mesh_plain.vert: PLAIN (stage 4 and other shadow maps: no tangents)
#include "shared.glsl"

layout(push_constant, scalar) uniform Push { DrawPush push; };
layout(binding = 0, scalar) readonly buffer Instances { Instance instances[]; };

#ifdef PULLED
// Drawn without indices: each vertex looks up its own, so that triangles share no vertices and each can carry its
// number.
layout(binding = 17, scalar) readonly buffer Vertices { uint vertex_words[]; };
layout(binding = 18, scalar) readonly buffer Indices { uint indices[]; };
layout(binding = 19, scalar) readonly buffer Draws { DrawRecord draws[]; };
#else
layout(location = 0) in vec3 model_position;
#ifndef DEPTH
layout(location = 1) in vec3 model_normal;
#ifndef PLAIN
layout(location = 2) in vec4 model_tangent;
#endif
layout(location = 3) in vec2 uv0;
layout(location = 4) in vec2 uv1;
layout(location = 5) in vec4 color;
#endif
#endif

#ifndef DEPTH
layout(location = 0) out vec3 out_position;
layout(location = 1) out vec3 out_normal;
#ifndef PLAIN
layout(location = 2) out vec4 out_tangent;
#endif
layout(location = 3) out vec4 out_uv;
layout(location = 4) out vec4 out_color;
#endif
#ifdef PULLED
layout(location = 5) flat out uint out_triangle;

// Two floats of a vertex, starting at this word.
vec2 two(uint word) {
    return uintBitsToFloat(uvec2(vertex_words[word], vertex_words[word + 1u]));
}
#endif

void main() {
#ifdef PULLED
    DrawRecord draw = draws[push.draw - 1u];
    uint at = VERTEX_WORDS * (draw.first_vertex + indices[draw.first_index + uint(gl_VertexIndex)]);
    vec3 model_position = vec3(two(at), two(at + 1u).y);
    vec3 model_normal = vec3(two(at + 3u), two(at + 4u).y);
    vec4 model_tangent = vec4(two(at + 6u), two(at + 8u));
    vec2 uv0 = two(at + 10u);
    vec2 uv1 = two(at + 12u);
    vec4 color = unpackUnorm4x8(vertex_words[at + 14u]);
    out_triangle = uint(gl_VertexIndex) / 3u;
#endif
    Instance instance = instances[push.instance];
    vec3 position = (instance.world_from_model * vec4(model_position, 1.0)).xyz;
    gl_Position = push.clip_from_world * vec4(position, 1.0);
#ifndef DEPTH
    out_position = position;
    out_normal = mat3(instance.world_from_normal) * model_normal;
#ifndef PLAIN
    mat3 linear = mat3(instance.world_from_model);
    // Mirroring flips the bitangent. Without a tangent the sign only marks the side of the surface and stays.
    bool turned = determinant(linear) < 0.0 && dot(model_tangent.xyz, model_tangent.xyz) > 0.0;
    out_tangent = vec4(linear * model_tangent.xyz, turned ? -model_tangent.w : model_tangent.w);
#endif
    out_uv = vec4(uv0, uv1);
    out_color = color;
#endif
}
