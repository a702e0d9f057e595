// Stage 3, end: takes the normals of caches that no light reaches and no eye sees: in narrow gaps, or inside another
// body. Without a normal a cache has no weight anywhere. The bake leaves out caches in gaps between static things; bodies
// that move cover different caches in each frame. One workgroup per cache, one ray per thread. METHOD 8.
// Twin: src/reference/hidden.rs.
#extension GL_EXT_control_flow_attributes : require
#include "lib/hit.glsl"
#include "lib/depth_image.glsl"
#include "lib/disc.glsl"

layout(local_size_x = HIDDEN_RAYS) in;
layout(push_constant, scalar) uniform Push { HiddenPush push; };
layout(binding = 12, scalar) buffer Caches { Cache caches[]; };

shared uint open_count;

void main() {
    uint cache = gl_WorkGroupID.y * DEPTH_IMAGE_ROW + gl_WorkGroupID.x;
    if (cache >= push.cache_count) {
        return;
    }
    if (gl_LocalInvocationID.x == 0u) {
        open_count = 0u;
    }
    barrier();
    vec3 position = caches[cache].position;
    vec3 normal = caches[cache].normal;
    vec3 tangent, bitangent;
    tangents(normal, tangent, bitangent);
    float lift = lift_at(position, 0.0);
    vec2 p = disc_point(gl_LocalInvocationID.x, HIDDEN_RAYS, 0.0);
    vec3 direction = p.x * tangent + p.y * bitangent + sqrt(1.0 - dot(p, p)) * normal; // distributed by the cosine
    Hit hit = trace(position + normal * lift, direction, lift, 3e38, push.root, 0u, false);
    bool is_open = hit.triangle == NO_HIT;
    if (!is_open) {
        // The back of a one-sided surface is the inside of a body.
        bool front;
        hit_geometric(hit, direction, front);
        is_open = front && hit.distance > push.gap;
    }
    atomicAdd(open_count, is_open ? 1u : 0u);
    barrier();
    if (gl_LocalInvocationID.x == 0u && open_count <= 1u) {
        caches[cache].normal = vec3(0.0);
    }
}
