// Before stage 1: morphs and skins the vertices of deforming meshes as glTF defines it. METHOD 8. Twin:
// scene/deform.rs.
#include "shared.glsl"
#include "lib/phong.glsl"

layout(local_size_x = 64) in;
layout(push_constant, scalar) uniform Push { DeformPush push; };
layout(binding = 0, scalar) readonly buffer Blocks { BodyBlock blocks[]; };
layout(binding = 1, scalar) readonly buffer Bodies { Body bodies[]; };
layout(binding = 2, scalar) readonly buffer Bind { BindVertex bind[]; };
layout(binding = 3, scalar) readonly buffer Influences { Influence influences[]; };
layout(binding = 4, scalar) readonly buffer Displacements { Displacement displacements[]; };
layout(binding = 5, scalar) readonly buffer Joints { Joint joints[]; };
layout(binding = 6, scalar) readonly buffer Weights { float weights[]; };
layout(binding = 7, scalar) writeonly buffer Vertices { float vertices[]; };
layout(binding = 8, scalar) writeonly buffer Corners { Corner corners[]; };

void main() {
    uint at = gl_WorkGroupID.y * DEFORM_ROW + gl_WorkGroupID.x;
    if (at >= push.block_count) {
        return;
    }
    Body body = bodies[blocks[at].body];
    uint i = blocks[at].first + gl_LocalInvocationID.x;
    if (i >= body.bind_count) {
        return;
    }
    BindVertex v = bind[body.first_bind + i];
    bool has_tangent = dot(v.tangent.xyz, v.tangent.xyz) > 0.0;
    vec3 bind_normal = v.normal;
    for (uint t = 0u; t < body.target_count; ++t) {
        float weight = weights[body.first_weight + t];
        if (weight != 0.0) {
            Displacement d = displacements[body.first_displacement + t * body.bind_count + i];
            v.position += weight * d.position;
            v.normal += weight * d.normal;
            v.tangent.xyz += weight * d.tangent;
        }
    }
    if (v.influence_count > 0u) {
        Joint m = Joint(vec4(0.0), vec4(0.0), vec4(0.0));
        for (uint k = v.first_influence; k < v.first_influence + v.influence_count; ++k) {
            Joint joint = joints[body.first_joint + influences[k].joint];
            float weight = influences[k].weight;
            m.x += weight * joint.x;
            m.y += weight * joint.y;
            m.z += weight * joint.z;
        }
        // Rows of the cofactor matrix: the inverse transpose up to a factor, without a division.
        vec3 cx = cross(m.y.xyz, m.z.xyz), cy = cross(m.z.xyz, m.x.xyz), cz = cross(m.x.xyz, m.y.xyz);
        float side = dot(m.x.xyz, cx) < 0.0 ? -1.0 : 1.0;
        vec4 p = vec4(v.position, 1.0);
        v.position = vec3(dot(m.x, p), dot(m.y, p), dot(m.z, p));
        v.normal = side * vec3(dot(cx, v.normal), dot(cy, v.normal), dot(cz, v.normal));
        vec3 t = v.tangent.xyz;
        // Without a tangent the sign only marks the side of a double-sided surface, which mirroring does not change.
        v.tangent = vec4(dot(m.x.xyz, t), dot(m.y.xyz, t), dot(m.z.xyz, t), has_tangent ? side * v.tangent.w : v.tangent.w);
    }
    // If the pose leaves no normal, use the one in the file.
    v.normal = unit_of_any_or(v.normal, bind_normal);
    v.tangent.xyz = has_tangent ? unit_of_any_or(v.tangent.xyz, vec3(0.0)) : vec3(0.0);
    uint vertex = body.first_vertex + i;
    uint word = VERTEX_WORDS * vertex;
    for (uint k = 0u; k < 3u; ++k) {
        vertices[word + k] = v.position[k];
        vertices[word + 3u + k] = v.normal[k];
    }
    for (uint k = 0u; k < 4u; ++k) {
        vertices[word + 6u + k] = v.tangent[k];
    }
    corners[vertex] = Corner(v.position, v.normal);
}
