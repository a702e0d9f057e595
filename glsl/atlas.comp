// Stage 3: places every instance's caches in the world. METHOD 1, 8 and 9. On a deforming model a cache stays at its
// point of its triangle: the posed corners give its position, its normal is the posed triangle's on the side of the
// vertex normals, and its area scales with the triangle's.
#include "shared.glsl"
#include "lib/phong.glsl"
#include "lib/form_factor.glsl"

layout(local_size_x = 64) in;
layout(binding = 0, scalar) readonly buffer ModelCaches { ModelCache model_caches[]; };
layout(binding = 1, scalar) readonly buffer Instances { Instance instances[]; };
layout(binding = 2, scalar) readonly buffer Indices { uint indices[]; };
layout(binding = 3, scalar) readonly buffer Corners { Corner corners[]; };
layout(binding = 4, scalar) writeonly buffer Caches { Cache caches[]; };
layout(push_constant, scalar) uniform Push { PlacePush push; };

// A cache on a triangle of a deforming model.
Cache on_triangle(ModelCache c, Instance instance) {
    uint first = instance.first_index + 3u * uint(c.position.z);
    Corner a = corners[instance.first_vertex + indices[first]];
    Corner b = corners[instance.first_vertex + indices[first + 1u]];
    Corner d = corners[instance.first_vertex + indices[first + 2u]];
    vec3 w = vec3(1.0 - c.position.x - c.position.y, c.position.xy);
    mat3 linear = mat3(instance.world_from_model);
    vec3 e1 = linear * (b.position - a.position);
    vec3 e2 = linear * (d.position - a.position);
    vec3 face = cross(e1, e2);
    vec3 upward = unit_of_any_or(face, vec3(0.0, 1.0, 0.0));
    vec3 position = (instance.world_from_model * vec4(w.x * a.position + w.y * b.position + w.z * d.position, 1.0)).xyz;
    vec3 normal = mat3(instance.world_from_normal) * (w.x * a.normal + w.y * b.normal + w.z * d.normal);
    normal = face == vec3(0.0) ? unit_of_any_or(normal, upward) : dot(normal, upward) < 0.0 ? -upward : upward;
    float area = c.area * 0.5 * length(face) * instance.area_scale;
    vec3 middle = position + c.middle.x * e1 + c.middle.y * e2 + c.middle.z * upward;
    vec3 axis = c.axis.x * e1 + c.axis.y * e2 + c.axis.z * upward;
    return Cache(position, c.exponent, normal, area, middle, 0.0, axis - normal * dot(axis, normal), 0.0);
}

// A cache moved by a rigid transform.
Cache rigid(ModelCache c, Instance instance) {
    vec3 position = (instance.world_from_model * vec4(c.position, 1.0)).xyz;
    vec3 normal = mat3(instance.world_from_normal) * c.normal;
    float area = c.area * length(normal) * instance.area_scale;
    vec3 middle = (instance.world_from_model * vec4(c.middle, 1.0)).xyz;
    vec3 axis = mat3(instance.world_from_model) * c.axis;
    return Cache(position, c.exponent, unit_or(normal, vec3(0.0, 1.0, 0.0)), area, middle, 0.0, axis, 0.0);
}

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= push.cache_count) {
        return;
    }
    ModelCache c = model_caches[i];
    Instance instance = instances[c.instance];
    Cache cache = instance.first_vertex == RIGID ? rigid(c, instance) : on_triangle(c, instance);
    float length2 = dot(cache.axis, cache.axis);
    cache.breadth = length2 > 0.0 ? c.breadth * cache.area * inversesqrt(length2) : 0.0;
    cache.radius = sqrt(cache.area / PI);
    caches[i] = cache;
}
