// Stages 1 and 4, and shadow maps: a model's vertex into the world and into a view.
#include "shared.glsl"

layout(push_constant, scalar) uniform Push { DrawPush push; };
layout(binding = 0, scalar) readonly buffer Instances { Instance instances[]; };

layout(location = 0) in vec3 model_position;
layout(location = 1) in vec3 model_normal;
layout(location = 2) in vec4 model_tangent;
layout(location = 3) in vec2 uv0;
layout(location = 4) in vec2 uv1;
layout(location = 5) in vec4 color;

layout(location = 0) out vec3 out_position;
layout(location = 1) out vec3 out_normal;
layout(location = 2) out vec4 out_tangent;
layout(location = 3) out vec4 out_uv;
layout(location = 4) out vec4 out_color;

void main() {
    Instance instance = instances[push.instance];
    vec3 position = (instance.world_from_model * vec4(model_position, 1.0)).xyz;
    gl_Position = push.clip_from_world * vec4(position, 1.0);
    out_position = position;
    out_normal = mat3(instance.world_from_normal) * model_normal;
    mat3 linear = mat3(instance.world_from_model);
    // A mirror turns the bitangent round. Without a tangent the sign says which side this is, and stays.
    bool turned = determinant(linear) < 0.0 && dot(model_tangent.xyz, model_tangent.xyz) > 0.0;
    out_tangent = vec4(linear * model_tangent.xyz, turned ? -model_tangent.w : model_tangent.w);
    out_uv = vec4(uv0, uv1);
    out_color = color;
}
