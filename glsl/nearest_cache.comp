// Debug view: finds the live cache nearest to the surface of a pixel, on the side that the pixel shows, and copies its
// depth image. One workgroup.
#include "shared.glsl"
#include "lib/depth_image.glsl"

const uint THREADS = 64u;

layout(local_size_x = 64) in;
layout(push_constant, scalar) uniform Push { NearestPush push; };
layout(binding = 0, scalar) readonly buffer Caches { Cache caches[]; };
layout(binding = 1, scalar) readonly buffer Live { uint live[]; };
layout(binding = 2, scalar) readonly buffer Args { LiveArgs args; };
layout(binding = 3, scalar) readonly buffer Images { uint images[]; };
layout(binding = 4) uniform sampler2D depth_image;
layout(binding = 5) uniform sampler2D normal_image;
layout(binding = 6, r32f) uniform writeonly image2D shown;
layout(binding = 7, scalar) writeonly buffer Found { NearestCache found; };

const uint NO_SLOT = 0xffffffffu;

shared float distances2[THREADS];
shared uint slots[THREADS];

// Reciprocal of the distance at which a cache's view ends in the middle of a texel [1/m].
float limit_of(uint slot, uint texel) {
    uint at = slot * DEPTH_IMAGE_TEXELS + texel;
    if (push.are_planes == 0u) {
        return uintBitsToFloat(images[at]);
    }
    vec3 normal = caches[live[slot]].normal;
    vec3 tangent, bitangent;
    tangents(normal, tangent, bitangent);
    vec3 direction = texel_direction(texel, tangent, bitangent, normal);
    return max(reaches(uvec2(images[2u * at], images[2u * at + 1u]), direction), 0.0);
}

void main() {
    uint thread = gl_LocalInvocationID.x;
    ivec2 pixel = ivec2(push.column, push.row);
    float depth = texelFetch(depth_image, pixel, 0).r;
    vec3 normal = texelFetch(normal_image, pixel, 0).xyz;
    vec2 place = (vec2(pixel) + 0.5) / vec2(textureSize(depth_image, 0)) * 2.0 - 1.0;
    vec4 clip = push.world_from_clip * vec4(place, depth, 1.0);
    vec3 position = clip.xyz / clip.w;

    float best2 = 3e38;
    uint best = NO_SLOT;
    uint count = depth > 0.0 ? args.cache_count : 0u;
    for (uint slot = thread; slot < count; slot += THREADS) {
        Cache c = caches[live[slot]];
        vec3 d = c.position - position;
        float d2 = dot(d, d);
        if (d2 < best2 && dot(c.normal, normal) > 0.0) {
            best2 = d2;
            best = slot;
        }
    }
    distances2[thread] = best2;
    slots[thread] = best;
    barrier();
    for (uint i = 0u; i < THREADS; ++i) {
        float other2 = distances2[i];
        if (other2 < best2 || (other2 == best2 && slots[i] < best)) {
            best2 = other2;
            best = slots[i];
        }
    }

    for (uint texel = thread; texel < DEPTH_IMAGE_TEXELS; texel += THREADS) {
        float limit = best == NO_SLOT ? 0.0 : limit_of(best, texel);
        imageStore(shown, ivec2(texel % DEPTH_IMAGE_SIDE, texel / DEPTH_IMAGE_SIDE), vec4(limit));
    }
    if (thread == 0u && best != NO_SLOT) {
        uint index = live[best];
        Cache c = caches[index];
        found = NearestCache(index + 1u, c.position, c.normal, sqrt(best2));
    }
}
