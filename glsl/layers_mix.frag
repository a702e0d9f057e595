// Stage 8, end: attenuates the background by a layer and adds the layer's own light. METHOD 15.
layout(constant_id = 0) const uint DIMS = 0; // 1: output factors to multiply by; 0: output light to add
layout(binding = 0) uniform sampler2D layer_image;
layout(binding = 1) uniform sampler2D through_image;
layout(binding = 2) uniform sampler2D depth_image;

layout(location = 0) out vec4 out_radiance;

void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    if (texelFetch(depth_image, at, 0).r == 0.0) {
        discard;
    }
    vec4 through = texelFetch(through_image, at, 0);
    out_radiance = DIMS != 0u ? vec4(through.rgb, 1.0) : vec4(texelFetch(layer_image, at, 0).rgb * abs(through.a), 0.0);
}
