// Stage 5, compaction, second pass: writes the ordered list of live caches and the gather's dispatch arguments. Clears
// the flags for the next frame.
#include "shared.glsl"
#include "lib/pack.glsl"

layout(local_size_x = PACK_THREADS) in;
layout(push_constant, scalar) uniform Push { PackPush push; };
layout(binding = 0, scalar) buffer Flags { uint flags[]; };
layout(binding = 1, scalar) readonly buffer Blocks { uint blocks[]; };
layout(binding = 2, scalar) readonly buffer LightCount { uint light_count; }; // VALs, or cluster nodes
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

    uint first = gl_GlobalInvocationID.x * push.per_thread;
    uint end = min(first + push.per_thread, push.count);
    uint mine = 0u;
    for (uint i = first; i < end; ++i) {
        mine += flags[i];
    }
    uint all;
    uint to = before + running_sum(mine, all) - mine;
    for (uint i = first; i < end; ++i) {
        if (flags[i] != 0u) {
            live[to++] = i;
        }
        flags[i] = 0u;
    }
    if (gl_WorkGroupID.x == gl_NumWorkGroups.x - 1u && thread == 0u) {
        args = live_args(before + all, light_count, push.caches_per_group, push.split);
    }
}
