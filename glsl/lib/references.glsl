// The caches that a visible vertex or cell refers to. The including shader declares `REFERENCES`. Uses bindings 1 and
// 2.
#ifndef REFERENCES_GLSL
#define REFERENCES_GLSL

layout(binding = 1, scalar) readonly buffer Draws { DrawRecord draws[]; };
layout(binding = 2, scalar) readonly buffer References { uint references[]; }; // two 16-bit indices each

// Atlas index of reference `i` (of REFERENCES) of a vertex or cell; NO_REFERENCES if unused.
uint referred_cache(DrawRecord draw, uint vertex, uint i) {
    uint reference = vertex * REFERENCES + i;
    uint pair = references[draw.reference_base + reference / 2u];
    uint index = (reference & 1u) == 0u ? pair & 0xffffu : pair >> 16;
    return index == NO_CACHE ? NO_REFERENCES : draw.cache_base + index;
}

#endif
