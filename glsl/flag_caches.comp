// Stage 5: flags every group of caches that a visible vertex or cell refers to. METHOD 9.
#extension GL_EXT_control_flow_attributes : require
#extension GL_KHR_memory_scope_semantics : require
#include "shared.glsl"

layout(local_size_x = 64) in;
layout(constant_id = 0) const uint REFERENCES = 8;
layout(constant_id = 1) const uint GROUP = 1; // caches per flag

layout(binding = 0, scalar) readonly buffer Visible { VisibleVertex visible[]; };

#include "lib/references.glsl"

layout(binding = 3, scalar) readonly buffer Args { VisibleArgs args; };
layout(binding = 4, scalar) buffer Flags { uint flags[]; };

void flag(uint cache_base, uint index) {
    if (index != NO_CACHE) {
        // Concurrent stores write the same value.
        atomicStore(flags[(cache_base + index) / GROUP], 1u, gl_ScopeDevice, 0, 0);
    }
}

void main() {
    uint at = gl_GlobalInvocationID.x;
    if (at >= args.count) {
        return;
    }
    VisibleVertex v = visible[at];
    DrawRecord draw = draws[v.draw];
    [[unroll]] for (uint i = 0u; i < REFERENCES / 2u; ++i) {
        uint pair = references[draw.reference_base + v.vertex * REFERENCES / 2u + i];
        flag(draw.cache_base, pair & 0xffffu);
        flag(draw.cache_base, pair >> 16);
    }
}
