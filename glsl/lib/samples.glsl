// Sample points of a pixel, and the plane of its surface. METHOD 13.
#ifndef SAMPLES_GLSL
#define SAMPLES_GLSL

// Offset of point `i` (1 to `samples`) from the pixel's centre [pixels]. Together with the centre the points form a
// lattice: no two in one row or column.
vec2 sample_offset(uint i, uint samples) {
    return fract(vec2(i, 2u * i) / float(samples + 1u) + 0.5) - 0.5;
}

// Offsets of a multisampled image's samples from the pixel's centre [pixels]: Vulkan's standard places, assumed also
// of drivers that do not promise them. `Antialiasing::offsets` has them on the CPU.
const vec2 STANDARD_SAMPLES[4] = vec2[](vec2(-1, -3) / 8.0, vec2(3, -1) / 8.0, vec2(-3, 1) / 8.0, vec2(1, 3) / 8.0);

// Slope of the plane through a point: depth over screen position [NDC per NDC]. Planes remain planes in clip space.
vec2 plane_slope(mat4 world_from_clip, vec3 position, vec3 n) {
    vec4 plane = vec4(n, -dot(n, position)) * world_from_clip;
    return -plane.xy / plane.z;
}

#endif
