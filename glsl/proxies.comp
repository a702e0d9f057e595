// Stage 6: sums become proxy lights. METHOD 4: one VAL alone is exact; nothing is divided by what can vanish.
#include "shared.glsl"
#include "lib/phong.glsl"

layout(local_size_x = 64) in;
layout(constant_id = 0) const uint GLOSSY = 1;
layout(push_constant, scalar) uniform Push { GatherPush push; };
layout(binding = 0, scalar) readonly buffer Caches { Cache caches[]; };
layout(binding = 1) uniform sampler2D diffuse_position_image;
layout(binding = 2) uniform sampler2D diffuse_irradiance_image;
layout(binding = 3) uniform sampler2D glossy_position_image;
layout(binding = 4) uniform sampler2D glossy_irradiance_image;
layout(binding = 5, scalar) writeonly buffer Proxies { Proxy proxies[]; };

// Least N.w of light. The weighted mean of points above the surface lies above it; lower it is the rounding of VALs in
// the cache's own plane, which send it nothing and must not move a proxy.
const float MIN_COSINE = 1e-4;

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= push.cache_count) {
        return;
    }
    Cache c = caches[i];
    ivec2 at = ivec2(i % ATLAS_WIDTH, i / ATLAS_WIDTH);
    vec4 position = texelFetch(diffuse_position_image, at, 0);
    vec4 sum = texelFetch(diffuse_irradiance_image, at, 0);
    vec3 irradiance = sum.rgb;

    Proxy p;
    p.diffuse_distance2 = 0.0;
    p.diffuse_position = c.position + c.normal;
    p.diffuse_irradiance = vec3(0.0);
    if (position.w > 0.0) {
        vec3 d = position.xyz / position.w;
        float cosine = dot(c.normal, d) * inversesqrt(max(dot(d, d), 1e-30));
        if (cosine > MIN_COSINE) {
            p.diffuse_distance2 = sum.w / position.w;
            p.diffuse_position = c.position + d;
            p.diffuse_irradiance = irradiance / cosine;
        }
    }

    p.glossy_lit = 0.0;
    p.glossy_position = c.position + c.normal;
    p.glossy_irradiance = vec3(0.0);
    if (GLOSSY != 0u) {
        vec4 glossy = texelFetch(glossy_position_image, at, 0);
        if (glossy.w > 0.0) {
            vec3 d = glossy.xyz / glossy.w;
            vec3 w = d * inversesqrt(max(dot(d, d), 1e-30));
            vec3 mirrored = reflect(view_direction(push.eye, c.position), c.normal);
            float lobe = cosine_power(dot(mirrored, w), c.exponent);
            vec3 arrived = texelFetch(glossy_irradiance_image, at, 0).rgb;
            // The mean direction can miss the lobe that its parts lie in: what is divided by it never exceeds all
            // the light there is.
            vec3 facing = mix(irradiance, min(arrived / max(lobe, 1e-30), irradiance), lobe > 0.0 ? 1.0 : 0.0);
            float cosine = dot(c.normal, w);
            if (cosine > MIN_COSINE) {
                p.glossy_lit = 1.0;
                p.glossy_position = c.position + d;
                p.glossy_irradiance = facing / cosine;
            }
        }
    }
    proxies[i] = p;
}
