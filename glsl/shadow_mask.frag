// Shadow maps of alpha-masked materials: light passes through holes.
#include "shared.glsl"
#include "lib/surface.glsl"

layout(push_constant, scalar) uniform Push { DrawPush push; };
layout(location = 3) in vec4 uv;
layout(location = 4) in vec4 color;

void main() {
    if (base_color(push.material, uv_here(uv), color).a < materials[push.material].alpha_cutoff) {
        discard;
    }
}
