// Which surface each further point of a pixel shows. METHOD 13.
#ifndef POINTS_GLSL
#define POINTS_GLSL
#include "shared.glsl"

uint shown_by(uint codes, uint point) {
    return codes >> (4u * point) & 15u;
}

// Offset from a pixel to one of its eight neighbours, by number.
ivec2 pixel_around(uint number) {
    int at = int(number < 4u ? number : number + 1u);
    return ivec2(at % 3, at / 3) - 1;
}

#endif
