// Stage 6 by clusters: each cache's illuminance from the coarse cut. The bound rule limits errors to shares of it.
#include "shared.glsl"

layout(local_size_x = 64) in;
layout(push_constant, scalar) uniform Push { ClusterPush push; };
layout(binding = 0, scalar) readonly buffer Args { LiveArgs args; };
layout(binding = 1, scalar) readonly buffer Parts { GatherSums parts[]; };
layout(binding = 2, scalar) writeonly buffer Totals { float totals[]; };

void main() {
    uint slot = gl_GlobalInvocationID.x;
    if (slot >= min(args.cache_count * CLUSTER_GROUP, push.cache_count)) {
        return;
    }
    vec3 irradiance = vec3(0.0);
    for (uint part = 0u; part < args.groups_y; ++part) {
        irradiance += parts[part * push.cache_count + slot].diffuse_irradiance;
    }
    totals[slot] = dot(irradiance, vec3(0.2126, 0.7152, 0.0722));
}
