// Compaction in order: what a thread needs to know to place its items among all that are flagged.
#ifndef PACK_GLSL
#define PACK_GLSL

// Consecutive items of a thread.
const uint PACK_ITEMS = PACK_BLOCK / PACK_THREADS;

shared uint pack_sums[PACK_THREADS];

// Sum over the workgroup's threads up to and including this one; `all` is that of the last one.
uint running_sum(uint mine, out uint all) {
    uint thread = gl_LocalInvocationID.x;
    barrier();
    pack_sums[thread] = mine;
    for (uint step = 1u; step < PACK_THREADS; step *= 2u) {
        barrier();
        uint before = thread >= step ? pack_sums[thread - step] : 0u;
        barrier();
        pack_sums[thread] += before;
    }
    barrier();
    all = pack_sums[PACK_THREADS - 1u];
    return pack_sums[thread];
}

#endif
