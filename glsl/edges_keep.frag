// Stage 8, end: saves the light of pixels' first surfaces before mixing, for neighbouring pixels to read. METHOD 13.
layout(binding = 0) uniform sampler2D image;

layout(location = 0) out vec4 out_radiance;

void main() {
    out_radiance = texelFetch(image, ivec2(gl_FragCoord.xy), 0);
}
