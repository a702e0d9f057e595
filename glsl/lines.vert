// Draws a line from each live cache towards its diffuse proxy light, for the window's debug views. marks.frag blackens
// its beginning.
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

void main() {
    uint index = uint(gl_VertexIndex) / 2u;
    gl_Position = NOWHERE;
    out_color = vec3(0.0);
    float way_done = float(gl_VertexIndex & 1);
    out_at = vec2(1.0 - way_done, 0.0);
    if (index >= args.cache_count) {
        return;
    }
    index = live[index];
    Cache cache = caches[index];
    Proxy proxy = proxies[index];
    if (cache.area <= 0.0 || proxy.diffuse_irradiance == vec3(0.0) || !faces(cache.position, cache.normal, push.eye)) {
        return;
    }
    vec3 way = proxy.diffuse_position - cache.position;
    // Ends at the proxy, if that is near.
    float share = min(push.size * cache.radius / length(way), 1.0);
    vec3 at = cache.position + share * way_done * way;
    gl_Position = push.clip_from_world * vec4(at, 1.0);
    out_color = hue_of(proxy.diffuse_irradiance);
}
