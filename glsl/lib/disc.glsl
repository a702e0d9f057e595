// Points on a disc.
#ifndef DISC_GLSL
#define DISC_GLSL

// Golden angle [rad]: spreads points evenly on a disc.
const float GOLDEN = 2.39996323;

// Vogel's point `i` of `count` on the unit disc, turned by an angle [rad].
vec2 disc_point(uint i, uint count, float turn) {
    float angle = float(i) * GOLDEN + turn;
    return sqrt((float(i) + 0.5) / float(count)) * vec2(cos(angle), sin(angle));
}

#endif
