// Stage 8: the averaged lights on a pixel's own surface. METHOD 5, thesis listing 5.2.
#include "shared.glsl"
#include "lib/form_factor.glsl"
#include "lib/phong.glsl"

layout(constant_id = 2) const uint PRINTED = 0;
layout(push_constant, scalar) uniform Push { DrawPush push; };
layout(binding = 4) uniform sampler2D normal_image;
layout(binding = 5) uniform sampler2D albedo_image;
#ifndef DIFFUSE_ONLY
layout(binding = 6) uniform sampler2D specular_image;
#endif

layout(location = 0) in vec3 position;
layout(location = 1) in vec3 diffuse_position;
layout(location = 2) in vec3 diffuse_irradiance;
layout(location = 3) in vec3 glossy_position;
layout(location = 4) in vec3 glossy_irradiance;

layout(location = 0) out vec4 out_diffuse;
#ifndef DIFFUSE_ONLY
layout(location = 1) out vec4 out_glossy;
#endif

// Irradiance of an averaged light through the surface, and the direction it comes from.
vec3 received(vec3 light, vec3 carried, vec3 n, out vec3 towards) {
    vec3 d = light - position;
    float d2 = max(dot(d, d), 1e-30);
    towards = d * inversesqrt(d2);
    // Rounding of the interpolation leaves -1e-13 where the vertices say 0.
    return max(carried, vec3(0.0)) * (max(dot(n, towards), 0.0) / (PRINTED != 0u ? d2 : 1.0));
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 normal_exponent = texelFetch(normal_image, pixel, 0);
    vec3 n = normal_exponent.xyz;
    vec3 towards;
    vec3 e = received(diffuse_position, diffuse_irradiance, n, towards);
    out_diffuse = vec4(texelFetch(albedo_image, pixel, 0).rgb / PI * e, 0.0);
#ifndef DIFFUSE_ONLY
    e = received(glossy_position, glossy_irradiance, n, towards);
    vec3 r = reflect(view_direction(push.eye, position), n);
    out_glossy = vec4(texelFetch(specular_image, pixel, 0).rgb * phong_lobe(normal_exponent.w, dot(r, towards)) * e, 0.0);
#endif
}
