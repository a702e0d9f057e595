// The thesis's ground truth: sums one tile of VALs at every pixel, without caches or interpolation. METHOD 3.
// variant brute_force_diffuse.frag: DIFFUSE_ONLY (where nothing in the scene is glossy)
#include "shared.glsl"
#include "lib/form_factor.glsl"
#include "lib/brdf.glsl"

layout(push_constant, scalar) uniform Push { ScreenPush push; };
layout(binding = 0, scalar) uniform Tile { Val vals[VAL_TILE]; };
layout(binding = 1, scalar) readonly buffer ValCount { uint val_count; };
layout(binding = 2) uniform sampler2D depth_image;
layout(binding = 3) uniform sampler2D normal_image;
layout(binding = 4) uniform sampler2D albedo_image;
#ifndef DIFFUSE_ONLY
layout(binding = 5) uniform sampler2D specular_image;
#endif

layout(location = 0) out vec4 out_diffuse;
#ifndef DIFFUSE_ONLY
layout(location = 1) out vec4 out_glossy;
#endif

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    float depth = texelFetch(depth_image, pixel, 0).r;
    out_diffuse = vec4(0.0);
#ifndef DIFFUSE_ONLY
    out_glossy = vec4(0.0);
#endif
    if (depth <= 0.0) {
        return;
    }
    vec2 size = vec2(textureSize(depth_image, 0));
    vec4 world = push.world_from_clip * vec4(gl_FragCoord.xy / size * 2.0 - 1.0, depth, 1.0);
    vec3 position = world.xyz / world.w;
    vec4 normal_coded = texelFetch(normal_image, pixel, 0);
    vec3 n = normal_coded.xyz;
    vec3 looking = view_direction(push.eye, position);
    vec3 r = reflect(looking, n);
#ifndef DIFFUSE_ONLY
    vec3 specular = texelFetch(specular_image, pixel, 0).rgb;
    PhongLobe fitted = fitted_lobe(specular, normal_coded.w, -dot(n, looking));
#endif
    vec3 irradiance = vec3(0.0);
    vec3 glossy = vec3(0.0);
    uint end = min(VAL_TILE, max(val_count, push.first_val) - push.first_val);
    for (uint i = 0u; i < end; ++i) {
        Val v = vals[i];
        vec3 d = v.position - position;
        float g = val_geometry_towards(d, v.normal, n, v.area);
        irradiance += v.flux * g;
#ifndef DIFFUSE_ONLY
        glossy += v.flux * (g * cosine_power(dot(r, d) * inversesqrt(max(dot(d, d), 1e-30)), fitted.exponent));
#endif
    }
    out_diffuse = vec4(texelFetch(albedo_image, pixel, 0).rgb / PI * irradiance, 0.0);
#ifndef DIFFUSE_ONLY
    out_glossy = vec4(fitted.albedo * (fitted.exponent + 2.0) / (2.0 * PI) * glossy, 0.0);
#endif
}
