// Stage 6, fragment path: one tile of VALs onto every cache, added to float targets. METHOD 3-4, thesis listing 5.1.
// Positions are summed relative to the cache, so that the sums do not know how far the scene is from anywhere.
#include "shared.glsl"
#include "lib/form_factor.glsl"
#include "lib/phong.glsl"

layout(push_constant, scalar) uniform Push { GatherPush push; };
layout(binding = 0, scalar) readonly buffer Caches { Cache caches[]; };
layout(binding = 1, scalar) uniform Tile { Val vals[VAL_TILE]; };

layout(location = 0) out vec4 out_diffuse_position; // sum of w (x - c), sum of w
layout(location = 1) out vec4 out_diffuse_irradiance; // sum of phi G, sum of w (x - c)^2
#ifndef DIFFUSE_ONLY
layout(location = 2) out vec4 out_glossy_position; // the same times cos^k
layout(location = 3) out vec4 out_glossy_irradiance;
#endif

void main() {
    uint index = uint(gl_FragCoord.y) * ATLAS_WIDTH + uint(gl_FragCoord.x);
    vec4 diffuse_position = vec4(0.0);
    vec3 diffuse_irradiance = vec3(0.0);
    float distance2 = 0.0;
    vec4 glossy_position = vec4(0.0);
    vec3 glossy_irradiance = vec3(0.0);
    if (index < push.cache_count) {
        Cache c = caches[index];
        vec3 mirrored = reflect(view_direction(push.eye, c.position), c.normal);
        for (uint i = 0u; i < push.val_count; ++i) {
            Val v = vals[i];
            vec3 d = v.position - c.position;
            float g = disc_geometry_towards(d, v.normal, c.normal, v.area);
            float w = v.weight * g;
            diffuse_position += vec4(d, 1.0) * w;
            diffuse_irradiance += v.flux * g;
            distance2 += dot(d, d) * w;
#ifndef DIFFUSE_ONLY
            float lobe = cosine_power(dot(mirrored, d) * inversesqrt(max(dot(d, d), 1e-30)), c.exponent);
            glossy_position += vec4(d, 1.0) * (w * lobe);
            glossy_irradiance += v.flux * (g * lobe);
#endif
        }
    }
    out_diffuse_position = diffuse_position;
    out_diffuse_irradiance = vec4(diffuse_irradiance, distance2);
#ifndef DIFFUSE_ONLY
    out_glossy_position = glossy_position;
    out_glossy_irradiance = vec4(glossy_irradiance, 0.0);
#endif
}
