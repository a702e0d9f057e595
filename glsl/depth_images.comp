// Stage 6, before the gather: every live cache draws the rectangles of all caches into its depth image. METHOD 6,
// beyond the print. The nearest rectangle hides everything more than a margin behind it. Rectangles occlude from both
// sides: the far side of a closed body thus fills the gaps between rectangles of its near side.
// A workgroup draws one image in shared memory. With ALONE each thread draws one image; neighbouring caches have
// similar work, which suits CPUs, whose vector lanes are the threads.
// variant depth_images_alone.comp: ALONE (a thread draws an image)
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
layout(binding = 3, scalar) readonly buffer Groups { OccluderGroup groups[]; };
layout(binding = 4) uniform samplerBuffer cache_texels; // all caches again: lavapipe reads texels faster than buffers
#ifdef ALONE
layout(binding = 5, scalar) buffer Images { float images[]; };
uint image; // offset of this thread's image
#else
layout(binding = 5, scalar) writeonly buffer Images { float images[]; };
shared uint image[DEPTH_IMAGE_TEXELS];
#endif

const int SIDE = int(DEPTH_IMAGE_SIDE);
const float STEP = 2.0 / float(SIDE);

void keep(int texel, float limit) {
#ifdef ALONE
    uint at = image + uint(texel);
    images[at] = max(images[at], limit);
#else
    // The bits of non-negative floats sort like the floats.
    atomicMax(image[texel], floatBitsToUint(limit));
#endif
}

// First and last texel whose centre may lie between two coordinates.
ivec2 texels(float low, float high) {
    vec2 bounds = (vec2(low, high) + 1.0) * (1.0 / STEP) - 0.5;
    return clamp(ivec2(ceil(bounds.x), floor(bounds.y)), ivec2(0, -1), ivec2(SIDE, SIDE - 1));
}

// The same for a ball: `w` is a component of the unit direction to its centre, `sine` the sine of its angular radius.
ivec2 texels_of_ball(float w, float sine) {
    float cosine = sqrt(max(1.0 - sine * sine, 0.0));
    float reach = sine * sqrt(max(1.0 - w * w, 0.0));
    return texels(w < -cosine ? -1.0 : w * cosine - reach, w > cosine ? 1.0 : w * cosine + reach);
}

// Draws one cache's rectangle; the rows of `own` are the viewing cache's frame.
void draw(Cache c, mat3 own, uint other) {
    vec3 to = texelFetch(cache_texels, int(4u * other)).xyz - c.position;
    vec3 n = texelFetch(cache_texels, int(4u * other + 1u)).xyz;
    vec4 middle_breadth = texelFetch(cache_texels, int(4u * other + 2u));
    vec3 o = middle_breadth.xyz - c.position;
    vec4 axis_radius = texelFetch(cache_texels, int(4u * other + 3u));
    float share = axis_radius.w;
    // Two sides of one body: neither cache lies in front of the other, so their rectangles do not occlude.
    float level = DEPTH_IMAGE_PLANE * share;
    if (-dot(to, n) < level && dot(to, c.normal) <= level) {
        return;
    }
    // Distance from the rectangle's plane. A cache in or near the plane is a neighbour on the same surface.
    float h = dot(o, n);
    n = own * (h < 0.0 ? -n : n);
    h = abs(h);
    if (h <= level) {
        return;
    }
    o = own * o;
    vec3 u = own * axis_radius.xyz;
    float u2 = dot(u, u);
    float v2 = middle_breadth.w * middle_breadth.w;
    vec3 v = cross(n, u) * (middle_breadth.w * inversesqrt(max(u2, 1e-37)));
    if (o.z + abs(u.z) + abs(v.z) <= 0.0) {
        return;
    }
    float distance2 = dot(o, o);
    float inverse = inversesqrt(max(distance2, 1e-37));
    vec3 w0 = o * inverse;
    float sine = sqrt(u2 + v2) * inverse;
    ivec2 xs = ivec2(0, SIDE - 1);
    ivec2 ys = xs;
    if (sine < 0.25) {
        // First-order bound of the directions, plus a bound of the second- and third-order terms.
        vec2 reach = abs(u.xy - w0.xy * dot(w0, u)) + abs(v.xy - w0.xy * dot(w0, v));
        reach = reach * inverse + 1.25 * sine * sine;
        xs = texels(w0.x - reach.x, w0.x + reach.x);
        ys = texels(w0.y - reach.y, w0.y + reach.y);
    } else {
        // Bound from the corners' coordinates, divided by the distance of the nearest point or of the farthest corner.
        vec2 reach = abs(u.xy) + abs(v.xy);
        vec2 aside = abs(vec2(dot(o, u), dot(o, v))) * inversesqrt(max(vec2(u2, v2), vec2(1e-37)));
        vec2 halves = sqrt(vec2(u2, v2));
        vec2 near = max(aside - halves, vec2(0.0));
        vec2 far = aside + halves;
        float nearest = inversesqrt(max(h * h + dot(near, near), 1e-37)) * 1.0001;
        float farthest = inversesqrt(max(h * h + dot(far, far), 1e-37)) * 0.9999;
        vec2 low = o.xy - reach;
        vec2 high = o.xy + reach;
        low *= mix(vec2(farthest), vec2(nearest), lessThan(low, vec2(0.0)));
        high *= mix(vec2(nearest), vec2(farthest), lessThan(high, vec2(0.0)));
        xs = texels(low.x, high.x);
        ys = texels(low.y, high.y);
        if (sine < 1.0) {
            ivec2 x = texels_of_ball(w0.x, sine);
            ivec2 y = texels_of_ball(w0.y, sine);
            xs = ivec2(max(xs.x, x.x), min(xs.y, x.y));
            ys = ivec2(max(ys.x, y.x), min(ys.y, y.y));
        }
    }
    // The ray meets the plane at `w h / along`. Its coordinates along the axes, times `along`, are the dot products
    // with these.
    vec3 across = u * h - n * dot(o, u);
    vec3 upward = v * h - n * dot(o, v);
    // A single loop: older lavapipe versions count the rounds of all loops together.
    int width = xs.y - xs.x + 1;
    int count = max(width, 0) * max(ys.y - ys.x + 1, 0);
    ivec2 at = ivec2(xs.x, ys.x);
    for (int i = 0; i < count; ++i) {
        vec2 p = (vec2(at) + 0.5) * STEP - 1.0;
        float z2 = 1.0 - dot(p, p);
        vec3 w = vec3(p, sqrt(max(z2, 0.0)));
        float along = dot(w, n);
        if (z2 > 0.0 && abs(dot(w, across)) < u2 * along && abs(dot(w, upward)) < v2 * along) {
            // The reciprocal distance of a plane is linear in w: this is its minimum in the texel, up to the curvature
            // of z.
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

// Whether all rectangles of a group lie behind a cache. The margin covers rounding.
bool is_behind(Cache c, OccluderGroup g) {
    vec3 o = g.position - c.position;
    return dot(o, c.normal) + g.reach + 1e-5 * (length(o) + g.reach) <= 0.0;
}

// Matrix whose rows are the frame of a cache's image.
mat3 frame(Cache c) {
    vec3 tangent, bitangent;
    tangents(c.normal, tangent, bitangent);
    return transpose(mat3(tangent, bitangent, c.normal));
}

void main() {
#ifdef ALONE
    uint slot = gl_GlobalInvocationID.x;
    if (slot >= args.cache_count) {
        return;
    }
    Cache c = caches[live[slot]];
    mat3 own = frame(c);
    image = slot * DEPTH_IMAGE_TEXELS;
    if (push.first == 0u) {
        for (uint i = 0u; i < DEPTH_IMAGE_TEXELS; ++i) {
            images[image + i] = 0.0;
        }
    }
    uint end = min(push.first + push.count, push.cache_count);
    for (uint first = push.first; first < end; first += OCCLUDER_GROUP) {
        if (!is_behind(c, groups[first / OCCLUDER_GROUP])) {
            for (uint i = first; i < min(first + OCCLUDER_GROUP, end); ++i) {
                draw(c, own, i);
            }
        }
    }
#else
    uint slot = gl_WorkGroupID.y * DEPTH_IMAGE_ROW + gl_WorkGroupID.x;
    if (slot >= args.cache_count) {
        return;
    }
    Cache c = caches[live[slot]];
    mat3 own = frame(c);
    for (uint i = gl_LocalInvocationID.x; i < DEPTH_IMAGE_TEXELS; i += gl_WorkGroupSize.x) {
        image[i] = 0u;
    }
    barrier();
    for (uint i = gl_LocalInvocationID.x; i < push.cache_count; i += gl_WorkGroupSize.x) {
        if (!is_behind(c, groups[i / OCCLUDER_GROUP])) {
            draw(c, own, i);
        }
    }
    barrier();
    for (uint i = gl_LocalInvocationID.x; i < DEPTH_IMAGE_TEXELS; i += gl_WorkGroupSize.x) {
        images[slot * DEPTH_IMAGE_TEXELS + i] = uintBitsToFloat(image[i]);
    }
#endif
}
