// Stage 6, after trace_images.comp: moves the planes of traced depth images back by a margin. Around an edge of a body,
// and where a surface curves away, points of a texel lie behind its plane. The neighbours show how far: a texel's
// corners are half as far away in its row and in its column. One workgroup per image. METHOD 11.
// Twin: src/reference/depth_image.rs.
#include "shared.glsl"
#include "lib/depth_image.glsl"

layout(local_size_x = 64) in;
layout(binding = 0, scalar) readonly buffer Caches { Cache caches[]; };
layout(binding = 1, scalar) readonly buffer Live { uint live[]; };
layout(binding = 2, scalar) readonly buffer Args { LiveArgs args; };
layout(binding = 3, scalar) buffer Images { uvec2 images[]; };

// How far behind its plane points are still visible at least, as a share of their distance: surfaces are not flat.
const float LEAST = 0.01;

// Margins are at most this share: farther points are hardly of the same surface.
const float MOST = 1.0;

const int SIDE = int(DEPTH_IMAGE_SIDE);

shared uvec2 planes[DEPTH_IMAGE_TEXELS];

// How many times as far as the plane of the texel `at` the hit of the texel `other` lies, if the surface bends away
// between them: then each hit lies behind the other's plane. Else 0, as where a body hides part of what is behind it.
// The vectors are the texels' directions.
float bends_to(uint at, vec3 own, uint other, vec3 direction) {
    float closeness = reaches(planes[other], direction); // reciprocal distance of its hit [1/m]; 0 without one
    bool bends = reaches(planes[other], own) >= 0.999 * reaches(planes[at], own);
    return closeness > 0.0 && bends ? reaches(planes[at], direction) / closeness : 0.0;
}

void main() {
    uint slot = gl_WorkGroupID.y * DEPTH_IMAGE_ROW + gl_WorkGroupID.x;
    if (slot >= args.cache_count) {
        return;
    }
    vec3 normal = caches[live[slot]].normal;
    vec3 tangent, bitangent;
    tangents(normal, tangent, bitangent);
    uint first = slot * DEPTH_IMAGE_TEXELS;
    for (uint texel = gl_LocalInvocationID.x; texel < DEPTH_IMAGE_TEXELS; texel += gl_WorkGroupSize.x) {
        planes[texel] = images[first + texel];
    }
    barrier();
    for (uint texel = gl_LocalInvocationID.x; texel < DEPTH_IMAGE_TEXELS; texel += gl_WorkGroupSize.x) {
        if (planes[texel] == NO_PLANE) {
            continue;
        }
        vec3 own = texel_direction(texel, tangent, bitangent, normal);
        vec2 behind = vec2(0.0); // in the row and in the column
        for (int i = 0; i < 4; ++i) {
            int along = i / 2;
            ivec2 place = ivec2(texel % DEPTH_IMAGE_SIDE, texel / DEPTH_IMAGE_SIDE);
            place[along] += 2 * (i % 2) - 1;
            if (place[along] >= 0 && place[along] < SIDE) {
                uint other = uint(place.y * SIDE + place.x);
                vec3 direction = texel_direction(other, tangent, bitangent, normal);
                behind[along] = max(behind[along], bends_to(texel, own, other, direction) - 1.0);
            }
        }
        float margin = min(LEAST + 0.5 * (behind.x + behind.y), MOST);
        images[first + texel].y = floatBitsToUint(uintBitsToFloat(planes[texel].y) / (1.0 + margin));
    }
}
