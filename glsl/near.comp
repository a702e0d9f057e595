// Stage 8, first: short rays from visible surfaces, one cache spacing long. Surfaces hit add their own light and block
// the caches' light from that direction. A pixel has few rays. A square of NEAR_SIDE^2 pixels has all directions, which
// the next pass combines. A glossy lobe has one more ray. METHOD 11.
// variant near_glossy.comp: GLOSSY (where a material has a glossy lobe)
// variant near_lit.comp: LIT (where surfaces hit also reflect the light of caches)
// variant near_glossy_lit.comp: GLOSSY LIT (both)
// variant near_sky.comp: SKY (where caches see a sky)
// variant near_glossy_sky.comp: GLOSSY SKY (where caches see a sky)
// variant near_lit_sky.comp: LIT SKY (where caches see a sky)
// variant near_glossy_lit_sky.comp: GLOSSY LIT SKY (where caches see a sky)
#extension GL_EXT_control_flow_attributes : require
#include "lib/hit_light.glsl"
#include "lib/triangle.glsl"
#include "lib/depth_image.glsl"
#include "lib/directions.glsl"
#include "lib/tile.glsl"
#ifdef GLOSSY
#include "lib/lobe.glsl"
#endif

layout(local_size_x = 64) in;
layout(constant_id = 4) const uint RAYS = 8; // per pixel
layout(push_constant, scalar) uniform Push { TracePush push; };
layout(binding = 13) uniform usampler2D element_image;
layout(binding = 14, scalar) readonly buffer Draws { DrawRecord draws[]; };
layout(binding = 15, scalar) readonly buffer Directions { vec3 directions[]; }; // about +z, with cosine density
layout(binding = 16, scalar) writeonly buffer Near { NearPixel near_pixels[]; };
layout(constant_id = 5) const uint REFERENCES = 8;
layout(constant_id = 6) const uint BY_CELLS = 0; // 1: references are stored per cell
layout(binding = 17, scalar) readonly buffer Radiances { uint radiances[]; }; // per cache and direction [cd/m^2]
layout(binding = 18, scalar) readonly buffer Caches { Cache caches[]; };
#define REFERENCE_BINDINGS 19
#include "lib/hit_caches.glsl"
#ifdef GLOSSY
layout(binding = 24) uniform sampler2D normal_image;
layout(binding = 25) uniform sampler2D specular_image;
#define NEXT_BINDING 26
#else
#define NEXT_BINDING 24
#endif
#ifdef LIT
layout(binding = NEXT_BINDING, scalar) readonly buffer CacheVals { Val cache_vals[]; };
#define SKY_FIRST (NEXT_BINDING + 1)
#else
#define SKY_FIRST NEXT_BINDING
#endif
#ifdef SKY
layout(binding = SKY_FIRST, scalar) readonly buffer Seen { SkySeen seen[]; }; // per cache
layout(binding = SKY_FIRST + 1, scalar) readonly buffer Open { uint open_parts[]; }; // open quarters, 8 bits each
#define SKY_BINDING SKY_FIRST + 2
#include "lib/sky.glsl"
#ifdef LIT
layout(binding = SKY_FIRST + 4, scalar) readonly buffer Albedos { vec3 albedos[]; }; // of the caches
#endif
#endif

// Radiance [cd/m^2] from far surfaces in a direction: weighted sum over the caches `at` with weights `w`.
vec3 far_radiance(uvec3 at, vec3 w, vec3 direction) {
    uint index = direction_index(direction);
    vec3 sum = vec3(0.0);
    for (uint i = 0u; i < 3u; ++i) {
        sum += at[i] == NO_REFERENCES ? vec3(0.0) : w[i] * unpack_radiance(radiances[at[i] * DIRECTIONS + index]);
    }
    return sum;
}

#ifdef SKY
// Share of a direction that is open to the sky, by the caches `at` with weights `w`. Without caches nothing is known: a
// half.
float sky_open(uvec3 at, vec3 w, vec3 direction) {
    uint index = direction_index(direction);
    if (at.x == NO_REFERENCES) {
        return 0.5;
    }
    float sum = 0.0;
    for (uint i = 0u; i < 3u; ++i) {
        if (at[i] != NO_REFERENCES) {
            uint parts = open_parts[at[i] * (DIRECTIONS / 4u) + index / 4u] >> (8u * (index % 4u)) & 0xffu;
            sum += 0.25 * w[i] * float(parts);
        }
    }
    return sum;
}
#endif

#if defined(LIT) || defined(SKY)
// Radiance [cd/m^2] that a point reflects of the light its caches receive: of their bounced light if LIT, of the sky if
// SKY. With `first` one cache is enough, as for one of many rays that are averaged.
vec3 cache_radiance(Hit hit, HitSurface s, vec3 direction, bool first) {
    uvec3 v = corners_hit(hit, direction) - hit_instances[hit.instance].drawn_vertex;
    vec3 w = vec3(1.0 - hit.weights.x - hit.weights.y, hit.weights);
    vec3 shares;
    uvec3 at = caches_about(hit.instance, v, w, 1u, s.position, s.normal, push.cache_reach, shares);
    if (at.x == NO_REFERENCES) {
        return vec3(0.0);
    }
    shares = seen_weights(at, shares, s.position, s.geometric, push.seen_lift, push.root, first);
    vec3 sum = vec3(0.0);
    for (uint i = 0u; i < 3u; ++i) {
        if (shares[i] == 0.0) {
            continue;
        }
        vec3 own = vec3(0.0);
#ifdef LIT
        Val val = cache_vals[at[i]];
        own += val.flux / max(PI * val.area, 1e-30);
#endif
#ifdef SKY
        vec3 albedo = s.diffuse;
#ifdef LIT
        // This flux includes the sky's light, reflected with the cache's albedo.
        albedo -= albedos[at[i]];
#endif
        own += push.reflects != 0u ? albedo / PI * seen[at[i]].irradiance : vec3(0.0);
#endif
        sum += shares[i] * max(own, vec3(0.0));
    }
    return sum;
}
#endif

// Radiance [cd/m^2] of the surface that a ray hits. `spread`: width of the ray's cone by distance; `number` selects the
// light; `first`: as above.
vec3 met_radiance(Hit hit, vec3 start, vec3 direction, float spread, uint number, bool first) {
    HitSurface s = surface_at(hit, start, direction, spread);
    vec3 chance = fract(0.5 + float(number) * vec3(0.8191725134, 0.6710436067, 0.5497004779));
    vec3 sum = s.emission;
    if (push.reflects != 0u) {
        sum += reflected_direct(s, direction, push.light_count, push.first_sky_light, push.sky_light_count, push.root, chance);
    }
#if defined(LIT) || defined(SKY)
    sum += cache_radiance(hit, s, direction, first);
#endif
    return sum;
}

#ifdef GLOSSY
// Rays by a lobe whose albedo is greater than MUCH, as of metals.
const uint LOBE_RAYS = 4u;
const float MUCH = 0.3;

// Weight of a direction's radiance in a lobe, divided by the density of directions. These are sampled by the cosine
// about the vertex normal and by the lobe, with this number of rays. Veach and Guibas 1995, balance heuristic.
float share_of(Lobe lobe, float rays, vec3 direction, vec3 n) {
    float by_cosine = float(RAYS) * max(dot(direction, n), 0.0) / PI;
    float by_lobe = lobe_density(lobe, direction);
    return lobe_weight(lobe, direction) * by_lobe / max(by_cosine + rays * by_lobe, 1e-30);
}
#endif

void main() {
    // All threads of a workgroup trace the same directions, so that they visit similar nodes of the hierarchy.
    const uint ALL = NEAR_SIDE * NEAR_SIDE;
    uint subset = gl_WorkGroupID.x % ALL;
    uvec2 block = uvec2(gl_WorkGroupID.x / ALL, gl_WorkGroupID.y) * (NEAR_SIDE * 8u);
    uvec2 within = place_in_tile(gl_LocalInvocationID.x) * NEAR_SIDE;
    uvec2 at = block + within + uvec2(subset % NEAR_SIDE, subset / NEAR_SIDE);
    if (at.x >= push.width || at.y >= push.height) {
        return;
    }
    ivec2 size = textureSize(element_image, 0);
    ivec2 pixel = min(ivec2(at * push.every), size - 1);
    uvec2 element = texelFetch(element_image, pixel, 0).xy;
    NearPixel found = NearPixel(vec3(0.0), 1.0, vec3(0.0), 0u, vec3(0.0), 0.0, vec3(0.0), 0.0, vec3(0.0), 0.0, vec3(0.0), 0.0,
                                 vec3(0.0), 0.0, vec3(0.0), vec3(0.0), vec2(0.0));
    if (element.x == 0u) {
        near_pixels[at.y * push.width + at.x] = found;
        return;
    }
    DrawRecord draw = draws[element.x - 1u];
    Instance instance = hit_instances[draw.instance];
    vec3 place[3], facing[3];
    vec4 clip[3];
    uvec3 corners;
    for (uint i = 0u; i < 3u; ++i) {
        corners[i] = hit_indices[draw.first_index + 3u * element.y + i];
        uint vertex = draw.first_vertex + corners[i];
        place[i] = (instance.world_from_model * vec4(corner_vector(vertex, 0u), 1.0)).xyz;
        facing[i] = mat3(instance.world_from_normal) * corner_vector(vertex, 3u);
        clip[i] = push.clip_from_world * vec4(place[i], 1.0);
    }
    vec2 ndc = (vec2(pixel) + 0.5) / vec2(size) * 2.0 - 1.0;
    vec3 w = weights_at(ndc, clip[0], clip[1], clip[2]);
    found.position = w.x * place[0] + w.y * place[1] + w.z * place[2];
    vec3 towards_eye = -view_direction(push.eye, found.position);
    vec3 geometric = cross(place[1] - place[0], place[2] - place[0]);
    float largest = max(max(abs(geometric.x), abs(geometric.y)), max(abs(geometric.z), 1e-37));
    geometric = normalize(geometric / largest + vec3(0.0, 1e-30, 0.0));
    geometric = dot(geometric, towards_eye) < 0.0 ? -geometric : geometric;
    vec3 n = w.x * facing[0] + w.y * facing[1] + w.z * facing[2];
    n = dot(n, n) > 0.0 ? normalize(n) : geometric;
    found.normal = n;
    found.is_surface = 1u;
    float from_eye = push.eye.w > 0.0 ? distance(push.eye.xyz, found.position) : 0.0;
    // In a corner the start may also lie on another surface. Rays begin at the distance `lift`, so they do not hit it.
    float lift = lift_at(found.position, from_eye);
    vec3 start = found.position + geometric * lift;

    vec3 shares;
    uvec3 around = caches_about(draw.instance, corners, w, 3u, found.position, n, push.cache_reach, shares);
#ifdef GLOSSY
    vec4 normal_coded = texelFetch(normal_image, pixel, 0);
    vec3 specular = texelFetch(specular_image, pixel, 0).rgb;
    bool is_glossy = specular != vec3(0.0);
    Lobe lobe = lobe_of(specular, normal_coded.w, normal_coded.xyz, towards_eye);
    // Caches know far light well enough for wide lobes. Narrow lobes need rays of unlimited length.
    float narrow = smoothstep(3.0, 5.0, log2(max(lobe.exponent, 1.0)));
#endif
    const vec3 LUMINANCE = vec3(0.2126, 0.7152, 0.0722);
    found.open = 0.0;
#ifdef SKY
    // The sky's radiance is a weight, so it is slightly above 0 everywhere.
    float least_sky = 1e-4 / PI * dot(sky_at(SKY_IRRADIANCE, n), LUMINANCE);
#endif
#ifdef GLOSSY
    bool endless = narrow > 0.0;
    // Twice the distance between traced pixels on a plane that faces the eye [m].
    float depth = dot(w, vec3(clip[0].w, clip[1].w, clip[2].w));
    vec3 upward = vec3(push.clip_from_world[0][1], push.clip_from_world[1][1], push.clip_from_world[2][1]);
    float two = max(4.0 * float(push.every) * depth / (length(upward) * float(size.y)), 1e-30);
    float width = inversesqrt(0.5 * (lobe.exponent + 1.0));
    if (is_glossy) {
        found.nearness = endless ? 0.0 : 1.0 / push.reach;
        found.mirrored = lobe.mirrored;
        found.width = width;
    }
    // The last rays sample the lobe: one, or several if it reflects much. All rays share the code of one loop: twice that
    // code would not fit the registers.
    uint lobe_rays = !is_glossy ? 0u : endless && dot(specular, LUMINANCE) > MUCH ? LOBE_RAYS : 1u;
    float of_lobe = 1.0 / float(max(lobe_rays, 1u));
    uint count = RAYS + lobe_rays;
#else
    const uint count = RAYS;
#endif
    for (uint i = 0u; i < count; ++i) {
        uint number = i * ALL + subset;
        vec3 local = directions[min(i, RAYS - 1u) * ALL + subset];
        vec3 tangent, bitangent;
        tangents(n, tangent, bitangent);
        vec3 direction = tangent * local.x + bitangent * local.y + n * local.z;
        // The ray represents a cone: its projected solid angle is pi over the number of rays combined.
        float spread = 2.0 * inversesqrt(float(RAYS * ALL));
        float reach = push.reach;
#ifdef GLOSSY
        bool by_lobe = i >= RAYS;
        if (by_lobe) {
            // Some of the lobe's directions. Neighbouring pixels have the others.
            number = (i - RAYS) * ALL + subset;
            // Each block turns the directions of a metal: the same ones everywhere would make whole walls too bright or dark.
            float turn = lobe_rays > 1u ? 2.0 * PI * fract(dot(vec2(at / NEAR_SIDE), vec2(0.7548776662, 0.5698402910))) : 0.0;
            direction = lobe_direction(lobe, vec2((float(number) + 0.5) / float(lobe_rays * ALL), float(number) * 2.39996323 + turn));
            spread = 0.25 * width * sqrt(of_lobe);
            reach = endless ? 3e38 : push.reach;
            if (dot(direction, geometric) <= 0.0) {
                continue;
            }
        }
#else
        const bool by_lobe = false;
#endif
        vec3 far = far_radiance(around, shares, direction);
        // Rays below the triangle's plane are mirrored above it. The lookup of far light keeps the original direction,
        // since caches know only vertex normals.
        float above = dot(direction, geometric);
        direction -= above < 0.0 ? 2.0 * above * geometric : vec3(0.0);
#ifdef SKY
        float open = sky_open(around, shares, direction);
        // Where caches call a direction partly open, the ray goes on and decides.
        bool decides = abs(open - 0.5) < 0.4999;
        Hit hit = trace(start, direction, lift, decides ? 3e38 : reach, push.root, 0u, false);
        open = !decides ? open : hit.triangle == NO_HIT ? 1.0 : 0.0;
        vec3 radiance = sky_at(SKY_OF_CACHES, direction) + least_sky;
        float sky_luminance = dot(radiance, LUMINANCE);
#else
        Hit hit = trace(start, direction, lift, reach, push.root, 0u, false);
#endif
        bool met = hit.triangle != NO_HIT && hit.distance < reach;
        vec3 arrives = met ? met_radiance(hit, start, direction, spread, number, reach == push.reach) : vec3(0.0);
        if (!by_lobe) {
            found.all += far;
            found.crowding += 1.0 / (float(RAYS) * max(met ? hit.distance : push.reach, 1e-30));
            found.far += met ? vec3(0.0) : far;
            found.open += met ? 0.0 : 1.0 / float(RAYS);
            found.irradiance += arrives;
#ifdef SKY
            found.all_sky += radiance;
            bool hides = hit.triangle != NO_HIT;
            found.hidden_sky += hides ? sky_luminance * vec2(1.0, 1.0 / max(hit.distance, 1e-30)) : vec2(0.0);
            found.open_sky += met ? vec3(0.0) : open * radiance;
#endif
        }
#ifdef GLOSSY
        if (is_glossy) {
            bool is_near = met && hit.distance <= push.reach;
            float wide_share = narrow < 1.0 ? (1.0 - narrow) * share_of(lobe, float(lobe_rays), direction, n) : 0.0;
            float narrow_share = by_lobe ? of_lobe * narrow * lobe_weight(lobe, direction) : 0.0;
            found.glossy += narrow_share * arrives;
            found.glossy += wide_share * (is_near ? arrives : far);
#ifdef SKY
            found.sky_all += (wide_share + narrow_share) * sky_luminance;
            found.sky += (wide_share * (is_near ? 0.0 : open) + narrow_share * (met ? 0.0 : 1.0)) * sky_luminance;
#endif
            // Nearer hits, as right in a corner, say nothing of other traced pixels.
            found.nearness += by_lobe && met && endless ? of_lobe / max(hit.distance, two) : 0.0;
        }
#endif
    }
    found.irradiance *= PI / float(RAYS);
    near_pixels[at.y * push.width + at.x] = found;
}
