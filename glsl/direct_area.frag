// Stage 2: adds the direct reflection of a rectangular area light. Its unoccluded light is exact. Visible sample
// points, each with a shadow map of its own, give the share that arrives.
// variant direct_area_rays.frag: RAYS (where rays find the share that arrives)
// variant direct_area_coat.frag: COAT (where a material has a clear coat or sheen: METHOD 16)
// variant direct_area_rays_coat.frag: RAYS COAT (both)
#extension GL_EXT_control_flow_attributes : require
#include "shared.glsl"
#include "lib/area_light.glsl"
#include "lib/brdf.glsl"
#include "lib/disc.glsl"
#include "lib/dipole.glsl"
#include "lib/form_factor.glsl"
#include "lib/ggx_area.glsl"
#include "lib/light.glsl"
#include "lib/octahedral.glsl"
#include "lib/samples.glsl"
#ifdef COAT
#include "lib/coat.glsl"
#endif

#ifdef RAYS
#include "lib/arriving.glsl"
#else
layout(binding = 1, scalar) readonly buffer Views { LightView views[]; };
layout(binding = 6) uniform sampler2D shadow_image;
#endif
layout(push_constant, scalar) uniform Push { AreaPush push; };
layout(binding = 0, scalar) readonly buffer Lights { Light lights[]; };
layout(binding = 2) uniform sampler2D depth_image;
layout(binding = 3) uniform sampler2D normal_image;
layout(binding = 4) uniform sampler2D albedo_image;
layout(binding = 5) uniform sampler2D specular_image;
#ifdef COAT
layout(binding = 7) uniform usampler2D coat_image;
#endif

layout(location = 0) out vec4 out_radiance;

// Below this size, as a share of its distance, a rectangle is treated as a point: differences of its corners would
// round too much.
const float SMALL = 0.003;

bool is_small(Light light, vec3 to_middle) {
    return max(dot(light.right, light.right), dot(light.up, light.up)) < SMALL * SMALL * dot(to_middle, to_middle);
}

// Form factor of a small rectangle, times pi.
float small_factor(Light light, vec3 to_middle, vec3 n) {
    float d2 = dot(to_middle, to_middle);
    vec3 towards = to_middle * inversesqrt(d2);
    float area = 4.0 * length(cross(light.right, light.up));
    return max(dot(n, towards), 0.0) * -dot(towards, light.direction) * area / d2;
}

// Share of a rectangle's radiance that a glossy lobe reflects. `part`: above the horizon of n.
vec3 glossy_area(Light light, SeenPart part, vec3 to_middle, vec3 n, vec3 looking, vec3 specular, float coded) {
    if (specular == vec3(0.0)) {
        return vec3(0.0);
    }
    if (is_small(light, to_middle)) {
        vec3 brdf = glossy_lobe(specular, coded, n, looking, normalize(to_middle));
        return brdf * small_factor(light, to_middle, n);
    }
    if (coded < 0.0) {
        return polygon_ggx(part, n, looking, specular, coded);
    }
    return specular * polygon_lobe(part, n, reflect(looking, n), coded);
}

#ifndef RAYS
// Blocker search taps for all samples of a light together; the filter uses up to twice as many.
const int TAPS = 96;

// A blocker must be nearer than this share of the surface's own depth.
const float NEARER = 0.998;

// One face of a sample's shadow map, relative to the shaded point.
struct Face {
    ivec2 corner; // texel
    vec2 at; // position of the point in the face, as tangents
    vec3 normal; // the surface's normal in the face's axes
    vec3 front; // the light's normal in the face's axes
    float offset; // distance of the surface's plane from the sample
    float depth; // depth of the point along the face's axis
    float near; // view depth times the map's value, a constant
};

// Depths of the four texels about a direction, and the depth of the point's own plane there.
void look(Face face, vec2 tangents, out vec4 seen, out vec4 own, out vec2 f) {
    float size = float(push.face_size);
    vec2 at = (tangents * vec2(0.5, -0.5) + 0.5) * size - 0.5;
    vec2 corner = clamp(floor(at), vec2(0.0), vec2(size - 2.0));
    f = clamp(at - corner, vec2(0.0), vec2(1.0));
    // Texel order: (0, 1), (1, 1), (1, 0), (0, 0).
    vec2 between = (vec2(face.corner) + corner + 1.0) / vec2(textureSize(shadow_image, 0));
    seen = face.near / max(textureGather(shadow_image, between, 0), vec4(1e-30));
    vec2 low = (corner + 0.5) / size * 2.0 - 1.0;
    float step = 2.0 / size;
    vec4 x = low.x + step * vec4(0.0, 1.0, 1.0, 0.0);
    vec4 y = -(low.y + step * vec4(1.0, 1.0, 0.0, 0.0));
    // Ignore geometry behind the light: the light's own surface and its housing.
    seen = mix(vec4(1e30), seen, greaterThan(face.front.x * x + face.front.y * y + face.front.z, vec4(0.0)));
    vec4 slope = face.normal.x * x + face.normal.y * y + face.normal.z;
    own = mix(vec4(2.0 * face.depth), vec4(face.offset) / slope, greaterThan(slope * face.offset, vec4(0.0)));
    own = min(own, vec4(2.0 * face.depth)) * NEARER;
}

// Visibility of a sample from a point, with the sample as a disc of this radius. A blocker search finds the mean
// blocker depth, which gives the width of the penumbra; Fernando 2005.
float visibility(Light light, uint number, float radius, int taps, vec3 position, vec3 n) {
    LightView first = views[light.first_view + number * AREA_VIEWS];
    vec3 d = position - first.position;
    // In the light's own axes, along which the faces are aligned.
    vec3 z = light.direction;
    vec3 x = normalize(light.right);
    uint side = cube_face(vec3(dot(d, x), dot(d, cross(z, x)), dot(d, z)));
    if (side >= AREA_VIEWS) {
        return 0.0;
    }
    LightView view = views[light.first_view + number * AREA_VIEWS + side];
    float texel = 2.0 / float(push.face_size);
    // Small normal offset for surfaces that are not quite flat.
    d += n * (0.25 * texel * dot(d, view.forward));
    uvec2 tile = uvec2(number % push.columns, number / push.columns) * uvec2(3u, 2u) + uvec2(side % 3u, side / 3u);
    Face face;
    face.corner = ivec2(tile * push.face_size);
    face.depth = max(dot(d, view.forward), 1e-30);
    face.at = vec2(dot(d, view.right), dot(d, view.up)) / face.depth;
    face.normal = vec3(dot(n, view.right), dot(n, view.up), dot(n, view.forward));
    face.front = vec3(dot(z, view.right), dot(z, view.up), dot(z, view.forward));
    face.offset = dot(n, d);
    face.near = (view.clip_from_world * vec4(position, 1.0)).z;

    float turn = float(number);
    vec4 seen, own;
    vec2 f;
    float region = clamp(2.0 * radius / face.depth, 1.5 * texel, 0.25);
    float sum = 0.0;
    float count = 0.0;
    for (int i = 0; i < taps; ++i) {
        look(face, face.at + region * disc_point(uint(i), uint(taps), turn), seen, own, f);
        vec4 blocks = vec4(lessThan(seen, own));
        sum += dot(blocks, seen);
        count += dot(blocks, vec4(1.0));
    }
    if (count == 0.0) {
        return 1.0;
    }
    if (count == float(4 * taps)) {
        return 0.0;
    }
    float blocker = sum / count;
    float penumbra = radius * max(face.depth - blocker, 0.0) / (face.depth * blocker);
    penumbra = clamp(penumbra, texel, 2.0 * region);
    // A narrow penumbra needs few taps.
    int many = clamp(int(2.0 * penumbra * penumbra / (texel * texel)), 8, 2 * taps);
    float open = 0.0;
    for (int i = 0; i < many; ++i) {
        look(face, face.at + penumbra * disc_point(uint(i), uint(many), turn), seen, own, f);
        vec4 passes = vec4(greaterThanEqual(seen, own));
        open += mix(mix(passes.w, passes.z, f.x), mix(passes.x, passes.y, f.x), f.y);
    }
    return open / float(many);
}
#endif

#ifdef COAT
// Sheen's reflection of a rectangle, relative to the surface's form factor: the mean over 3 points in each triangle
// about the centre of the visible part, weighted by the light from each point.
vec3 sheen_area(Coat coat, CoatAlbedo over, SeenPart part, vec3 n, vec3 looking) {
    vec3 middle = middle_of(part);
    float roughness = max(coat.sheen_roughness, LEAST_SHEEN_ROUGHNESS);
    float sum = 0.0;
    float all = 0.0;
    for (int i = 0; i < part.count; ++i) {
        for (int point = 0; point < 3; ++point) {
            vec4 towards = point_of_part(part, middle, i, point);
            sum += towards.w * sheen_formula(roughness, n, looking, towards.xyz);
            all += towards.w * max(dot(n, towards.xyz), 0.0);
        }
    }
    float excess = max(sheen_whole(roughness, -dot(n, looking)), 1.0);
    return coat.sheen * ((1.0 - over.coat) * PI * sum / max(all * excess, 1e-37));
}

// Share of a rectangle's radiance that a coat reflects.
vec3 coat_area(Coat coat, Light light, vec3 to_middle, vec3 looking) {
    SeenPart part = above_horizon(to_middle, light.right, light.up, coat.normal);
    return part.count < 3 ? vec3(0.0)
        : coat.share * glossy_area(light, part, to_middle, coat.normal, looking, vec3(COAT_F0), coded_coat(coat));
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
    vec4 world = push.world_from_clip * vec4(gl_FragCoord.xy / size * 2.0 - 1.0, depth, 1.0);
    vec3 position = world.xyz / world.w;
    Light light = lights[push.light];
    vec3 to_middle = light.position - position;
    vec4 normal_coded = texelFetch(normal_image, pixel, 0);
    vec3 n = normal_coded.xyz;
    SeenPart part = above_horizon(to_middle, light.right, light.up, n);
    if (dot(to_middle, light.direction) >= 0.0 || part.count < 3 || light.intensity == vec3(0.0)) {
        return;
    }
    vec4 albedo = texelFetch(albedo_image, pixel, 0);
    vec4 specular = texelFetch(specular_image, pixel, 0);
    vec3 geometric = octahedral_decode(vec2(albedo.a, specular.a));
    albedo.rgb *= enters(max(dot(n, unit_or(to_middle, n)), 0.0), coded_ior(normal_coded.w));
    vec3 looking = view_direction(push.eye, position);
    bool glossy = specular.rgb != vec3(0.0);

    // Unoccluded light.
    float diffuse_share = is_small(light, to_middle) ? small_factor(light, to_middle, n) / PI : polygon_form_factor(part, n);
    vec3 glossy_share = glossy_area(light, part, to_middle, n, looking, specular.rgb, normal_coded.w);

#ifdef RAYS
    vec2 arrives = arriving(depth_image, pixel, depth, plane_slope(push.world_from_clip, position, geometric));
#else
    // Share that arrives: each lobe weights the samples by their unoccluded light.
    vec3 r = reflect(looking, n);
    float exponent = fitted_exponent(normal_coded.w);
    uint samples = light.columns * light.rows;
    float area = 4.0 * length(cross(light.right, light.up));
    float cell = area / float(samples);
    float radius = sqrt(cell / PI);
    int taps = clamp(TAPS / int(samples), 8, 32);
    vec2 seen = vec2(0.0);
    vec2 all = vec2(0.0);
    for (uint i = 0u; i < samples; ++i) {
        vec3 d = views[light.first_view + i * AREA_VIEWS].position - position;
        float cell_d2 = max(dot(d, d), 1e-30);
        vec3 towards = d * inversesqrt(cell_d2);
        float given = max(-dot(towards, light.direction), 0.0) / (cell_d2 + cell);
        // A lobe narrower than a sample's cell is widened to it.
        float k = min(exponent, 2.0 * PI * cell_d2 / cell);
        float received = max(dot(n, towards), 0.0) + 0.01;
        vec2 weight = given * received * vec2(1.0, glossy ? cosine_power(dot(r, towards), k) + 1e-4 : 0.0);
        all += weight;
        if (given > 0.0 && dot(geometric, towards) > 0.0) {
            seen += weight * visibility(light, i, radius, taps, position, geometric);
        }
    }
    vec2 arrives = seen / max(all, vec2(1e-30));
#endif
#ifdef COAT
    Coat coat = unpack_coat(texelFetch(coat_image, pixel, 0));
    CoatAlbedo over = albedo_of(coat, n, looking);
    vec3 diffuse = without_sheen(albedo.rgb, over);
    vec3 sheen_and_coat = vec3(0.0);
    if (over.sheen != vec3(0.0)) {
        sheen_and_coat += sheen_area(coat, over, part, n, looking) * (diffuse_share * arrives.x);
    }
    if (coat.share > 0.0) {
        sheen_and_coat += coat_area(coat, light, to_middle, looking) * (glossy ? arrives.y : arrives.x);
    }
    vec3 reflected =
        diffuse * (diffuse_share * arrives.x) + glossy_share * arrives.y + sheen_and_coat;
#else
    vec3 reflected = albedo.rgb * (diffuse_share * arrives.x) + glossy_share * arrives.y;
#endif
    out_radiance = vec4(light.intensity * reflected, 0.0);
}
