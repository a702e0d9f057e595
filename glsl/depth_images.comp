// Stage 6, before the gather: every live cache draws all discs of the atlas into its depth image. METHOD 6, beyond the print.
// Whatever lies nearest hides what is farther than itself by more than a margin. A disc blocks from both sides: holes
// between the discs of a closed thing's near side are filled by those of its far side.
#include "shared.glsl"
#include "lib/form_factor.glsl"
#include "lib/depth_image.glsl"

layout(local_size_x = 64) in;
layout(push_constant, scalar) uniform Push { DepthImagePush push; };
layout(binding = 0, scalar) readonly buffer Caches { Cache caches[]; };
layout(binding = 1, scalar) readonly buffer Live { uint live[]; };
layout(binding = 2, scalar) readonly buffer Args { LiveArgs args; };
layout(binding = 3, scalar) writeonly buffer Images { float images[]; };

const int SIDE = int(DEPTH_IMAGE_SIDE);
const float STEP = 2.0 / float(SIDE);

// Bits of numbers that are not negative are in order.
shared uint image[DEPTH_IMAGE_TEXELS];

// First and last texel whose centre can lie between the coordinates that directions within an angle of a unit
// direction have on one axis.
ivec2 texels(float at, float cosine, float sine) {
    float reach = sine * sqrt(max(1.0 - at * at, 0.0));
    float low = at < -cosine ? -1.0 : at * cosine - reach;
    float high = at > cosine ? 1.0 : at * cosine + reach;
    vec2 bounds = (vec2(low, high) + 1.0) / STEP - 0.5;
    return clamp(ivec2(ceil(bounds.x), floor(bounds.y)), ivec2(0, -1), ivec2(SIDE, SIDE - 1));
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
        float sine = radius / distance;
        float cosine = sqrt(max(1.0 - sine * sine, 0.0));
        xs = texels(o.x / distance, cosine, sine);
        ys = texels(o.y / distance, cosine, sine);
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
                atomicMax(image[at.y * SIDE + at.x], floatBitsToUint(limit));
            }
        }
        at = at.x < xs.y ? ivec2(at.x + 1, at.y) : ivec2(xs.x, at.y + 1);
    }
}

void main() {
    uint slot = gl_WorkGroupID.y * DEPTH_IMAGE_ROW + gl_WorkGroupID.x;
    if (slot >= args.cache_count) {
        return;
    }
    uint own = live[slot];
    Cache c = caches[own];
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
}
