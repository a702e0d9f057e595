// The lobe in which a virtual light's surface reflects, beside its diffuse light: GGX, for the direction that the light
// came from. Two words of the virtual light hold it. METHOD 2. tests/val_lobes.rs holds it against the path tracer.
#ifndef VAL_LOBE_GLSL
#define VAL_LOBE_GLSL
#include "lib/form_factor.glsl"
#include "lib/material.glsl"
#include "lib/octahedral.glsl"

// The words are floats, which are copied as they are: their exponent fields must be neither 0 nor 255, their signs +.
// Shape, from the lowest bit on: two coordinates of the direction to the light, 9 bits each; roughness, 5 bits; 64 plus
// F0's step, 8 bits. 0: no lobe. Flux: red and green, 8 bits each; blue, 7 bits; 128 plus their exponent, 8 bits.
const float DIRECTION_STEPS = 511.0;
const float ROUGHNESS_STEPS = 31.0;
const float F0_STEPS = 15.0;

// Least F0 of a packed lobe: F0 is LEAST_F0^(1 - i / F0_STEPS).
const float LEAST_F0 = 0.04;

// Largest tint of a lobe.
const float MOST_TINT = 4.0;

// The lobe of a surface with the normal n, lit along the unit vector `looking`: its shape. `diffuse` becomes the albedo of
// the diffuse light, `tint` what the lobe is multiplied by.
float lobe_shape(Reflectance r, vec3 n, vec3 looking, inout vec3 diffuse, out vec3 tint) {
    vec3 glossy;
    float cosine = max(-dot(n, looking), LEAST_COSINE);
    reflected_from(r, cosine, diffuse, glossy);
    float f0 = dot(r.glossy, vec3(0.2126, 0.7152, 0.0722));
    float roughness = coded_roughness(r.coded);
    tint = r.glossy;
    if (r.coded >= 0.0) {
        // A Phong lobe becomes one of the same width and light, without Fresnel's rise.
        roughness = inversesqrt(sqrt(2.0 * r.coded + 1.0));
        tint = f0 > 0.0 ? glossy : vec3(0.0);
        f0 = f0 > 0.0 ? 1.0 : 0.0;
    }
    if (f0 <= 0.0) {
        return 0.0;
    }
    roughness = clamp(roughness, LEAST_LOBE, 1.0);
    float f0_step = floor(clamp(F0_STEPS * (1.0 - log(min(f0, 1.0)) / log(LEAST_F0)), 0.0, F0_STEPS) + 0.5);
    tint *= scattered_again(vec3(f0), scattered_once(roughness, cosine)).x;
    tint /= exp(log(LEAST_F0) * (1.0 - f0_step / F0_STEPS)); // F0 is rounded, its light is not
    uvec2 at = uvec2((octahedral_encode(-looking) * 0.5 + 0.5) * DIRECTION_STEPS + 0.5);
    uint w = uint(roughness * ROUGHNESS_STEPS + 0.5);
    return uintBitsToFloat((64u + uint(f0_step)) << 23 | w << 18 | at.y << 9 | at.x);
}

// A tint as a whole number, which a float holds exactly.
float packed_tint(vec3 tint) {
    uvec3 steps = uvec3(clamp(tint / MOST_TINT, 0.0, 1.0) * 255.0 + 0.5);
    return float(steps.x | steps.y << 8 | steps.z << 16);
}

vec3 unpacked_tint(float word) {
    uint steps = uint(word);
    return vec3(steps & 255u, steps >> 8 & 255u, steps >> 16) * (MOST_TINT / 255.0);
}

// The flux of a lobe [lm], within 1/128 of its largest channel.
float packed_flux(vec3 flux) {
    float most = max(flux.x, max(flux.y, flux.z));
    if (!(most > 1e-18)) {
        return 0.0;
    }
    int exponent = min(int(floor(log2(most))) + 1, 60);
    vec3 most_steps = vec3(255.0, 255.0, 127.0);
    uvec3 steps = uvec3(min(flux * exp2(float(8 - exponent)) * vec3(1.0, 1.0, 0.5) + 0.5, most_steps));
    return uintBitsToFloat(uint(128 + exponent) << 23 | steps.z << 16 | steps.y << 8 | steps.x);
}

vec3 unpacked_flux(float word) {
    uint bits = floatBitsToUint(word);
    uint exponent = bits >> 23 & 255u;
    vec3 steps = vec3(bits & 255u, bits >> 8 & 255u, 2u * (bits >> 16 & 127u));
    return exponent == 0u ? vec3(0.0) : steps * exp2(float(int(exponent) - 136));
}

// Shapes of the lobes of four virtual lights, one component per vector.
struct FourLobes {
    vec4 x; // direction to the light
    vec4 y;
    vec4 z;
    vec4 cosine; // with the normal
    vec4 shadow; // Smith's root for it
    vec4 alpha2;
    vec4 f0;
};

// Unpacks four shapes; the vectors are the normals.
FourLobes unpacked_lobes(vec4 words, vec4 normal_x, vec4 normal_y, vec4 normal_z) {
    uvec4 bits = floatBitsToUint(words);
    FourLobes l;
    l.x = vec4(bits & 511u) * (2.0 / DIRECTION_STEPS) - 1.0;
    l.y = vec4(bits >> 9 & 511u) * (2.0 / DIRECTION_STEPS) - 1.0;
    l.z = 1.0 - abs(l.x) - abs(l.y);
    vec4 fold = max(-l.z, 0.0);
    l.x -= mix(-fold, fold, greaterThanEqual(l.x, vec4(0.0)));
    l.y -= mix(-fold, fold, greaterThanEqual(l.y, vec4(0.0)));
    vec4 closeness = inversesqrt(l.x * l.x + l.y * l.y + l.z * l.z);
    l.x *= closeness;
    l.y *= closeness;
    l.z *= closeness;
    l.cosine = max(l.x * normal_x + l.y * normal_y + l.z * normal_z, LEAST_COSINE);
    vec4 roughness = max(vec4(bits >> 18 & 31u) / ROUGHNESS_STEPS, LEAST_LOBE);
    l.alpha2 = roughness * roughness * (roughness * roughness);
    l.shadow = sqrt(l.alpha2 + (1.0 - l.alpha2) * l.cosine * l.cosine);
    l.f0 = exp2(log2(LEAST_F0) * (1.0 - (vec4(bits >> 23 & 255u) - 64.0) / F0_STEPS));
    return l;
}

// Light that the lobes of four virtual lights send towards a point, relative to diffuse light of the same flux. The
// vectors lead from the point to the lights; `facing`: their products with the normals, negated; d2: their squared lengths.
vec4 sent_towards(FourLobes l, vec4 facing, vec4 x, vec4 y, vec4 z, vec4 d2) {
    vec4 closeness = inversesqrt(max(d2, 1e-37));
    vec4 to_point = max(facing * closeness, LEAST_COSINE);
    vec4 half2 = max(2.0 - 2.0 * (l.x * x + l.y * y + l.z * z) * closeness, 1e-6); // squared sum of both directions
    vec4 half_cosine = l.cosine + to_point; // times the length of that sum
    // The bounded cosines may belong to a longer sum. Without the minimum the divisor could become 0.
    vec4 along2 = min(half_cosine * half_cosine, half2);
    vec4 narrow = half2 / (half2 - along2 * (1.0 - l.alpha2)); // GGX is alpha2 / pi of its square
    vec4 missed = max(1.0 - 0.5 * sqrt(half2), 0.0);
    vec4 missed2 = missed * missed;
    vec4 fresnel = l.f0 + (1.0 - l.f0) * (missed2 * missed2 * missed);
    vec4 seen = l.cosine * sqrt(l.alpha2 + (1.0 - l.alpha2) * to_point * to_point) + to_point * l.shadow;
    return 0.5 * l.alpha2 * narrow * narrow * fresnel / seen;
}

#endif
