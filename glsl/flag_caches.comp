// Stage 5, compute way: flags every cache, or group of them, that a visible element needs. METHOD 9.
#include "shared.glsl"

layout(local_size_x = 64) in;
layout(constant_id = 0) const uint REFERENCES = 8;
layout(constant_id = 1) const uint GROUP = 1; // caches that are live together

#include "lib/references.glsl"

layout(binding = 4, scalar) readonly buffer Args { ElementArgs args; };
layout(binding = 5, scalar) buffer Flags { uint flags[]; };

void main() {
    uint at = gl_GlobalInvocationID.x;
    if (at >= args.vertex_count / (3u * REFERENCES)) {
        return;
    }
    for (uint i = 0u; i < 3u * REFERENCES; ++i) {
        uint cache = needed_cache(elements[at], i);
        if (cache != NO_REFERENCES) {
            atomicOr(flags[cache / GROUP], 1u);
        }
    }
}
