// Stage 8, vertex level: the proxies of a vertex's references, averaged. METHOD 5, thesis listing 5.2.
#include "shared.glsl"
#include "lib/interpolation.glsl"
#include "lib/phong.glsl"

layout(constant_id = 0) const uint REFERENCES = 8;
layout(constant_id = 1) const uint GLOSSY = 1;
layout(constant_id = 2) const uint PRINTED = 0; // 1: the thesis's weights, flux and position
layout(push_constant, scalar) uniform Push { DrawPush push; };
layout(binding = 0, scalar) readonly buffer Instances { Instance instances[]; };
layout(binding = 1, scalar) readonly buffer References { uint references[]; }; // two 16-bit indices each
layout(binding = 2, scalar) readonly buffer Caches { Cache caches[]; };
layout(binding = 3, scalar) readonly buffer Proxies { Proxy proxies[]; };

layout(location = 0) in vec3 model_position;
layout(location = 1) in vec3 model_normal;

layout(location = 0) out vec3 out_position;
layout(location = 1) out vec3 out_diffuse_position;
layout(location = 2) out vec3 out_diffuse_irradiance; // facing irradiance; with PRINTED flux / (4 pi)
layout(location = 3) out vec3 out_glossy_position;
layout(location = 4) out vec3 out_glossy_irradiance;

precise gl_Position;

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
    Instance instance = instances[push.instance];
    vec3 position = (instance.world_from_model * vec4(model_position, 1.0)).xyz;
    gl_Position = push.clip_from_world * vec4(position, 1.0);
    vec3 normal = unit_or(mat3(instance.world_from_normal) * model_normal, vec3(0.0, 1.0, 0.0));
    vec3 mirrored = reflect(view_direction(push.eye, position), normal);

    uint indices[REFERENCES];
    float distances[REFERENCES];
    float d_max = 0.0;
    uint first = push.reference_base + gl_VertexIndex * (REFERENCES / 2u);
    for (uint i = 0u; i < REFERENCES; ++i) {
        uint pair = references[first + i / 2u];
        uint index = (i & 1u) == 0u ? pair & 0xffffu : pair >> 16;
        indices[i] = index;
        if (index != NO_CACHE) {
            distances[i] = distance(position, caches[push.cache_base + index].position);
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
            if (indices[i] == NO_CACHE) {
                continue;
            }
            uint index = push.cache_base + indices[i];
            Cache c = caches[index];
            Proxy p = proxies[index];
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
                    add_printed(glossy, w, p.glossy_lit, p.glossy_irradiance, p.glossy_position, c.position);
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
            if (do_glossy && p.glossy_lit > 0.0) {
                vec3 towards = p.glossy_position - position;
                float cosine = dot(mirrored, towards) * inversesqrt(max(dot(towards, towards), 1e-30));
                float steps = c.exponent * log2(max(cosine, LEAST_LOBE_COSINE));
                add(glossy, w, exp2(steps) + LEAST_PULL, p.glossy_irradiance * exp2(WEIGHED_SHARE * steps), p.glossy_position);
                glossy_plain += w * p.glossy_irradiance;
                exponent += w * c.exponent;
            }
        }
    }
    out_position = position;
    out_diffuse_irradiance = diffuse.weight > 0.0 ? diffuse.irradiance / diffuse.weight : vec3(0.0);
    out_diffuse_position = diffuse.lit > 0.0 ? diffuse.position / diffuse.lit : position + normal;
    out_glossy_irradiance = glossy.weight > 0.0 ? glossy.irradiance / glossy.weight : vec3(0.0);
    out_glossy_position = glossy.lit > 0.0 ? glossy.position / glossy.lit : position + normal;
    if (GLOSSY != 0u && PRINTED == 0u && glossy.weight > 0.0) {
        // What the lobes see of the proxies is what the lobe is to see of the average; never more than without lobes.
        vec3 towards = out_glossy_position - position;
        float cosine = dot(mirrored, towards) * inversesqrt(max(dot(towards, towards), 1e-30));
        float seen = cosine_power(max(cosine, LEAST_LOBE_COSINE), WEIGHED_SHARE * exponent / glossy.weight);
        out_glossy_irradiance = min(out_glossy_irradiance / max(seen, 1e-30), glossy_plain / glossy.weight);
    }
}
