// Stage 2: the sky where no surface is.
#include "shared.glsl"

layout(push_constant, scalar) uniform Push { SkyPush push; };
layout(binding = 0) uniform sampler2D depth_image;
layout(binding = 1, scalar) readonly buffer Texels { vec3 texels[]; };

layout(location = 0) out vec4 out_radiance;

const float TAU = 6.28318530717959;

// Texel of the grid; it goes round, and on beyond a pole on the other side.
vec3 texel(int column, int row) {
    int width = int(push.width);
    int on = clamp(row, 0, int(push.height) - 1);
    column += on == row ? width : width + width / 2;
    return texels[on * width + column % width];
}

void main() {
    out_radiance = vec4(0.0);
    if (texelFetch(depth_image, ivec2(gl_FragCoord.xy), 0).r != 0.0) {
        return;
    }
    vec2 size = vec2(textureSize(depth_image, 0));
    // Depth 0 is infinitely far: a direction. Parallel views have one.
    vec3 far = (push.world_from_clip * vec4(gl_FragCoord.xy / size * 2.0 - 1.0, 0.0, 1.0)).xyz;
    vec3 d = normalize(push.eye.w == 0.0 ? -push.eye.xyz : far);
    // Straight up and down every longitude is right.
    float longitude = (d.xz == vec2(0.0) ? 0.0 : atan(d.x, -d.z)) + push.turn;
    vec2 at = vec2(fract(longitude / TAU + 0.5) * float(push.width), acos(clamp(d.y, -1.0, 1.0)) * 2.0 / TAU * float(push.height));
    at -= 0.5;
    vec2 f = fract(at);
    ivec2 corner = ivec2(floor(at));
    vec3 above = mix(texel(corner.x, corner.y), texel(corner.x + 1, corner.y), f.x);
    vec3 below = mix(texel(corner.x, corner.y + 1), texel(corner.x + 1, corner.y + 1), f.x);
    out_radiance = vec4(mix(above, below, f.y), 0.0);
}
