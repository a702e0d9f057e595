// Stage 2: shows the sky at pixels without a surface.
#include "shared.glsl"

layout(push_constant, scalar) uniform Push { SkyPush push; };
layout(binding = 0) uniform sampler2D depth_image;
#define SKY_BINDING 1
#include "lib/sky_grid.glsl"

layout(location = 0) out vec4 out_radiance;

void main() {
    out_radiance = vec4(0.0);
    if (texelFetch(depth_image, ivec2(gl_FragCoord.xy), 0).r != 0.0) {
        return;
    }
    vec2 size = vec2(textureSize(depth_image, 0));
    // Depth 0 is infinitely far: a direction. Parallel views have a single direction.
    vec3 far = (push.world_from_clip * vec4(gl_FragCoord.xy / size * 2.0 - 1.0, 0.0, 1.0)).xyz;
    vec3 d = normalize(push.eye.w == 0.0 ? -push.eye.xyz : far);
    out_radiance = vec4(sky_value(SkyLevel(0u, push.width, push.height, push.turn), d), 0.0);
}
