// Stage 4 for area lights, where rays can be traced: one ray per VAL, each from another point of the light, distributed by
// the cosine. A few viewpoints would not do: a frame or a shade close to a light hides some points of it and not others.
// METHOD 2. Twin: src/reference/area_light.rs.
#extension GL_EXT_control_flow_attributes : require
#include "lib/hit_light.glsl"
#include "lib/val_lobe.glsl"

layout(local_size_x = 64) in;
layout(constant_id = 4) const uint IRRADIANCE_WEIGHTS = 1; // else form-factor weights
layout(constant_id = 5) const uint LOBES = 0; // 1: VALs also send light in a lobe
layout(push_constant, scalar) uniform Push { AreaValsPush push; };
layout(binding = 13, scalar) writeonly buffer Vals { Val vals[]; };
layout(binding = 14, scalar) writeonly buffer Flags { uint flags[]; }; // 1 for VALs with light or weight

// Cosine of vertex normal and triangle above which they count as the same.
const float SAME = 0.9999;

// If an area light fills more than 1 - UNDER of a surface's view, less and less of the surface's light gets past it.
const float UNDER = 0.05;

// Lower bound of the light's form factor at a surface: limits the area of a VAL.
const float LEAST_FACTOR = 1e-6;

// Point `i` of three evenly spread sequences in [0, 1): multiples of irrational numbers, in units of 2^-32 so that they
// stay exact.
vec3 spread_point(uint i) {
    return vec3(uvec3(i) * uvec3(3518319155u, 2882110345u, 2360945575u)) * (1.0 / 4294967296.0);
}

void main() {
    uint i = gl_GlobalInvocationID.y * AREA_VALS_ROW + gl_GlobalInvocationID.x;
    if (i >= push.count) {
        return;
    }
    Light light = hit_lights[push.light];
    vec3 spread = spread_point(i);
    vec3 start = light.position + light.right * (2.0 * spread.x - 1.0) + light.up * (2.0 * spread.y - 1.0);
    float square = (float(i) + 0.5) / float(push.count);
    float turn = TWO_PI * spread.z;
    vec3 direction = sqrt(square) * (cos(turn) * normalize(light.right) + sin(turn) * normalize(light.up))
        + sqrt(1.0 - square) * light.direction;
    Hit hit = trace(start, direction, lift_at(start, 0.0), 3e38, push.root, RAY_AREA_LIGHT, false);

    // Each ray carries the same part of the light.
    float part = 4.0 * length(cross(light.right, light.up)) / float(push.count);
    Val val = Val(start, 1.0, vec3(0.0), 0u, vec3(0.0), 0.0);
    if (hit.triangle != NO_HIT) {
        HitSurface s = surface_at(hit, start, direction, sqrt(PI / float(push.count)));
        // As in rsm.frag: light leaves the triangle.
        val.normal = dot(s.normal, s.geometric) < SAME ? s.geometric : s.normal;
        val.position = s.position;
        vec3 to = light.position - s.position;
        // So much surface, square to the light, receives this part of the light if nothing occludes it.
        vec3 facing = unit_or(to, -direction);
        float factor = polygon_form_factor(above_horizon(to, light.right, light.up, facing), facing);
        val.area = part / max(factor, LEAST_FACTOR);
        vec3 entering = light.intensity * (PI * part);
        // A surface directly under the light reflects light back to it. If it is so close that depth images cannot tell
        // both apart, the light covers it.
        float under = polygon_form_factor(above_horizon(to, light.right, light.up, val.normal), val.normal);
        float past = min((1.0 - under) / UNDER, 1.0);
        vec2 foot = abs(vec2(dot(to, light.right), dot(to, light.up)));
        bool is_below = all(lessThan(foot, vec2(dot(light.right, light.right), dot(light.up, light.up))));
        past *= is_below ? min(-dot(to, light.direction) / push.close, 1.0) : 1.0;
        vec3 albedo = s.diffuse;
        vec3 tint = vec3(0.0);
        val.kind = LOBES != 0u ? floatBitsToUint(lobe_shape(s.lobes, val.normal, direction, albedo, tint)) : 0u;
        val.flux = albedo * entering * past;
        float luminance = dot(val.flux, vec3(0.2126, 0.7152, 0.0722));
        val.weight = IRRADIANCE_WEIGHTS != 0u ? luminance : val.area;
        if (val.kind != 0u) {
            val.weight = packed_flux(tint * entering * past);
        }
    }
    vals[push.first + i] = val;
    flags[push.first + i] = val.weight != 0.0 || val.flux != vec3(0.0) ? 1u : 0u;
}
