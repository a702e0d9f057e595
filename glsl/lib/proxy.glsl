// Turns gather sums into proxy lights. METHOD 4: exact for a single VAL; no division by a value that can vanish.
#ifndef PROXY_GLSL
#define PROXY_GLSL

#include "lib/phong.glsl"

// Lower bound of N.w for light. The weighted mean of points above the surface lies above it, too. Smaller values are
// rounding errors of VALs in the cache's own plane, which give no light and must not move a proxy.
const float MIN_COSINE = 1e-4;

// Lower bound of the sum of weights. Smaller sums may be denormal, which some devices flush to zero and others keep
// with few bits, so that their mean direction would be arbitrary.
const float MIN_WEIGHT = 1e-36;

// Adds the sums of one part of the VALs.
void add_part(inout GatherSums s, GatherSums p, bool glossy) {
    s.diffuse_position += p.diffuse_position;
    s.diffuse_weight += p.diffuse_weight;
    s.diffuse_irradiance += p.diffuse_irradiance;
    s.distance2 += p.distance2;
    if (glossy) {
        s.glossy_position += p.glossy_position;
        s.glossy_weight += p.glossy_weight;
        s.glossy_irradiance += p.glossy_irradiance;
        s.glossy_distance2 += p.glossy_distance2;
    }
}

// Both proxy lights of a cache; `spread`: stage 7 needs the distance of the glossy lobe's VALs.
Proxy proxy_of(Cache c, GatherSums s, vec4 eye, bool glossy, bool spread) {
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
    if (glossy && s.glossy_weight > MIN_WEIGHT) {
        vec3 d = s.glossy_position / s.glossy_weight;
        vec3 w = d * inversesqrt(max(dot(d, d), 1e-30));
        vec3 mirrored = reflect(view_direction(eye, c.position), c.normal);
        float lobe = cosine_power(dot(mirrored, w), c.exponent);
        // The mean direction can miss the lobe that its parts lie in: the quotient is limited to the total light.
        vec3 seen = min(s.glossy_irradiance / max(lobe, 1e-30), irradiance);
        vec3 facing = mix(irradiance, seen, lobe > 0.0 ? 1.0 : 0.0);
        float cosine = dot(c.normal, w);
        if (cosine > MIN_COSINE) {
            p.glossy_distance2 = spread ? max(s.glossy_distance2 / s.glossy_weight, 1e-30) : 1.0;
            p.glossy_position = c.position + d;
            p.glossy_irradiance = facing / cosine;
        }
    }
    return p;
}

#endif
