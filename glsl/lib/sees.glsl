// Visibility of points from a cache, by its depth image. METHOD 6 and 11. The including shader defines `IMAGE_BINDING`,
// `IMAGE_WORDS_BINDING` and the constants `IMAGES_AS_TEXELS` (0 if the device's texel buffers are too small) and
// `PLANES` (1 for images that rays trace, 0 for those drawn from rectangles).
#ifndef SEES_GLSL
#define SEES_GLSL
#include "lib/depth_image.glsl"

layout(binding = IMAGE_BINDING) uniform samplerBuffer image_texels; // PER_WORD consecutive texels of a row each
layout(binding = IMAGE_WORDS_BINDING, std430) readonly buffer ImageWords { vec4 image_words[]; }; // the same

const uint PER_WORD = PLANES != 0u ? 2u : 4u; // texels

// A cache's depth image and its tangent frame, scaled to half a side.
struct View {
    uint image; // its first word
    vec3 right;
    vec3 up;
};

View view(uint slot, vec3 normal) {
    const float HALF = 0.5 * float(DEPTH_IMAGE_SIDE);
    View v = View(slot * (DEPTH_IMAGE_TEXELS / PER_WORD), vec3(0.0), vec3(0.0));
    tangents(normal, v.right, v.up);
    v.right *= HALF;
    v.up *= HALF;
    return v;
}

// 1 if a cache sees a point, else 0. For points behind the cache the result is arbitrary.
float sees(View v, vec3 d) {
    const float HALF = 0.5 * float(DEPTH_IMAGE_SIDE);
    float d2 = dot(d, d);
    float inverse = inversesqrt(max(d2, 1e-37));
    uvec2 at = uvec2(clamp(vec2(dot(v.right, d), dot(v.up, d)) * inverse + HALF, 0.0, 2.0 * HALF - 0.5));
    uint texel = at.y * DEPTH_IMAGE_SIDE + at.x;
    uint word = v.image + texel / PER_WORD;
    vec4 texels = IMAGES_AS_TEXELS != 0u ? texelFetch(image_texels, int(word)) : image_words[word];
    if (PLANES != 0u) {
        return reaches(floatBitsToUint((at.x & 1u) != 0u ? texels.zw : texels.xy), d) <= 1.0 ? 1.0 : 0.0;
    }
    vec2 pair = (at.x & 2u) != 0u ? texels.zw : texels.xy;
    float limit = (at.x & 1u) != 0u ? pair.y : pair.x;
    return limit <= inverse ? 1.0 : 0.0;
}

#endif
