// A triangle over the whole target at half depth for a tile of VALs; nothing if the tile has no VALs.
#include "shared.glsl"

layout(push_constant, scalar) uniform Push { GatherPush push; };
layout(binding = 1, scalar) readonly buffer ValCount { uint val_count; };

void main() {
    vec2 corner = vec2(gl_VertexIndex == 1 ? 3.0 : -1.0, gl_VertexIndex == 2 ? 3.0 : -1.0);
    gl_Position = push.first < val_count ? vec4(corner, 0.5, 1.0) : vec4(2.0, 2.0, 2.0, 1.0);
}
