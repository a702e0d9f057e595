// Stages 6 and 7: bounds of the discs and rectangles of each group of consecutive caches.
#include "shared.glsl"

layout(local_size_x = 32) in;
layout(push_constant, scalar) uniform Push { OccludePush push; };
layout(binding = 0, scalar) readonly buffer Caches { Cache caches[]; };
layout(binding = 1, scalar) writeonly buffer Groups { OccluderGroup groups[]; };

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= push.group_count) {
        return;
    }
    uint first = i * OCCLUDER_GROUP;
    uint end = min(first + OCCLUDER_GROUP, push.cache_count);
    vec3 low = caches[first].position;
    vec3 high = low;
    OccluderGroup g = OccluderGroup(vec3(0.0), 0.0, 0.0, 0.0);
    for (uint j = first; j < end; ++j) {
        low = min(low, caches[j].position);
        high = max(high, caches[j].position);
        g.area = max(g.area, caches[j].area);
    }
    g.position = 0.5 * (low + high);
    for (uint j = first; j < end; ++j) {
        Cache c = caches[j];
        g.radius = max(g.radius, distance(g.position, c.position));
        g.reach = max(g.reach, distance(g.position, c.middle) + sqrt(dot(c.axis, c.axis) + c.breadth * c.breadth));
    }
    groups[i] = g;
}
