// Before stage 1: vertices that follow a triangle of a deforming mesh, after its corners are posed: vertices created by
// tessellation, and corners of flat triangles, which need the posed normal.
#include "shared.glsl"
#include "lib/phong.glsl"

layout(local_size_x = 64) in;
layout(push_constant, scalar) uniform Push { DeformPush push; };
layout(binding = 0, scalar) readonly buffer Blocks { BodyBlock blocks[]; };
layout(binding = 1, scalar) readonly buffer Bodies { Body bodies[]; };
layout(binding = 2, scalar) readonly buffer Followers { Follower followers[]; };
layout(binding = 3, scalar) readonly buffer Bind { BindVertex bind[]; };
layout(binding = 4, scalar) buffer Vertices { float vertices[]; };
layout(binding = 5, scalar) writeonly buffer Corners { Corner corners[]; };

vec3 three(uint word) {
    return vec3(vertices[word], vertices[word + 1u], vertices[word + 2u]);
}

void main() {
    uint at = gl_WorkGroupID.y * DEFORM_ROW + gl_WorkGroupID.x;
    if (at >= push.block_count) {
        return;
    }
    Body body = bodies[blocks[at].body];
    uint i = blocks[at].first + gl_LocalInvocationID.x;
    if (i >= body.follower_count) {
        return;
    }
    Follower f = followers[body.first_follower + i];
    uint a = VERTEX_WORDS * (body.first_vertex + f.a);
    uint b = VERTEX_WORDS * (body.first_vertex + f.b);
    uint c = VERTEX_WORDS * (body.first_vertex + f.c);
    vec3 w = vec3(1.0 - f.weights.x - f.weights.y, f.weights);
    vec3 pa = three(a), pb = three(b), pc = three(c);
    vec3 position = w.x * pa + w.y * pb + w.z * pc;
    vec3 normal, tangent = vec3(0.0);
    if (f.is_flat == 1u) {
        // A triangle degenerated to a line has no normal of its own.
        normal = unit_of_any_or(cross(pb - pa, pc - pa), bind[body.first_bind + f.a].normal);
    } else {
        normal = unit_of_any_or(w.x * three(a + 3u) + w.y * three(b + 3u) + w.z * three(c + 3u), three(a + 3u));
        tangent = unit_of_any_or(w.x * three(a + 6u) + w.y * three(b + 6u) + w.z * three(c + 6u), vec3(0.0));
    }
    uint vertex = body.first_vertex + f.vertex;
    uint word = VERTEX_WORDS * vertex;
    // A flat corner keeps its posed position; other threads may be reading it.
    bool moves = f.vertex >= body.bind_count;
    for (uint k = 0u; k < 3u; ++k) {
        if (moves) {
            vertices[word + k] = position[k];
        }
        vertices[word + 3u + k] = normal[k];
        vertices[word + 6u + k] = tangent[k];
    }
    if (f.is_flat == 0u) {
        vertices[word + 9u] = vertices[a + 9u];
    }
    corners[vertex] = Corner(position, normal);
}
