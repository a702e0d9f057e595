// Cells of a model's surface: look up the references of a point. Twin: src/frame/cells.rs. If CELL_BINDINGS is defined,
// it is the first of two bindings that hold the cells.
#ifndef CELLS_GLSL
#define CELLS_GLSL

// Hash of a cell: where probing starts in a model's hash table.
uint cell_hash(uint xy, uint z) {
    uint h = (xy * 0x9e3779b1u) ^ (z * 0x85ebca77u);
    h = (h ^ (h >> 15)) * 0x2c1b3c6du;
    return h ^ (h >> 13);
}

#ifdef CELL_BINDINGS
layout(binding = CELL_BINDINGS, scalar) readonly buffer Grids { CellGrid grids[]; };
layout(binding = CELL_BINDINGS + 1, scalar) readonly buffer Entries { CellEntry entries[]; };

// Row of references for the cell that contains a point (relative to the model's centre); NO_REFERENCES if there is
// none.
uint row_at(CellGrid grid, vec3 offset) {
    vec3 place = (grid.cell_from_offset * vec4(offset, 1.0)).xyz;
    uvec3 cell = uvec3(clamp(floor(place), vec3(0.0), vec3(65535.0)));
    uint xy = cell.x | cell.y << 16;
    for (uint i = 0u; i <= grid.entry_mask; ++i) {
        CellEntry entry = entries[grid.first_entry + ((cell_hash(xy, cell.z) + i) & grid.entry_mask)];
        if (entry.row == NO_REFERENCES || (entry.xy == xy && entry.z == cell.z)) {
            return entry.row;
        }
    }
    return NO_REFERENCES;
}
#endif

#endif
