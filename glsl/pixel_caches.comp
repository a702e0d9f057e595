// Debug view: lists the caches whose light is averaged at a pixel, with their weights in the diffuse lobe. METHOD 5. One
// thread.
// variant pixel_caches_cells.comp: BY_CELLS (where pixels look up their caches in cells)
#include "shared.glsl"

layout(local_size_x = 1) in;
layout(push_constant, scalar) uniform Push { PixelPush push; };
const uint GLOSSY = 0u;
// No constants: loops that are not unrolled compile fast, and a pixel needs no speed.
#define REFERENCES push.references
#define PRINTED push.printed // 1: the thesis's weights
#define HERE (vec2(push.column, push.row) + 0.5)
#include "lib/here.glsl"
#include "lib/references.glsl"
#ifdef BY_CELLS
layout(binding = 8, scalar) readonly buffer Proxies { Proxy proxies[]; };
layout(binding = 9, scalar) writeonly buffer Found { PixelCache found[]; };
#else
#include "lib/average.glsl"
layout(binding = 4, scalar) readonly buffer Instances { Instance instances[]; };
layout(binding = 5, scalar) readonly buffer Corners { Corner corners[]; };
layout(binding = 6, scalar) readonly buffer Caches { Cache caches[]; };
layout(binding = 7, scalar) readonly buffer Proxies { Proxy proxies[]; };
layout(binding = 8, scalar) writeonly buffer Found { PixelCache found[]; };
#endif

float weight(Point x, Cache c, bool by_distance) {
    float d = distance(x.position, c.position);
    float cosine = dot(x.normal, c.normal);
    if (by_distance) {
        return distance_weight(d, x.d_max);
    }
    if (d >= x.d_max || cosine <= 0.0) {
        return 0.0;
    }
    return PRINTED != 0u ? printed_weight(d, x.d_max, cosine) : facing_weight(d, x.d_max, cosine);
}

// What a cache gives: irradiance [lx] on a plane at the point that faces the cache's diffuse proxy light.
vec3 given(Point x, Cache c, Proxy p) {
    if (p.diffuse_distance2 <= 0.0) {
        return vec3(0.0);
    }
    vec3 there = p.diffuse_position - c.position;
    vec3 here = p.diffuse_position - x.position;
    float from_cache2 = dot(there, there);
    float from_point2 = dot(here, here);
    return p.diffuse_irradiance * (PRINTED != 0u ? from_cache2 / max(from_point2, 1e-30)
                                                 : falloff(p.diffuse_distance2, from_cache2, from_point2));
}

// Lists the caches of a point that counts with this share, as entries from `first`.
void list(DrawRecord draw, uint row, Point x, float share, uint first) {
    float all = 0.0;
    bool by_distance = false;
    for (uint round = 0u; round < 2u && all <= 0.0; ++round) {
        by_distance = round > 0u;
        for (uint i = 0u; i < REFERENCES; ++i) {
            uint cache = referred_cache(draw, row, i);
            all += cache == NO_REFERENCES ? 0.0 : weight(x, caches[cache], by_distance);
        }
    }
    for (uint i = 0u; i < REFERENCES; ++i) {
        uint cache = referred_cache(draw, row, i);
        float w = cache == NO_REFERENCES ? 0.0 : share * weight(x, caches[cache], by_distance) / max(all, 1e-30);
        if (w > 0.0) {
            Cache c = caches[cache];
            vec3 light = given(x, c, proxies[cache]);
            found[first + i] = PixelCache(cache + 1u, w, w * light, c.position, c.normal);
        }
    }
}

void main() {
    uvec2 element = texelFetch(element_image, ivec2(HERE), 0).xy;
    if (element.x == 0u) {
        return;
    }
    DrawRecord draw = draws[element.x - 1u];
    if (draw.reference_base == NO_REFERENCES) {
        return;
    }
    uint first_index = draw.first_index + 3u * element.y;
#ifdef BY_CELLS
    if (row_here() != NO_REFERENCES) {
        list(draw, row_here(), point_here(draw, first_index), 1.0, 0u);
    }
#else
    Instance instance = instances[draw.instance];
    Point points[3];
    vec4 clip[3];
    for (uint i = 0u; i < 3u; ++i) {
        uint vertex = indices[first_index + i];
        Corner corner = corners[draw.first_vertex + vertex];
        Point x;
        x.position = (instance.world_from_model * vec4(corner.position, 1.0)).xyz;
        x.normal = unit_or(mat3(instance.world_from_normal) * corner.normal, vec3(0.0, 1.0, 0.0));
        x.mirrored = vec3(0.0);
        x.eye = push.eye;
        x.d_max = 1e-15;
        for (uint j = 0u; j < REFERENCES; ++j) {
            uint cache = referred_cache(draw, vertex, j);
            if (cache != NO_REFERENCES) {
                x.d_max = max(x.d_max, distance(x.position, caches[cache].position));
            }
        }
        points[i] = x;
        clip[i] = push.clip_from_world * vec4(x.position, 1.0);
    }
    vec3 shares = weights_here(clip[0], clip[1], clip[2]);
    for (uint i = 0u; i < 3u; ++i) {
        list(draw, indices[first_index + i], points[i], shares[i], i * REFERENCES);
    }
#endif
}
