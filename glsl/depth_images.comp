// Stage 6, before the gather: every live cache draws all discs of the atlas into its depth image. METHOD 6, beyond the print.
// Whatever lies nearest hides what is farther than itself by more than a margin. A disc blocks from both sides: holes
// between the discs of a closed thing's near side are filled by those of its far side.
// A workgroup draws one image in its own memory; with ALONE a thread draws one, and neighbours' work is alike, which is
// what CPUs want, whose vectors are threads side by side.
#include "shared.glsl"
#include "lib/form_factor.glsl"
#include "lib/depth_image.glsl"

#ifdef ALONE
layout(local_size_x = 16) in;
#else
layout(local_size_x = 64) in;
#endif
layout(push_constant, scalar) uniform Push { DepthImagePush push; };
layout(binding = 0, scalar) readonly buffer Caches { Cache caches[]; };
layout(binding = 1, scalar) readonly buffer Live { uint live[]; };
layout(binding = 2, scalar) readonly buffer Args { LiveArgs args; };
#ifdef ALONE
layout(binding = 3, scalar) buffer Images { float images[]; };
uint image; // where it begins
#else
layout(binding = 3, scalar) writeonly buffer Images { float images[]; };
shared uint image[DEPTH_IMAGE_TEXELS];
#endif

const int SIDE = int(DEPTH_IMAGE_SIDE);
const float STEP = 2.0 / float(SIDE);

void keep(int texel, float limit) {
#ifdef ALONE
    uint at = image + uint(texel);
    images[at] = max(images[at], limit);
#else
    // Bits of numbers that are not negative are in order.
    atomicMax(image[texel], floatBitsToUint(limit));
#endif
}

// First and last texel whose centre can lie between two coordinates.
ivec2 texels(float low, float high) {
    vec2 bounds = (vec2(low, high) + 1.0) * (1.0 / STEP) - 0.5;
    return clamp(ivec2(ceil(bounds.x), floor(bounds.y)), ivec2(0, -1), ivec2(SIDE, SIDE - 1));
}

// The texels of one axis that a disc can reach which is seen in the unit direction w under an angle. A disc that is small
// for its distance covers the ellipse of first order; a large one is taken for the ball around it.
ivec2 reached(float w, float normal, float facing, float sine) {
    float across = max(1.0 - w * w, 0.0);
    if (sine < 0.25) {
        float aside = normal - w * facing;
        float reach = 1.1 * sine * sqrt(max(across - aside * aside, 0.0)) + sine * sine;
        return texels(w - reach, w + reach);
    }
    float cosine = sqrt(max(1.0 - sine * sine, 0.0));
    float reach = sine * sqrt(across);
    return texels(w < -cosine ? -1.0 : w * cosine - reach, w > cosine ? 1.0 : w * cosine + reach);
}

void draw(Cache c, vec3 tangent, vec3 bitangent, Cache other) {
    vec3 o = other.position - c.position;
    float share = sqrt(other.area / PI);
    float radius = DEPTH_IMAGE_RADIUS * share;
    // Distance from the disc's plane. In the plane, or nearly, it is a neighbour on the same surface.
    float h = dot(o, other.normal);
    vec3 n = h < 0.0 ? -other.normal : other.normal;
    h = abs(h);
    float above = dot(o, c.normal);
    if (above <= -radius || h <= DEPTH_IMAGE_PLANE * share) {
        return;
    }
    n = vec3(dot(n, tangent), dot(n, bitangent), dot(n, c.normal));
    o = vec3(dot(o, tangent), dot(o, bitangent), above);
    float distance = length(o);
    ivec2 xs = ivec2(0, SIDE - 1);
    ivec2 ys = xs;
    if (distance > radius) {
        vec2 w = o.xy / distance;
        float sine = radius / distance;
        xs = reached(w.x, n.x, h / distance, sine);
        ys = reached(w.y, n.y, h / distance, sine);
    }
    // One loop: older lavapipe counts rounds of all loops together.
    int width = xs.y - xs.x + 1;
    int count = max(width, 0) * max(ys.y - ys.x + 1, 0);
    ivec2 at = ivec2(xs.x, ys.x);
    for (int i = 0; i < count; ++i) {
        vec2 p = (vec2(at) + 0.5) * STEP - 1.0;
        float z2 = 1.0 - dot(p, p);
        vec3 w = vec3(p, sqrt(max(z2, 0.0)));
        float along = dot(w, n);
        vec3 off = w * h - o * along; // along times the way from the disc's centre to where the ray meets its plane
        if (z2 > 0.0 && along > 0.0 && dot(off, off) <= radius * radius * along * along) {
            // The reciprocal distance of a plane is linear in w: its least value in the texel, but for the curvature of z.
            float slope = 1.0 / max(w.z, DEPTH_IMAGE_LEAST_Z);
            float least = along - 0.5 * STEP * (abs(n.x - n.z * p.x * slope) + abs(n.y - n.z * p.y * slope));
            if (least > 0.0) {
                float limit = least / (h + DEPTH_IMAGE_MARGIN * share * least);
                keep(at.y * SIDE + at.x, limit);
            }
        }
        at = at.x < xs.y ? ivec2(at.x + 1, at.y) : ivec2(xs.x, at.y + 1);
    }
}

void main() {
#ifdef ALONE
    uint slot = gl_GlobalInvocationID.x;
    if (slot >= args.cache_count) {
        return;
    }
    Cache c = caches[live[slot]];
    vec3 tangent, bitangent;
    tangents(c.normal, tangent, bitangent);
    image = slot * DEPTH_IMAGE_TEXELS;
    if (push.first == 0u) {
        for (uint i = 0u; i < DEPTH_IMAGE_TEXELS; ++i) {
            images[image + i] = 0.0;
        }
    }
    uint end = min(push.first + push.count, push.cache_count);
    for (uint i = push.first; i < end; ++i) {
        draw(c, tangent, bitangent, caches[i]);
    }
#else
    uint slot = gl_WorkGroupID.y * DEPTH_IMAGE_ROW + gl_WorkGroupID.x;
    if (slot >= args.cache_count) {
        return;
    }
    Cache c = caches[live[slot]];
    vec3 tangent, bitangent;
    tangents(c.normal, tangent, bitangent);
    for (uint i = gl_LocalInvocationID.x; i < DEPTH_IMAGE_TEXELS; i += gl_WorkGroupSize.x) {
        image[i] = 0u;
    }
    barrier();
    for (uint i = gl_LocalInvocationID.x; i < push.cache_count; i += gl_WorkGroupSize.x) {
        draw(c, tangent, bitangent, caches[i]);
    }
    barrier();
    for (uint i = gl_LocalInvocationID.x; i < DEPTH_IMAGE_TEXELS; i += gl_WorkGroupSize.x) {
        images[slot * DEPTH_IMAGE_TEXELS + i] = uintBitsToFloat(image[i]);
    }
#endif
}
