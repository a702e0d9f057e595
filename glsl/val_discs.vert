// Draws VALs that carry light as discs on their surfaces, for the window's debug views: one triangle each, which
// marks.frag cuts.
#include "shared.glsl"
#include "lib/tonemap.glsl"
#include "lib/marks.glsl"

layout(push_constant, scalar) uniform Push { MarkPush push; };
layout(binding = 0, scalar) readonly buffer Vals { Val vals[]; };
layout(binding = 3, scalar) readonly buffer ValCount { uint val_count; };

layout(location = 0) flat out vec3 out_color;
layout(location = 1) out vec2 out_at;

// Least radius of a disc that faces the viewer [pixels].
const float LEAST_RADIUS = 2.0;

void main() {
    uint index = uint(gl_VertexIndex) / 3u;
    gl_Position = NOWHERE;
    out_color = vec3(0.0);
    out_at = around_disc(uint(gl_VertexIndex) % 3u);
    if (index >= val_count) {
        return;
    }
    Val val = vals[index];
    if (val.flux == vec3(0.0) || !faces(val.position, val.normal, push.eye)) {
        return;
    }
    float pixel = push.pixel * (push.clip_from_world * vec4(val.position, 1.0)).w;
    float radius = max(push.size * sqrt(val.area / 3.14159265), LEAST_RADIUS * pixel);
    gl_Position = push.clip_from_world * vec4(on_disc(val.position, val.normal, radius, out_at), 1.0);
    out_color = hue_of(val.flux);
}
