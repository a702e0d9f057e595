// Two triangles over each listed tile of 8 x 8 pixels, one instance per tile.
#include "shared.glsl"

layout(binding = 8, scalar) readonly buffer Tiles {
    uint width; // of the picture [pixels]
    uint height;
    uint tiles[];
};

void main() {
    const uvec2 CORNERS[6] = uvec2[](uvec2(0, 0), uvec2(1, 0), uvec2(0, 1), uvec2(0, 1), uvec2(1, 0), uvec2(1, 1));
    uint tile = tiles[gl_InstanceIndex];
    vec2 size = vec2(width, height);
    vec2 at = min(vec2((uvec2(tile & 0xffffu, tile >> 16) + CORNERS[gl_VertexIndex]) * 8u), size);
    gl_Position = vec4(at / size * 2.0 - 1.0, 0.0, 1.0);
}
