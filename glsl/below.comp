// Stage 10, first half: irradiance from below at each visible vertex of a filled body. METHOD 7, thesis (5.91) to
// (5.93).
#include "shared.glsl"

layout(local_size_x = 64) in;
layout(constant_id = 0) const uint REFERENCES = 8;
layout(binding = 0, scalar) readonly buffer Visible { VisibleVertex visible[]; };
#include "lib/dipole.glsl"
#include "lib/references.glsl"
layout(binding = 3, scalar) readonly buffer Args { VisibleArgs args; };
layout(binding = 4, scalar) readonly buffer Lights { VertexLight lights[]; };
layout(binding = 5, scalar) readonly buffer Caches { Cache caches[]; };
layout(binding = 6, scalar) readonly buffer Parts { uint parts[]; };
layout(binding = 7, scalar) readonly buffer FilledParts { Filled filled[]; };
layout(binding = 8, scalar) readonly buffer ProxyDipoles { ProxyDipole dipoles[]; };
layout(binding = 9, scalar) writeonly buffer Below { vec3 below[]; };

// Irradiance from below at a point of a filled part, from a vertex's references.
vec3 from_below(DrawRecord draw, uint vertex, uint part, vec3 position) {
    float d_max = 1e-15;
    for (uint i = 0u; i < REFERENCES; ++i) {
        uint cache = referred_cache(draw, vertex, i);
        if (cache != NO_REFERENCES) {
            d_max = max(d_max, distance(position, caches[cache].position));
        }
    }
    Filled f = filled[part];
    Dipoles mean = no_dipoles();
    vec3 scales = vec3(0.0);
    for (uint round = 0u; round < 2u; ++round) {
        if (round > 0u) {
            mean = mean_dipoles(f, mean);
        }
        for (uint i = 0u; i < REFERENCES; ++i) {
            uint cache = referred_cache(draw, vertex, i);
            if (cache == NO_REFERENCES || dipoles[cache].filled != part) {
                continue;
            }
            vec3 from = caches[cache].position - position;
            float w = dipole_weight(length(from), d_max);
            if (round == 0u) {
                take_dipole(mean, w, dipoles[cache], from);
            } else {
                scales += w * own_scale(f, mean, dipoles[cache]);
            }
        }
    }
    return irradiance_below(f, mean, scales);
}

void main() {
    uint at = gl_GlobalInvocationID.x;
    if (at >= args.count) {
        return;
    }
    VisibleVertex v = visible[at];
    uint part = parts[v.draw];
    below[at] = part == HOLLOW ? vec3(0.0) : from_below(draws[v.draw], v.vertex, part, lights[at].position);
}
