// Stage 8, end: mixes the light of all points of a pixel. METHOD 13.
#include "shared.glsl"
#include "lib/points.glsl"

layout(constant_id = 0) const uint POINTS = 4; // besides the centre
layout(binding = 0) uniform sampler2D first_image; // light of each pixel's first surface
layout(binding = 1) uniform sampler2D second_image;
layout(binding = 2) uniform usampler2D codes_image;

layout(location = 0) out vec4 out_radiance;

void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    uint codes = texelFetch(codes_image, at, 0).r;
    if (codes == 0u) {
        discard;
    }
    vec3 first = texelFetch(first_image, at, 0).rgb;
    vec3 second = texelFetch(second_image, at, 0).rgb; // without second surfaces: the first image
    vec3 sum = first;
    float count = 1.0;
    for (uint i = 0u; i < POINTS; i++) {
        uint code = shown_by(codes, i);
        if (code == SHOWS_ANOTHER) {
            continue;
        }
        sum += code == SHOWS_FIRST ? first
               : code == SHOWS_SECOND ? second
                                      : texelFetch(first_image, at + pixel_around(code - SHOWS_AROUND), 0).rgb;
        count += 1.0;
    }
    out_radiance = vec4(sum / count, 0.0);
}
