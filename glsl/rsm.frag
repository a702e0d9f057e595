// Stage 4: the scene as a light sees it: position, the triangle's normal on the lit side, reflected share of the light.
// METHOD 2, thesis 5.2.
// variant rsm_inside.frag: INSIDE (where bodies are filled: also the light that enters them. METHOD 7)
#include "shared.glsl"
#include "lib/surface.glsl"
#include "lib/val_lobe.glsl"
#ifdef INSIDE
#include "lib/dipole.glsl"
#endif

layout(constant_id = 1) const uint LOBES = 0; // 1: VALs also send light in a lobe
layout(push_constant, scalar) uniform Push { DrawPush push; };

layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 3) in vec4 uv;
layout(location = 4) in vec4 color;

layout(location = 0) out vec4 out_position; // w = 1: the texel hit a surface
layout(location = 1) out vec4 out_normal; // w: shape of the lobe
layout(location = 2) out vec4 out_albedo; // w: tint of the lobe
#ifdef INSIDE
layout(binding = 15, scalar) readonly buffer Parts { uint parts[]; }; // filled part of each draw, or HOLLOW
layout(binding = 16, scalar) readonly buffer FilledParts { Filled filled[]; };
layout(location = 3) out vec4 out_inside; // share of the light that enters, part from 1, cosine of the triangle's normal
#endif

// Size of a texel in units of its positions' rounding error below which the triangle's normal is not known well enough.
const float LEAST_ROUNDINGS = 1000.0;

// Cosine of vertex normal and triangle above which they count as the same.
const float SAME = 0.9999;

void main() {
    vec3 right = dFdx(position);
    vec3 down = dFdy(position);
    vec3 geometric = cross(right, down);
    Uv here = uv_here(uv);
    vec4 base = base_color(push.material, here, color);
    if (has_holes() && base.a < materials[push.material].alpha_cutoff) {
        discard;
    }
    vec3 looking = view_direction(push.eye, position);
    // Both sides reflect. The side that faces the light decides, not the winding, which normals may contradict.
    vec3 plane = unit_of_any_or(geometric, vec3(0.0, 1.0, 0.0));
    plane = dot(plane, looking) > 0.0 ? -plane : plane;
    vec3 n = unit_or(normal, plane);
    vec3 size = abs(position);
    float rounding = 1.2e-7 * max(size.x, max(size.y, size.z));
    float side = length(geometric) / max(max(length(right), length(down)), 1e-30);
    bool is_known = side > LEAST_ROUNDINGS * rounding;
    n = (is_known ? dot(n, plane) < 0.0 : dot(n, looking) > 0.0) ? -n : n;
    // Light leaves the triangle: a vertex normal that leans away from it would light what lies behind its plane.
    vec3 facing = is_known && dot(plane, n) < SAME ? plane : n;
    // A sliver between pixel centres may come without a finite position; one such VAL would blacken every cache.
    bool is_finite = all(lessThan(abs(position), vec3(1e30))); // false for NaN
    out_position = is_finite ? vec4(position, 1.0) : vec4(0.0);
    Reflectance sent = reflectance(push.material, base.rgb, here, MEAN_COSINE);
    vec3 albedo = sent_on(sent);
    vec3 tint = vec3(0.0);
    float lobe = LOBES != 0u ? lobe_shape(sent, facing, looking, albedo, tint) : 0.0;
    out_normal = vec4(facing, lobe);
    out_albedo = vec4(albedo, packed_tint(tint));
#ifdef INSIDE
    out_inside = vec4(0.0);
    uint part = parts[push.draw - 1u];
    if (part != HOLLOW) {
        float entering = 1.0 - dielectric_fresnel(min(dot(n, looking), 0.0), filled[part].ior);
        out_inside = vec4(entering, float(part + 1u), abs(dot(unit_or(geometric, n), looking)), 0.0);
    }
#endif
}
