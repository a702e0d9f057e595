// Draws caches as discs on their surfaces, for the window's debug views: one triangle each, which marks.frag cuts.
#include "shared.glsl"
#include "lib/tonemap.glsl"
#include "lib/marks.glsl"

layout(push_constant, scalar) uniform Push { MarkPush push; };
layout(binding = 0, scalar) readonly buffer Caches { Cache caches[]; };
layout(binding = 3, scalar) readonly buffer Live { uint live[]; };
layout(binding = 4, scalar) readonly buffer Args { LiveArgs args; };
layout(binding = 5, scalar) readonly buffer Proxies { Proxy proxies[]; };

layout(location = 0) flat out vec3 out_color;
layout(location = 1) out vec2 out_at;

const float PI = 3.14159265;

void main() {
    uint index = uint(gl_VertexIndex) / 3u;
    gl_Position = NOWHERE;
    out_color = vec3(0.0);
    out_at = around_disc(uint(gl_VertexIndex) % 3u);
    if (push.live != 0u) {
        if (index >= args.cache_count) {
            return;
        }
        index = live[index];
    }
    Cache cache = caches[index];
    if (cache.area <= 0.0 || !faces(cache.position, cache.normal, push.eye)) {
        return;
    }
    gl_Position = push.clip_from_world * vec4(on_disc(cache.position, cache.normal, push.size * cache.radius, out_at), 1.0);
    if (push.how == MARK_LIGHT) {
        // What a white diffuse surface reflects.
        vec3 towards = normalize(proxies[index].diffuse_position - cache.position);
        out_color = proxies[index].diffuse_irradiance * dot(cache.normal, towards) / PI;
    } else if (push.how == MARK_DARK) {
        out_color = vec3(0.1);
    } else {
        // Neighbouring caches get very different hues: steps of the golden ratio around the hue circle.
        float hue = fract(float(index) * 0.61803399);
        vec3 saturated = clamp(abs(fract(hue + vec3(0.0, 2.0 / 3.0, 1.0 / 3.0)) * 6.0 - 3.0) - 1.0, 0.0, 1.0);
        out_color = saturated * 0.85 + 0.15;
    }
}
