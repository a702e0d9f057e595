// Sample points of a pixel, and the plane of its surface. METHOD 13.
#ifndef SAMPLES_GLSL
#define SAMPLES_GLSL

// Offset of point `i` (1 to `samples`) from the pixel's centre [pixels]. Together with the centre the points form a
// lattice: no two in one row or column.
vec2 sample_offset(uint i, uint samples) {
    return fract(vec2(i, 2u * i) / float(samples + 1u) + 0.5) - 0.5;
}

// Slope of the plane through a point: depth over screen position [NDC per NDC]. Planes remain planes in clip space.
vec2 plane_slope(mat4 world_from_clip, vec3 position, vec3 n) {
    vec4 plane = vec4(n, -dot(n, position)) * world_from_clip;
    return -plane.xy / plane.z;
}

#endif
