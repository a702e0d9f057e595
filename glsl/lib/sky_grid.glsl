// Lookup in a latitude-longitude grid of a sky. Uses binding SKY_BINDING. Twin: src/scene/sky.rs.
#ifndef SKY_GRID_GLSL
#define SKY_GRID_GLSL

layout(binding = SKY_BINDING, scalar) readonly buffer SkyTexels { vec3 sky_texels[]; };

// Texel of a grid; columns wrap around, rows continue beyond a pole on its other side.
vec3 sky_texel(SkyLevel level, int column, int row) {
    int width = int(level.width);
    int on = clamp(row, 0, int(level.height) - 1);
    column += on == row ? width : width + width / 2;
    return sky_texels[level.first + uint(on * width + column % width)];
}

// Value of a grid in a unit direction, bilinear.
vec3 sky_value(SkyLevel level, vec3 d) {
    const float TAU = 6.28318530717959;
    // At the poles any longitude is valid.
    float longitude = (d.xz == vec2(0.0) ? 0.0 : atan(d.x, -d.z)) + level.turn;
    float latitude = acos(clamp(d.y, -1.0, 1.0));
    vec2 at = vec2(fract(longitude / TAU + 0.5) * float(level.width), latitude * 2.0 / TAU * float(level.height)) - 0.5;
    vec2 f = fract(at);
    ivec2 corner = ivec2(floor(at));
    vec3 above = mix(sky_texel(level, corner.x, corner.y), sky_texel(level, corner.x + 1, corner.y), f.x);
    vec3 below = mix(sky_texel(level, corner.x, corner.y + 1), sky_texel(level, corner.x + 1, corner.y + 1), f.x);
    return mix(above, below, f.y);
}

#endif
