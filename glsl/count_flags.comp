// Compaction, first pass: how many items of each block are flagged.
#include "shared.glsl"
#include "lib/pack.glsl"

layout(local_size_x = PACK_THREADS) in;
layout(push_constant, scalar) uniform Push { PackPush push; };
layout(binding = 0, scalar) readonly buffer Flags { uint flags[]; };
layout(binding = 1, scalar) writeonly buffer Blocks { uint blocks[]; };

void main() {
    uint first = gl_GlobalInvocationID.x * PACK_ITEMS;
    uint mine = 0u;
    for (uint i = first; i < min(first + PACK_ITEMS, push.count); ++i) {
        mine += push.all | flags[i];
    }
    uint all;
    running_sum(mine, all);
    if (gl_LocalInvocationID.x == 0u) {
        blocks[gl_WorkGroupID.x] = all;
    }
}
