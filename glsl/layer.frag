// One layer of a picture, as a window shows it: colours of the display, sRGB.
#include "shared.glsl"
#include "lib/tonemap.glsl"

layout(push_constant, scalar) uniform Push { LayerPush push; };
layout(binding = 0) uniform sampler2D image;
layout(binding = 1, scalar) readonly buffer Exposure { float ev; };

layout(location = 0) out vec4 out_color;

void main() {
    vec3 c = texelFetch(image, ivec2(gl_FragCoord.xy) - ivec2(push.left, push.top), 0).rgb;
    if (push.how == LAYER_DIRECTION) {
        out_color = vec4(c * 0.5 + 0.5, 1.0);
        return;
    }
    if (push.how == LAYER_RADIANCE) {
        c = tonemap(c * (exp2(-ev) / 1.2), push.tonemap);
    }
    c = clamp(c, 0.0, 1.0);
    out_color = vec4(mix(12.92 * c, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, greaterThan(c, vec3(0.0031308))), 1.0);
}
