// Stage 5, compute way: flags every cache, or group of them, that a visible vertex refers to. METHOD 9.
#include "shared.glsl"

layout(local_size_x = 64) in;
layout(constant_id = 0) const uint REFERENCES = 8;
layout(constant_id = 1) const uint GROUP = 1; // caches that are live together

layout(binding = 0, scalar) readonly buffer Visible { VisibleVertex visible[]; };

#include "lib/references.glsl"

layout(binding = 3, scalar) readonly buffer Args { VisibleArgs args; };
layout(binding = 4, scalar) buffer Flags { uint flags[]; };

void main() {
    uint at = gl_GlobalInvocationID.x;
    if (at >= args.reference_count / REFERENCES) {
        return;
    }
    VisibleVertex v = visible[at];
    DrawRecord draw = draws[v.draw];
    for (uint i = 0u; i < REFERENCES; ++i) {
        uint cache = referred_cache(draw, v.vertex, i);
        if (cache != NO_REFERENCES) {
            atomicOr(flags[cache / GROUP], 1u);
        }
    }
}
