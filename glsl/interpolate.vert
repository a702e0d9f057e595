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

// What the average is taken of: the facing irradiance, or with PRINTED the flux over 4 pi.
vec3 carried(vec3 irradiance, vec3 proxy, vec3 cache) {
    vec3 d = proxy - cache;
    return PRINTED != 0u ? irradiance * dot(d, d) : irradiance;
}

float weight(float d, float d_max, float cosine) {
    return PRINTED != 0u ? printed_weight(d, d_max, cosine) : facing_weight(d, d_max, cosine);
}

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
            if (do_diffuse) {
                float w = round == 0u ? weight(distances[i], d_max, dot(normal, c.normal)) : apart;
                add(diffuse, w, p.diffuse_lit, carried(p.diffuse_irradiance, p.diffuse_position, c.position), p.diffuse_position);
            }
            if (do_glossy) {
                vec3 r = reflect(view_direction(push.eye, c.position), c.normal);
                float w = round == 0u ? weight(distances[i], d_max, dot(mirrored, r)) : apart;
                // A cache whose lobe catches no light has no proxy to average; as printed it still counts as dark.
                w *= PRINTED != 0u ? 1.0 : p.glossy_lit;
                add(glossy, w, p.glossy_lit, carried(p.glossy_irradiance, p.glossy_position, c.position), p.glossy_position);
            }
        }
    }
    out_position = position;
    out_diffuse_irradiance = diffuse.weight > 0.0 ? diffuse.irradiance / diffuse.weight : vec3(0.0);
    out_diffuse_position = diffuse.lit > 0.0 ? diffuse.position / diffuse.lit : position + normal;
    out_glossy_irradiance = glossy.weight > 0.0 ? glossy.irradiance / glossy.weight : vec3(0.0);
    out_glossy_position = glossy.lit > 0.0 ? glossy.position / glossy.lit : position + normal;
}
