// Stage 8, end: the light of pixels' second surfaces, mixed in by their share of the samples. METHOD 13.
layout(binding = 0) uniform sampler2D second_image;
layout(binding = 1) uniform usampler2D counts;

layout(location = 0) out vec4 out_radiance;

void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    uint count = texelFetch(counts, at, 0).r;
    float second = float(count >> 16u);
    if (second == 0.0) {
        discard;
    }
    float share = second / (second + float(count & 0xffffu));
    out_radiance = vec4(texelFetch(second_image, at, 0).rgb * share, share);
}
