// Where a cache lies in the images of the fragment path: two neighbours to a texel, texels in blocks of 8 x 8, blocks row
// by row, so that neighbours share what the depth test skips as one, and hardly a texel is left over. CPUs draw in squares
// of 64 x 64 texels, one after the other on a thread: few blocks lie about the border of two. Twin: src/frame/targets.rs.
#ifndef ATLAS_GLSL
#define ATLAS_GLSL

// Texels to the left of the blocks; `columns` of them.
uint atlas_left(uint columns) {
    return columns <= 16u ? 64u - 8u * ((columns + 1u) / 2u) : 0u;
}

// Texel of a cache of the atlas; `columns` of blocks.
ivec2 atlas_texel(uint cache, uint columns) {
    uint texel = cache / TEXEL_CACHES;
    uint block = texel / 64u;
    return ivec2(atlas_left(columns) + block % columns * 8u + texel % 8u, block / columns * 8u + texel / 8u % 8u);
}

// First cache of a texel.
uint atlas_cache(ivec2 texel, uint columns) {
    uvec2 t = uvec2(texel.x - int(atlas_left(columns)), texel.y);
    return TEXEL_CACHES * ((t.y / 8u * columns + t.x / 8u) * 64u + t.y % 8u * 8u + t.x % 8u);
}

#endif
