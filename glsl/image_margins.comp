// Stage 6, after trace_images.comp: moves the planes of traced depth images back by a margin. Around an edge of a body,
// and where a surface curves away, points of a texel lie behind its plane: the margin reaches half as far as what the
// four neighbours show. One workgroup per image. METHOD 11. Twin: src/reference/depth_image.rs.
#include "shared.glsl"
#include "lib/depth_image.glsl"

layout(local_size_x = 64) in;
layout(binding = 0, scalar) readonly buffer Caches { Cache caches[]; };
layout(binding = 1, scalar) readonly buffer Live { uint live[]; };
layout(binding = 2, scalar) readonly buffer Args { LiveArgs args; };
layout(binding = 3, scalar) buffer Images { uvec2 images[]; };

// How far behind its plane points are still visible at least, as a share of their distance: surfaces are not flat.
const float LEAST = 0.01;

// Share of the distance by which a neighbour may lie behind a texel's plane to belong to the same surface.
const float SAME_SURFACE = 0.3;

const int SIDE = int(DEPTH_IMAGE_SIDE);

// Reciprocal lengths of the rays [1/m]; 0 without a hit.
shared float closeness[DEPTH_IMAGE_TEXELS];

void main() {
    uint slot = gl_WorkGroupID.y * DEPTH_IMAGE_ROW + gl_WorkGroupID.x;
    if (slot >= args.cache_count) {
        return;
    }
    vec3 normal = caches[live[slot]].normal;
    vec3 tangent, bitangent;
    tangents(normal, tangent, bitangent);
    uint first = slot * DEPTH_IMAGE_TEXELS;
    for (uint texel = gl_LocalInvocationID.x; texel < DEPTH_IMAGE_TEXELS; texel += gl_WorkGroupSize.x) {
        closeness[texel] = reaches(images[first + texel], texel_direction(texel, tangent, bitangent, normal));
    }
    barrier();
    for (uint texel = gl_LocalInvocationID.x; texel < DEPTH_IMAGE_TEXELS; texel += gl_WorkGroupSize.x) {
        uvec2 plane = images[first + texel];
        if (plane == NO_PLANE) {
            continue;
        }
        ivec2 at = ivec2(texel % DEPTH_IMAGE_SIDE, texel / DEPTH_IMAGE_SIDE);
        float behind = 0.0;
        for (int i = 0; i < 4; ++i) {
            ivec2 place = at + (i < 2 ? ivec2(2 * i - 1, 0) : ivec2(0, 2 * i - 5));
            int other = place.y * SIDE + place.x;
            bool is_inside = all(greaterThanEqual(place, ivec2(0))) && all(lessThan(place, ivec2(SIDE)));
            if (is_inside && closeness[other] > 0.0) {
                vec3 direction = texel_direction(uint(other), tangent, bitangent, normal);
                float beyond = reaches(plane, direction) / closeness[other] - 1.0;
                behind = beyond < SAME_SURFACE ? max(behind, beyond) : behind;
            }
        }
        images[first + texel].y = floatBitsToUint(uintBitsToFloat(plane.y) / (1.0 + LEAST + 0.5 * behind));
    }
}
