// Points of a pixel, and the plane that it shows there. METHOD 13.
#ifndef SAMPLES_GLSL
#define SAMPLES_GLSL

// Where point `i` from 1 to `samples` is, from the pixel's middle [pixels]. With the middle they are a lattice: no two in one row
// or column.
vec2 sample_offset(uint i, uint samples) {
    return fract(vec2(i, 2u * i) / float(samples + 1u) + 0.5) - 0.5;
}

// Depth over place of the plane through a point [NDC per NDC]: planes stay planes in clip space.
vec2 plane_slope(mat4 world_from_clip, vec3 position, vec3 n) {
    vec4 plane = vec4(n, -dot(n, position)) * world_from_clip;
    return -plane.xy / plane.z;
}

#endif
