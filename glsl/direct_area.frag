// Stage 2: the direct reflection of a rectangle that shines, added to what is there. Its light is exact where nothing is in
// the way; of points on it, each with a shadow map of its own, those that are seen give the share that arrives.
#include "shared.glsl"
#include "lib/area_light.glsl"
#include "lib/form_factor.glsl"
#include "lib/light.glsl"
#include "lib/octahedral.glsl"
#include "lib/phong.glsl"

layout(push_constant, scalar) uniform Push { AreaPush push; };
layout(binding = 0, scalar) readonly buffer Lights { Light lights[]; };
layout(binding = 1, scalar) readonly buffer Views { LightView views[]; };
layout(binding = 2) uniform sampler2D depth_image;
layout(binding = 3) uniform sampler2D normal_image;
layout(binding = 4) uniform sampler2D albedo_image;
layout(binding = 5) uniform sampler2D specular_image;
layout(binding = 6) uniform sampler2D shadow_image;

layout(location = 0) out vec4 out_radiance;

// Smaller than this share of its distance a rectangle is a point: differences of its corners round too much.
const float SMALL = 0.003;

// Texels looked at for what may be in the way, and for how much of it is.
const int SEARCH_TAPS = 12;
const int FILTER_TAPS = 16;

// Golden angle [rad]: points of a disc that are evenly spread.
const float GOLDEN = 2.39996323;

// One face of a sample's shadow map, as a point sees it.
struct Face {
    ivec2 corner; // texel
    vec2 at; // where the point is, as tangents
    vec3 normal; // the surface's, in the axes of the face
    float offset; // of the surface's plane from the sample
    float depth; // of the point, along the face's axis
    float near; // depth times the map's value
};

// Depth along the axis of the nearest surface in a direction, and of the point's own plane where the texel is.
vec2 depths(Face face, vec2 tangents) {
    float size = float(push.face_size);
    ivec2 texel = clamp(ivec2(floor((tangents * vec2(0.5, -0.5) + 0.5) * size)), ivec2(0), ivec2(int(push.face_size) - 1));
    float seen = face.near / max(texelFetch(shadow_image, face.corner + texel, 0).r, 1e-30);
    vec2 middle = ((vec2(texel) + 0.5) / size * 2.0 - 1.0) * vec2(1.0, -1.0);
    float slope = dot(face.normal, vec3(middle, 1.0));
    float own = slope * face.offset > 0.0 ? face.offset / slope : 2.0 * face.depth;
    return vec2(seen, clamp(own, 0.5 * face.depth, 2.0 * face.depth));
}

vec2 disc_point(int i, int count, float turn) {
    float angle = float(i) * GOLDEN + turn;
    return sqrt((float(i) + 0.5) / float(count)) * vec2(cos(angle), sin(angle));
}

// Share of a disc of this radius about sample `number` that a point sees: blockers are looked for, and their mean depth says
// how wide the shadow's edge is; Fernando 2005.
float visibility(Light light, uint number, float radius, vec3 position, vec3 n) {
    LightView first = views[light.first_view + number * AREA_VIEWS];
    vec3 d = position - first.position;
    // In the light's own axes, which the faces are along.
    vec3 z = light.direction;
    vec3 x = normalize(light.right);
    uint side = cube_face(vec3(dot(d, x), dot(d, cross(z, x)), dot(d, z)));
    if (side >= AREA_VIEWS) {
        return 0.0;
    }
    LightView view = views[light.first_view + number * AREA_VIEWS + side];
    Face face;
    uvec2 tile = uvec2(number % push.columns, number / push.columns) * uvec2(3u, 2u) + uvec2(side % 3u, side / 3u);
    face.corner = ivec2(tile * push.face_size);
    float texel = 2.0 / float(push.face_size);
    face.depth = dot(d, view.forward);
    // A little out of the surface, for what is not quite flat.
    d += n * (0.25 * texel * face.depth);
    face.depth = max(dot(d, view.forward), 1e-30);
    face.at = vec2(dot(d, view.right), dot(d, view.up)) / face.depth;
    face.normal = vec3(dot(n, view.right), dot(n, view.up), dot(n, view.forward));
    face.offset = dot(n, d);
    face.near = (view.clip_from_world * vec4(position, 1.0)).z;

    float turn = float(number);
    float region = clamp(2.0 * radius / face.depth, 1.5 * texel, 0.25);
    float sum = 0.0;
    float count = 0.0;
    for (int i = 0; i < SEARCH_TAPS; ++i) {
        vec2 both = depths(face, face.at + region * disc_point(i, SEARCH_TAPS, turn));
        if (both.x < both.y * 0.998) {
            sum += both.x;
            count += 1.0;
        }
    }
    if (count == 0.0) {
        return 1.0;
    }
    float blocker = sum / count;
    float penumbra = radius * max(face.depth - blocker, 0.0) / (face.depth * blocker);
    penumbra = clamp(penumbra, texel, 2.0 * region);
    float open = 0.0;
    for (int i = 0; i < FILTER_TAPS; ++i) {
        vec2 both = depths(face, face.at + penumbra * disc_point(i, FILTER_TAPS, turn));
        open += both.x < both.y * 0.998 ? 0.0 : 1.0;
    }
    return open / float(FILTER_TAPS);
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    float depth = texelFetch(depth_image, pixel, 0).r;
    out_radiance = vec4(0.0);
    if (depth == 0.0) {
        return;
    }
    vec2 size = vec2(textureSize(depth_image, 0));
    vec4 world = push.world_from_clip * vec4(gl_FragCoord.xy / size * 2.0 - 1.0, depth, 1.0);
    vec3 position = world.xyz / world.w;
    Light light = lights[push.light];
    vec3 to_middle = light.position - position;
    vec4 normal_exponent = texelFetch(normal_image, pixel, 0);
    vec3 n = normal_exponent.xyz;
    SeenPart part = above_horizon(to_middle, light.right, light.up, n);
    if (dot(to_middle, light.direction) >= 0.0 || part.count < 3 || light.intensity == vec3(0.0)) {
        return;
    }
    vec4 albedo = texelFetch(albedo_image, pixel, 0);
    vec4 specular = texelFetch(specular_image, pixel, 0);
    vec3 geometric = octahedral_decode(vec2(albedo.a, specular.a));
    vec3 r = reflect(view_direction(push.eye, position), n);
    float exponent = normal_exponent.w;
    bool glossy = specular.rgb != vec3(0.0);

    // Without anything in the way.
    float d2 = dot(to_middle, to_middle);
    float area = 4.0 * length(cross(light.right, light.up));
    float diffuse_share;
    float glossy_share = 0.0;
    if (max(dot(light.right, light.right), dot(light.up, light.up)) < SMALL * SMALL * d2) {
        vec3 towards = to_middle * inversesqrt(d2);
        float facing = max(dot(n, towards), 0.0) * -dot(towards, light.direction) * area / d2;
        diffuse_share = facing / PI;
        glossy_share = glossy ? facing * phong_lobe(exponent, dot(r, towards)) : 0.0;
    } else {
        diffuse_share = polygon_form_factor(part, n);
        glossy_share = glossy ? polygon_lobe(part, n, r, exponent) : 0.0;
    }

    // What arrives of it: each lobe weighs the samples by what they would give it.
    float cell = area / float(light.columns * light.rows);
    float radius = sqrt(cell / PI);
    vec2 seen = vec2(0.0);
    vec2 all = vec2(0.0);
    for (uint i = 0u; i < light.columns * light.rows; ++i) {
        vec3 d = views[light.first_view + i * AREA_VIEWS].position - position;
        float cell_d2 = max(dot(d, d), 1e-30);
        vec3 towards = d * inversesqrt(cell_d2);
        float given = max(-dot(towards, light.direction), 0.0) / (cell_d2 + cell);
        // A lobe narrower than a cell is as wide as that here.
        float k = min(exponent, 2.0 * PI * cell_d2 / cell);
        float received = max(dot(n, towards), 0.0) + 0.01;
        vec2 weight = given * received * vec2(1.0, glossy ? cosine_power(dot(r, towards), k) + 1e-4 : 0.0);
        all += weight;
        if (given > 0.0 && dot(geometric, towards) > 0.0) {
            seen += weight * visibility(light, i, radius, position, geometric);
        }
    }
    vec2 arrives = seen / max(all, vec2(1e-30));
    out_radiance = vec4(light.intensity * (albedo.rgb * (diffuse_share * arrives.x) + specular.rgb * (glossy_share * arrives.y)), 0.0);
}
