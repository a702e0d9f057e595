// Where a cell begins to look for its place in a model's hash table. Twin: src/frame/cells.rs.
#ifndef CELLS_GLSL
#define CELLS_GLSL

uint cell_hash(uint xy, uint z) {
    uint h = (xy * 0x9e3779b1u) ^ (z * 0x85ebca77u);
    h = (h ^ (h >> 15)) * 0x2c1b3c6du;
    return h ^ (h >> 13);
}

#endif
