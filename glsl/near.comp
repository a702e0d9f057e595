// Stage 8, third: what a pixel's short rays bring. Surfaces hit add their own light and block the caches' light from that
// direction. Where caches disagree, and with ENDLESS, only the surface hit counts. METHOD 11.
// variant near_glossy.comp: GLOSSY (where a material has a glossy lobe)
// variant near_sky.comp: SKY (where caches see a sky)
// variant near_glossy_sky.comp: GLOSSY SKY (both)
#extension GL_EXT_control_flow_attributes : require
#include "lib/hit.glsl"
layout(local_size_x = 64) in;
#include "lib/near_rays.glsl"
layout(binding = 16, scalar) writeonly buffer Near { NearPixel near_pixels[]; };
#ifdef SKY
#define SKY_BINDING 29
#include "lib/sky.glsl"
#endif
layout(binding = 32, scalar) readonly buffer Rays { NearRay near_rays[]; };

#ifdef GLOSSY
// Weight of a direction's radiance in a lobe, divided by the density of directions. These are sampled by the cosine
// about the vertex normal, by `guided` rays per solid angle [1/sr], and by the lobe with this number of rays. Veach and
// Guibas 1995, balance heuristic.
float share_of(Lobe lobe, float rays, float guided, vec3 direction, vec3 n) {
    float by_cosine = float(RAYS) * max(dot(direction, n), 0.0) / PI;
    float by_lobe = lobe_density(lobe, direction);
    return lobe_weight(lobe, direction) * by_lobe / max(by_cosine + guided + rays * by_lobe, 1e-30);
}
#endif

void main() {
    uint subset;
    uvec2 at = traced_pixel(subset);
    if (at.x >= push.width || at.y >= push.height) {
        return;
    }
    NearPixel found = NearPixel(vec3(0.0), 1.0, vec3(0.0), 0.0, vec3(0.0), 0.0, vec3(0.0), 0.0, vec3(0.0), 0.0, vec3(0.0), 0.0,
                                 vec3(0.0), 0.0, vec3(0.0), vec3(0.0), vec2(0.0));
    NearSurface s;
    if (!surface_shown(at, s)) {
        near_pixels[at.y * push.width + at.x] = found;
        return;
    }
    vec3 n = s.normal;
    found.geometric = coded_normal(s.geometric);
    found.position = s.position;
    found.normal = n;
    found.open = 0.0;
    vec3 shares;
    uvec3 around = caches_about(s.instance, s.corners, s.weights, 3u, s.position, n, push.cache_reach, shares);
#ifdef SKY
    // The sky's radiance is a weight, so it is slightly above 0 everywhere.
    float least_sky = 1e-4 / PI * dot(sky_at(SKY_IRRADIANCE, n), LUMINANCE);
#endif
    uint count = RAYS + GUIDED;
#ifdef GLOSSY
    NearLobe l = lobe_shown(s);
    bool endless = l.narrow > 0.0;
    // Twice the distance between traced pixels on a plane that faces the eye [m].
    vec3 upward = vec3(push.clip_from_world[0][1], push.clip_from_world[1][1], push.clip_from_world[2][1]);
    float two = max(4.0 * float(push.every) * s.depth / (length(upward) * float(textureSize(element_image, 0).y)), 1e-30);
    if (l.rays > 0u) {
        found.nearness = endless ? 0.0 : 1.0 / push.reach;
        found.mirrored = l.lobe.mirrored;
        found.width = l.width;
    }
    float of_lobe = 1.0 / float(max(l.rays, 1u));
    count += l.rays;
#endif
    for (uint i = 0u; i < count; ++i) {
        NearRay ray = near_rays[ray_slot(i)];
        vec3 direction = ray.direction;
        bool by_lobe = i >= RAYS + GUIDED;
        if (ray.spread == 0.0) {
            continue;
        }
        // A ray below the triangle's plane was mirrored above it. The lookup of far light keeps the original direction,
        // since caches know only vertex normals.
        vec3 way = i < RAYS ? direction_about(n, i, subset) : direction;
        FarLight known = far_light(around, shares, way);
        // Where caches disagree, the ray is endless.
        vec3 far = known.unsure ? vec3(0.0) : known.radiance;
        float by_guides = dot(way, s.geometric) > 0.0 ? float(GUIDED) * known.guided : 0.0;
        float cosine = max(dot(way, n), 0.0);
        // Balance heuristic over rays about the normal and guided ones.
        float weight = cosine / max(float(RAYS) / PI * cosine + by_guides, 1e-30);
        bool hides = ray.triangle != NO_HIT;
        bool met = hides && (ray.spread < 0.0 || known.unsure || ray.distance < push.reach);
        vec3 arrives = met ? ray.start : vec3(0.0);
#ifdef SKY
        float open = sky_open(around, shares, direction);
        open = ENDLESS == 0u && !ray_decides(open) ? open : hides ? 0.0 : 1.0;
        vec3 radiance = sky_at(SKY_OF_CACHES, direction) + least_sky;
        float sky_luminance = dot(radiance, LUMINANCE);
#endif
        if (!by_lobe) {
            found.all += weight * known.radiance;
            found.far += met ? vec3(0.0) : weight * far;
            found.irradiance += weight * arrives;
#ifdef SKY
            found.all_sky += weight * radiance;
            found.open_sky += met ? vec3(0.0) : weight * open * radiance;
#endif
        }
        if (i < RAYS) {
            found.crowding += 1.0 / (float(RAYS) * max(met ? min(ray.distance, push.reach) : push.reach, 1e-30));
            found.open += met || ENDLESS == 1u ? 0.0 : 1.0 / float(RAYS);
#ifdef SKY
            found.hidden_sky += hides ? sky_luminance * vec2(1.0, 1.0 / max(ray.distance, 1e-30)) : vec2(0.0);
#endif
        }
#ifdef GLOSSY
        if (l.rays > 0u) {
            bool is_near = met && (known.unsure || ray.distance <= push.reach);
            float wide_share = l.narrow < 1.0 ? (1.0 - l.narrow) * share_of(l.lobe, float(l.rays), by_guides, direction, n) : 0.0;
            float narrow_share = by_lobe ? of_lobe * l.narrow * lobe_weight(l.lobe, direction) : 0.0;
            found.glossy += narrow_share * arrives;
            found.glossy += wide_share * (is_near ? arrives : far);
#ifdef SKY
            found.sky_all += (wide_share + narrow_share) * sky_luminance;
            found.sky += (wide_share * (is_near ? 0.0 : open) + narrow_share * (met ? 0.0 : 1.0)) * sky_luminance;
#endif
            // Nearer hits, as right in a corner, say nothing of other traced pixels.
            found.nearness += by_lobe && met && endless ? of_lobe / max(ray.distance, two) : 0.0;
        }
#endif
    }
    near_pixels[at.y * push.width + at.x] = found;
}
