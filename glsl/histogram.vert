// Stage 5, fragment way: every reference of a visible vertex becomes a point of depth 1 at its cache's texel.
// METHOD 9, thesis 6.1.3.
#include "shared.glsl"
#include "lib/atlas.glsl"

layout(constant_id = 0) const uint REFERENCES = 8;
layout(push_constant, scalar) uniform Push { AtlasPush push; };

layout(binding = 0, scalar) readonly buffer Visible { VisibleVertex visible[]; };

#include "lib/references.glsl"

void main() {
    VisibleVertex v = visible[gl_VertexIndex / REFERENCES];
    uint cache = referred_cache(draws[v.draw], v.vertex, gl_VertexIndex % REFERENCES);
    vec2 texel = vec2(atlas_texel(cache, push.columns)) - vec2(atlas_left(push.columns), 0.0);
    vec2 at = (texel + 0.5) / vec2(8u * push.columns, push.rows) * 2.0 - 1.0;
    gl_Position = cache == NO_REFERENCES ? vec4(2.0, 2.0, 2.0, 1.0) : vec4(at, 1.0, 1.0);
    gl_PointSize = 1.0;
}
