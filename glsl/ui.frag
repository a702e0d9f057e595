// Panels over the picture in a window. All colours are sRGB display colours with premultiplied alpha.

layout(binding = 0) uniform sampler2D panel_texture;
layout(location = 0) in vec2 uv;
layout(location = 1) in vec4 color;
layout(location = 0) out vec4 out_color;

void main() {
    out_color = color * texture(panel_texture, uv);
}
