// The caches that a visible element needs: those of all its corners. Includer declares `REFERENCES`, and
// leaves bindings 0 to 3 to this.
#ifndef REFERENCES_GLSL
#define REFERENCES_GLSL

layout(binding = 0, scalar) readonly buffer Elements { uvec2 elements[]; };
layout(binding = 1, scalar) readonly buffer Draws { DrawRecord draws[]; };
layout(binding = 2, scalar) readonly buffer Indices { uint indices[]; };
layout(binding = 3, scalar) readonly buffer References { uint references[]; }; // two 16-bit indices each

// Atlas index of reference `i`, of 3 * REFERENCES, of an element; NO_REFERENCES where there is none.
uint needed_cache(uvec2 element, uint i) {
    DrawRecord draw = draws[element.x - 1u];
    if (draw.reference_base == NO_REFERENCES) {
        return NO_REFERENCES;
    }
    uint vertex = indices[draw.first_index + 3u * element.y + i / REFERENCES];
    uint reference = vertex * REFERENCES + i % REFERENCES;
    uint pair = references[draw.reference_base + reference / 2u];
    uint index = (reference & 1u) == 0u ? pair & 0xffffu : pair >> 16;
    return index == NO_CACHE ? NO_REFERENCES : draw.cache_base + index;
}

#endif
