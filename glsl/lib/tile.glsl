// Order of threads in a tile of 8 x 8. Software devices run eight consecutive threads together; here these cover 4 x 2
// pixels instead of a row, so that their rays take similar ways.
#ifndef TILE_GLSL
#define TILE_GLSL

// Place of a thread in its tile.
uvec2 place_in_tile(uint thread) {
    uint x = (thread & 3u) | (thread >> 1 & 4u);
    uint y = (thread >> 2 & 1u) | (thread >> 3 & 6u);
    return uvec2(x, y);
}

#endif
