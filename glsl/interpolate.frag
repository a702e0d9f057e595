// Stage 8, second half: applies the averaged cache lights to each pixel's surface. METHOD 5, thesis listings 5.2 and
// 6.5. At vertex level the averages at a triangle's corners are interpolated; at texel level each pixel averages the
// caches of its cell.
// variant interpolate_diffuse.frag: DIFFUSE_ONLY (where nothing in the scene is glossy)
// variant interpolate_cells.frag: BY_CELLS (at the level of pixels)
// variant interpolate_cells_diffuse.frag: BY_CELLS DIFFUSE_ONLY (both)
// variant interpolate_near.frag: NEAR (with short rays)
// variant interpolate_near_diffuse.frag: NEAR DIFFUSE_ONLY (with short rays)
// variant interpolate_near_cells.frag: NEAR BY_CELLS (with short rays)
// variant interpolate_near_cells_diffuse.frag: NEAR BY_CELLS DIFFUSE_ONLY (with short rays)
#include "shared.glsl"

layout(constant_id = 0) const uint PRINTED = 0;
layout(constant_id = 1) const uint REFERENCES = 8;
#ifdef NEAR
layout(push_constant, scalar) uniform Push { NearPush push; };
#else
layout(push_constant, scalar) uniform Push { InterpolatePush push; };
#endif
#if defined(DIFFUSE_ONLY) || defined(NEAR)
const uint GLOSSY = 0u;
#else
const uint GLOSSY = 1u;
#endif
#include "lib/here.glsl"
#ifdef BY_CELLS
#include "lib/references.glsl"
#else
layout(binding = 1, scalar) readonly buffer Draws { DrawRecord draws[]; };
#endif
#include "lib/brdf.glsl"
#include "lib/form_factor.glsl"

#ifdef BY_CELLS
layout(binding = 8, scalar) readonly buffer Proxies { Proxy proxies[]; };
#else
layout(binding = 4, scalar) readonly buffer Slots { uint slots[]; };
layout(binding = 5, scalar) readonly buffer Lights { VertexLight lights[]; };
#endif
layout(binding = 9) uniform sampler2D normal_image;
layout(binding = 10) uniform sampler2D albedo_image;
#if defined(NEAR) || !defined(DIFFUSE_ONLY)
layout(binding = 11) uniform sampler2D specular_image;
#endif
#ifdef NEAR
#include "lib/near.glsl"
#endif

layout(location = 0) out vec4 out_diffuse;
#ifndef DIFFUSE_ONLY
layout(location = 1) out vec4 out_glossy;
#endif

// Irradiance from an averaged light, and the direction to it.
vec3 received(vec3 position, vec3 light, vec3 carried, vec3 n, out vec3 towards) {
    vec3 d = light - position;
    float d2 = max(dot(d, d), 1e-30);
    towards = d * inversesqrt(d2);
    // Interpolation may round a value of 0 at the vertices to -1e-13.
    return max(carried, vec3(0.0)) * (max(dot(n, towards), 0.0) / (PRINTED != 0u ? d2 : 1.0));
}

#ifdef BY_CELLS
// Light averaged over the caches of this pixel's cell.
VertexLight light_at(DrawRecord draw, uint first_index) {
    Point x = point_here(draw, first_index);
    uint row = row_here();
    Averages a = no_caches();
    bvec2 lobes = bvec2(row != NO_REFERENCES, row != NO_REFERENCES && GLOSSY != 0u);
    for (uint round = 0u; round < 2u && any(lobes); ++round) {
        for (uint i = 0u; i < REFERENCES; ++i) {
            uint cache = referred_cache(draw, row, i);
            if (cache == NO_REFERENCES) {
                break;
            }
            Cache c = caches[cache];
            if (round > 0u || (distance(x.position, c.position) < x.d_max && dot(x.normal, c.normal) > 0.0)) {
                take(a, x, c, proxies[push.first_proxy + cache], round > 0u, lobes);
            }
        }
        lobes = left_over(a);
    }
    return averaged(a, x);
}
#else
// Light interpolated between the triangle's corners.
VertexLight light_at(DrawRecord draw, uint first_index) {
    VertexLight a = lights[slots[draw.first_slot + indices[first_index]]];
    VertexLight b = lights[slots[draw.first_slot + indices[first_index + 1u]]];
    VertexLight c = lights[slots[draw.first_slot + indices[first_index + 2u]]];
    vec3 w = weights_here(push.clip_from_world * vec4(a.position, 1.0), push.clip_from_world * vec4(b.position, 1.0),
                          push.clip_from_world * vec4(c.position, 1.0));
    return VertexLight(w.x * a.position + w.y * b.position + w.z * c.position,
                       w.x * a.diffuse_position + w.y * b.diffuse_position + w.z * c.diffuse_position,
                       w.x * a.diffuse_irradiance + w.y * b.diffuse_irradiance + w.z * c.diffuse_irradiance,
                       w.x * a.glossy_position + w.y * b.glossy_position + w.z * c.glossy_position,
                       w.x * a.glossy_irradiance + w.y * b.glossy_irradiance + w.z * c.glossy_irradiance);
}
#endif

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
    VertexLight light = light_at(draw, draw.first_index + 3u * element.y);
    vec4 normal_coded = texelFetch(normal_image, pixel, 0);
    vec3 n = normal_coded.xyz;
    vec3 from;
    vec3 e = received(light.position, light.diffuse_position, light.diffuse_irradiance, n, from);
    vec4 albedo = texelFetch(albedo_image, pixel, 0);
#ifndef DIFFUSE_ONLY
    vec4 specular = texelFetch(specular_image, pixel, 0);
    vec3 looking = view_direction(push.eye, light.position);
#endif
#ifdef NEAR
    vec3 geometric = octahedral_decode(vec2(albedo.a, texelFetch(specular_image, pixel, 0).a));
    Near near = near_of(pixel, light.position, geometric);
    e = e * near.open + near.irradiance;
#ifndef DIFFUSE_ONLY
    // Rays handle lobes of any width.
    float axis = clamp(dot(n, lobe_axis(normal_coded.w, n, looking)), LEAST_COSINE, 1.0);
    out_glossy = vec4(lobe_albedo(specular.rgb, normal_coded.w, -dot(n, looking), axis) * near.glossy, 0.0);
#endif
#elif !defined(DIFFUSE_ONLY)
    vec3 glossy_from;
    vec3 g = received(light.position, light.glossy_position, light.glossy_irradiance, n, glossy_from);
    PhongLobe fitted = fitted_lobe(specular.rgb, normal_coded.w, -dot(n, looking));
    float lobe = phong_lobe(fitted.exponent, dot(reflect(looking, n), glossy_from));
    out_glossy = vec4(fitted.albedo * lobe * g, 0.0);
#endif
    out_diffuse = vec4(albedo.rgb / PI * e, 0.0);
}
