// Stage 10: adds the light that leaves filled bodies at each pixel to direct light. METHOD 7, thesis (5.87).
// variant scatter_cells.frag: BY_CELLS (at the level of pixels)
#include "shared.glsl"

layout(constant_id = 0) const uint REFERENCES = 8;
#ifdef BY_CELLS
const uint GLOSSY = 0u;
const uint PRINTED = 0u;
#endif
layout(push_constant, scalar) uniform Push { InterpolatePush push; };
#include "lib/here.glsl"
#include "lib/dipole.glsl"
#include "lib/phong.glsl"
#ifdef BY_CELLS
#include "lib/references.glsl"
layout(binding = 8, scalar) readonly buffer ProxyDipoles { ProxyDipole dipoles[]; };
#else
layout(binding = 1, scalar) readonly buffer Draws { DrawRecord draws[]; };
layout(binding = 4, scalar) readonly buffer Slots { uint slots[]; };
layout(binding = 5, scalar) readonly buffer Lights { VertexLight lights[]; };
layout(binding = 8, scalar) readonly buffer Below { vec3 below[]; }; // per vertex
#endif
layout(binding = 9) uniform sampler2D normal_image;
layout(binding = 10, scalar) readonly buffer Parts { uint parts[]; };
layout(binding = 11, scalar) readonly buffer FilledParts { Filled filled[]; };

layout(location = 0) out vec4 out_radiance;

#ifdef BY_CELLS
// Irradiance from below, from the caches of this pixel's cell.
vec3 from_below(DrawRecord draw, uint first_index, uint part, out vec3 position) {
    Point x = point_here(draw, first_index);
    position = x.position;
    Filled f = filled[part];
    uint row = row_here();
    Dipoles mean = no_dipoles();
    vec3 scales = vec3(0.0);
    for (uint round = 0u; round < 2u && row != NO_REFERENCES; ++round) {
        if (round > 0u) {
            mean = mean_dipoles(f, mean);
        }
        for (uint i = 0u; i < REFERENCES; ++i) {
            uint cache = referred_cache(draw, row, i);
            if (cache == NO_REFERENCES) {
                break;
            }
            if (dipoles[cache].filled != part) {
                continue;
            }
            vec3 from = caches[cache].position - x.position;
            float w = dipole_weight(length(from), x.d_max);
            if (round == 0u) {
                take_dipole(mean, w, dipoles[cache], from);
            } else {
                scales += w * own_scale(f, mean, dipoles[cache]);
            }
        }
    }
    return irradiance_below(f, mean, scales);
}
#else
// Irradiance from below, interpolated between the triangle's corners.
vec3 from_below(DrawRecord draw, uint first_index, uint part, out vec3 position) {
    uvec3 at = uvec3(slots[draw.first_slot + indices[first_index]], slots[draw.first_slot + indices[first_index + 1u]],
                     slots[draw.first_slot + indices[first_index + 2u]]);
    vec3 a = lights[at.x].position;
    vec3 b = lights[at.y].position;
    vec3 c = lights[at.z].position;
    vec3 w = weights_here(push.clip_from_world * vec4(a, 1.0), push.clip_from_world * vec4(b, 1.0),
                          push.clip_from_world * vec4(c, 1.0));
    position = w.x * a + w.y * b + w.z * c;
    return w.x * below[at.x] + w.y * below[at.y] + w.z * below[at.z];
}
#endif

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    out_radiance = vec4(0.0);
    uvec2 element = texelFetch(element_image, pixel, 0).xy;
    if (element.x == 0u) {
        return;
    }
    uint part = parts[element.x - 1u];
    DrawRecord draw = draws[element.x - 1u];
    if (part == HOLLOW || draw.reference_base == NO_REFERENCES) {
        return;
    }
    vec3 position;
    vec3 irradiance = from_below(draw, draw.first_index + 3u * element.y, part, position);
    vec3 n = texelFetch(normal_image, pixel, 0).xyz;
    float cosine = -dot(n, view_direction(push.eye, position));
    out_radiance = vec4(leaving(filled[part], cosine, max(irradiance, vec3(0.0))), 0.0);
}
