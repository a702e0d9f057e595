// Stage 8, first half: the proxies of a visible vertex's references, averaged. METHOD 5, thesis listing 5.2.
#include "shared.glsl"
#include "lib/interpolation.glsl"
#include "lib/phong.glsl"

layout(local_size_x = 64) in;
layout(constant_id = 0) const uint REFERENCES = 8;
layout(constant_id = 1) const uint GLOSSY = 1;
layout(constant_id = 2) const uint PRINTED = 0; // 1: the thesis's weights, flux and position
layout(push_constant, scalar) uniform Push { AveragePush push; };

#include "lib/references.glsl"

layout(binding = 3, scalar) readonly buffer Args { VisibleArgs args; };
layout(binding = 4, scalar) readonly buffer Instances { Instance instances[]; };
layout(binding = 5, scalar) readonly buffer Corners { Corner corners[]; };
layout(binding = 6, scalar) readonly buffer Caches { Cache caches[]; };
layout(binding = 7, scalar) readonly buffer Proxies { Proxy proxies[]; };
layout(binding = 8, scalar) writeonly buffer Lights { VertexLight lights[]; };

// Sums of one lobe: irradiance over the caches that take part, position over those that are lit.
struct Sums {
    vec3 irradiance;
    float weight;
    vec3 position;
    float lit;
};

void add(inout Sums s, float w, float lit, vec3 irradiance, vec3 position) {
    s.irradiance += w * irradiance;
    s.weight += w;
    s.position += (w * lit) * position;
    s.lit += w * lit;
}

// As printed: flux, here over 4 pi, and position.
void add_printed(inout Sums s, float w, float lit, vec3 irradiance, vec3 proxy, vec3 cache) {
    vec3 d = proxy - cache;
    add(s, w, lit, irradiance * dot(d, d), proxy);
}

void main() {
    uint at = gl_GlobalInvocationID.x;
    if (at >= args.reference_count / REFERENCES) {
        return;
    }
    VisibleVertex v = visible[at];
    DrawRecord draw = draws[v.draw];
    Instance instance = instances[draw.instance];
    Corner corner = corners[draw.first_vertex + v.vertex];
    vec3 position = (instance.world_from_model * vec4(corner.position, 1.0)).xyz;
    vec3 normal = unit_or(mat3(instance.world_from_normal) * corner.normal, vec3(0.0, 1.0, 0.0));
    vec3 mirrored = reflect(view_direction(push.eye, position), normal);

    uint indices[REFERENCES];
    float distances[REFERENCES];
    float d_max = 0.0;
    for (uint i = 0u; i < REFERENCES; ++i) {
        indices[i] = referred_cache(draw, v.vertex, i);
        if (indices[i] != NO_REFERENCES) {
            distances[i] = distance(position, caches[indices[i]].position);
            d_max = max(d_max, distances[i]);
        }
    }
    d_max = max(d_max, 1e-15);

    Sums diffuse = Sums(vec3(0.0), 0.0, vec3(0.0), 0.0);
    Sums glossy = diffuse;
    vec3 glossy_plain = vec3(0.0); // facing irradiance and exponent, whatever the lobe sees of them
    float exponent = 0.0;
    // A second round, by distance alone, where no weight of the first is above zero.
    for (uint round = 0u; round < 2u; ++round) {
        bool do_diffuse = diffuse.weight <= 0.0;
        bool do_glossy = GLOSSY != 0u && glossy.weight <= 0.0;
        if (!do_diffuse && !do_glossy) {
            break;
        }
        for (uint i = 0u; i < REFERENCES; ++i) {
            if (indices[i] == NO_REFERENCES) {
                continue;
            }
            Cache c = caches[indices[i]];
            Proxy p = proxies[indices[i]];
            float apart = distance_weight(distances[i], d_max);
            float diffuse_lit = p.diffuse_distance2 > 0.0 ? 1.0 : 0.0;
            if (PRINTED != 0u) {
                if (do_diffuse) {
                    float w = round == 0u ? printed_weight(distances[i], d_max, dot(normal, c.normal)) : apart;
                    add_printed(diffuse, w, diffuse_lit, p.diffuse_irradiance, p.diffuse_position, c.position);
                }
                if (do_glossy) {
                    vec3 r = reflect(view_direction(push.eye, c.position), c.normal);
                    float w = round == 0u ? printed_weight(distances[i], d_max, dot(mirrored, r)) : apart;
                    add_printed(glossy, w, p.glossy_distance2 > 0.0 ? 1.0 : 0.0, p.glossy_irradiance, p.glossy_position, c.position);
                }
                continue;
            }
            float w = round == 0u ? facing_weight(distances[i], d_max, dot(normal, c.normal)) : apart;
            if (do_diffuse) {
                vec3 there = p.diffuse_position - c.position;
                vec3 here = p.diffuse_position - position;
                float left = falloff(p.diffuse_distance2, dot(there, there), dot(here, here));
                add(diffuse, w, diffuse_lit, p.diffuse_irradiance * left, p.diffuse_position);
            }
            // A cache whose lobe catches no light has no proxy to average.
            if (do_glossy && p.glossy_distance2 > 0.0) {
                vec3 towards = p.glossy_position - position;
                float cosine = dot(mirrored, towards) * inversesqrt(max(dot(towards, towards), 1e-30));
                float steps = c.exponent * log2(max(cosine, LEAST_LOBE_COSINE));
                add(glossy, w, exp2(steps) + LEAST_PULL, p.glossy_irradiance * exp2(WEIGHED_SHARE * steps), p.glossy_position);
                glossy_plain += w * p.glossy_irradiance;
                exponent += w * c.exponent;
            }
        }
    }
    VertexLight light;
    light.position = position;
    light.diffuse_irradiance = diffuse.weight > 0.0 ? diffuse.irradiance / diffuse.weight : vec3(0.0);
    light.diffuse_position = diffuse.lit > 0.0 ? diffuse.position / diffuse.lit : position + normal;
    light.glossy_irradiance = glossy.weight > 0.0 ? glossy.irradiance / glossy.weight : vec3(0.0);
    light.glossy_position = glossy.lit > 0.0 ? glossy.position / glossy.lit : position + normal;
    if (GLOSSY != 0u && PRINTED == 0u && glossy.weight > 0.0) {
        // What the lobes see of the proxies is what the lobe is to see of the average; never more than without lobes.
        vec3 towards = light.glossy_position - position;
        float cosine = dot(mirrored, towards) * inversesqrt(max(dot(towards, towards), 1e-30));
        float seen = cosine_power(max(cosine, LEAST_LOBE_COSINE), WEIGHED_SHARE * exponent / glossy.weight);
        light.glossy_irradiance = min(light.glossy_irradiance / max(seen, 1e-30), glossy_plain / glossy.weight);
    }
    lights[at] = light;
}
