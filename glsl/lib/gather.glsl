// Inner loop of stage 6: adds the light of VALs to a cache's sums. METHOD 3-4, thesis listing 5.1.
// Positions are summed relative to the cache, so that precision does not depend on the scene's distance from the
// origin.
// The including shader defines the constants GLOSSY, SPREAD (the glossy lobe also needs its VALs' distances) and
// BY_HAND (the device is a CPU), 0 or 1. With TWO_EYES the glossy lobe is summed for two views that share everything
// else.
#ifndef GATHER_GLSL
#define GATHER_GLSL

#include "lib/phong.glsl"
#include "lib/power.glsl"

// A cache as the loop reads it.
struct Receiver {
    vec3 position;
    vec3 against; // negated normal
    vec3 mirrored; // view direction reflected about the normal
    float half_exponent;
#ifdef TWO_EYES
    vec3 second_mirrored;
#endif
};

#ifdef TWO_EYES
Receiver receiver(Cache c, vec4 eye, vec4 second_eye) {
    return Receiver(c.position, -c.normal, reflect(view_direction(eye, c.position), c.normal), 0.5 * c.exponent,
                    reflect(view_direction(second_eye, c.position), c.normal));
}
#else
Receiver receiver(Cache c, vec4 eye) {
    return Receiver(c.position, -c.normal, reflect(view_direction(eye, c.position), c.normal), 0.5 * c.exponent);
}
#endif

GatherSums no_light() {
    return GatherSums(vec3(0.0), 0.0, vec3(0.0), 0.0, vec3(0.0), 0.0, vec3(0.0), 0.0);
}

// VALs per round of the loop: each step processes all of them before the next. A CPU can thus work on another VAL while
// it waits for a result, and sums stay in registers longer.
const uint AT_ONCE = 4u;

// Four VALs, one component per vector.
struct FourVals {
    vec4 x;
    vec4 y;
    vec4 z;
    vec4 area;
    vec4 normal_x;
    vec4 normal_y;
    vec4 normal_z;
    vec4 weight;
    vec4 lobe; // shape of its lobe, lib/val_lobe.glsl
    vec3 flux[AT_ONCE];
};

// Inserts a VAL from three texels: (position, area), (normal, lobe), (flux, weight).
void put(inout FourVals v, uint i, vec4 place, vec4 facing, vec4 light) {
    v.x[i] = place.x;
    v.y[i] = place.y;
    v.z[i] = place.z;
    v.area[i] = place.w;
    v.normal_x[i] = facing.x;
    v.normal_y[i] = facing.y;
    v.normal_z[i] = facing.z;
    v.weight[i] = light.w;
    v.lobe[i] = facing.w;
    v.flux[i] = light.rgb;
}

// cos^k between the mirrored view and the direction to each VAL.
vec4 lobe_of(vec3 mirrored, vec4 x, vec4 y, vec4 z, vec4 d2, float half_exponent) {
    vec4 along = max(mirrored.x * x + mirrored.y * y + mirrored.z * z, 0.0);
    return power_of(along * along, d2, half_exponent, BY_HAND != 0u);
}

// Irradiance at a cache per flux of VALs [1/m^2], by their vectors from the cache. No square root: with
// q = d^2 max(A, pi d^2), G = |d|^2 cos cos / q, and the lobe's cos^2 = (R.d)^2 / d^2. The lower bound avoids 0/0 for a
// cache on a VAL, where the numerator is 0. It applies to all of q because devices may flush the product of a small area
// and a small distance to zero.
vec4 form_factors(Receiver c, FourVals v, vec4 x, vec4 y, vec4 z, vec4 d2) {
    vec4 q = max(d2 * max(v.area, 3.14159265358979 * d2), 1e-37);
    // Both cosines are negative for VALs that light the cache.
    vec4 at_val = min(v.normal_x * x + v.normal_y * y + v.normal_z * z, 0.0);
    vec4 at_cache = min(c.against.x * x + c.against.y * y + c.against.z * z, 0.0);
    return at_val * at_cache / q;
}

// Adds four VALs. The lobe is computed first, so that the sums fill its latency. `seen`: 1, or 0 if occluded. `far`: 1, or
// less if the diffuse lobe leaves a VAL to short rays.
void accumulate(inout GatherSums s,
#ifdef TWO_EYES
                inout GlossySums second,
#endif
                Receiver c, FourVals v, vec4 seen, vec4 far) {
    vec4 x = v.x - c.position.x;
    vec4 y = v.y - c.position.y;
    vec4 z = v.z - c.position.z;
    vec4 d2 = x * x + y * y + z * z;
    vec4 g = form_factors(c, v, x, y, z, d2) * seen;
    vec4 w = v.weight * g;
    vec4 diffuse_g = g * far;
    vec4 diffuse_w = w * far;
    vec4 lobe = vec4(0.0);
    if (GLOSSY != 0u) {
        lobe = lobe_of(c.mirrored, x, y, z, d2, c.half_exponent);
    }
#ifdef TWO_EYES
    vec4 second_lobe = lobe_of(c.second_mirrored, x, y, z, d2, c.half_exponent);
#endif
    [[unroll]] for (uint i = 0u; i < AT_ONCE; ++i) {
        s.diffuse_position += vec3(x[i], y[i], z[i]) * diffuse_w[i];
        s.diffuse_weight += diffuse_w[i];
        s.diffuse_irradiance += v.flux[i] * diffuse_g[i];
        s.distance2 += d2[i] * diffuse_w[i];
    }
#ifdef TWO_EYES
    vec4 second_g = g * second_lobe;
    vec4 second_w = w * second_lobe;
    [[unroll]] for (uint i = 0u; i < AT_ONCE; ++i) {
        second.position += vec3(x[i], y[i], z[i]) * second_w[i];
        second.weight += second_w[i];
        second.irradiance += v.flux[i] * second_g[i];
        if (SPREAD != 0u) {
            second.distance2 += d2[i] * second_w[i];
        }
    }
#endif
    if (GLOSSY != 0u) {
        g *= lobe;
        w *= lobe;
        [[unroll]] for (uint i = 0u; i < AT_ONCE; ++i) {
            s.glossy_position += vec3(x[i], y[i], z[i]) * w[i];
            s.glossy_weight += w[i];
            s.glossy_irradiance += v.flux[i] * g[i];
            if (SPREAD != 0u) {
                s.glossy_distance2 += d2[i] * w[i];
            }
        }
    }
}

#endif
