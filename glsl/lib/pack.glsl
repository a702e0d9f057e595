// Order-preserving compaction: prefix sums that give each thread the output position of its flagged items.
#ifndef PACK_GLSL
#define PACK_GLSL

shared uint pack_sums[PACK_THREADS];

// Inclusive prefix sum over the workgroup's threads; `all` receives the total.
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

// Dispatch of the gather for these numbers of live caches and of VALs (or cluster nodes). At least one part, so that
// caches get written without light, too.
LiveArgs live_args(uint caches, uint lights, uint caches_per_group, uint split) {
    return LiveArgs((caches + caches_per_group - 1u) / caches_per_group, max((lights + split - 1u) / split, 1u), 1u, caches,
                    min(caches, DEPTH_IMAGE_ROW), (caches + DEPTH_IMAGE_ROW - 1u) / DEPTH_IMAGE_ROW, 1u);
}

#endif
