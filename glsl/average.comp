// Stage 8, first half: averages the proxies of each visible vertex's references. METHOD 5, thesis listing 5.2.
// variant average_sky.comp: SKY (where caches are lit by a sky, too)
#include "shared.glsl"

layout(local_size_x = 64) in;
layout(constant_id = 0) const uint REFERENCES = 8;
layout(constant_id = 1) const uint GLOSSY = 1;
layout(constant_id = 2) const uint PRINTED = 0; // 1: the thesis's weights, averaging flux and position
layout(push_constant, scalar) uniform Push { AveragePush push; };
layout(binding = 0, scalar) readonly buffer Visible { VisibleVertex visible[]; };

#include "lib/average.glsl"
#include "lib/references.glsl"

layout(binding = 3, scalar) readonly buffer Args { VisibleArgs args; };
layout(binding = 4, scalar) readonly buffer Instances { Instance instances[]; };
layout(binding = 5, scalar) readonly buffer Corners { Corner corners[]; };
layout(binding = 6, scalar) readonly buffer Caches { Cache caches[]; };
layout(binding = 7, scalar) readonly buffer Proxies { Proxy proxies[]; };
layout(binding = 8, scalar) writeonly buffer Lights { VertexLight lights[]; };
#ifdef SKY
#include "lib/sky_seen.glsl"
layout(binding = 9, scalar) readonly buffer Seen { SkySeen seen[]; }; // per cache
layout(binding = 10, scalar) writeonly buffer SkyLights { vec3 sky_lights[]; }; // share of the sky's light that arrives
#endif

void main() {
    uint at = gl_GlobalInvocationID.x;
    if (at >= args.count) {
        return;
    }
    VisibleVertex v = visible[at];
    DrawRecord draw = draws[v.draw];
    Instance instance = instances[draw.instance];
    Corner corner = corners[draw.first_vertex + v.vertex];
    Point x;
    x.position = (instance.world_from_model * vec4(corner.position, 1.0)).xyz;
    x.normal = unit_or(mat3(instance.world_from_normal) * corner.normal, vec3(0.0, 1.0, 0.0));
    x.mirrored = reflect(view_direction(push.eye, x.position), x.normal);
    x.eye = push.eye;

    uint indices[REFERENCES];
    x.d_max = 1e-15;
    for (uint i = 0u; i < REFERENCES; ++i) {
        indices[i] = referred_cache(draw, v.vertex, i);
        if (indices[i] != NO_REFERENCES) {
            x.d_max = max(x.d_max, distance(x.position, caches[indices[i]].position));
        }
    }
    Averages a = no_caches();
    bvec2 lobes = bvec2(true, GLOSSY != 0u);
    for (uint round = 0u; round < 2u && any(lobes); ++round) {
        for (uint i = 0u; i < REFERENCES; ++i) {
            if (indices[i] != NO_REFERENCES) {
                take(a, x, caches[indices[i]], proxies[push.first_proxy + indices[i]], round > 0u, lobes);
            }
        }
        lobes = left_over(a);
    }
    lights[at] = averaged(a, x);
#ifdef SKY
    SeenSum sky = SeenSum(vec3(0.0), 0.0);
    for (uint round = 0u; round < 2u && sky.weight <= 0.0; ++round) {
        for (uint i = 0u; i < REFERENCES; ++i) {
            if (indices[i] != NO_REFERENCES) {
                take_seen(sky, x.position, x.normal, x.d_max, caches[indices[i]], seen[indices[i]].share, round > 0u);
            }
        }
    }
    // A surface without caches counts as unoccluded.
    sky_lights[at] = sky.weight > 0.0 ? sky.seen / sky.weight : vec3(1.0);
#endif
}
