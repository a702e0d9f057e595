// Stage 8, last: adds the light of the sky at each pixel to direct light: the unoccluded light by the pixel's normal,
// times the share that reaches the pixel: by its short rays, or as the caches around see it. METHOD 12.
// variant sky_light_cells.frag: BY_CELLS (at the level of pixels)
// variant sky_light_near.frag: NEAR (with short rays)
// variant sky_light_coat.frag: COAT (where a material has a clear coat: METHOD 16)
// variant sky_light_cells_coat.frag: BY_CELLS COAT (likewise)
// variant sky_light_near_coat.frag: NEAR COAT (likewise)
#include "shared.glsl"

layout(constant_id = 0) const uint GLOSSY = 1;
layout(constant_id = 1) const uint REFERENCES = 8;
#ifdef BY_CELLS
const uint PRINTED = 0u;
#endif
#ifdef NEAR
layout(push_constant, scalar) uniform Push { NearPush push; };
#else
layout(push_constant, scalar) uniform Push { InterpolatePush push; };
#endif
#include "lib/here.glsl"
#ifdef BY_CELLS
#include "lib/references.glsl"
#include "lib/sky_seen.glsl"
layout(binding = 8, scalar) readonly buffer Seen { SkySeen seen[]; }; // per cache
#elif defined(NEAR)
layout(binding = 1, scalar) readonly buffer Draws { DrawRecord draws[]; };
layout(binding = 4, scalar) readonly buffer Instances { Instance instances[]; };
layout(binding = 5, scalar) readonly buffer Corners { Corner corners[]; };
#else
layout(binding = 1, scalar) readonly buffer Draws { DrawRecord draws[]; };
layout(binding = 4, scalar) readonly buffer Slots { uint slots[]; };
layout(binding = 5, scalar) readonly buffer Lights { VertexLight lights[]; };
layout(binding = 8, scalar) readonly buffer SkyLights { vec3 sky_lights[]; }; // per vertex
#endif
#include "lib/brdf.glsl"
#include "lib/form_factor.glsl"
layout(binding = 9) uniform sampler2D normal_image;
layout(binding = 10) uniform sampler2D albedo_image;
layout(binding = 11) uniform sampler2D specular_image;
#ifdef NEAR
#include "lib/near.glsl"
#endif
#define SKY_BINDING 14
#include "lib/sky.glsl"
#ifdef COAT
#include "lib/coat.glsl"
layout(binding = 16) uniform usampler2D coat_image;
#endif

layout(location = 0) out vec4 out_radiance;

#ifdef BY_CELLS
// Visible share of the sky's light from this pixel's cell, and the position of the pixel's surface.
vec3 seen_here(DrawRecord draw, uint first_index, out vec3 position) {
    Point x = point_here(draw, first_index);
    position = x.position;
    SeenSum sum = SeenSum(vec3(0.0), 0.0);
    uint row = row_here();
    for (uint round = 0u; round < 2u && sum.weight <= 0.0 && row != NO_REFERENCES; ++round) {
        for (uint i = 0u; i < REFERENCES; ++i) {
            uint cache = referred_cache(draw, row, i);
            if (cache == NO_REFERENCES) {
                break;
            }
            take_seen(sum, x.position, x.normal, x.d_max, caches[cache], seen[cache].share, round > 0u);
        }
    }
    return sum.weight > 0.0 ? sum.seen / sum.weight : vec3(1.0);
}
#elif defined(NEAR)
// Position of the pixel's surface.
vec3 position_here(DrawRecord draw, uint first_index) {
    mat3 place;
    vec4 clip[3];
    for (uint i = 0u; i < 3u; ++i) {
        vec3 corner = corners[draw.first_vertex + indices[first_index + i]].position;
        place[i] = (instances[draw.instance].world_from_model * vec4(corner, 1.0)).xyz;
        clip[i] = push.clip_from_world * vec4(place[i], 1.0);
    }
    return place * weights_here(clip[0], clip[1], clip[2]);
}
#else
// Visible share of the sky's light from the triangle's corners, and the position of the pixel's surface.
vec3 seen_here(DrawRecord draw, uint first_index, out vec3 position) {
    uvec3 at = uvec3(slots[draw.first_slot + indices[first_index]], slots[draw.first_slot + indices[first_index + 1u]],
                     slots[draw.first_slot + indices[first_index + 2u]]);
    vec3 a = lights[at.x].position;
    vec3 b = lights[at.y].position;
    vec3 c = lights[at.z].position;
    vec3 w = weights_here(push.clip_from_world * vec4(a, 1.0), push.clip_from_world * vec4(b, 1.0),
                          push.clip_from_world * vec4(c, 1.0));
    position = w.x * a + w.y * b + w.z * c;
    return w.x * sky_lights[at.x] + w.y * sky_lights[at.y] + w.z * sky_lights[at.z];
}
#endif

#if !defined(NEAR) || defined(COAT)
// Visible share of the sky for a lobe, from the visible share `seen` of all light, as if a cone about the normal were
// open. Lagarde and de Rousiers 2014, 4.10.2.
float lobe_seen(float seen, float cosine, float k) {
    float alpha = sqrt(2.0 / (k + 2.0));
    return clamp(pow(cosine + seen, exp2(-16.0 * sqrt(alpha) - 1.0)) - 1.0 + seen, 0.0, 1.0);
}
#endif

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    out_radiance = vec4(0.0);
    uvec2 element = texelFetch(element_image, pixel, 0).xy;
    if (element.x == 0u) {
        return;
    }
    DrawRecord draw = draws[element.x - 1u];
    uint first_index = draw.first_index + 3u * element.y;
#ifdef NEAR
    vec3 position = position_here(draw, first_index);
#else
    vec3 position = vec3(0.0);
    vec3 seen = draw.reference_base == NO_REFERENCES ? vec3(1.0) : seen_here(draw, first_index, position);
#endif
    vec4 normal_coded = texelFetch(normal_image, pixel, 0);
    vec3 n = normal_coded.xyz;
    vec4 albedo = texelFetch(albedo_image, pixel, 0);
    vec4 specular = texelFetch(specular_image, pixel, 0);
#ifdef NEAR
    Near near = near_of(pixel, position, octahedral_decode(vec2(albedo.a, specular.a)));
    vec3 seen = near.open_sky;
#endif
    vec3 radiance = albedo.rgb / PI * seen * sky_at(SKY_IRRADIANCE, n);
    if (GLOSSY != 0u && specular.rgb != vec3(0.0)) {
        vec3 looking = view_direction(push.eye, position);
        vec3 axis = lobe_axis(normal_coded.w, n, looking);
        PhongLobe lobe = fitted_about(specular.rgb, normal_coded.w, -dot(n, looking), dot(n, axis), 1e9);
        float share = phong_albedo(lobe.exponent, dot(n, axis));
#ifdef NEAR
        share *= near.sky;
#else
        share *= lobe_seen(dot(seen, vec3(0.2126, 0.7152, 0.0722)), max(-dot(looking, n), 0.0), lobe.exponent);
#endif
        radiance += lobe.albedo * share * sky_lobe(axis, lobe.exponent);
    }
#ifdef COAT
    Coat coat = unpack_coat(texelFetch(coat_image, pixel, 0));
    if (coat.share > 0.0) {
        // Occlusion of a coat is known only for light as a whole.
        vec3 looking = view_direction(push.eye, position);
        vec3 axis = lobe_axis(coded_coat(coat), coat.normal, looking);
        float cosine = dot(coat.normal, axis);
        PhongLobe lobe = fitted_about(vec3(COAT_F0), coded_coat(coat), -dot(coat.normal, looking), cosine, 1e9);
        float luminance = dot(seen, vec3(0.2126, 0.7152, 0.0722));
        float share = lobe_seen(luminance, max(-dot(looking, coat.normal), 0.0), lobe.exponent);
        share *= coat.share * phong_albedo(lobe.exponent, cosine);
        radiance += lobe.albedo * share * sky_lobe(axis, lobe.exponent);
    }
#endif
    out_radiance = vec4(radiance, 0.0);
}
