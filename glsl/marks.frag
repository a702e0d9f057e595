// Colours the marks of the window's debug views where nothing is in front of them.
#include "shared.glsl"
#include "lib/tonemap.glsl"

layout(push_constant, scalar) uniform Push { MarkPush push; };
layout(binding = 1) uniform sampler2D depth_image;
layout(binding = 2, scalar) readonly buffer Exposure { float ev; };

layout(location = 0) flat in vec3 color; // a display colour, or radiance
layout(location = 1) in vec2 at; // in a disc's radii from its centre, or in a line's lengths from its end

layout(location = 0) out vec4 out_color;

void main() {
    float depth = texelFetch(depth_image, ivec2(gl_FragCoord.xy) - ivec2(push.left, push.top), 0).r;
    // Keeps fragments slightly behind the surface: discs are flat, surfaces may be curved.
    if (dot(at, at) > 1.0 || gl_FragCoord.z < depth * 0.98) {
        discard;
    }
    vec3 shown = color;
    if (push.how == MARK_LIGHT) {
        shown = srgb_from_linear(tonemap(color / (exp2(ev) * 1.2), push.tonemap));
    } else if (push.how == MARK_RIMMED && dot(at, at) > 0.5) {
        shown = vec3(0.0);
    }
    out_color = vec4(shown, 1.0);
}
