// Scene-referred linear Rec.709 to display-referred linear, and the sRGB encoding. Twin: src/reference/tonemap.rs.
#ifndef TONEMAP_GLSL
#define TONEMAP_GLSL

const uint TONEMAP_PBR_NEUTRAL = 0u;
const uint TONEMAP_AGX = 1u;
const uint TONEMAP_ACES = 2u;
const uint TONEMAP_LINEAR = 3u;

// Khronos PBR Neutral: keeps base colours up to 0.8, then compresses and desaturates highlights.
vec3 pbr_neutral(vec3 c) {
    const float start = 0.8 - 0.04;
    const float desaturation = 0.15;
    float x = min(c.r, min(c.g, c.b));
    float offset = x < 0.08 ? x - 6.25 * x * x : 0.04;
    c -= offset;
    float peak = max(c.r, max(c.g, c.b));
    if (peak < start) {
        return c;
    }
    const float d = 1.0 - start;
    float new_peak = 1.0 - d * d / (peak + d - start);
    c *= new_peak / peak;
    float g = 1.0 - 1.0 / (desaturation * (peak - new_peak) + 1.0);
    return mix(c, vec3(new_peak), g);
}

// ACES filmic: Stephen Hill's fit of the reference rendering and output transforms.
vec3 aces(vec3 c) {
    const mat3 input_matrix = mat3(0.59719, 0.07600, 0.02840, 0.35458, 0.90834, 0.13383, 0.04823, 0.01566, 0.83777);
    const mat3 output_matrix = mat3(1.60475, -0.10208, -0.00327, -0.53108, 1.10813, -0.07276, -0.07367, -0.00605, 1.07602);
    c = input_matrix * c;
    vec3 a = c * (c + 0.0245786) - 0.000090537;
    vec3 b = c * (0.983729 * c + 0.4329510) + 0.238081;
    return clamp(output_matrix * (a / b), 0.0, 1.0);
}

// AgX with its default look: log encoding from -12.47 to 4.03 stops, sixth-order fit of the sigmoid.
vec3 agx(vec3 c) {
    const mat3 inset = mat3(0.842479062253094, 0.0423282422610123, 0.0423756549057051, 0.0784335999999992, 0.878468636469772,
                            0.0784336, 0.0792237451477643, 0.0791661274605434, 0.879142973793104);
    const mat3 outset = mat3(1.19687900512017, -0.0528968517574562, -0.0529716355144438, -0.0980208811401368, 1.15190312990417,
                             -0.0980434501171241, -0.0990297440797205, -0.0989611768448433, 1.15107367264116);
    const float low = -12.47393;
    const float high = 4.026069;
    vec3 x = clamp((log2(max(inset * c, vec3(1e-10))) - low) / (high - low), 0.0, 1.0);
    vec3 x2 = x * x;
    vec3 x4 = x2 * x2;
    vec3 s = 15.5 * x4 * x2 - 40.14 * x4 * x + 31.96 * x4 - 6.868 * x2 * x + 0.4298 * x2 + 0.1191 * x - 0.00232;
    return clamp(pow(max(outset * s, vec3(0.0)), vec3(2.2)), 0.0, 1.0);
}

// Applies the chosen curve; result in [0, 1].
vec3 tonemap(vec3 c, uint kind) {
    c = max(c, vec3(0.0));
    if (kind == TONEMAP_PBR_NEUTRAL) {
        c = pbr_neutral(c);
    } else if (kind == TONEMAP_AGX) {
        c = agx(c);
    } else if (kind == TONEMAP_ACES) {
        c = aces(c);
    }
    return clamp(c, 0.0, 1.0);
}

// sRGB encoding of a linear colour, clipped to the display's range.
vec3 srgb_from_linear(vec3 c) {
    c = clamp(c, 0.0, 1.0);
    return mix(12.92 * c, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, greaterThan(c, vec3(0.0031308)));
}

#endif
