// Arithmetic peak benchmark: independent chains x -> a x + b. Host: src/lab/bench/peak.rs.
#extension GL_EXT_control_flow_attributes : require
#include "shared.glsl"

layout(local_size_x = 64) in;
layout(binding = 0, scalar) writeonly buffer Results { float results[]; };

// Every chain tends to 1 but is still far from it after all steps, so that skipped steps would show in the result.
const float STEP = 1.0 / 4096.0;

void main() {
    uint at = gl_GlobalInvocationID.x;
    vec4 x = float(at % 8u) + vec4(100.0, 101.0, 102.0, 103.0);
    vec4 y = x + 4.0;
    vec4 z = x + 8.0;
    // Unrolled: lavapipe keeps loop variables in memory between rounds.
    for (uint i = 0u; i < PEAK_STEPS / 32u; ++i) {
        [[unroll]] for (uint j = 0u; j < 32u; ++j) {
            x = fma(x, vec4(1.0 - STEP), vec4(STEP));
            y = fma(y, vec4(1.0 - STEP), vec4(STEP));
            z = fma(z, vec4(1.0 - STEP), vec4(STEP));
        }
    }
    vec4 sum = x + y + z;
    results[at] = sum.x + sum.y + sum.z + sum.w;
}
