// Stage 1, edges: which surface each sample of a pixel shows: the one at its centre, or that of a pixel around. METHOD 13.
// variant samples_elements.comp: ELEMENTS (where caches are interpolated: also which draw a pixel shows)
#include "shared.glsl"
#include "lib/found_around.glsl"
#include "lib/octahedral.glsl"
#include "lib/samples.glsl"

layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { SamplesPush push; };
layout(binding = 0) uniform sampler2D first_depth;
layout(binding = 1) uniform sampler2D first_albedo;
layout(binding = 2) uniform sampler2D first_specular;
layout(binding = 3) uniform sampler2DMS sample_depth;
layout(binding = 4) uniform sampler2DMS samples; // of samples.frag
layout(binding = 5, r32ui) writeonly uniform uimage2D codes; // SHOWS_* code of each sample
#ifdef ELEMENTS
layout(binding = 6) uniform usampler2D first_element;
#endif

vec2 middle(ivec2 at) {
    return (vec2(at) + 0.5) / vec2(textureSize(first_depth, 0)) * 2.0 - 1.0;
}

// The first surface of a pixel.
Seen first_at(ivec2 at, float depth) {
    vec2 normal = vec2(texelFetch(first_albedo, at, 0).a, texelFetch(first_specular, at, 0).a);
    uint draw = 0u;
#ifdef ELEMENTS
    draw = texelFetch(first_element, at, 0).x;
#endif
    return Seen(depth, draw, depth > 0.0 ? place(push.world_from_clip, middle(at), depth) : vec3(0.0), octahedral_decode(normal));
}

bool shows(ivec2 other, float depth, Seen here, float pixel) {
    Seen there = first_at(other, depth);
    bool near = abs(dot(there.position - here.position, here.normal)) < pixel;
    return near && there.draw == here.draw && dot(there.normal, here.normal) > 0.8;
}

void main() {
    ivec2 at = ivec2(gl_GlobalInvocationID.xy);
    ivec2 size = textureSize(first_depth, 0);
    if (any(greaterThanEqual(at, size))) {
        return;
    }
    Seen first = first_at(at, texelFetch(first_depth, at, 0).r);
    uint found = 0u;
    for (uint i = 0u; i < 4u; i++) {
        vec2 offset = STANDARD_SAMPLES[i];
        vec2 ndc = middle(at) + offset / vec2(size) * 2.0;
        float depth = texelFetch(sample_depth, at, int(i)).r;
        vec2 of_sample = texelFetch(samples, at, int(i)).xy;
        vec3 position = depth > 0.0 ? place(push.world_from_clip, ndc, depth) : vec3(0.0);
        Seen here = Seen(depth, 0u, position, decoded_normal(of_sample.y));
#ifdef ELEMENTS
        here.draw = depth > 0.0 ? uint(of_sample.x) : 0u;
#endif
        float pixel = pixel_side(push.world_from_clip, middle(at), max(first.depth, depth), size.x);
        uint code = same_surface(first, here, pixel) ? SHOWS_FIRST : found_around(here, first_depth, at, offset, pixel);
        found |= code << (4u * i);
    }
    imageStore(codes, at, uvec4(found));
}
