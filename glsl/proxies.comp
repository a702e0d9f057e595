// Stage 6: turns sums into proxy lights, if the gather does not do so itself. METHOD 4.
// variant proxies_bounces.comp: BOUNCES (where caches light caches, too)
// variant proxies_images.comp: FROM_IMAGES (after the fragment path)
#include "shared.glsl"
#include "lib/proxy.glsl"

#ifdef FROM_IMAGES
#include "lib/atlas.glsl"
#endif

layout(local_size_x = 64) in;
layout(constant_id = 0) const uint GLOSSY = 1;
layout(constant_id = 1) const uint GROUP = 1; // caches per flag
layout(constant_id = 2) const uint SPREAD = 0; // 1: stage 7 needs the distances of glossy VALs
layout(push_constant, scalar) uniform Push { GatherPush push; };
layout(binding = 0, scalar) readonly buffer Caches { Cache caches[]; };
layout(binding = 1, scalar) writeonly buffer Proxies { Proxy proxies[]; };
#ifdef FROM_IMAGES
layout(binding = 2) uniform sampler2D first_diffuse_position;
layout(binding = 3) uniform sampler2D first_diffuse_irradiance;
layout(binding = 4) uniform sampler2D first_glossy_position;
layout(binding = 5) uniform sampler2D first_glossy_irradiance;
layout(binding = 6) uniform sampler2D second_diffuse_position;
layout(binding = 7) uniform sampler2D second_diffuse_irradiance;
layout(binding = 8) uniform sampler2D second_glossy_position;
layout(binding = 9) uniform sampler2D second_glossy_irradiance;
#else
layout(binding = 2, scalar) readonly buffer Live { uint live[]; };
layout(binding = 3, scalar) readonly buffer Args { LiveArgs args; };
layout(binding = 4, scalar) readonly buffer Parts { GatherSums parts[]; };
#ifdef BOUNCES
layout(binding = 5, scalar) readonly buffer Scales { float scales[]; };
#endif
#endif

#ifdef FROM_IMAGES
// Sums of a cache of the atlas.
GatherSums sums_of(uint cache) {
    ivec2 at = atlas_texel(cache, push.columns);
    bool first = cache % TEXEL_CACHES == 0u;
    vec4 position = first ? texelFetch(first_diffuse_position, at, 0) : texelFetch(second_diffuse_position, at, 0);
    vec4 irradiance = first ? texelFetch(first_diffuse_irradiance, at, 0) : texelFetch(second_diffuse_irradiance, at, 0);
    GatherSums s = GatherSums(position.xyz, position.w, irradiance.rgb, irradiance.w, vec3(0.0), 0.0, vec3(0.0), 0.0);
    if (GLOSSY != 0u) {
        position = first ? texelFetch(first_glossy_position, at, 0) : texelFetch(second_glossy_position, at, 0);
        irradiance = first ? texelFetch(first_glossy_irradiance, at, 0) : texelFetch(second_glossy_irradiance, at, 0);
        s.glossy_position = position.xyz;
        s.glossy_weight = position.w;
        s.glossy_irradiance = irradiance.rgb;
        s.glossy_distance2 = irradiance.w;
    }
    return s;
}
#else
// Sums of a live cache: its parts, in order.
GatherSums sums_of(uint slot) {
    GatherSums s = GatherSums(vec3(0.0), 0.0, vec3(0.0), 0.0, vec3(0.0), 0.0, vec3(0.0), 0.0);
#ifdef BOUNCES
    // Light from caches comes first and is scaled as a whole.
    for (uint part = 0u; part < push.cache_parts; ++part) {
        add_part(s, parts[part * push.cache_count + slot], GLOSSY != 0u);
    }
    float scale = scales[slot];
    s.diffuse_position *= scale;
    s.diffuse_weight *= scale;
    s.diffuse_irradiance *= scale;
    s.distance2 *= scale;
    s.glossy_position *= scale;
    s.glossy_weight *= scale;
    s.glossy_irradiance *= scale;
    s.glossy_distance2 *= scale;
#endif
    for (uint part = push.cache_parts; part < push.cache_parts + args.groups_y; ++part) {
        add_part(s, parts[part * push.cache_count + slot], GLOSSY != 0u);
    }
    return s;
}
#endif

void main() {
    uint slot = gl_GlobalInvocationID.x;
#ifdef FROM_IMAGES
    uint i = slot;
    if (slot >= push.cache_count) {
        return;
    }
#else
    if (slot >= args.cache_count * GROUP) {
        return;
    }
    uint i = live[slot / GROUP] * GROUP + slot % GROUP;
    if (i >= push.cache_count) {
        return;
    }
#endif
    proxies[push.first_proxy + i] = proxy_of(caches[i], sums_of(slot), push.eye, GLOSSY != 0u, SPREAD != 0u);
}
