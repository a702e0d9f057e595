// Shows one layer of a picture in the window, in sRGB display colours.
#include "shared.glsl"
#include "lib/false_color.glsl"
#include "lib/tonemap.glsl"

layout(push_constant, scalar) uniform Push { LayerPush push; };
layout(binding = 0) uniform sampler2D image;
layout(binding = 1, scalar) readonly buffer Exposure { float ev; };
layout(binding = 2) uniform sampler2D second_image;
layout(binding = 3) uniform sampler2D third_image;

layout(location = 0) out vec4 out_color;

// Impossible radiance: NaN, infinite or negative; -0 is valid. Tested by bits: compilers may fold isnan to false.
bool broken(float v) {
    uint bits = floatBitsToUint(v);
    return bits >= 0x7f800000u && bits != 0x80000000u;
}

bool broken(vec3 v) {
    return broken(v.r) || broken(v.g) || broken(v.b);
}

float luminance_of(vec3 c) {
    return dot(c, vec3(0.2126, 0.7152, 0.0722));
}

void main() {
    vec2 from_corner = floor(gl_FragCoord.xy) - vec2(push.left, push.top) + 0.5;
    ivec2 texel = ivec2(push.first_column, push.first_row) + ivec2(from_corner * push.texels);
    vec3 part = texelFetch(image, texel, 0).rgb;
    vec3 c = part;
    bool is_broken = broken(part);
    if (push.parts > 1u) {
        part = texelFetch(second_image, texel, 0).rgb;
        c += part;
        is_broken = is_broken || broken(part);
    }
    if (push.parts > 2u) {
        part = texelFetch(third_image, texel, 0).rgb;
        c += part;
        is_broken = is_broken || broken(part);
    }
    float white = exp2(ev) * 1.2;
    if (push.how == LAYER_DIRECTION) {
        c = c * 0.5 + 0.5;
    } else if (push.how == LAYER_LUMINANCE) {
        c = false_color(decades(luminance_of(c), push.low, push.high));
    } else if (push.how == LAYER_DEPTH) {
        float distance = (push.depth.x + push.depth.y * c.r) / (push.depth.z + push.depth.w * c.r);
        // Pixels without a surface are black.
        c = c.r > 0.0 ? false_color(decades(distance, push.low, push.high)) : vec3(0.0);
    } else if (push.how == LAYER_BROKEN) {
        c = is_broken ? vec3(1.0, 0.0, 1.0) : srgb_from_linear(vec3(0.5 * luminance_of(tonemap(c / white, push.tonemap))));
    } else if (push.how == LAYER_RADIANCE) {
        c = srgb_from_linear(tonemap(c / white, push.tonemap));
    } else if (push.how == LAYER_REFLECTANCE) {
        c = srgb_from_linear(c);
    }
    out_color = vec4(c, 1.0);
}
