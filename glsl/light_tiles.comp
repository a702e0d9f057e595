// Stage 2, first: lists the tiles of 8 x 8 pixels that have a surface in any pixel. METHOD 14.
#include "shared.glsl"

layout(local_size_x = 8, local_size_y = 8) in;
layout(binding = 0) uniform sampler2D depth_image;
layout(binding = 1, scalar) buffer Work { LightWork work; };
layout(binding = 2, scalar) writeonly buffer Tiles { uint tiles[]; };
layout(binding = 3, scalar) writeonly buffer Firsts { float firsts[]; }; // first ray of each pixel

shared uint shows;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    bool is_inside = all(lessThan(pixel, textureSize(depth_image, 0)));
    if (gl_LocalInvocationIndex == 0u) {
        shows = 0u;
    }
    barrier();
    if (is_inside && texelFetch(depth_image, pixel, 0).r > 0.0) {
        atomicOr(shows, 1u);
    }
    barrier();
    if (gl_LocalInvocationIndex == 0u && shows != 0u) {
        uint at = atomicAdd(work.count, 1u);
        atomicMax(work.groups_y, at / WORK_ROW + 1u);
        tiles[at] = gl_WorkGroupID.x | gl_WorkGroupID.y << 16;
    }
    if (is_inside && shows == 0u) {
        firsts[pixel.y * textureSize(depth_image, 0).x + pixel.x] = FIRST_NOT; // no ray will be sent
    }
}
