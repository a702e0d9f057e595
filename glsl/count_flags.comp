// Compaction, first pass: counts the flagged items of each block.
#include "shared.glsl"
#include "lib/pack.glsl"

layout(local_size_x = PACK_THREADS) in;
layout(push_constant, scalar) uniform Push { PackPush push; };
layout(binding = 0, scalar) readonly buffer Flags { uint flags[]; };
layout(binding = 1, scalar) writeonly buffer Blocks { uint blocks[]; };

void main() {
    uint first = gl_GlobalInvocationID.x * push.per_thread;
    uint mine = 0u;
    for (uint i = first; i < min(first + push.per_thread, push.count); ++i) {
        mine += flags[i];
    }
    uint all;
    running_sum(mine, all);
    if (gl_LocalInvocationID.x == 0u) {
        blocks[gl_WorkGroupID.x] = all;
    }
}
