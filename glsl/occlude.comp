// Stage 7: dims the proxy lights of live caches by the discs of all caches. METHOD 6, thesis listing 5.3.
// A workgroup dims a few consecutive caches of the list. Each thread tests one cache against every OCCLUDE_PARTS-th
// group of discs. Partial results are combined in a fixed order, so that skipping groups changes no bit.
// variant occlude_all.comp: ALL (all caches instead of a list of live ones; the others are unlit)
#include "shared.glsl"
#include "lib/overlap.glsl"

layout(local_size_x = OCCLUDE_RECEIVERS, local_size_y = OCCLUDE_PARTS) in;
layout(constant_id = 0) const uint GLOSSY = 1;
layout(constant_id = 1) const uint GROUP = 1; // caches per flag
layout(constant_id = 2) const uint SKIP = 1; // 0: test every disc
layout(push_constant, scalar) uniform Push { OccludePush push; };
layout(binding = 0, scalar) readonly buffer Caches { Cache caches[]; };
layout(binding = 1, scalar) readonly buffer Groups { OccluderGroup groups[]; };
layout(binding = 2, scalar) buffer Proxies { Proxy proxies[]; };
#ifndef ALL
layout(binding = 3, scalar) readonly buffer Live { uint live[]; };
layout(binding = 4, scalar) readonly buffer Args { LiveArgs args; };
#endif

// Minimal radius of a light, as a share of its distance from the cache: a point has no area to cover, and smaller
// variances are rounding errors.
const float LEAST_RADIUS = 1.0 / 64.0;

// A proxy light as its cache sees it, as a square on the unit disc.
struct SeenLight {
    vec3 towards_cache; // unit
    float distance;
    vec3 tangent;
    float reach; // distance in front of it at which discs occlude it fully
    vec3 bitangent;
    float half_side; // of its square
    vec2 centre;
};

// Accumulated occlusion of a light.
struct Cover {
    float sum;
    vec2 low; // bounds of all overlaps
    vec2 high;
};

// An unlit proxy becomes a square that nothing overlaps.
SeenLight light_of(Cache c, vec3 position, float distance2) {
    vec3 offset = position - c.position;
    float d2 = max(dot(offset, offset), 1e-36);
    float inverse = inversesqrt(d2);
    vec3 direction = offset * inverse;
    // Radius of a uniform disc with the same variance.
    float radius2 = max(2.0 * (distance2 - d2), LEAST_RADIUS * LEAST_RADIUS * d2);
    vec3 tangent = tangent_towards(direction, c.normal);
    vec3 bitangent = cross(c.normal, tangent);
    float side2 = SQUARE * sphere_form_factor(radius2, dot(c.normal, direction), d2);
    float half_side = distance2 > 0.0 ? 0.5 * sqrt(side2) : -1e9;
    return SeenLight(-direction, d2 * inverse, tangent, FADE * sqrt(radius2), bitangent, half_side,
                 vec2(dot(tangent, direction), dot(bitangent, direction)));
}

// Whether a group's discs can cover any part of a light: discs within `radius` of `offset`, with directions from the
// cache within `chord` and squares of at most this half side. The margins cover rounding.
bool may_cover(SeenLight l, vec3 offset, float radius, float chord, float half_side) {
    vec3 direction = offset * inversesqrt(max(dot(offset, offset), 1e-36));
    vec2 apart = abs(vec2(dot(l.tangent, direction), dot(l.bitangent, direction)) - l.centre);
    float margin = 1e-5 * (l.distance + radius);
    return max(apart.x, apart.y) <= l.half_side + half_side + chord + 1e-4
        && dot(offset, l.towards_cache) + l.distance + radius + margin > 0.0;
}

bool may_cover(Cache c, OccluderGroup g, SeenLight diffuse, SeenLight glossy) {
    vec3 offset = g.position - c.position;
    float distance = length(offset);
    float radius = g.radius * 1.0001;
    float margin = 1e-5 * (distance + radius);
    float above = dot(c.normal, offset) + radius + margin;
    if (above <= 0.0) {
        return false;
    }
    float nearest = distance - radius;
    if (nearest <= margin) {
        return true;
    }
    float sine = radius / distance;
    float chord = sine * sqrt(2.0 / (1.0 + sqrt(max(1.0 - sine * sine, 0.0))));
    float cosine = min(above / nearest, 1.0);
    float half_side = 0.5 * sqrt(SQUARE * g.area * cosine / (g.area + 3.14159265358979 * nearest * nearest));
    return may_cover(diffuse, offset, radius, chord, half_side)
        || (GLOSSY != 0u && may_cover(glossy, offset, radius, chord, half_side));
}

void cover(inout Cover found, SeenLight l, vec3 offset, float inverse, float half_side) {
    vec2 centre = vec2(dot(l.tangent, offset), dot(l.bitangent, offset)) * inverse;
    vec4 corners = overlap(l.centre, l.half_side, centre, half_side);
    float area = overlap_area(corners) * fade(dot(offset, l.towards_cache) + l.distance, l.reach);
    found.sum += area;
    if (area > 0.0) {
        found.low = min(found.low, corners.xy);
        found.high = max(found.high, corners.zw);
    }
}

// Unoccluded share of the light.
float left(Cover c, SeenLight l) {
    vec2 size = max(c.high - c.low, vec2(0.0));
    float all = 4.0 * l.half_side * l.half_side;
    return all > 0.0 ? max(1.0 - min(c.sum, size.x * size.y) / all, 0.0) : 1.0;
}

shared Cover covers[2][OCCLUDE_PARTS][OCCLUDE_RECEIVERS];

// Combines the results of all threads of a cache.
Cover together(uint lobe, uint receiver) {
    Cover all = covers[lobe][0][receiver];
    for (uint part = 1u; part < OCCLUDE_PARTS; ++part) {
        Cover c = covers[lobe][part][receiver];
        all = Cover(all.sum + c.sum, min(all.low, c.low), max(all.high, c.high));
    }
    return all;
}

void main() {
    uint slot = gl_GlobalInvocationID.x;
#ifdef ALL
    uint count = push.cache_count;
#else
    uint count = args.cache_count * GROUP;
#endif
    if (gl_WorkGroupID.x * OCCLUDE_RECEIVERS >= count) {
        return;
    }
    // Threads without a cache of their own repeat the last one and write nothing.
    uint to_do = min(slot, count - 1u);
#ifdef ALL
    uint i = to_do;
#else
    uint i = live[to_do / GROUP] * GROUP + to_do % GROUP;
#endif
    bool is_own = slot < count && i < push.cache_count;
    Cache c = caches[min(i, push.cache_count - 1u)];
    Proxy p = proxies[push.first_proxy + min(i, push.cache_count - 1u)];
    SeenLight diffuse = light_of(c, p.diffuse_position, p.diffuse_distance2);
    SeenLight glossy = diffuse;
    if (GLOSSY != 0u) {
        glossy = light_of(c, p.glossy_position, p.glossy_distance2);
    }
    Cover found[2] = Cover[2](Cover(0.0, vec2(1e9), vec2(-1e9)), Cover(0.0, vec2(1e9), vec2(-1e9)));
    bool is_lit = p.diffuse_distance2 > 0.0 || (GLOSSY != 0u && p.glossy_distance2 > 0.0);
    uint groups_to_do = is_lit ? push.group_count : 0u;
    for (uint g = gl_LocalInvocationID.y; g < groups_to_do; g += OCCLUDE_PARTS) {
        if (SKIP != 0u && !may_cover(c, groups[g], diffuse, glossy)) {
            continue;
        }
        uint end = min((g + 1u) * OCCLUDER_GROUP, push.cache_count);
        for (uint j = g * OCCLUDER_GROUP; j < end; ++j) {
            Cache disc = caches[j];
            vec3 offset = disc.position - c.position;
            float inverse = inversesqrt(max(dot(offset, offset), 1e-36));
            float half_side = 0.5 * sqrt(disc_side2(offset, disc.normal, c.normal, disc.area));
            cover(found[0], diffuse, offset, inverse, half_side);
            if (GLOSSY != 0u) {
                cover(found[1], glossy, offset, inverse, half_side);
            }
        }
    }
    covers[0][gl_LocalInvocationID.y][gl_LocalInvocationID.x] = found[0];
    covers[1][gl_LocalInvocationID.y][gl_LocalInvocationID.x] = found[1];
    barrier();
    if (gl_LocalInvocationID.y == 0u && is_own) {
        proxies[push.first_proxy + i].diffuse_irradiance = p.diffuse_irradiance * left(together(0u, gl_LocalInvocationID.x), diffuse);
        if (GLOSSY != 0u) {
            proxies[push.first_proxy + i].glossy_irradiance = p.glossy_irradiance * left(together(1u, gl_LocalInvocationID.x), glossy);
        }
    }
}
