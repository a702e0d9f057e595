// False colours: Turbo (Mikhailov 2019), by his polynomials. Twin: src/reference/false_color.rs.
#ifndef FALSE_COLOR_GLSL
#define FALSE_COLOR_GLSL

// sRGB colour from dark blue over green and yellow to dark red, for `t` from 0 to 1.
vec3 false_color(float t) {
    t = clamp(t, 0.0, 1.0);
    vec4 low = vec4(1.0, t, t * t, t * t * t);
    vec2 high = low.zw * low.z;
    return clamp(vec3(
        dot(low, vec4(0.13572138, 4.61539260, -42.66032258, 132.13108234)) + dot(high, vec2(-152.94239396, 59.28637943)),
        dot(low, vec4(0.09140261, 2.19418839, 4.84296658, -14.18503333)) + dot(high, vec2(4.27729857, 2.82956604)),
        dot(low, vec4(0.10667330, 12.64194608, -60.58204836, 110.36276771)) + dot(high, vec2(-89.90310912, 27.34824973))
    ), 0.0, 1.0);
}

// Logarithmic position of a value between two bounds, 0 to 1; 0 for values without a logarithm.
float decades(float value, float low, float high) {
    return value > low ? clamp(log2(value / low) / log2(high / low), 0.0, 1.0) : 0.0;
}

#endif
