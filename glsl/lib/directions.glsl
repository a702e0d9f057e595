// A cache's light by direction: an octahedral map of the world. METHOD 11. Twin: src/reference/near.rs.
#ifndef DIRECTIONS_GLSL
#define DIRECTIONS_GLSL
#include "lib/octahedral.glsl"

// Index of the texel that contains a unit direction.
uint direction_index(vec3 direction) {
    vec2 at = (octahedral_encode(direction) * 0.5 + 0.5) * float(DIRECTION_SIDE);
    uvec2 texel = uvec2(clamp(at, vec2(0.0), vec2(float(DIRECTION_SIDE) - 0.5)));
    return texel.y * DIRECTION_SIDE + texel.x;
}

// Solid angle of a texel [sr], from its square on the octahedron, evaluated at its centre.
float direction_solid_angle(uint index) {
    const float STEP = 2.0 / float(DIRECTION_SIDE);
    vec2 at = abs((vec2(index % DIRECTION_SIDE, index / DIRECTION_SIDE) + 0.5) * STEP - 1.0);
    at = at.x + at.y > 1.0 ? 1.0 - at.yx : at;
    vec3 on = vec3(at, 1.0 - at.x - at.y);
    float d2 = dot(on, on);
    return STEP * STEP * inversesqrt(d2) / d2;
}

// Texels per solid angle [1/sr] at a unit direction. The texels divide the octahedron |x| + |y| + |z| = 1 evenly.
float directions_per_solid_angle(vec3 direction) {
    float length_ = abs(direction.x) + abs(direction.y) + abs(direction.z);
    return float(DIRECTION_SIDE * DIRECTION_SIDE) / (4.0 * length_ * length_ * length_);
}

// Packs a radiance into 32 bits: 8 bits per channel and a shared exponent. Values below 1e-35 become 0, because the
// exponent's range ends.
uint pack_radiance(vec3 radiance) {
    float most = max(radiance.x, max(radiance.y, radiance.z));
    if (!(most > 1e-35)) {
        return 0u;
    }
    int exponent;
    frexp(min(most, 1e38), exponent);
    // The bound keeps the largest channel from rounding up to 256.
    uvec3 parts = uvec3(min(ldexp(radiance, ivec3(8 - exponent)) + 0.5, 255.0));
    return parts.x | parts.y << 8 | parts.z << 16 | uint(exponent + 127) << 24;
}

vec3 unpack_radiance(uint packed_) {
    vec3 parts = vec3(packed_ & 0xffu, packed_ >> 8 & 0xffu, packed_ >> 16 & 0xffu);
    return ldexp(parts, ivec3(int(packed_ >> 24) - 127 - 8));
}

#endif
