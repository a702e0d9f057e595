// Caches of the surfaces that rays meet. Whoever includes this has lib/hit.glsl and the constants REFERENCES and BY_CELLS (1:
// references are those of cells). Bindings from REFERENCE_BINDINGS on are its own, four of them.
#ifndef HIT_CACHES_GLSL
#define HIT_CACHES_GLSL
layout(binding = REFERENCE_BINDINGS, scalar) readonly buffer References { uint references[]; }; // two 16-bit indices each
layout(binding = REFERENCE_BINDINGS + 1, scalar) readonly buffer Models { InstanceCaches instance_caches[]; };
#define CELL_BINDINGS REFERENCE_BINDINGS + 2
#include "lib/cells.glsl"

// Rows of references of a triangle's corners, or of the cell which a point of it lies in, three times; NO_REFERENCES where there is
// none.
uvec3 reference_rows(InstanceCaches model, uvec3 v, vec3 w) {
    if (BY_CELLS == 0u) {
        return v;
    }
    CellGrid grid = grids[model.grid];
    vec3 at = vec3(0.0);
    for (uint i = 0u; i < 3u; ++i) {
        at += w[i] * (corner_vector(model.first_rest + v[i], 0u) - grid.centre);
    }
    return uvec3(row_at(grid, at));
}

// The cache that a reference of a model is to; NO_REFERENCES where it is to none.
uint reference_at(InstanceCaches model, uint reference) {
    uint pair = references[model.reference_base + reference / 2u];
    uint index = (reference & 1u) == 0u ? pair & 0xffffu : pair >> 16;
    return index == NO_CACHE ? NO_REFERENCES : model.cache_base + index;
}

// The nearest cache of each corner of an instance's triangle, or that of the cell which a point of it lies in; NO_REFERENCES
// where there is none. Vertices are the mesh's.
uvec3 nearest_caches(uint instance, uvec3 v, vec3 w) {
    InstanceCaches model = instance_caches[instance];
    if (model.reference_base == NO_REFERENCES) {
        return uvec3(NO_REFERENCES);
    }
    uvec3 rows = reference_rows(model, v, w);
    uvec3 nearest = uvec3(NO_REFERENCES);
    for (uint i = 0u; i < 3u; ++i) {
        nearest[i] = rows[i] == NO_REFERENCES ? NO_REFERENCES : reference_at(model, rows[i] * REFERENCES);
    }
    return nearest;
}

#endif
