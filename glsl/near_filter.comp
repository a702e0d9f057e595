// Stage 8, fourth: combines the short rays of neighbouring pixels. Any square of NEAR_SIDE^2 pixels has all directions.
// The window is that wide with half-weighted borders, so that all directions count equally. A picture that is the mean
// of many takes a narrower window: each of its views has other directions. METHOD 11.
// variant near_filter_glossy.comp: GLOSSY (where a material has a glossy lobe)
#include "shared.glsl"
#include "lib/near_alike.glsl"

layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { NearFilterPush push; };
layout(constant_id = 0) const uint AS_TEXELS = 0; // 1: pixels are read as texels
layout(constant_id = 1) const int HALF = int(NEAR_SIDE) / 2; // radius of the window [pixels]; the outermost count half
layout(binding = 0, scalar) readonly buffer NearPixels { NearPixel near_pixels[]; };
layout(binding = 1) uniform samplerBuffer near_pixel_texels;
layout(binding = 2, scalar) writeonly buffer NearLights { NearLight near_lights[]; };

const int WINDOW = 2 * HALF + 1;

const vec3 LUMINANCE = vec3(0.2126, 0.7152, 0.0722);

NearPixel near_pixel(ivec2 at) {
    int index = at.y * int(push.width) + at.x;
    if (AS_TEXELS == 0u) {
        return near_pixels[index];
    }
    index *= 9;
    vec4 a = texelFetch(near_pixel_texels, index);
    vec4 b = texelFetch(near_pixel_texels, index + 1);
    vec4 c = texelFetch(near_pixel_texels, index + 2);
    vec4 d = texelFetch(near_pixel_texels, index + 3);
    vec4 e = texelFetch(near_pixel_texels, index + 4);
    vec4 f = texelFetch(near_pixel_texels, index + 5);
    vec4 g = texelFetch(near_pixel_texels, index + 6);
    vec4 h = texelFetch(near_pixel_texels, index + 7);
    vec4 i = texelFetch(near_pixel_texels, index + 8);
    return NearPixel(a.xyz, a.w, b.xyz, b.w, c.xyz, c.w, d.xyz, d.w, e.xyz, e.w, f.xyz, f.w, g.xyz, g.w,
                     h.xyz, vec3(h.w, i.xy), i.zw);
}

// Weight of a pixel of the window.
float weight_of(NearPixel own, NearPixel p, ivec2 offset) {
    float weight = near_alike(own.position - p.position, facing_of(own.normal, own.geometric), facing_of(p.normal, p.geometric));
    weight *= abs(offset.x) == HALF ? 0.5 : 1.0;
    weight *= abs(offset.y) == HALF ? 0.5 : 1.0;
    return weight;
}

bool is_outside(ivec2 at) {
    return any(lessThan(at, ivec2(0))) || any(greaterThanEqual(at, ivec2(push.width, push.height)));
}

void main() {
    ivec2 at = ivec2(gl_GlobalInvocationID.xy);
    if (at.x >= int(push.width) || at.y >= int(push.height)) {
        return;
    }
    uint index = uint(at.y) * push.width + uint(at.x);
    NearPixel own = near_pixel(at);
    NearLight sum = NearLight(vec3(0.0), own.geometric, vec3(0.0), 0.0, vec3(0.0), 0.0, own.position, 0.0,
                              octahedral_encode(own.normal), 0.0, 0.0, vec3(0.0), vec3(0.0), 0.0, 0.0);
    if (own.geometric == 0.0) {
        near_lights[index] = sum;
        return;
    }
    vec3 far = vec3(0.0);
    vec3 all = vec3(0.0);
    float open = 0.0;
    vec3 open_sky = vec3(0.0);
    vec3 all_sky = vec3(0.0);
    vec2 hidden_sky = vec2(0.0);
    float weights = 0.0;
#ifdef GLOSSY
    float nearness = 0.0;
    float with_lobes = 0.0;
#endif
    for (int j = 0; j < WINDOW * WINDOW; ++j) {
        ivec2 offset = ivec2(j % WINDOW, j / WINDOW) - HALF;
        if (is_outside(at + offset)) {
            continue;
        }
        NearPixel p = near_pixel(at + offset);
        if (p.geometric == 0.0) {
            continue;
        }
        float weight = weight_of(own, p, offset);
        weights += weight;
        sum.irradiance += weight * p.irradiance;
        sum.crowding += weight * p.crowding;
        far += weight * p.far;
        float light = min(dot(p.irradiance + p.far, LUMINANCE), 1e18);
        sum.light_squared += weight * light * light;
        all += weight * p.all;
        open += weight * p.open;
        open_sky += weight * p.open_sky;
        all_sky += weight * p.all_sky;
        hidden_sky += weight * p.hidden_sky;
#ifdef GLOSSY
        weight = p.width > 0.0 ? weight : 0.0;
        nearness += weight * p.nearness;
        with_lobes += weight;
#endif
    }
    sum.irradiance /= weights;
    sum.crowding /= weights;
    sum.light = dot(sum.irradiance + far / weights, LUMINANCE);
    sum.light_squared /= weights;
    // If the nearest caches have no light, assume that light comes equally from all directions.
    sum.open = mix(vec3(open / weights), far / max(all, 1e-37), greaterThan(all, vec3(0.0)));
    sum.open_sky = mix(vec3(open / weights), open_sky / max(all_sky, 1e-37), greaterThan(all_sky, vec3(0.0)));
    sum.sky_crowding = hidden_sky.y / max(hidden_sky.x, 1e-37);
#ifdef GLOSSY
    // Each pixel has one direction of the lobe. Directions are combined if both lobes mirror the same place.
    nearness /= max(with_lobes, 1e-30);
    float lobe_weights = 0.0;
    float sky_all = 0.0;
    for (int j = 0; j < WINDOW * WINDOW; ++j) {
        ivec2 offset = ivec2(j % WINDOW, j / WINDOW) - HALF;
        if (is_outside(at + offset)) {
            continue;
        }
        NearPixel p = near_pixel(at + offset);
        if (p.geometric != 0.0 && p.width > 0.0) {
            float apart = lobes_apart(own.position - p.position, own.mirrored - p.mirrored, nearness, own.width);
            float share = weight_of(own, p, offset) / (1.0 + apart * apart);
            lobe_weights += share;
            sum.glossy += share * p.glossy;
            sum.sky += share * p.sky;
            sky_all += share * p.sky_all;
        }
    }
    sum.glossy /= max(lobe_weights, 1e-37);
    sum.sky = min(sum.sky / max(sky_all, 1e-37), 1.0);
    sum.mirrored = own.mirrored;
    sum.width = own.width;
    sum.nearness = nearness;
#endif
    near_lights[index] = sum;
}
