// (a / b)^k for four independent pairs side by side. Fits minimise the largest relative error (Remez).
#ifndef POWER_GLSL
#define POWER_GLSL

// log2(a / b) of normal positive numbers, relative error at most 3.1e-7. Below -126 - log2(b) for a = 0; NaN if both
// are 0.
vec4 log2_by_hand(vec4 a, vec4 b) {
    // Float bits grow about logarithmically: the remaining quotient lies within [2/3, 3/2].
    ivec4 whole = (floatBitsToInt(a) - floatBitsToInt(b) + 0x00400000) >> 23;
    vec4 near = intBitsToFloat(floatBitsToInt(a) - (whole << 23));
    // 2 atanh(y) / ln 2 for |y| <= 1/5.
    vec4 y = (near - b) / (near + b);
    vec4 z = y * y;
    return y * (2.88539097 + z * (0.961402812 + z * 0.602878646)) + vec4(whole);
}

// 2^x with relative error at most 1.5e-7 for x in [-126, 127]; undefined elsewhere.
vec4 exp2_by_hand(vec4 x) {
    vec4 whole = roundEven(x);
    vec4 f = x - whole;
    vec4 f2 = f * f;
    vec4 high = 0.00132764690 * f + 0.00967554189;
    vec4 middle = 0.0555071346 * f + 0.240221202;
    vec4 low = 0.693146944 * f + 1.0;
    vec4 power = (high * f2 + middle) * f2 + low;
    return intBitsToFloat(floatBitsToInt(power) + (ivec4(whole) << 23));
}

// (a / b)^k for 0 <= a <= b, k >= 0; some number in [0, 1] if both are 0. Results below 2^-110 become 0: their products
// could be denormal, which are slow on CPUs and invisible. `by_hand`: use the polynomials, for devices that
// compute log2 and exp2 by library calls, one value after the other.
vec4 power_of(vec4 a, vec4 b, float k, bool by_hand) {
    vec4 exponent = k * (by_hand ? log2_by_hand(a, b) : log2(max(a / max(b, 1e-37), 1e-37)));
    vec4 power = by_hand ? exp2_by_hand(exponent) : exp2(exponent);
    return mix(vec4(0.0), power, greaterThan(exponent, vec4(-110.0)));
}

#endif
