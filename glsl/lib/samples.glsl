// Points of a pixel. METHOD 13.
#ifndef SAMPLES_GLSL
#define SAMPLES_GLSL

// Where point `i` from 1 to `samples` is, from the pixel's middle [pixels]. With the middle they are a lattice: no two in one row
// or column.
vec2 sample_offset(uint i, uint samples) {
    return fract(vec2(i, 2u * i) / float(samples + 1u) + 0.5) - 0.5;
}

#endif
