// Stage 4: the scene as a light sees it: position, normal on the lit side, reflected share of the light. METHOD 2,
// thesis 5.2.
// variant rsm_inside.frag: INSIDE (where bodies are filled: also the light that enters them. METHOD 7)
#include "shared.glsl"
#include "lib/surface.glsl"
#ifdef INSIDE
#include "lib/dipole.glsl"
#endif

layout(push_constant, scalar) uniform Push { DrawPush push; };

layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 3) in vec4 uv;
layout(location = 4) in vec4 color;

layout(location = 0) out vec4 out_position; // w = 1: the texel hit a surface
layout(location = 1) out vec4 out_normal; // w = material
layout(location = 2) out vec4 out_albedo;
#ifdef INSIDE
layout(binding = 15, scalar) readonly buffer Parts { uint parts[]; }; // filled part of each draw, or HOLLOW
layout(binding = 16, scalar) readonly buffer FilledParts { Filled filled[]; };
layout(location = 3) out vec4 out_inside; // share of the light that enters, part from 1, cosine of the triangle's normal
#endif

void main() {
    vec3 geometric = cross(dFdx(position), dFdy(position));
    Uv here = uv_here(uv);
    vec4 base = base_color(push.material, here, color);
    if (has_holes() && base.a < materials[push.material].alpha_cutoff) {
        discard;
    }
    // Image rows run downwards: the cross product points away from the light.
    vec3 n = unit_or(normal, unit_or(-geometric, vec3(0.0, 1.0, 0.0)));
    // Both sides reflect. The side that faces the light decides, not the winding, which normals may contradict.
    n = dot(n, view_direction(push.eye, position)) > 0.0 ? -n : n;
    // A sliver between pixel centres may come without a valid position; one such VAL would blacken every cache.
    out_position = any(isnan(position)) ? vec4(0.0) : vec4(position, 1.0);
    out_normal = vec4(n, float(push.material));
    out_albedo = vec4(sent_on(reflectance(push.material, base.rgb, here, MEAN_COSINE)), 0.0);
#ifdef INSIDE
    out_inside = vec4(0.0);
    uint part = parts[push.draw - 1u];
    if (part != HOLLOW) {
        vec3 looking = view_direction(push.eye, position);
        float entering = 1.0 - dielectric_fresnel(dot(n, looking), filled[part].ior);
        out_inside = vec4(entering, float(part + 1u), abs(dot(unit_or(geometric, n), looking)), 0.0);
    }
#endif
}
