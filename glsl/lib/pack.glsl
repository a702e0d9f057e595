// Compaction in order: what a thread needs to know to place its items among all that are flagged.
#ifndef PACK_GLSL
#define PACK_GLSL

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

// The gather's dispatch of so many live caches and VALs, or nodes over them. There is one part at least: without light it
// says so.
LiveArgs live_args(uint caches, uint lights, uint caches_per_group, uint split) {
    return LiveArgs((caches + caches_per_group - 1u) / caches_per_group, max((lights + split - 1u) / split, 1u), 1u, caches,
                    min(caches, DEPTH_IMAGE_ROW), (caches + DEPTH_IMAGE_ROW - 1u) / DEPTH_IMAGE_ROW, 1u);
}

#endif
