// See discs.vert.
#include "shared.glsl"

layout(push_constant, scalar) uniform Push { DiscPush push; };
layout(binding = 1) uniform sampler2D depth_image;

layout(location = 0) flat in vec3 color;

layout(location = 0) out vec4 out_color;

void main() {
    float depth = texelFetch(depth_image, ivec2(gl_FragCoord.xy) - ivec2(push.left, push.top), 0).r;
    // Keeps fragments slightly behind the surface: discs are flat, surfaces may be curved.
    if (gl_FragCoord.z < depth * 0.98) {
        discard;
    }
    out_color = vec4(color, 1.0);
}
