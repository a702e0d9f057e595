// Stage 3: every instance's caches into the world. METHOD 1, 8 and 9. On a model that bends a cache stays where it is on its
// triangle: posed corners give its place and its normal, and as the triangle grows, so does its share of the surface.
#include "shared.glsl"
#include "lib/phong.glsl"

layout(local_size_x = 64) in;
layout(binding = 0, scalar) readonly buffer ModelCaches { ModelCache model_caches[]; };
layout(binding = 1, scalar) readonly buffer Instances { Instance instances[]; };
layout(binding = 2, scalar) readonly buffer Indices { uint indices[]; };
layout(binding = 3, scalar) readonly buffer Corners { Corner corners[]; };
layout(binding = 4, scalar) writeonly buffer Caches { Cache caches[]; };
layout(push_constant, scalar) uniform Push { PlacePush push; };

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= push.cache_count) {
        return;
    }
    ModelCache c = model_caches[i];
    Instance instance = instances[c.instance];
    mat3 world_from_normal = mat3(instance.world_from_normal);
    if (c.triangle == RIGID) {
        vec3 position = (instance.world_from_model * vec4(c.position, 1.0)).xyz;
        vec3 normal = world_from_normal * c.normal;
        float area = c.area * length(normal) * instance.area_scale;
        caches[i] = Cache(position, c.exponent, unit_or(normal, vec3(0.0, 1.0, 0.0)), area);
        return;
    }
    Corner a = corners[c.first_vertex + indices[3u * c.triangle]];
    Corner b = corners[c.first_vertex + indices[3u * c.triangle + 1u]];
    Corner d = corners[c.first_vertex + indices[3u * c.triangle + 2u]];
    vec3 w = vec3(1.0 - c.position.x - c.position.y, c.position.xy);
    vec3 position = (instance.world_from_model * vec4(w.x * a.position + w.y * b.position + w.z * d.position, 1.0)).xyz;
    mat3 linear = mat3(instance.world_from_model);
    vec3 face = 0.5 * cross(linear * (b.position - a.position), linear * (d.position - a.position));
    vec3 normal = unit_of_any_or(world_from_normal * (w.x * a.normal + w.y * b.normal + w.z * d.normal), unit_of_any_or(face, vec3(0.0, 1.0, 0.0)));
    float area = instance.area_scale > 0.0 ? c.area * length(face) : 0.0;
    caches[i] = Cache(position, c.exponent, normal, area);
}
