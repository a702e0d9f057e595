// Stage 8, second half: the averaged lights of a triangle's corners, interpolated and put on the pixel's own surface.
// METHOD 5, thesis listing 5.2.
#include "shared.glsl"
#include "lib/form_factor.glsl"
#include "lib/phong.glsl"

layout(constant_id = 0) const uint PRINTED = 0;
layout(push_constant, scalar) uniform Push { InterpolatePush push; };
layout(binding = 0) uniform usampler2D element_image;
layout(binding = 1, scalar) readonly buffer Draws { DrawRecord draws[]; };
layout(binding = 2, scalar) readonly buffer Indices { uint indices[]; };
layout(binding = 3, scalar) readonly buffer Slots { uint slots[]; };
layout(binding = 4, scalar) readonly buffer Lights { VertexLight lights[]; };
layout(binding = 5) uniform sampler2D normal_image;
layout(binding = 6) uniform sampler2D albedo_image;
#ifndef DIFFUSE_ONLY
layout(binding = 7) uniform sampler2D specular_image;
#endif

layout(location = 0) out vec4 out_diffuse;
#ifndef DIFFUSE_ONLY
layout(location = 1) out vec4 out_glossy;
#endif

// Irradiance of an averaged light through the surface, and the direction it comes from.
vec3 received(vec3 position, vec3 light, vec3 carried, vec3 n, out vec3 towards) {
    vec3 d = light - position;
    float d2 = max(dot(d, d), 1e-30);
    towards = d * inversesqrt(d2);
    // Rounding of the interpolation leaves -1e-13 where the vertices say 0.
    return max(carried, vec3(0.0)) * (max(dot(n, towards), 0.0) / (PRINTED != 0u ? d2 : 1.0));
}

// Where the pixel's ray meets the triangle, as weights of its corners: areas of the triangle as the pixel sees it. Corners
// count from the pixel, else small triangles far from the picture's middle would be lost in rounding.
vec3 weights_at(vec2 pixel, vec4 a, vec4 b, vec4 c) {
    vec2 pa = a.xy - pixel * a.w;
    vec2 pb = b.xy - pixel * b.w;
    vec2 pc = c.xy - pixel * c.w;
    vec3 areas = vec3(pb.x * pc.y - pb.y * pc.x, pc.x * pa.y - pc.y * pa.x, pa.x * pb.y - pa.y * pb.x);
    // Seen from either side; a centre that rounding puts outside counts as one on the edge.
    areas = max(areas * sign(areas.x + areas.y + areas.z), vec3(0.0));
    float all = areas.x + areas.y + areas.z;
    return all > 0.0 ? areas / all : vec3(1.0 / 3.0);
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    out_diffuse = vec4(0.0);
#ifndef DIFFUSE_ONLY
    out_glossy = vec4(0.0);
#endif
    uvec2 element = texelFetch(element_image, pixel, 0).xy;
    if (element.x == 0u) {
        return;
    }
    DrawRecord draw = draws[element.x - 1u];
    if (draw.reference_base == NO_REFERENCES) {
        return;
    }
    uint first = draw.first_index + 3u * element.y;
    VertexLight a = lights[slots[draw.first_slot + indices[first]]];
    VertexLight b = lights[slots[draw.first_slot + indices[first + 1u]]];
    VertexLight c = lights[slots[draw.first_slot + indices[first + 2u]]];
    vec2 place = gl_FragCoord.xy / vec2(textureSize(element_image, 0)) * 2.0 - 1.0;
    vec3 w = weights_at(place, push.clip_from_world * vec4(a.position, 1.0), push.clip_from_world * vec4(b.position, 1.0),
                        push.clip_from_world * vec4(c.position, 1.0));
    vec3 position = w.x * a.position + w.y * b.position + w.z * c.position;
    vec3 from = w.x * a.diffuse_position + w.y * b.diffuse_position + w.z * c.diffuse_position;
    vec3 carried = w.x * a.diffuse_irradiance + w.y * b.diffuse_irradiance + w.z * c.diffuse_irradiance;

    vec4 normal_exponent = texelFetch(normal_image, pixel, 0);
    vec3 n = normal_exponent.xyz;
    vec3 towards;
    vec3 e = received(position, from, carried, n, towards);
    out_diffuse = vec4(texelFetch(albedo_image, pixel, 0).rgb / PI * e, 0.0);
#ifndef DIFFUSE_ONLY
    from = w.x * a.glossy_position + w.y * b.glossy_position + w.z * c.glossy_position;
    carried = w.x * a.glossy_irradiance + w.y * b.glossy_irradiance + w.z * c.glossy_irradiance;
    e = received(position, from, carried, n, towards);
    vec3 r = reflect(view_direction(push.eye, position), n);
    out_glossy = vec4(texelFetch(specular_image, pixel, 0).rgb * phong_lobe(normal_exponent.w, dot(r, towards)) * e, 0.0);
#endif
}
