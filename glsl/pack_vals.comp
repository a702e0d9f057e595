// Stage 4, compaction, second pass: copies the VALs that carry light, in order, padded with dark VALs to whole tiles.
// variant pack_vals_args.comp: ARGS (where no cache is culled: the gather's dispatch, too)
#include "shared.glsl"
#include "lib/pack.glsl"

layout(local_size_x = PACK_THREADS) in;
layout(push_constant, scalar) uniform Push { PackPush push; };
layout(binding = 0, scalar) readonly buffer Flags { uint flags[]; };
layout(binding = 1, scalar) readonly buffer Blocks { uint blocks[]; };
layout(binding = 2, scalar) readonly buffer Vals { Val vals[]; };
layout(binding = 3, scalar) writeonly buffer LiveVals { Val live_vals[]; };
layout(binding = 4, scalar) writeonly buffer ValCount { uint val_count; };
#ifdef ARGS
layout(binding = 5, scalar) writeonly buffer Args { LiveArgs args; };
#endif

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
            live_vals[to++] = vals[i];
        }
    }
    if (gl_WorkGroupID.x == gl_NumWorkGroups.x - 1u) {
        uint count = before + all;
        if (thread == 0u) {
            val_count = count;
#ifdef ARGS
            args = live_args(push.cache_count, count, push.caches_per_group, push.split);
#endif
        }
        uint padded = (count + VAL_TILE - 1u) / VAL_TILE * VAL_TILE;
        for (uint i = count + thread; i < padded; i += PACK_THREADS) {
            live_vals[i] = Val(vec3(0.0), 1.0, vec3(0.0), 0u, vec3(0.0), 0.0);
        }
    }
}
