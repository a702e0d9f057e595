// Stage 5: lists the vertices of visible triangles, each once. Neighbouring pixels mostly show the same triangle, so a
// pixel reports only if its left and upper neighbours show another one. In any set of pixels the leftmost of the top
// row does. METHOD 9.
#include "shared.glsl"

layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { VisiblePush push; };
layout(binding = 0) uniform usampler2D element_image;
layout(binding = 1, scalar) readonly buffer Draws { DrawRecord draws[]; };
layout(binding = 2, scalar) readonly buffer Indices { uint indices[]; };
layout(binding = 3, scalar) buffer Seen { uint seen[]; }; // per vertex of each instance: last frame that showed it
layout(binding = 4, scalar) writeonly buffer Slots { uint slots[]; }; // likewise: its index in the list
layout(binding = 5, scalar) writeonly buffer Visible { VisibleVertex visible[]; };
layout(binding = 6, scalar) buffer Args { VisibleArgs args; };

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, textureSize(element_image, 0)))) {
        return;
    }
    uvec2 element = texelFetch(element_image, pixel, 0).xy;
    bool other_left = pixel.x == 0 || texelFetch(element_image, pixel - ivec2(1, 0), 0).xy != element;
    bool other_above = pixel.y == 0 || texelFetch(element_image, pixel - ivec2(0, 1), 0).xy != element;
    if (element.x == 0u || !other_left || !other_above) {
        return;
    }
    DrawRecord draw = draws[element.x - 1u];
    if (draw.reference_base == NO_REFERENCES) {
        return;
    }
    for (uint i = 0u; i < 3u; ++i) {
        uint vertex = indices[draw.first_index + 3u * element.y + i];
        uint slot = draw.first_slot + vertex;
        if (atomicExchange(seen[slot], push.frame) == push.frame) {
            continue;
        }
        uint at = atomicAdd(args.count, 1u);
        slots[slot] = at;
        visible[at] = VisibleVertex(element.x - 1u, vertex);
        if (at % 64u == 0u) {
            atomicAdd(args.groups_x, 1u);
        }
    }
}
