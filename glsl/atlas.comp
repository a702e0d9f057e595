// Stage 3: every instance's caches into the world. METHOD 1 and 9.
#include "shared.glsl"
#include "lib/phong.glsl"
#include "lib/form_factor.glsl"

layout(local_size_x = 64) in;
layout(binding = 0, scalar) readonly buffer ModelCaches { ModelCache model_caches[]; };
layout(binding = 1, scalar) readonly buffer Instances { Instance instances[]; };
layout(binding = 2, scalar) writeonly buffer Caches { Cache caches[]; };
layout(push_constant, scalar) uniform Push { PlacePush push; };

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= push.cache_count) {
        return;
    }
    ModelCache c = model_caches[i];
    Instance instance = instances[c.instance];
    vec3 position = (instance.world_from_model * vec4(c.position, 1.0)).xyz;
    vec3 normal = unit_or(mat3(instance.world_from_normal) * c.normal, vec3(0.0, 1.0, 0.0));
    vec3 middle = (instance.world_from_model * vec4(c.middle, 1.0)).xyz;
    vec3 axis = mat3(instance.world_from_model) * c.axis;
    caches[i] = Cache(position, c.exponent, normal, c.area, middle, c.breadth, axis, sqrt(c.area / PI));
}
