// Stage 11: sums all radiance, exposes it and tone-maps it. METHOD 1.
// variant composite_edges.frag: EDGES (where points of a pixel show more than one surface)
// variant composite_layers.frag: LAYERS (where surfaces are seen through, whose light is mixed in)
// variant composite_edges_layers.frag: EDGES LAYERS (both)
#include "shared.glsl"
#include "lib/points.glsl"
#include "lib/tonemap.glsl"

layout(constant_id = 0) const uint DIFFUSE = 1;
layout(constant_id = 1) const uint GLOSSY = 1;
layout(push_constant, scalar) uniform Push { CompositePush push; };
layout(binding = 0) uniform sampler2D direct_image;
layout(binding = 1) uniform sampler2D diffuse_image;
layout(binding = 2) uniform sampler2D glossy_image;
layout(binding = 3) uniform sampler2D depth_image;
layout(binding = 4, scalar) readonly buffer Exposure { float ev; };
#ifdef EDGES
layout(constant_id = 2) const uint POINTS = 4; // besides the centre
layout(binding = 5) uniform sampler2D first_direct; // first surfaces, before mixing
layout(binding = 6) uniform sampler2D first_diffuse;
layout(binding = 7) uniform sampler2D first_glossy;
layout(binding = 8) uniform sampler2D second_direct;
layout(binding = 9) uniform sampler2D second_diffuse;
layout(binding = 10) uniform sampler2D second_glossy;
layout(binding = 11) uniform sampler2D second_depth;
layout(binding = 12) uniform usampler2D codes_image;
#endif

#ifdef LAYERS
#ifdef EDGES
layout(binding = 13) uniform sampler2D layer_depth;
#else
layout(binding = 5) uniform sampler2D layer_depth;
#endif
#endif

layout(location = 0) out vec4 out_color;

// Radiance of a pixel: direct light and the enabled lobes.
vec3 radiance(sampler2D direct, sampler2D diffuse, sampler2D glossy, ivec2 at) {
    vec3 c = texelFetch(direct, at, 0).rgb;
    if (DIFFUSE != 0u) {
        c += texelFetch(diffuse, at, 0).rgb;
    }
    if (GLOSSY != 0u) {
        c += texelFetch(glossy, at, 0).rgb;
    }
    return c;
}

void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    vec3 c = radiance(direct_image, diffuse_image, glossy_image, at);
    // Share of the pixel covered by surfaces, if the background is replaced; `c` then becomes the radiance of the
    // surfaces alone.
    float covered = 1.0;
    if (push.replaced != 0u) {
        bool first = texelFetch(depth_image, at, 0).r > 0.0;
        covered = first ? 1.0 : 0.0;
#ifdef EDGES
        uint codes = texelFetch(codes_image, at, 0).r;
        if (codes != 0u) {
            vec4 sum = covered * vec4(radiance(first_direct, first_diffuse, first_glossy, at), 1.0);
            float points = 1.0;
            for (uint i = 0u; i < POINTS; i++) {
                uint code = shown_by(codes, i);
                if (code == SHOWS_ANOTHER) {
                    continue;
                }
                points += 1.0;
                ivec2 pixel = code < SHOWS_AROUND ? at : at + pixel_around(code - SHOWS_AROUND);
                if (code == SHOWS_SECOND) {
                    if (texelFetch(second_depth, at, 0).r > 0.0) {
                        sum += vec4(radiance(second_direct, second_diffuse, second_glossy, at), 1.0);
                    }
                } else if (texelFetch(depth_image, pixel, 0).r > 0.0) {
                    sum += vec4(radiance(first_direct, first_diffuse, first_glossy, pixel), 1.0);
                }
            }
            covered = sum.a / points;
            c = sum.rgb / max(sum.a, 1.0);
        }
#endif
#ifdef LAYERS
        // Through transparent layers the scene's own background shows, even where it is replaced.
        if (texelFetch(layer_depth, at, 0).r > 0.0) {
            covered = 1.0;
            c = radiance(direct_image, diffuse_image, glossy_image, at);
        }
#endif
    }
    vec3 color = tonemap(max(c, vec3(0.0)) * (exp2(-ev) / 1.2), push.tonemap);
    if (covered == 0.0) {
        out_color = push.behind;
    } else {
        // A fully transparent background has no colour to mix in.
        out_color = vec4(push.behind.a == 0.0 ? color : mix(push.behind.rgb, color, covered), mix(push.behind.a, 1.0, covered));
    }
}
