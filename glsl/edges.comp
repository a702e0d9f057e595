// Stage 1, second half: evaluates one more point of every pixel. The first point on another surface than the pixel's
// centre defines the pixel's second surface, which is shaded like the first. Points on further surfaces use a
// neighbouring pixel's shading. Reflectances are averaged over the points of one surface. METHOD 13.
// variant edges_elements.comp: ELEMENTS (where caches are interpolated: also which triangle a pixel shows)
// variant edges_coat.comp: COAT (where a material has a clear coat or sheen)
// variant edges_elements_coat.comp: ELEMENTS COAT (both)
#include "shared.glsl"
#include "lib/found_around.glsl"
#include "lib/octahedral.glsl"

layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { EdgesPush push; };
// The surface at the pixel's centre.
layout(binding = 0) uniform sampler2D first_depth;
layout(binding = 1, rgba16f) uniform image2D first_albedo;
layout(binding = 2, rgba16f) uniform image2D first_specular;
layout(binding = 3, rgba32f) uniform image2D first_radiance;
// The surface at the sample.
layout(binding = 4) uniform sampler2D sample_depth;
layout(binding = 5) uniform sampler2D sample_normal;
layout(binding = 6) uniform sampler2D sample_albedo;
layout(binding = 7) uniform sampler2D sample_specular;
layout(binding = 8) uniform sampler2D sample_radiance;
// The pixel's second surface.
layout(binding = 9, r32f) uniform image2D second_depth;
layout(binding = 10, rgba32f) writeonly uniform image2D second_normal;
layout(binding = 11, rgba16f) uniform image2D second_albedo;
layout(binding = 12, rgba16f) uniform image2D second_specular;
layout(binding = 13, rgba32f) uniform image2D second_radiance;
layout(binding = 14, r32ui) uniform uimage2D codes; // SHOWS_* code of each point
layout(binding = 15) uniform sampler2D first_normal;
#ifdef ELEMENTS
layout(binding = 16) uniform usampler2D first_element;
layout(binding = 17) uniform usampler2D sample_element;
layout(binding = 18, rg32ui) uniform uimage2D second_element;
#endif
#ifdef COAT
layout(binding = 19) uniform usampler2D sample_coat;
layout(binding = 20, rgba32ui) writeonly uniform uimage2D second_coat;
#endif

Seen seen(vec2 ndc, float depth, uint draw, float x, float y) {
    return Seen(depth, draw, depth > 0.0 ? place(push.world_from_clip, ndc, depth) : vec3(0.0), octahedral_decode(vec2(x, y)));
}

// Whether reflectances differ by more than the rounding of their mean.
bool differ(vec4 a, vec4 b) {
    return any(greaterThan(abs(a.rgb - b.rgb), 0.004 * a.rgb));
}

// Depth at the pixel's centre of the plane through a sample at this offset.
float depth_in_the_middle(Seen at, vec2 middle, vec2 offset, float pixel) {
    // Planes remain planes in clip space.
    vec4 plane = vec4(at.normal, -dot(at.normal, at.position)) * push.world_from_clip;
    float moved = at.depth + dot(plane.xy, offset) / plane.z;
    // On planes seen nearly edge-on the depth may be far off; keep the sample's depth then.
    bool stays = moved > 0.0 && distance(place(push.world_from_clip, middle, moved), at.position) < 4.0 * pixel;
    return stays ? moved : at.depth;
}

bool shows(ivec2 other, float depth, Seen here, float pixel) {
    ivec2 size = textureSize(first_depth, 0);
    vec3 p = place(push.world_from_clip, (vec2(other) + 0.5) / vec2(size) * 2.0 - 1.0, depth);
    vec3 normal = texelFetch(sample_normal, ivec2(gl_GlobalInvocationID.xy), 0).xyz;
    bool is_it = abs(dot(p - here.position, here.normal)) < pixel && dot(texelFetch(first_normal, other, 0).xyz, normal) > 0.8;
#ifdef ELEMENTS
    is_it = is_it && texelFetch(first_element, other, 0).x == here.draw;
#endif
    return is_it;
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
    vec4 first_a = imageLoad(first_albedo, at);
    vec4 first_s = imageLoad(first_specular, at);
    Seen first = seen(middle, texelFetch(first_depth, at, 0).r, first_draw, first_a.a, first_s.a);
    float pixel = pixel_side(push.world_from_clip, middle, max(here.depth, first.depth), size.x);

    uint all = push.point > 0u ? imageLoad(codes, at).r : 0u;
    uint of_first = 1u;
    uint of_second = 0u;
    for (uint i = 0u; i < push.point; i++) {
        uint code = shown_by(all, i);
        of_first += code == SHOWS_FIRST ? 1u : 0u;
        of_second += code == SHOWS_SECOND ? 1u : 0u;
    }
    vec4 emitted = texelFetch(sample_radiance, at, 0);
    uint code = SHOWS_SECOND;
    if (same_surface(first, here, pixel)) {
        code = SHOWS_FIRST;
        float share = 1.0 / float(of_first + 1u);
        if (differ(first_a, albedo)) {
            imageStore(first_albedo, at, vec4(mix(first_a.rgb, albedo.rgb, share), first_a.a));
        }
        if (differ(first_s, specular)) {
            imageStore(first_specular, at, vec4(mix(first_s.rgb, specular.rgb, share), first_s.a));
        }
        imageStore(first_radiance, at, mix(imageLoad(first_radiance, at), emitted, share));
    } else if (of_second == 0u) {
        imageStore(second_depth, at, vec4(here.depth > 0.0 ? depth_in_the_middle(here, middle, offset, pixel) : 0.0));
        imageStore(second_normal, at, texelFetch(sample_normal, at, 0));
        imageStore(second_albedo, at, albedo);
        imageStore(second_specular, at, specular);
        imageStore(second_radiance, at, vec4(emitted.rgb, 0.0));
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
        vec4 second_a = imageLoad(second_albedo, at);
        vec4 second_s = imageLoad(second_specular, at);
        Seen second = seen(middle, imageLoad(second_depth, at).r, second_draw, second_a.a, second_s.a);
        if (same_surface(second, here, pixel)) {
            float share = 1.0 / float(of_second + 1u);
            if (differ(second_a, albedo)) {
                imageStore(second_albedo, at, vec4(mix(second_a.rgb, albedo.rgb, share), second_a.a));
            }
            if (differ(second_s, specular)) {
                imageStore(second_specular, at, vec4(mix(second_s.rgb, specular.rgb, share), second_s.a));
            }
            imageStore(second_radiance, at, mix(imageLoad(second_radiance, at), vec4(emitted.rgb, 0.0), share));
        } else {
            code = found_around(here, first_depth, at, push.offset, pixel);
        }
    }
    if (push.point == 0u && code != SHOWS_SECOND) {
        // Depth behind everything: passes over pixels skip it.
        imageStore(second_depth, at, vec4(NO_SURFACE));
#ifdef ELEMENTS
        imageStore(second_element, at, uvec4(0u));
#endif
    }
    imageStore(codes, at, uvec4(all | code << (4u * push.point)));
}
