// Stage 6, before the gather: traces each live cache's depth image, one ray per texel. Rays begin at a given distance.
// The next pass, image_margins.comp, moves the planes back. METHOD 11.
// variant trace_images_sent_on.comp: SENT_ON (also the caches at hits, for the light that caches send on)
#extension GL_EXT_control_flow_attributes : require
#include "lib/hit.glsl"
#include "lib/depth_image.glsl"

layout(local_size_x = 64) in;
layout(push_constant, scalar) uniform Push { TraceImagesPush push; };
layout(binding = 12, scalar) readonly buffer Caches { Cache caches[]; };
layout(binding = 13, scalar) readonly buffer Live { uint live[]; };
layout(binding = 14, scalar) readonly buffer Args { LiveArgs args; };
layout(binding = 15, scalar) writeonly buffer Images { uvec2 images[]; };

#ifdef SENT_ON
layout(binding = 16, scalar) writeonly buffer AllImages { uvec2 all_images[]; };
layout(binding = 17, scalar) writeonly buffer Met { uint met[]; }; // cache at each ray's hit, UNKNOWN_CACHE, or without a hit NO_REFERENCES
layout(binding = 18, scalar) writeonly buffer FarMet { uint far_met[]; }; // the same at the ends of the rays of `images`
layout(constant_id = 4) const uint REFERENCES = 8;
layout(constant_id = 5) const uint BY_CELLS = 0; // 1: references are stored per cell
#define REFERENCE_BINDINGS 19
#include "lib/hit_caches.glsl"

// The cache of largest weight that a ray's hit sees, on the side that was hit: as in `Met`.
uint met_cache(Hit hit, vec3 start, vec3 direction) {
    if (hit.triangle == NO_HIT) {
        return NO_REFERENCES;
    }
    bool front;
    vec3 n = hit_geometric(hit, direction, front);
    uvec3 v = corners_hit(hit, direction) - hit_instances[hit.instance].drawn_vertex;
    vec3 w = vec3(1.0 - hit.weights.x - hit.weights.y, hit.weights);
    vec3 position = start + hit.distance * direction;
    vec3 shares;
    uvec3 about = caches_about(hit.instance, v, w, 3u, position, n, push.cache_reach, shares);
    if (about.x == NO_REFERENCES || dot(caches[about.x].normal, n) <= 0.0) {
        return UNKNOWN_CACHE;
    }
    vec3 seen = seen_weights(about, shares, position, n, push.seen_lift, push.root, true);
    return seen.x > 0.0 ? about.x : seen.y > 0.0 ? about.y : about.z;
}
#endif

// Plane of the surface that a ray hits.
uvec2 plane_of(Hit hit, vec3 direction) {
    if (hit.triangle == NO_HIT) {
        return NO_PLANE;
    }
    bool front;
    vec3 n = -hit_geometric(hit, direction, front);
    return plane_texel(n, hit.distance * dot(n, direction));
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
    uint first = slot * DEPTH_IMAGE_TEXELS;
    for (uint texel = gl_LocalInvocationID.x; texel < DEPTH_IMAGE_TEXELS; texel += gl_WorkGroupSize.x) {
        uvec2 plane = NO_PLANE;
#ifdef SENT_ON
        uvec2 of_all = NO_PLANE;
        uint of_hit = NO_REFERENCES;
        uint of_far_hit = NO_REFERENCES;
#endif
        if (is_on_disc(texel)) {
            vec3 direction = texel_direction(texel, tangent, bitangent, c.normal);
#ifdef SENT_ON
            Hit hit = trace(start, direction, lift, 3e38, push.root, 0u, false);
            of_all = plane_of(hit, direction);
            of_hit = met_cache(hit, start, direction);
            plane = of_all;
            of_far_hit = of_hit;
            if (hit.triangle != NO_HIT && hit.distance < push.reach) {
                hit = trace(start, direction, push.reach, 3e38, push.root, 0u, false);
                plane = plane_of(hit, direction);
                of_far_hit = met_cache(hit, start, direction);
            }
#else
            Hit hit = trace(start, direction, max(push.reach, lift), 3e38, push.root, 0u, false);
            plane = plane_of(hit, direction);
#endif
        }
#ifdef SENT_ON
        all_images[first + texel] = of_all;
        met[first + texel] = of_hit;
        far_met[first + texel] = of_far_hit;
#endif
        images[first + texel] = plane;
    }
}
