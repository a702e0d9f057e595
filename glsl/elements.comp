// Stage 5: the triangles that pixels show. Neighbours mostly show the same one, so a pixel speaks only where the ones to
// its left and above show another: of any set of pixels the leftmost of the topmost row does. METHOD 9.
#include "shared.glsl"

layout(local_size_x = 8, local_size_y = 8) in;
layout(constant_id = 0) const uint REFERENCES = 8;
layout(binding = 0) uniform usampler2D element_image;
layout(binding = 1, scalar) writeonly buffer Elements { uvec2 elements[]; };
layout(binding = 2, scalar) buffer Args { ElementArgs args; };

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    ivec2 size = textureSize(element_image, 0);
    if (any(greaterThanEqual(pixel, size))) {
        return;
    }
    uvec2 element = texelFetch(element_image, pixel, 0).xy;
    bool other_left = pixel.x == 0 || texelFetch(element_image, pixel - ivec2(1, 0), 0).xy != element;
    bool other_above = pixel.y == 0 || texelFetch(element_image, pixel - ivec2(0, 1), 0).xy != element;
    if (element.x == 0u || !other_left || !other_above) {
        return;
    }
    uint at = atomicAdd(args.vertex_count, 3u * REFERENCES) / (3u * REFERENCES);
    elements[at] = element;
    if (at % 64u == 0u) {
        atomicAdd(args.groups_x, 1u);
    }
}
