// Reference for proxy dipoles: sums every inner VAL at every pixel of a filled body; added to direct light. METHOD 7,
// thesis (5.87).
#include "shared.glsl"
#include "lib/dipole.glsl"
#include "lib/phong.glsl"

layout(push_constant, scalar) uniform Push { InnerPush push; };
layout(binding = 0) uniform usampler2D element_image;
layout(binding = 1) uniform sampler2D depth_image;
layout(binding = 2) uniform sampler2D normal_image;
layout(binding = 3, scalar) readonly buffer Parts { uint parts[]; };
layout(binding = 4, scalar) readonly buffer FilledParts { Filled filled[]; };
layout(binding = 5, scalar) readonly buffer InnerVals { Val inner_vals[]; };
layout(binding = 6, scalar) readonly buffer InnerCount { uint inner_count; };

layout(location = 0) out vec4 out_radiance;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    out_radiance = vec4(0.0);
    uint element = texelFetch(element_image, pixel, 0).x;
    uint part = element > 0u ? parts[element - 1u] : HOLLOW;
    if (part == HOLLOW) {
        return;
    }
    vec2 size = vec2(textureSize(depth_image, 0));
    float depth = texelFetch(depth_image, pixel, 0).r;
    vec4 world = push.world_from_clip * vec4(gl_FragCoord.xy / size * 2.0 - 1.0, depth, 1.0);
    vec3 position = world.xyz / world.w;
    Filled f = filled[part];
    vec3 irradiance = vec3(0.0);
    uint end = min(inner_count, push.first + INNER_RUN);
    for (uint i = push.first; i < end; ++i) {
        Val val = inner_vals[i];
        if (val.kind == part) {
            vec3 d = val.position - position;
            irradiance += val.flux * diffuse_reflectance(f, vec3(dot(d, d)), vec3(widest_of(val.area)));
        }
    }
    float cosine = -dot(texelFetch(normal_image, pixel, 0).xyz, view_direction(push.eye, position));
    out_radiance = vec4(leaving(f, cosine, irradiance), 0.0);
}
