// Stage 8, before layers are mixed: what bodies of glass show. A ray follows the light through the body and whatever glass
// is behind it, to a surface or the sky. The surface is lit where the ray meets it. The result replaces the light of the
// surfaces straight behind the layer. METHOD 15. Twin: src/reference/path_trace/seen.rs.
// variant refract_lit.frag: LIT (where caches are lit by each other)
// variant refract_lit_sky.frag: LIT SKY (where they also see a sky)
#extension GL_EXT_control_flow_attributes : require
#define LOOKS
#include "lib/hit_light.glsl"
#include "lib/octahedral.glsl"

layout(push_constant, scalar) uniform Push { RefractPush push; };
layout(binding = 13) uniform sampler2D depth_image; // of the layer, as the next three
layout(binding = 14) uniform sampler2D normal_image;
layout(binding = 15) uniform sampler2D albedo_image;
layout(binding = 16) uniform sampler2D specular_image;
layout(binding = 17) uniform sampler2D through_image; // alpha is negative where the layer bends light
#define SKY_BINDING 18
#include "lib/sky_grid.glsl"
#ifdef LIT
layout(constant_id = 4) const uint REFERENCES = 8;
layout(constant_id = 5) const uint BY_CELLS = 0; // 1: references are stored per cell
layout(binding = 19, scalar) readonly buffer Caches { Cache caches[]; };
#define REFERENCE_BINDINGS 20
#include "lib/hit_caches.glsl"
layout(binding = 25, scalar) readonly buffer CacheVals { Val cache_vals[]; };
layout(binding = 26, scalar) readonly buffer Albedos { vec3 albedos[]; }; // of the caches
#endif
#ifdef SKY
layout(binding = 27, scalar) readonly buffer Seen { SkySeen seen[]; }; // per cache
#endif

layout(location = 0) out vec4 out_direct;
// There are images for these only with indirect light, and with glossy surfaces.
layout(location = 1) out vec4 out_diffuse;
layout(location = 2) out vec4 out_glossy;

// Surfaces that a ray meets, at most, with those that it leaves a body through.
const uint MOST_MET = 64u;

// Points of an area light that shine on a surface.
const uint AREA_POINTS = 6u;

// Least albedo of a cache that tells how much light arrives there.
const float LEAST_ALBEDO = 0.02;

const uint NO_BODY = 0xffffffffu;

// Direction of light behind a surface between media with this ratio of indices; zero if all is reflected. Where the
// normal would bend it back, the triangle's normal counts.
vec3 bent(vec3 direction, vec3 normal, vec3 geometric, float ratio) {
    if (dot(direction, normal) >= 0.0) {
        return refract(direction, geometric, ratio);
    }
    vec3 d = refract(direction, normal, ratio);
    return dot(d, d) == 0.0 || dot(d, geometric) < 0.0 ? d : refract(direction, geometric, ratio);
}

// Direction of light that a surface reflects back into a body.
vec3 mirrored(vec3 direction, vec3 normal, vec3 geometric) {
    vec3 d = reflect(direction, normal);
    return dot(d, geometric) > 0.0 ? d : reflect(direction, geometric);
}

// Thickness of a body at a hit on its surface [m].
float thickness(uint material, uint instance) {
    float scale = pow(abs(determinant(mat3(hit_instances[instance].world_from_model))), 1.0 / 3.0);
    return materials[material].thickness * min(scale, 1e9);
}

// Emitted radiance [cd/m^2] and that of lights, reflected along a ray.
vec3 direct_light(HitSurface s, vec3 looking) {
    vec3 sum = s.emission;
    for (uint at = 0u; at < push.light_count - push.sky_light_count; ++at) {
        Light light = hit_lights[at < push.first_sky_light ? at : at + push.sky_light_count];
        vec3 given = light_irradiance(light, s);
        if (given != vec3(0.0)) {
            uint points = light.kind == LIGHT_AREA ? AREA_POINTS : 1u;
            for (uint i = 0u; i < points; ++i) {
                vec2 chance = fract(0.5 + float(i) * vec2(0.7548776662, 0.5698402910));
                sum += reflected_along(ray_to(light, given / float(points), s, looking, chance), s, push.root);
            }
        }
    }
    return sum;
}

#ifdef LIT
// Radiance [cd/m^2] that a surface reflects of the light of its caches; `of_sky`: of the sky itself.
vec3 cache_light(Hit hit, HitSurface s, vec3 direction, out vec3 of_sky) {
    of_sky = vec3(0.0);
    uvec3 v = corners_hit(hit, direction) - hit_instances[hit.instance].drawn_vertex;
    vec3 w = vec3(1.0 - hit.weights.x - hit.weights.y, hit.weights);
    vec3 shares;
    uvec3 at = caches_about(hit.instance, v, w, 3u, s.position, s.normal, push.cache_reach, shares);
    if (at.x == NO_REFERENCES) {
        return vec3(0.0);
    }
    shares = seen_weights(at, shares, s.position, s.geometric, push.seen_lift, push.root, false);
    vec3 sum = vec3(0.0);
    for (uint i = 0u; i < 3u; ++i) {
        if (shares[i] == 0.0) {
            continue;
        }
#ifdef SKY
        vec3 sky = s.diffuse / PI * seen[at[i]].irradiance;
        of_sky += shares[i] * sky;
#endif
        // What the cache sends on, with this surface's albedo instead of its own.
        Val val = cache_vals[at[i]];
        vec3 ratio = s.diffuse / max(albedos[at[i]], vec3(LEAST_ALBEDO));
        vec3 sent = val.flux / max(PI * val.area, 1e-30) * ratio;
#ifdef SKY
        sent -= albedos[at[i]] * ratio / PI * seen[at[i]].irradiance;
#endif
        sum += shares[i] * max(sent, vec3(0.0));
    }
    return sum;
}
#endif

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    float depth = texelFetch(depth_image, pixel, 0).r;
    // Devices may run the rest for discarded pixels, too: these must not begin the loop.
    bool ends = depth == 0.0 || texelFetch(through_image, pixel, 0).a >= 0.0;
    if (ends) {
        discard;
    }
    vec2 pixels = vec2(textureSize(depth_image, 0));
    vec4 place = push.world_from_clip * vec4(gl_FragCoord.xy / pixels * 2.0 - 1.0, depth, 1.0);
    vec4 beside = place + push.world_from_clip * vec4(2.0 / pixels.x, 0.0, 0.0, 0.0);
    vec3 position = place.xyz / place.w;
    vec3 direction = view_direction(push.eye, position);
    float width = distance(beside.xyz / beside.w, position);
    float from_eye = push.eye.w == 0.0 ? 3e38 : distance(push.eye.xyz, position);
    // The first hit is the layer itself, which has the light of its surface already.
    float margin = 10.0 * lift_at(position, min(from_eye, 1e30));
    vec3 origin = position - margin * direction;
    float from = 0.0;
    float gone = 0.0; // behind the layer [m]
    vec3 share = vec3(1.0);
    vec3 direct = vec3(0.0);
    vec3 diffuse = vec3(0.0);
    uint body = NO_BODY;
    float body_thickness = 0.0;
    bool first = true;
    for (uint i = 0u; i < MOST_MET && !ends; ++i) {
        looks = true;
        Hit hit = trace(origin, direction, from, 3e38, push.root, 0u, false);
        looks = false;
        if (hit.triangle == NO_HIT) {
            if (push.sky_width > 0u) {
                direct += share * sky_value(SkyLevel(0u, push.sky_width, push.sky_height, push.sky_turn), direction);
            }
            break;
        }
        uint what = floatBitsToUint(ray_triangle(3u * hit.triangle + 2u).w);
        bool two_sided = (what & RAY_TWO_SIDED) != 0u;
        bool front;
        vec3 geometric = hit_geometric(hit, direction, front);
        uint material = floatBitsToUint(ray_triangle(3u * hit.triangle + 1u).w);
        bool leaves = material == body && (two_sided || !front);
        // A viewer sees front sides alone. A body's own front sides within it mean nothing.
        if ((!front && !leaves) || (front && material == body && !two_sided)) {
            from = hit.distance * 1.000001 + lift_at(origin, 0.0);
            continue;
        }
        vec3 met = origin + hit.distance * direction;
        if (body != NO_BODY) {
            // Behind a surface that has no other side, the body is as thick as the file says.
            share *= exp(-materials[body].attenuation * (leaves ? hit.distance : min(hit.distance, body_thickness)));
        }
        float within = body == NO_BODY ? 1.0 : max(materials[body].ior, 1.0);
        gone += hit.distance;
        Material m = materials[material];
        bool clear = m.blend != 0u || m.transmission > 0.0;
        bool bends = m.thickness > 0.0 && m.transmission > 0.0;
        vec3 normal = hit_normal(hit, geometric);
        if (first) {
            bends = true;
            normal = texelFetch(normal_image, pixel, 0).xyz;
            geometric = octahedral_decode(vec2(texelFetch(albedo_image, pixel, 0).a, texelFetch(specular_image, pixel, 0).a));
        }
        // A loop, since devices that run both sides of an `if` leave out only loops.
        for (bool shows = !first && !leaves; shows; shows = false) {
            float spread = width * (1.0 + gone / from_eye) / max(hit.distance, 1e-30);
            HitSurface s = surface_at(hit, origin, direction, spread);
            vec3 own = share;
            if (clear) {
                float alpha = m.blend != 0u ? clamp(s.alpha, 0.0, 1.0) : 1.0;
                float passes = m.transmission;
                vec3 under, glossy;
                reflected_from(s.lobes, -dot(s.normal, direction), under, glossy);
                own *= alpha;
                share *= 1.0 - alpha + alpha * passes * under;
                s.lobes.diffuse *= 1.0 - passes;
                s.diffuse = sent_on(s.lobes);
            }
            direct += own * direct_light(s, direction);
#ifdef LIT
            vec3 of_sky;
            diffuse += own * cache_light(hit, s, direction, of_sky);
            direct += own * of_sky;
#endif
            ends = !clear;
        }
        first = false;
        origin = met;
        from = lift_at(met, 0.0);
        if (leaves || (clear && bends)) {
            float ratio = leaves ? within : within / max(m.ior, 1.0);
            vec3 d = bent(direction, normal, geometric, ratio);
            bool passes = dot(d, d) > 0.0;
            direction = normalize(passes ? d : mirrored(direction, normal, geometric));
            if (passes) {
                body = leaves ? NO_BODY : material;
                body_thickness = thickness(material, hit.instance);
            }
        }
    }
    out_direct = vec4(direct, 0.0);
    out_diffuse = vec4(diffuse, 0.0);
    out_glossy = vec4(0.0);
}
