// Stage 6, before the gather: traces each live cache's depth image, one ray per texel. Rays begin at a given distance.
// METHOD 11.
// variant trace_images_sent_on.comp: SENT_ON (also the caches at hits, for the light that caches send on)
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

// How far behind a hit points still count as visible, as a share of the distance: surfaces are not flat.
const float MARGIN = 0.01;

#ifdef SENT_ON
layout(binding = 16, scalar) writeonly buffer AllImages { float all_images[]; };
layout(binding = 17, scalar) writeonly buffer Met { uint met[]; }; // cache at each ray's hit, UNKNOWN_CACHE, or without a hit NO_REFERENCES
layout(binding = 18, scalar) writeonly buffer FarMet { uint far_met[]; }; // the same at the ends of the rays of `images`
layout(constant_id = 4) const uint REFERENCES = 8;
layout(constant_id = 5) const uint BY_CELLS = 0; // 1: references are stored per cell
#define REFERENCE_BINDINGS 19
#include "lib/hit_caches.glsl"

// The cache of largest weight at a ray's hit, on the side that was hit: as in `Met`.
uint met_cache(Hit hit, vec3 start, vec3 direction) {
    if (hit.triangle == NO_HIT) {
        return NO_REFERENCES;
    }
    bool front;
    vec3 n = hit_geometric(hit, direction, front);
    uvec3 v = corners_hit(hit, direction) - hit_instances[hit.instance].drawn_vertex;
    vec3 w = vec3(1.0 - hit.weights.x - hit.weights.y, hit.weights);
    vec3 shares;
    uint cache = caches_about(hit.instance, v, w, 3u, start + hit.distance * direction, n, push.cache_reach, shares).x;
    return cache != NO_REFERENCES && dot(caches[cache].normal, n) > 0.0 ? cache : UNKNOWN_CACHE;
}
#endif

// Value that a texel keeps of its ray. `p`: its point on the unit disc; `z2`: squared cosine of the ray.
float limit_of(Hit hit, vec3 direction, vec2 p, float z2, vec3 tangent, vec3 bitangent, vec3 normal) {
    if (hit.triangle == NO_HIT) {
        return 0.0;
    }
    bool front;
    vec3 n = -hit_geometric(hit, direction, front);
    vec3 own = vec3(dot(n, tangent), dot(n, bitangent), dot(n, normal));
    float along = dot(n, direction);
    // The reciprocal distance of a plane is linear in the direction: this is its minimum in the texel.
    float slope = 1.0 / max(sqrt(z2), DEPTH_IMAGE_LEAST_Z);
    float least = along - 0.5 * STEP * (abs(own.x - own.z * p.x * slope) + abs(own.y - own.z * p.y * slope));
    return max(least, 0.0) / (hit.distance * along * (1.0 + MARGIN));
}

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
#ifdef SENT_ON
        float of_all = 0.0;
        uint of_hit = NO_REFERENCES;
        uint of_far_hit = NO_REFERENCES;
#endif
        if (z2 > 0.0) {
            vec3 direction = tangent * p.x + bitangent * p.y + c.normal * sqrt(z2);
#ifdef SENT_ON
            Hit hit = trace(start, direction, lift, 3e38, push.root, 0u, false);
            of_all = limit_of(hit, direction, p, z2, tangent, bitangent, c.normal);
            of_hit = met_cache(hit, start, direction);
            limit = of_all;
            of_far_hit = of_hit;
            if (hit.triangle != NO_HIT && hit.distance < push.reach) {
                hit = trace(start, direction, push.reach, 3e38, push.root, 0u, false);
                limit = limit_of(hit, direction, p, z2, tangent, bitangent, c.normal);
                of_far_hit = met_cache(hit, start, direction);
            }
#else
            Hit hit = trace(start, direction, max(push.reach, lift), 3e38, push.root, 0u, false);
            limit = limit_of(hit, direction, p, z2, tangent, bitangent, c.normal);
#endif
        }
#ifdef SENT_ON
        all_images[slot * DEPTH_IMAGE_TEXELS + texel] = of_all;
        met[slot * DEPTH_IMAGE_TEXELS + texel] = of_hit;
        far_met[slot * DEPTH_IMAGE_TEXELS + texel] = of_far_hit;
#endif
        images[slot * DEPTH_IMAGE_TEXELS + texel] = limit;
    }
}
