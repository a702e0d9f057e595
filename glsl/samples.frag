// Stage 1, edges: draw and normal of the surface at every sample of a pixel. METHOD 13.
// variant samples_holes.frag: HOLES (materials with an alpha mask, which every sample tests)
#include "shared.glsl"
#include "lib/octahedral.glsl"
#include "lib/surface.glsl"

layout(push_constant, scalar) uniform Push { DrawPush push; };

layout(location = 0) in vec3 raster_position;
layout(location = 1) in vec3 normal;
#ifdef HOLES
layout(location = 3) in vec4 uv;
layout(location = 4) in vec4 color;
#endif

layout(location = 0) out vec2 out_sample; // draw from 1; coded normal

void main() {
#ifdef HOLES
    Uv here = uv_here(uv);
    int covered = 0;
    for (uint i = 0u; i < 4u; i++) {
        float alpha = base_color(push.material, uv_at_sample(here, i), color).a;
        covered |= alpha < materials[push.material].seen_cutoff ? 0 : 1 << i;
    }
    gl_SampleMask[0] = covered;
#endif
    vec3 position = any(isnan(raster_position)) ? push.eye.xyz + vec3(0.0, 0.0, 1.0) : raster_position;
    vec3 facing = facing_normal(dFdx(position), dFdy(position), normal, -view_direction(push.eye, position));
    out_sample = vec2(float(push.draw), coded_normal(facing));
}
