// Stage 11: all radiance, exposed and tone-mapped. METHOD 1.
#include "shared.glsl"
#include "lib/tonemap.glsl"

layout(constant_id = 0) const uint DIFFUSE = 1;
layout(constant_id = 1) const uint GLOSSY = 1;
layout(push_constant, scalar) uniform Push { CompositePush push; };
layout(binding = 0) uniform sampler2D direct_image;
layout(binding = 1) uniform sampler2D diffuse_image;
layout(binding = 2) uniform sampler2D glossy_image;
layout(binding = 3) uniform sampler2D depth_image;
layout(binding = 4, scalar) readonly buffer Exposure { float ev; };

layout(location = 0) out vec4 out_color;

void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    if (push.replaced != 0u && texelFetch(depth_image, at, 0).r == 0.0) {
        out_color = push.behind;
        return;
    }
    vec3 c = texelFetch(direct_image, at, 0).rgb;
    if (DIFFUSE != 0u) {
        c += texelFetch(diffuse_image, at, 0).rgb;
    }
    if (GLOSSY != 0u) {
        c += texelFetch(glossy_image, at, 0).rgb;
    }
    out_color = vec4(tonemap(c * (exp2(-ev) / 1.2), push.tonemap), 1.0);
}
