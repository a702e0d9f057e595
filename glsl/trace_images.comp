// Stage 6, before the gather: what each live cache sees of the scene, or of it beyond a distance, by one ray for each texel of
// its depth image. METHOD 11.
#extension GL_EXT_control_flow_attributes : require
#include "lib/hit.glsl"
#include "lib/depth_image.glsl"

layout(local_size_x = 64) in;
layout(push_constant, scalar) uniform Push { TracePush push; };
layout(binding = 12, scalar) readonly buffer Caches { Cache caches[]; };
layout(binding = 13, scalar) readonly buffer Live { uint live[]; };
layout(binding = 14, scalar) readonly buffer Args { LiveArgs args; };
layout(binding = 15, scalar) writeonly buffer Images { float images[]; };

const float STEP = 2.0 / float(DEPTH_IMAGE_SIDE);

// How far behind what a texel's ray meets things are still seen: surfaces are not flat. [distances]
const float MARGIN = 0.01;

void main() {
    uint slot = gl_WorkGroupID.y * DEPTH_IMAGE_ROW + gl_WorkGroupID.x;
    if (slot >= args.cache_count) {
        return;
    }
    Cache c = caches[live[slot]];
    vec3 tangent, bitangent;
    tangents(c.normal, tangent, bitangent);
    float lift = lift_at(c.position, 0.0);
    vec3 start = c.position + c.normal * lift;
    for (uint texel = gl_LocalInvocationID.x; texel < DEPTH_IMAGE_TEXELS; texel += gl_WorkGroupSize.x) {
        vec2 p = (vec2(texel % DEPTH_IMAGE_SIDE, texel / DEPTH_IMAGE_SIDE) + 0.5) * STEP - 1.0;
        float z2 = 1.0 - dot(p, p);
        float limit = 0.0;
        if (z2 > 0.0) {
            vec3 direction = tangent * p.x + bitangent * p.y + c.normal * sqrt(z2);
            Hit hit = trace(start, direction, max(push.reach, lift), 3e38, push.root, 0u, false);
            if (hit.triangle != NO_HIT) {
                bool front;
                vec3 n = -hit_geometric(hit, direction, front);
                vec3 own = vec3(dot(n, tangent), dot(n, bitangent), dot(n, c.normal));
                float along = dot(n, direction);
                // The reciprocal distance of a plane is linear in the direction: its least value in the texel.
                float slope = 1.0 / max(sqrt(z2), DEPTH_IMAGE_LEAST_Z);
                float least = along - 0.5 * STEP * (abs(own.x - own.z * p.x * slope) + abs(own.y - own.z * p.y * slope));
                limit = max(least, 0.0) / (hit.distance * along * (1.0 + MARGIN));
            }
        }
        images[slot * DEPTH_IMAGE_TEXELS + texel] = limit;
    }
}
