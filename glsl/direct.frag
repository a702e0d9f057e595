// Stage 2: adds one light's direct reflection, shadowed by its shadow map. METHOD 1.
// variant direct_rays.frag: RAYS (where rays find the share that arrives)
// variant direct_coat.frag: COAT (where a material has a clear coat or sheen: METHOD 16)
// variant direct_rays_coat.frag: RAYS COAT (both)
#include "shared.glsl"
#include "lib/brdf.glsl"
#include "lib/dipole.glsl"
#include "lib/form_factor.glsl"
#include "lib/light.glsl"
#include "lib/octahedral.glsl"
#include "lib/samples.glsl"
#ifdef COAT
#include "lib/coat.glsl"
#endif

#ifdef RAYS
#include "lib/arriving.glsl"
#else
layout(constant_id = 0) const uint SAMPLES = 0; // further points of a pixel that smooth shadow edges
layout(binding = 1, scalar) readonly buffer Views { LightView views[]; };
layout(binding = 6) uniform sampler2D shadow_image;
#endif
layout(push_constant, scalar) uniform Push { ScreenPush push; };
layout(binding = 0, scalar) readonly buffer Lights { Light lights[]; };
layout(binding = 2) uniform sampler2D depth_image;
layout(binding = 3) uniform sampler2D normal_image;
layout(binding = 4) uniform sampler2D albedo_image;
layout(binding = 5) uniform sampler2D specular_image;
#ifdef COAT
layout(binding = 7) uniform usampler2D coat_image;
#endif

layout(location = 0) out vec4 out_radiance;

vec3 place(vec2 ndc, float depth) {
    vec4 world = push.world_from_clip * vec4(ndc, depth, 1.0);
    return world.xyz / world.w;
}

#ifndef RAYS
// Visibility by the shadow map: bilinear over the 2x2 texels around the point's projection.
float visibility(Light light, vec3 position, vec3 n, vec3 towards) {
    bool directional = light.kind == LIGHT_DIRECTIONAL;
    bool six = light.view_count > 1u;
    float size = float(push.shadow_size);
    // All views of a light have the same size; a directional light's view may be taller than wide.
    LightView first = views[light.first_view];
    float spread = max(length(first.right), length(first.up));
    float texel = 2.0 * spread * (directional ? 1.0 : length(position - light.position)) / size;
    // Normal offset: by as much as the surface can slope within a texel, against self-shadowing.
    float cosine = clamp(dot(n, towards), 0.0, 1.0);
    vec3 p = position + n * texel * (0.5 + 1.5 * sqrt(1.0 - cosine * cosine));
    // Projected from the offset point, which may lie on another cube face.
    uint face = six ? cube_face(p - light.position) : 0u;
    vec4 clip = views[light.first_view + face].clip_from_world * vec4(p, 1.0);
    vec3 ndc = clip.xyz / clip.w;
    if (!six && any(greaterThan(abs(ndc.xy), vec2(1.0)))) {
        return directional ? 1.0 : 0.0;
    }
    vec2 at = (ndc.xy * 0.5 + 0.5) * size - 0.5;
    vec2 corner = floor(at);
    vec2 f = at - corner;
    ivec2 origin = ivec2(face % 3u, face / 3u) * int(push.shadow_size);
    // Reversed depth: nearer is greater. The map's rounding error is relative for perspective, absolute for parallel
    // light.
    float own = directional ? ndc.z + 1e-5 : ndc.z * 1.0005;
    vec4 seen;
    for (int i = 0; i < 4; ++i) {
        ivec2 texel_at = clamp(ivec2(corner) + ivec2(i & 1, i >> 1), ivec2(0), ivec2(int(push.shadow_size) - 1));
        seen[i] = texelFetch(shadow_image, origin + texel_at, 0).r <= own ? 1.0 : 0.0;
    }
    return mix(mix(seen.x, seen.y, f.x), mix(seen.z, seen.w, f.x), f.y);
}

// Visibility of a whole pixel: the mean over points of its surface's plane.
float visibility_of_pixel(Light light, vec2 middle, vec2 pixel, float depth, vec3 position, vec3 n, vec3 towards) {
    float sum = visibility(light, position, n, towards);
    vec2 slope = plane_slope(push.world_from_clip, position, n);
    for (uint i = 1u; i <= SAMPLES; ++i) {
        vec2 offset = sample_offset(i, SAMPLES) * pixel;
        float there = depth + dot(slope, offset);
        // On planes seen nearly edge-on the point may be far off; use the centre then.
        sum += visibility(light, there > 0.5 * depth && there < 2.0 * depth ? place(middle + offset, there) : position, n, towards);
    }
    return sum / float(SAMPLES + 1u);
}
#endif

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    float depth = texelFetch(depth_image, pixel, 0).r;
    out_radiance = vec4(0.0);
    if (depth <= 0.0) {
        return;
    }
    vec2 size = vec2(textureSize(depth_image, 0));
    vec2 middle = gl_FragCoord.xy / size * 2.0 - 1.0;
    vec3 position = place(middle, depth);
    vec4 normal_coded = texelFetch(normal_image, pixel, 0);
    vec4 albedo = texelFetch(albedo_image, pixel, 0);
    vec4 specular = texelFetch(specular_image, pixel, 0);
    vec3 geometric = octahedral_decode(vec2(albedo.a, specular.a));
    vec3 n = normal_coded.xyz;

    Light light = lights[push.light];
    vec3 towards = -light.direction;
    vec3 irradiance = light.intensity; // on a plane that faces the light
    if (light.kind != LIGHT_DIRECTIONAL) {
        vec3 d = light.position - position;
        float d2 = max(dot(d, d), 1e-30);
        towards = d * inversesqrt(d2);
        irradiance *= range_window(d2, light.range) / d2;
        if (light.kind == LIGHT_SPOT) {
            irradiance *= spot_falloff(-dot(towards, light.direction), light.cone_scale, light.cone_offset);
        } else if (light.kind == LIGHT_BODY) {
            irradiance *= body_falloff(-towards, light.right, light.up, light.lean);
        }
    }
    float cosine = dot(n, towards);
#ifdef COAT
    Coat coat = unpack_coat(texelFetch(coat_image, pixel, 0));
    bool away = max(cosine, dot(coat.normal, towards)) <= 0.0;
#else
    bool away = cosine <= 0.0;
#endif
    if (away || dot(geometric, towards) <= 0.0 || irradiance == vec3(0.0)) {
        return;
    }
    albedo.rgb *= enters(max(cosine, 0.0), coded_ior(normal_coded.w));
    vec3 looking = view_direction(push.eye, position);
#ifdef COAT
    CoatAlbedo over = albedo_of(coat, n, looking);
    vec3 reflected = coat_reflected(coat, over, n, looking, towards);
    if (cosine > 0.0) {
        vec3 diffuse = without_sheen(albedo.rgb, over) / PI;
        reflected += (diffuse + glossy_lobe(specular.rgb, normal_coded.w, n, looking, towards)) * cosine;
    }
#else
    vec3 brdf = albedo.rgb / PI + glossy_lobe(specular.rgb, normal_coded.w, n, looking, towards);
#endif
#ifdef RAYS
    float seen = light.radius > 0.0
        ? arriving(depth_image, pixel, depth, plane_slope(push.world_from_clip, position, geometric)).x
        : arriving_alone(pixel.y * int(size.x) + pixel.x).x;
#else
    float seen = visibility_of_pixel(light, middle, 2.0 / size, depth, position, geometric, towards);
#endif
#ifdef COAT
    out_radiance = vec4(reflected * irradiance * seen, 0.0);
#else
    out_radiance = vec4(brdf * irradiance * (cosine * seen), 0.0);
#endif
}
