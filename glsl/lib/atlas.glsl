// Position of a cache in the images of the fragment gather. A texel holds two consecutive caches, a block 8 x 8 texels,
// and blocks are stored row by row. So neighbours share the blocks that the depth test skips, and hardly any texel is
// unused. Software devices draw tiles of 64 x 64 texels, one per thread at a time; the left margin keeps few blocks on
// tile borders. Twin: src/frame/targets.rs.
#ifndef ATLAS_GLSL
#define ATLAS_GLSL

// Left margin before the blocks [texels]; `columns`: number of block columns.
uint atlas_left(uint columns) {
    return columns <= 16u ? 64u - 8u * ((columns + 1u) / 2u) : 0u;
}

// Texel of a cache of the atlas; `columns`: number of block columns.
ivec2 atlas_texel(uint cache, uint columns) {
    uint texel = cache / TEXEL_CACHES;
    uint block = texel / 64u;
    return ivec2(atlas_left(columns) + block % columns * 8u + texel % 8u, block / columns * 8u + texel / 8u % 8u);
}

// First cache stored in a texel.
uint atlas_cache(ivec2 texel, uint columns) {
    uvec2 t = uvec2(texel.x - int(atlas_left(columns)), texel.y);
    return TEXEL_CACHES * ((t.y / 8u * columns + t.x / 8u) * 64u + t.y % 8u * 8u + t.x % 8u);
}

#endif
