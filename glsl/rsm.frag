// Stage 4: what a light sees: position, normal on the lit side, diffuse albedo. METHOD 2, thesis 5.2.
#include "shared.glsl"
#include "lib/surface.glsl"

layout(push_constant, scalar) uniform Push { DrawPush push; };

layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 3) in vec4 uv;
layout(location = 4) in vec4 color;

layout(location = 0) out vec4 out_position; // w = 1: something is here
layout(location = 1) out vec4 out_normal; // w = material
layout(location = 2) out vec4 out_albedo;

void main() {
    vec4 base = base_color(push.material, uv, color);
    if (base.a < materials[push.material].alpha_cutoff) {
        discard;
    }
    vec3 n = normalize(normal);
    out_position = vec4(position, 1.0);
    out_normal = vec4(gl_FrontFacing ? n : -n, float(push.material));
    out_albedo = vec4(reflectance(push.material, base.rgb, uv).diffuse, 0.0);
}
