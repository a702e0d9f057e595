// Direct light that a surface reflects where a ray hits it. One light is chosen with a probability in proportion to
// its unoccluded irradiance, and one ray tests its visibility. The mean over many rays is the sum over all lights. Uses
// binding 12. Twin: src/reference/near.rs.
#ifndef HIT_LIGHT_GLSL
#define HIT_LIGHT_GLSL
#include "lib/hit.glsl"
#include "lib/form_factor.glsl"
#include "lib/light.glsl"
#include "lib/area_light.glsl"

layout(binding = 12, scalar) readonly buffer HitLights { Light hit_lights[]; };

// Random point of a polygon, uniform over its area; `chance`: two numbers in [0, 1). `whole`: twice the polygon's area.
vec3 point_of(SeenPart part, vec2 chance, out float whole) {
    vec3 a = part.corners[0];
    whole = 0.0;
    for (int i = 2; i < part.count; ++i) {
        whole += length(cross(part.corners[i - 1] - a, part.corners[i] - a));
    }
    float pick = chance.x * whole;
    int i = 2;
    float area = 0.0;
    for (; i < part.count; ++i) {
        area = length(cross(part.corners[i - 1] - a, part.corners[i] - a));
        if (pick < area || i + 1 == part.count) {
            break;
        }
        pick -= area;
    }
    float root = sqrt(area > 0.0 ? min(pick / area, 1.0) : 0.0);
    return mix(a, mix(part.corners[i - 1], part.corners[i], chance.y), root);
}

// Most light of a point of an area light, relative to the mean of its points: very near to a light few points give most.
const float MOST_OF_POINT = 8.0;

// Irradiance [lx] from a light at a surface, without occlusion.
vec3 light_irradiance(Light light, HitSurface s) {
    vec3 to = light.position - s.position;
    if (light.kind == LIGHT_AREA) {
        if (dot(to, light.direction) >= 0.0) {
            return vec3(0.0);
        }
        SeenPart part = above_horizon(to, light.right, light.up, s.normal);
        return part.count < 3 ? vec3(0.0) : light.intensity * (PI * polygon_form_factor(part, s.normal));
    }
    vec3 towards = -light.direction;
    vec3 irradiance = light.intensity;
    if (light.kind != LIGHT_DIRECTIONAL) {
        float d2 = max(dot(to, to), 1e-30);
        towards = to * inversesqrt(d2);
        irradiance *= range_window(d2, light.range) / d2;
        if (light.kind == LIGHT_SPOT) {
            irradiance *= spot_falloff(-dot(towards, light.direction), light.cone_scale, light.cone_offset);
        } else if (light.kind == LIGHT_BODY) {
            irradiance *= body_falloff(-towards, light.right, light.up, light.lean);
        }
    }
    return dot(s.geometric, towards) > 0.0 ? irradiance * max(dot(s.normal, towards), 0.0) : vec3(0.0);
}

// BRDF [1/sr] of a surface for a ray along the unit vector `looking` and light from `towards`. Narrow lobes are widened,
// because few rays meet them. `share`: factor for the glossy lobe.
vec3 brdf_at(HitSurface s, vec3 looking, vec3 towards, float share) {
    vec3 diffuse, glossy;
    reflected_from(s.lobes, -dot(s.normal, looking), diffuse, glossy);
    float coded = s.lobes.coded;
    float a2 = LEAST_LOBE * LEAST_LOBE * LEAST_LOBE * LEAST_LOBE;
    vec3 lobe = coded < 0.0
        ? ggx_lobe(s.lobes.glossy, coded_f90(coded), max(coded_roughness(coded), LEAST_LOBE), s.normal, looking, towards)
        : s.lobes.glossy * phong_lobe(min(coded, 0.5 / a2 - 0.5), dot(reflect(looking, s.normal), towards));
    return diffuse / PI + share * lobe;
}

// A ray that tests whether light arrives at a surface.
struct LightRay {
    vec3 way; // of any length
    float far; // where it ends, in lengths of `way`
    uint passed; // kinds of surface that it passes
    vec3 radiance; // that the surface reflects if nothing is between it and the light [cd/m^2]; 0: no ray is needed
};

// Radiance [cd/m^2] that a surface reflects of the light at the end of a ray.
vec3 reflected_along(LightRay ray, HitSurface s, uint root) {
    if (ray.radiance == vec3(0.0)) {
        return vec3(0.0);
    }
    float lift = lift_at(s.position, 0.0);
    vec3 start = s.position + s.geometric * lift;
    float from = lift * inversesqrt(max(dot(ray.way, ray.way), 1e-30));
    Hit blocker = trace(start, ray.way, from, ray.far, root, ray.passed, true);
    return blocker.triangle == NO_HIT ? ray.radiance : vec3(0.0);
}

// The ray to a light that would give a surface this irradiance [lx] if nothing were between them; `looking`: the unit
// direction in which the surface is seen. `chance`: two numbers in [0, 1) that select a point of the light.
LightRay ray_to(Light light, vec3 given, HitSurface s, vec3 looking, vec2 chance) {
    vec3 start = s.position + s.geometric * lift_at(s.position, 0.0);
    LightRay ray = LightRay(-light.direction, 3e38, 0u, vec3(0.0));
    float share = 1.0;
    if (light.kind == LIGHT_AREA) {
        // A point above the horizon: all irradiance comes from there.
        SeenPart part = above_horizon(light.position - s.position, light.right, light.up, s.normal);
        float whole;
        ray.way = s.position + point_of(part, chance, whole) - start;
        ray.far = 0.9999;
        ray.passed = RAY_AREA_LIGHT;
        if (dot(ray.way, s.geometric) <= 0.0 || dot(ray.way, light.direction) >= 0.0) {
            return ray;
        }
        // The irradiance is that of the whole rectangle. The lobe sees the point, which gives more of it or less.
        float d2 = dot(ray.way, ray.way);
        float of_point = max(dot(ray.way, s.normal), 0.0) * -dot(ray.way, light.direction) / (d2 * d2);
        share = min(0.5 * whole * of_point / max(PI * polygon_form_factor(part, s.normal), 1e-6), MOST_OF_POINT);
    } else if (light.kind != LIGHT_DIRECTIONAL) {
        ray.way = light.position - start;
        ray.far = 0.99999 - light.clear / max(length(ray.way), 1e-30);
    }
    ray.radiance = brdf_at(s, looking, normalize(ray.way), share) * given;
    return ray;
}

// The ray to one of all lights except `left_out` consecutive ones; `looking`: the unit direction in which the surface is
// seen. `chance`: three numbers in [0, 1) that select a light and a point on it.
LightRay ray_to_some(HitSurface s, vec3 looking, uint light_count, uint first_left_out, uint left_out, vec3 chance) {
    const vec3 LUMINANCE = vec3(0.2126, 0.7152, 0.0722);
    float total = 0.0;
    float own = 0.0;
    uint chosen = 0u;
    vec3 given = vec3(0.0);
    float pick = chance.x;
    for (uint at = 0u; at < light_count - left_out; ++at) {
        uint i = at < first_left_out ? at : at + left_out;
        vec3 e = light_irradiance(hit_lights[i], s);
        float weight = dot(e, LUMINANCE);
        if (weight > 0.0) {
            total += weight;
            // This light replaces the previous choice with probability `share`. `pick` is rescaled for the next.
            float share = weight / total;
            if (pick < share) {
                pick /= share;
                chosen = i;
                given = e;
                own = weight;
            } else {
                pick = (pick - share) / max(1.0 - share, 1e-6);
            }
            pick = clamp(pick, 0.0, 0.999999);
        }
    }
    LightRay ray = LightRay(vec3(0.0), 0.0, 0u, vec3(0.0));
    if (own > 0.0) {
        ray = ray_to(hit_lights[chosen], given, s, looking, chance.yz);
        ray.radiance *= total / own;
    }
    return ray;
}

#endif
