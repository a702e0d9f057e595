// (a / b)^k of four pairs of numbers side by side: none waits for another. Fits are minimax (Remez) of the relative error.
#ifndef POWER_GLSL
#define POWER_GLSL

// log2(a / b), within 3.1e-7 of itself, of normal numbers above 0. Where a is 0, less than -126 - log2(b); NaN where both
// are.
vec4 log2_by_hand(vec4 a, vec4 b) {
    // Bits grow about as logarithms do: what is left of the quotient is within [2/3, 3/2].
    ivec4 whole = (floatBitsToInt(a) - floatBitsToInt(b) + 0x00400000) >> 23;
    vec4 near = intBitsToFloat(floatBitsToInt(a) - (whole << 23));
    // 2 atanh(y) / ln 2, |y| <= 1/5.
    vec4 y = (near - b) / (near + b);
    vec4 z = y * y;
    return y * (2.88539097 + z * (0.961402812 + z * 0.602878646)) + vec4(whole);
}

// 2^x within 1.5e-7 of itself, x in [-126, 127]; of others, anything.
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

// (a / b)^k, 0 <= a <= b, k >= 0; a number in [0, 1] where both are 0, and 0 below 2^-110: products with less are numbers that
// CPUs are slow with, and that nobody sees. `by_hand`: the device's log2 and exp2 are programs, which it runs one after the other.
vec4 power_of(vec4 a, vec4 b, float k, bool by_hand) {
    vec4 exponent = k * (by_hand ? log2_by_hand(a, b) : log2(max(a / max(b, 1e-37), 1e-37)));
    vec4 power = by_hand ? exp2_by_hand(exponent) : exp2(exponent);
    return mix(vec4(0.0), power, greaterThan(exponent, vec4(-110.0)));
}

#endif
