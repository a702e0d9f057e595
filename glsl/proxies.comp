// Stage 6: sums become proxy lights. METHOD 4: one VAL alone is exact; nothing is divided by what can vanish.
#include "shared.glsl"
#include "lib/phong.glsl"

#ifdef FROM_IMAGES
#include "lib/atlas.glsl"
#endif

layout(local_size_x = 64) in;
layout(constant_id = 0) const uint GLOSSY = 1;
layout(constant_id = 1) const uint GROUP = 1; // caches that are live together
layout(constant_id = 2) const uint SPREAD = 0; // 1: stage 7 asks for it
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

// Least N.w of light. The weighted mean of points above the surface lies above it; lower it is the rounding of VALs in
// the cache's own plane, which send it nothing and must not move a proxy.
const float MIN_COSINE = 1e-4;

// Least sum of weights. Below lie the numbers that some devices flush to zero and others keep in few bits: the mean of
// such terms points anywhere.
const float MIN_WEIGHT = 1e-36;

#ifdef FROM_IMAGES
// The sums of a cache of the atlas.
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
void add(inout GatherSums s, GatherSums p) {
    s.diffuse_position += p.diffuse_position;
    s.diffuse_weight += p.diffuse_weight;
    s.diffuse_irradiance += p.diffuse_irradiance;
    s.distance2 += p.distance2;
    if (GLOSSY != 0u) {
        s.glossy_position += p.glossy_position;
        s.glossy_weight += p.glossy_weight;
        s.glossy_irradiance += p.glossy_irradiance;
        s.glossy_distance2 += p.glossy_distance2;
    }
}

// The sums of a live cache: its parts, in order.
GatherSums sums_of(uint slot) {
    GatherSums s = GatherSums(vec3(0.0), 0.0, vec3(0.0), 0.0, vec3(0.0), 0.0, vec3(0.0), 0.0);
#ifdef BOUNCES
    // What the caches send comes first, and is scaled as a whole.
    for (uint part = 0u; part < push.cache_parts; ++part) {
        add(s, parts[part * push.cache_count + slot]);
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
        add(s, parts[part * push.cache_count + slot]);
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
    Cache c = caches[i];
    GatherSums s = sums_of(slot);
    vec3 irradiance = s.diffuse_irradiance;

    Proxy p;
    p.diffuse_distance2 = 0.0;
    p.diffuse_position = c.position + c.normal;
    p.diffuse_irradiance = vec3(0.0);
    if (s.diffuse_weight > MIN_WEIGHT) {
        vec3 d = s.diffuse_position / s.diffuse_weight;
        float cosine = dot(c.normal, d) * inversesqrt(max(dot(d, d), 1e-30));
        if (cosine > MIN_COSINE) {
            p.diffuse_distance2 = s.distance2 / s.diffuse_weight;
            p.diffuse_position = c.position + d;
            p.diffuse_irradiance = irradiance / cosine;
        }
    }

    p.glossy_distance2 = 0.0;
    p.glossy_position = c.position + c.normal;
    p.glossy_irradiance = vec3(0.0);
    if (GLOSSY != 0u && s.glossy_weight > MIN_WEIGHT) {
        vec3 d = s.glossy_position / s.glossy_weight;
        vec3 w = d * inversesqrt(max(dot(d, d), 1e-30));
        vec3 mirrored = reflect(view_direction(push.eye, c.position), c.normal);
        float lobe = cosine_power(dot(mirrored, w), c.exponent);
        // The mean direction can miss the lobe that its parts lie in: what is divided by it never exceeds all the light
        // there is.
        vec3 seen = min(s.glossy_irradiance / max(lobe, 1e-30), irradiance);
        vec3 facing = mix(irradiance, seen, lobe > 0.0 ? 1.0 : 0.0);
        float cosine = dot(c.normal, w);
        if (cosine > MIN_COSINE) {
            p.glossy_distance2 = SPREAD != 0u ? max(s.glossy_distance2 / s.glossy_weight, 1e-30) : 1.0;
            p.glossy_position = c.position + d;
            p.glossy_irradiance = facing / cosine;
        }
    }
    proxies[i] = p;
}
