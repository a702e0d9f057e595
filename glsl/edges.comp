// Stage 1, second half: one more sample of every pixel. Samples that show another surface than the one at the pixel's middle
// make up the pixel's second surface, which is shaded like the first and mixed in by its share of the samples. METHOD 13.
// variant edges_elements.comp: ELEMENTS (where caches are interpolated: also which triangle a pixel shows)
// variant edges_coat.comp: COAT (where a material has a clear coat or sheen)
// variant edges_elements_coat.comp: ELEMENTS COAT (both)
#include "shared.glsl"
#include "lib/octahedral.glsl"

layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { EdgesPush push; };
// The surface at the middle of the pixel.
layout(binding = 0) uniform sampler2D first_depth;
layout(binding = 1) uniform sampler2D first_albedo;
layout(binding = 2) uniform sampler2D first_specular;
// That at the sample.
layout(binding = 3) uniform sampler2D sample_depth;
layout(binding = 4) uniform sampler2D sample_normal;
layout(binding = 5) uniform sampler2D sample_albedo;
layout(binding = 6) uniform sampler2D sample_specular;
layout(binding = 7) uniform sampler2D sample_radiance;
// The pixel's second one.
layout(binding = 8, r32f) uniform image2D second_depth;
layout(binding = 9, rgba32f) writeonly uniform image2D second_normal;
layout(binding = 10, rgba16f) uniform image2D second_albedo;
layout(binding = 11, rgba16f) uniform image2D second_specular;
layout(binding = 12, rgba32f) writeonly uniform image2D second_radiance;
layout(binding = 13, r32ui) uniform uimage2D counts; // samples of the first surface, and from bit 16 on of the second
#ifdef ELEMENTS
layout(binding = 14) uniform usampler2D first_element;
layout(binding = 15) uniform usampler2D sample_element;
layout(binding = 16, rg32ui) uniform uimage2D second_element;
#endif
#ifdef COAT
layout(binding = 17) uniform usampler2D sample_coat;
layout(binding = 18, rgba32ui) writeonly uniform uimage2D second_coat;
#endif

// A surface somewhere in a pixel.
struct Seen {
    float depth; // 0 where none is
    uint draw; // 0 where that is not known
    vec3 position;
    vec3 normal; // of its triangle
};

vec3 place(vec2 ndc, float depth) {
    vec4 world = push.world_from_clip * vec4(ndc, depth, 1.0);
    return world.xyz / world.w;
}

Seen seen(vec2 ndc, float depth, uint draw, float x, float y) {
    return Seen(depth, draw, depth > 0.0 ? place(ndc, depth) : vec3(0.0), octahedral_decode(vec2(x, y)));
}

// Whether two samples are on one surface: of one draw, in one plane but for half a pixel, and facing alike.
bool alike(Seen a, Seen b, float pixel) {
    if (a.depth == 0.0 || b.depth == 0.0) {
        return a.depth == b.depth;
    }
    vec3 d = b.position - a.position;
    float aside = max(abs(dot(d, a.normal)), abs(dot(d, b.normal)));
    return a.draw == b.draw && dot(a.normal, b.normal) > 0.9 && aside < 0.5 * pixel;
}

// Depth in the middle of the pixel of the plane that a sample at this offset from there is in.
float depth_in_the_middle(Seen at, vec2 middle, vec2 offset, float pixel) {
    // Planes stay planes in clip space.
    vec4 plane = vec4(at.normal, -dot(at.normal, at.position)) * push.world_from_clip;
    float moved = at.depth + dot(plane.xy, offset) / plane.z;
    // One seen from nearly edge on goes anywhere.
    bool stays = moved > 0.0 && distance(place(middle, moved), at.position) < 4.0 * pixel;
    return stays ? moved : at.depth;
}

void main() {
    ivec2 at = ivec2(gl_GlobalInvocationID.xy);
    ivec2 size = textureSize(first_depth, 0);
    if (any(greaterThanEqual(at, size))) {
        return;
    }
    vec2 middle = (vec2(at) + 0.5) / vec2(size) * 2.0 - 1.0;
    vec2 offset = push.offset / vec2(size) * 2.0;
    uint first_draw = 0u;
    uint draw = 0u;
#ifdef ELEMENTS
    uvec2 element = texelFetch(sample_element, at, 0).xy;
    first_draw = texelFetch(first_element, at, 0).x;
    draw = element.x;
#endif
    vec4 albedo = texelFetch(sample_albedo, at, 0);
    vec4 specular = texelFetch(sample_specular, at, 0);
    Seen here = seen(middle + offset, texelFetch(sample_depth, at, 0).r, draw, albedo.a, specular.a);
    Seen first = seen(middle, texelFetch(first_depth, at, 0).r, first_draw, texelFetch(first_albedo, at, 0).a,
                      texelFetch(first_specular, at, 0).a);
    float depth = max(here.depth, first.depth);
    float pixel = depth > 0.0 ? distance(place(middle, depth), place(middle + vec2(2.0 / float(size.x), 0.0), depth)) : 0.0;

    uint count = push.begins != 0u ? 1u : imageLoad(counts, at).r;
    if (alike(first, here, pixel)) {
        count += 1u;
    } else if (count >> 16u == 0u) {
        count += 1u << 16u;
        imageStore(second_depth, at, vec4(here.depth > 0.0 ? depth_in_the_middle(here, middle, offset, pixel) : 0.0));
        imageStore(second_normal, at, texelFetch(sample_normal, at, 0));
        imageStore(second_albedo, at, albedo);
        imageStore(second_specular, at, specular);
        imageStore(second_radiance, at, vec4(texelFetch(sample_radiance, at, 0).rgb, 0.0));
#ifdef ELEMENTS
        imageStore(second_element, at, uvec4(element, 0u, 0u));
#endif
#ifdef COAT
        imageStore(second_coat, at, texelFetch(sample_coat, at, 0));
#endif
    } else {
        uint second_draw = 0u;
#ifdef ELEMENTS
        second_draw = imageLoad(second_element, at).x;
#endif
        // A third surface counts for neither.
        Seen second = seen(middle, imageLoad(second_depth, at).r, second_draw, imageLoad(second_albedo, at).a,
                           imageLoad(second_specular, at).a);
        count += alike(second, here, pixel) ? 1u << 16u : 0u;
    }
    if (push.begins != 0u && count >> 16u == 0u) {
        // Behind everything: passes over pixels leave it alone.
        imageStore(second_depth, at, vec4(NO_SURFACE));
#ifdef ELEMENTS
        imageStore(second_element, at, uvec4(0u));
#endif
    }
    imageStore(counts, at, uvec4(count));
}
