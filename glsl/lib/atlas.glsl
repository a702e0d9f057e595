// Where a cache lies in the images of the fragment path. Neighbours share blocks of 8 x 8 texels, which the depth test
// skips as one; the blocks follow each other at 64 texels, so that few caches still fill many of llvmpipe's bins.
#ifndef ATLAS_GLSL
#define ATLAS_GLSL

// Texel of a cache of the atlas.
ivec2 atlas_texel(uint cache) {
    uint block = cache / 64u;
    uint column = block % 128u;
    uint x = (column % 16u) * 64u + column / 16u * 8u + cache % 8u;
    uint y = block / 128u * 8u + cache / 8u % 8u;
    return ivec2(x, y);
}

// Cache of a texel.
uint atlas_cache(ivec2 texel) {
    uint x = uint(texel.x);
    uint column = x / 64u + x % 64u / 8u * 16u;
    uint block = uint(texel.y) / 8u * 128u + column;
    return block * 64u + uint(texel.y) % 8u * 8u + x % 8u;
}

#endif
