// One VAL onto one cache, added to its sums: the loop body of stage 6. METHOD 3-4, thesis listing 5.1.
// Positions are summed relative to the cache, so that the sums do not know how far the scene is from anywhere.
#ifndef GATHER_GLSL
#define GATHER_GLSL

#include "lib/phong.glsl"

// A cache as the loop needs it.
struct Receiver {
    vec3 position;
    vec3 normal;
    vec3 mirrored; // the view, about the normal
    float half_exponent;
};

Receiver receiver(Cache c, vec4 eye) {
    return Receiver(c.position, c.normal, reflect(view_direction(eye, c.position), c.normal), 0.5 * c.exponent);
}

GatherSums no_light() {
    return GatherSums(vec3(0.0), 0.0, vec3(0.0), 0.0, vec3(0.0), 0.0, vec3(0.0), 0.0);
}

// The VAL as three texels: position, area; normal, -; flux, weight. No square root, and one quotient for G and cos^2:
// with q = d^2 (A + pi d^2), G = |d|^2 cos cos / q and (R.d)^2 / d^2 = (R.d)^2 (A + pi d^2) / q. The bound keeps 0/0
// away where a cache lies on a VAL: both numerators are 0 there. It is on the whole of q because what devices flush to
// zero is the product of a small area and a small distance. `spread`: how far the glossy lobe's VALs are is asked, too.
void accumulate(inout GatherSums s, Receiver c, vec4 place, vec4 facing, vec4 light, bool glossy, bool spread) {
    vec3 d = place.xyz - c.position;
    float d2 = dot(d, d);
    float disc = place.w + 3.14159265358979 * d2;
    float inverse = 1.0 / max(d2 * disc, 1e-37);
    float g = max(-dot(facing.xyz, d), 0.0) * max(dot(c.normal, d), 0.0) * inverse;
    float w = light.w * g;
    s.diffuse_position += d * w;
    s.diffuse_weight += w;
    s.diffuse_irradiance += light.rgb * g;
    s.distance2 += d2 * w;
    if (glossy) {
        float along = max(dot(c.mirrored, d), 0.0);
        float power = c.half_exponent * log2(max(along * along * (disc * inverse), 1e-37));
        // Products with less are numbers that CPUs are slow with, and that nobody sees.
        float lobe = power > -110.0 ? exp2(power) : 0.0;
        w *= lobe;
        s.glossy_position += d * w;
        s.glossy_weight += w;
        s.glossy_irradiance += light.rgb * (g * lobe);
        if (spread) {
            s.glossy_distance2 += d2 * w;
        }
    }
}

#endif
