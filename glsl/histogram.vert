// Stage 5, fragment path: draws a point of depth 1 at every flagged texel of the atlas. METHOD 9, thesis 6.1.3.
#include "shared.glsl"
#include "lib/atlas.glsl"

layout(push_constant, scalar) uniform Push { AtlasPush push; };
layout(binding = 0, scalar) readonly buffer Flags { uint flags[]; };

void main() {
    vec2 texel = vec2(atlas_texel(gl_VertexIndex * TEXEL_CACHES, push.columns)) - vec2(atlas_left(push.columns), 0.0);
    vec2 at = (texel + 0.5) / vec2(8u * push.columns, push.rows) * 2.0 - 1.0;
    gl_Position = flags[gl_VertexIndex] == 0u ? vec4(2.0, 2.0, 2.0, 1.0) : vec4(at, 1.0, 1.0);
    gl_PointSize = 1.0;
}
