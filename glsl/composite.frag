// Stage 11: all radiance, exposed and tone-mapped. METHOD 1.
// variant composite_edges.frag: EDGES (where pixels have a second surface, whose light is mixed in)
// variant composite_layers.frag: LAYERS (where surfaces are seen through, whose light is mixed in)
// variant composite_edges_layers.frag: EDGES LAYERS (both)
#include "shared.glsl"
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
layout(binding = 5) uniform sampler2D second_direct;
layout(binding = 6) uniform sampler2D second_diffuse;
layout(binding = 7) uniform sampler2D second_glossy;
layout(binding = 8) uniform sampler2D second_depth;
layout(binding = 9) uniform usampler2D counts;
#endif

#ifdef LAYERS
#ifdef EDGES
layout(binding = 10) uniform sampler2D layer_depth;
#else
layout(binding = 5) uniform sampler2D layer_depth;
#endif
#endif

layout(location = 0) out vec4 out_color;

// All radiance of a pixel; the lobes that there are.
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
    // Share of the pixel that shows surfaces, where something else is to show behind them; `c` becomes theirs alone.
    float covered = 1.0;
    if (push.replaced != 0u) {
        bool first = texelFetch(depth_image, at, 0).r > 0.0;
        covered = first ? 1.0 : 0.0;
#ifdef EDGES
        uint count = texelFetch(counts, at, 0).r;
        float share = float(count >> 16u) / float((count >> 16u) + (count & 0xffffu));
        bool second = texelFetch(second_depth, at, 0).r > 0.0;
        if (share > 0.0 && first != second) {
            covered = first ? 1.0 - share : share;
            vec3 other = radiance(second_direct, second_diffuse, second_glossy, at);
            c = first ? (c - share * other) / covered : other;
        }
#endif
#ifdef LAYERS
        // The scene's own surroundings show through, whatever else is behind it.
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
        // What is transparent has no colour to mix in.
        out_color = vec4(push.behind.a == 0.0 ? color : mix(push.behind.rgb, color, covered), mix(push.behind.a, 1.0, covered));
    }
}
