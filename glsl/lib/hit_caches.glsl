// Caches of surfaces that rays hit. The including shader has lib/hit.glsl, the constants REFERENCES and BY_CELLS (1:
// references are stored per cell), and the buffer `caches`. Uses five bindings from REFERENCE_BINDINGS on.
#ifndef HIT_CACHES_GLSL
#define HIT_CACHES_GLSL
layout(binding = REFERENCE_BINDINGS, scalar) readonly buffer References { uint references[]; }; // two 16-bit indices each
layout(binding = REFERENCE_BINDINGS + 1, scalar) readonly buffer Models { InstanceCaches instance_caches[]; };
#define CELL_BINDINGS REFERENCE_BINDINGS + 2
layout(binding = REFERENCE_BINDINGS + 4) uniform samplerBuffer cache_texels; // `caches` again
#include "lib/cells.glsl"
#include "lib/interpolation.glsl"

// Rows of references of a triangle's corners, the nearest first. By cells, the row of the cell that contains the point,
// three times; NO_REFERENCES if there is none.
uvec3 reference_rows(InstanceCaches model, uvec3 v, vec3 w) {
    if (BY_CELLS == 0u) {
        return w.x >= max(w.y, w.z) ? v : w.y >= w.z ? v.yzx : v.zxy;
    }
    CellGrid grid = grids[model.grid];
    vec3 at = vec3(0.0);
    for (uint i = 0u; i < 3u; ++i) {
        at += w[i] * (corner_vector(model.first_rest + v[i], 0u) - grid.centre);
    }
    return uvec3(row_at(grid, at));
}

// Atlas index of the cache that a model's reference names; NO_REFERENCES if unused.
uint reference_at(InstanceCaches model, uint reference) {
    uint pair = references[model.reference_base + reference / 2u];
    uint index = (reference & 1u) == 0u ? pair & 0xffffu : pair >> 16;
    return index == NO_CACHE ? NO_REFERENCES : model.cache_base + index;
}

// Weight of a cache at a point with this unit normal; 0 if it faces away.
float cache_weight(uint cache, vec3 position, vec3 normal, float reach) {
    // A `Cache` is four texels; the first holds its position, the second its normal.
    bool texels = AS_TEXELS != 0u;
    vec3 at = texels ? texelFetch(cache_texels, int(4u * cache)).xyz : caches[cache].position;
    vec3 facing = texels ? texelFetch(cache_texels, int(4u * cache + 1u)).xyz : caches[cache].normal;
    // On surfaces that have stretched, even the nearest cache may be beyond `reach`.
    return facing_weight(min(distance(at, position), 0.99 * reach), reach, dot(facing, normal));
}

// Whether a cache is already among the three weighted ones.
bool is_among(uint cache, uvec3 best, vec3 weights) {
    bvec3 same = equal(uvec3(cache), best);
    return (same.x && weights.x > 0.0) || (same.y && weights.y > 0.0) || (same.z && weights.z > 0.0);
}

// The three caches of largest weight at a point on an instance's triangle, among the references of its corners or cell,
// and their weights, which sum to 1. Missing caches are NO_REFERENCES. `v`: vertices within the mesh; `w`: barycentric
// weights; `corners`: 3 for the references of all corners, 1 for those of the nearest.
uvec3 caches_about(uint instance, uvec3 v, vec3 w, uint corners, vec3 position, vec3 normal, float reach, out vec3 weights) {
    InstanceCaches model = instance_caches[instance];
    uvec3 best = uvec3(NO_REFERENCES);
    weights = vec3(0.0);
    if (model.reference_base == NO_REFERENCES) {
        return best;
    }
    uvec3 rows = reference_rows(model, v, w);
    for (uint row = 0u; row < (BY_CELLS == 0u ? corners : 1u) && rows[row] != NO_REFERENCES; ++row) {
        for (uint i = 0u; i < REFERENCES; ++i) {
            uint cache = reference_at(model, rows[row] * REFERENCES + i);
            if (cache == NO_REFERENCES) {
                break;
            }
            float weight = cache_weight(cache, position, normal, reach);
            best.x = best.x == NO_REFERENCES ? cache : best.x; // fallback if none faces the same way
            if (weight > weights.z && !is_among(cache, best, weights)) {
                bool first = weight > weights.x;
                bool second = weight > weights.y;
                best = uvec3(first ? cache : best.x, first ? best.x : second ? cache : best.y, second ? best.y : cache);
                weights = vec3(first ? weight : weights.x, first ? weights.x : second ? weight : weights.y, second ? weights.y : weight);
            }
        }
    }
    float sum = weights.x + weights.y + weights.z;
    weights = sum > 0.0 ? weights / sum : vec3(1.0, 0.0, 0.0);
    return best;
}

// Weights of the caches that a point sees, which sum to 1; with `first`, of the one of largest weight. Both ends of the
// way are lifted [m], so that small bends of one surface hide nothing. A point that sees no cache keeps the first: most
// likely its own surface bends between them.
vec3 seen_weights(uvec3 about, vec3 weights, vec3 position, vec3 geometric, float lift, uint root, bool first) {
    vec3 start = position + lift * geometric;
    vec3 seen = vec3(0.0);
    for (uint i = 0u; i < 3u && weights[i] > 0.0; ++i) {
        Cache cache = caches[about[i]];
        vec3 way = cache.position + lift * cache.normal - start;
        if (trace(start, way, 0.0, 1.0, root, 0u, true).triangle == NO_HIT) {
            seen[i] = weights[i];
            if (first) {
                break;
            }
        }
    }
    float sum = seen.x + seen.y + seen.z;
    return sum > 0.0 ? seen / sum : vec3(1.0, 0.0, 0.0);
}

#endif
