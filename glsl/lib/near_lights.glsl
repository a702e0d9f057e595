// Reads the filtered results of short rays. The including shader defines NEAR_BINDING (two bindings from there on) and
// NEAR_CONSTANT (a specialization constant).
#ifndef NEAR_LIGHTS_GLSL
#define NEAR_LIGHTS_GLSL
#include "shared.glsl"

layout(constant_id = NEAR_CONSTANT) const uint NEAR_TEXELS = 0; // 1: results are read as texels
layout(binding = NEAR_BINDING, scalar) readonly buffer NearLights { NearLight near_lights[]; };
layout(binding = NEAR_BINDING + 1) uniform samplerBuffer near_light_texels;

NearLight near_light(uint at) {
    if (NEAR_TEXELS == 0u) {
        return near_lights[at];
    }
    int first = int(7u * at);
    vec4 a = texelFetch(near_light_texels, first);
    vec4 b = texelFetch(near_light_texels, first + 1);
    vec4 c = texelFetch(near_light_texels, first + 2);
    vec4 d = texelFetch(near_light_texels, first + 3);
    vec4 e = texelFetch(near_light_texels, first + 4);
    vec4 f = texelFetch(near_light_texels, first + 5);
    vec4 g = texelFetch(near_light_texels, first + 6);
    return NearLight(a.xyz, a.w, b.xyz, b.w, c.xyz, c.w, d.xyz, d.w, e.xy, e.z, e.w, f.xyz, vec3(f.w, g.xy),
                     g.z, g.w);
}

#endif
