// Stage 5, compaction, second pass: the list of the live caches, in order, and the gather's dispatch. The flags are
// cleared for the next frame.
#include "shared.glsl"
#include "lib/pack.glsl"

layout(local_size_x = PACK_THREADS) in;
layout(push_constant, scalar) uniform Push { PackPush push; };
layout(binding = 0, scalar) buffer Flags { uint flags[]; };
layout(binding = 1, scalar) readonly buffer Blocks { uint blocks[]; };
layout(binding = 2, scalar) readonly buffer LightCount { uint light_count; }; // VALs, or nodes over them
layout(binding = 3, scalar) writeonly buffer Live { uint live[]; };
layout(binding = 4, scalar) writeonly buffer Args { LiveArgs args; };

void main() {
    uint thread = gl_LocalInvocationID.x;
    uint earlier = 0u;
    for (uint i = thread; i < gl_WorkGroupID.x; i += PACK_THREADS) {
        earlier += blocks[i];
    }
    uint before;
    running_sum(earlier, before);
    if (push.all != 0u) {
        before = gl_WorkGroupID.x * PACK_BLOCK; // nothing was counted
    }

    uint first = gl_GlobalInvocationID.x * PACK_ITEMS;
    uint end = min(first + PACK_ITEMS, push.count);
    uint mine = 0u;
    for (uint i = first; i < end; ++i) {
        mine += push.all | flags[i];
    }
    uint all;
    uint to = before + running_sum(mine, all) - mine;
    for (uint i = first; i < end; ++i) {
        if ((push.all | flags[i]) != 0u) {
            live[to++] = i;
        }
        flags[i] = 0u;
    }
    if (gl_WorkGroupID.x == gl_NumWorkGroups.x - 1u && thread == 0u) {
        uint count = before + all;
        args = LiveArgs((count + push.caches_per_group - 1u) / push.caches_per_group,
                        (light_count + push.split - 1u) / push.split, 1u, count, min(count, DEPTH_IMAGE_ROW),
                        (count + DEPTH_IMAGE_ROW - 1u) / DEPTH_IMAGE_ROW, 1u);
    }
}
