// Draws caches as discs on their surfaces, for the window's cache view. One triangle after another from the centre.
#include "shared.glsl"

layout(push_constant, scalar) uniform Push { DiscPush push; };
layout(binding = 0, scalar) readonly buffer Caches { Cache caches[]; };

layout(location = 0) flat out vec3 out_color;

void main() {
    uint index = uint(gl_VertexIndex) / (3u * DISC_CORNERS);
    uint corner = uint(gl_VertexIndex) % (3u * DISC_CORNERS);
    Cache cache = caches[index];
    // Neighbouring caches get very different hues: steps of the golden ratio around the hue circle.
    float hue = fract(float(index) * 0.61803399);
    out_color = clamp(abs(fract(hue + vec3(0.0, 2.0 / 3.0, 1.0 / 3.0)) * 6.0 - 3.0) - 1.0, 0.0, 1.0) * 0.85 + 0.15;
    vec3 towards = push.eye.xyz - cache.position * push.eye.w;
    if (cache.area <= 0.0 || dot(cache.normal, towards) <= 0.0) {
        gl_Position = vec4(0.0, 0.0, 0.0, 1.0); // degenerate: covers no pixel
        return;
    }
    float radius = push.size * sqrt(cache.area / 3.14159265);
    vec3 across = abs(cache.normal.x) < 0.7 ? vec3(1.0, 0.0, 0.0) : vec3(0.0, 1.0, 0.0);
    vec3 right = normalize(cross(cache.normal, across));
    vec3 up = cross(cache.normal, right);
    vec3 at = cache.position;
    if (corner % 3u > 0u) {
        float angle = 6.28318531 * float(corner / 3u + corner % 3u - 1u) / float(DISC_CORNERS);
        at += radius * (cos(angle) * right + sin(angle) * up);
    }
    gl_Position = push.clip_from_world * vec4(at, 1.0);
}
