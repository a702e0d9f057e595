// Stage 2: traces rays from pixels' surfaces to points of one light. Each pixel has one ray; listed pixels, whose
// neighbours' rays differ, have more. A square of LIGHT_SIDE^2 pixels covers all points of the light; at soft shadow
// edges shading combines their rays. METHOD 14.
// variant light_first.comp: FIRST (one ray from each pixel of the tiles with a surface; lists tiles that the light reaches)
#extension GL_EXT_control_flow_attributes : require
#include "lib/hit.glsl"
#include "lib/brdf.glsl"
#include "lib/depth_image.glsl"
#include "lib/disc.glsl"
#include "lib/form_factor.glsl"
#include "lib/light.glsl"
#include "lib/octahedral.glsl"
#include "lib/samples.glsl"
#include "lib/tile.glsl"

layout(local_size_x = 8, local_size_y = 8) in;
layout(constant_id = 4) const uint SAMPLES = 0; // further points of a pixel; 0: its centre alone
layout(constant_id = 5) const uint STEPS = 0; // vertex positions along a pixel's side; 0: exact
layout(push_constant, scalar) uniform Push { LightRaysPush push; };
layout(binding = 12, scalar) readonly buffer Lights { Light lights[]; };
layout(binding = 13) uniform sampler2D depth_image;
layout(binding = 14) uniform sampler2D normal_image;
layout(binding = 15) uniform sampler2D albedo_image;
layout(binding = 16) uniform sampler2D specular_image;
layout(binding = 17, scalar) buffer Arrivals { Arriving arrivals[]; };
#ifdef FIRST
layout(binding = 18, scalar) readonly buffer Shown { LightWork shown; }; // tiles with a surface
layout(binding = 19, scalar) readonly buffer ShownTiles { uint shown_tiles[]; };
layout(binding = 20, scalar) buffer Work { LightWork work; };
layout(binding = 21, scalar) buffer Tiles { // that the light reaches
    uint width;
    uint height;
    uint tiles[];
};
layout(binding = 22, scalar) writeonly buffer Firsts { float firsts[]; };
#else
layout(binding = 18, scalar) readonly buffer Work { LightWork work; };
layout(binding = 19, scalar) readonly buffer Pixels { uint pixels[]; }; // x and y << 16
#endif

// Minimum number of rays per pixel to a light with a size.
const uint LEAST = 4u;

// Factor on the number of rays if a penumbra is too narrow to combine neighbours.
const uint MORE = 2u;

vec3 place(vec2 ndc, float depth) {
    vec4 world = push.world_from_clip * vec4(ndc, depth, 1.0);
    return world.xyz / world.w;
}

// Hammersley's point `i` of `count` on the unit square.
vec2 square_point(uint i, uint count) {
    return vec2((float(i) + 0.5) / float(count), float(bitfieldReverse(i)) * 2.3283064e-10 + 0.5 / float(count));
}

// Whether a light can reach a surface at all: it shines there and is above the horizon. An area light does not light
// points within `lift` of its own plane.
bool shines_at(Light light, vec3 to, vec3 n, vec3 geometric, float lift) {
    if (light.intensity == vec3(0.0)) {
        return false;
    }
    if (light.kind == LIGHT_AREA) {
        // One corner above the horizon is enough.
        vec2 reach = abs(vec2(dot(light.right, n), dot(light.up, n)));
        return dot(to, light.direction) < -lift && dot(to, n) + reach.x + reach.y > lift;
    }
    if (dot(to, n) <= 0.0 || dot(to, geometric) <= 0.0) {
        return false;
    }
    float d2 = max(dot(to, to), 1e-30);
    float along = -dot(to, light.direction) * inversesqrt(d2);
    return light.kind == LIGHT_DIRECTIONAL || light.kind == LIGHT_BODY
        || (range_window(d2, light.range) > 0.0
            && (light.kind == LIGHT_POINT || spot_falloff(along, light.cone_scale, light.cone_offset) > 0.0));
}

// Traces the rays of a pixel. `width`: of the widest penumbra around [pixels]. Returns whether the light can reach the
// surface at all.
bool trace_from(ivec2 pixel, float width) {
#ifdef FIRST
    const bool is_first = true;
#else
    const bool is_first = false;
#endif
    ivec2 size = textureSize(depth_image, 0);
    uint at = uint(pixel.y * size.x + pixel.x);
    Light light = lights[push.light];
    bool is_area = light.kind == LIGHT_AREA;
    bool is_parallel = light.kind == LIGHT_DIRECTIONAL;
    bool is_soft = is_area || light.radius > 0.0;
    float depth = texelFetch(depth_image, pixel, 0).r;
    vec2 step_ = 2.0 / vec2(size);
    vec2 middle = (vec2(pixel) + 0.5) * step_ - 1.0;
    vec3 position = place(middle, max(depth, 1e-30));
    vec4 normal_coded = texelFetch(normal_image, pixel, 0);
    vec3 n = normal_coded.xyz;
    vec4 specular = texelFetch(specular_image, pixel, 0);
    vec3 geometric = octahedral_decode(vec2(texelFetch(albedo_image, pixel, 0).a, specular.a));
    vec3 to = is_parallel ? -light.direction : light.position - position;
    float d2 = dot(to, to);
    float footprint = max(distance(position, place(middle + vec2(step_.x, 0.0), max(depth, 1e-30))), 1e-30);
    float lift = lift_at(position, push.eye.w > 0.0 ? distance(push.eye.xyz, position) : 0.0);
    // The rasterizer displaces positions from the surface by as much as it moves vertices.
    lift += STEPS > 0u ? footprint / float(STEPS) : 0.0;
    Arriving found = Arriving(vec2(0.0), vec2(0.0), -1.0);
    if (depth <= 0.0 || !shines_at(light, to, n, geometric, lift)) {
        arrivals[at] = found;
#ifdef FIRST
        firsts[at] = FIRST_NOT;
#endif
        return false;
    }

    vec2 slope = plane_slope(push.world_from_clip, position, geometric);
    vec3 looking = view_direction(push.eye, position);
    vec3 mirrored = reflect(looking, n);
    float exponent = fitted_exponent(normal_coded.w);
    bool is_glossy = is_area && specular.rgb != vec3(0.0);
    uint subset = uint(pixel.x) % LIGHT_SIDE + LIGHT_SIDE * (uint(pixel.y) % LIGHT_SIDE);
    const uint SQUARE = LIGHT_SIDE * LIGHT_SIDE;
    uint rays = max(SAMPLES + 1u, is_soft ? LEAST : 1u);
    uint count = is_first ? 1u : is_soft && width < PENUMBRA_WIDE ? MORE * rays : rays;
    float area = 4.0 * length(cross(light.right, light.up));
    float cell = area / float(SQUARE * max(count, rays));
    vec3 x_axis, y_axis;
    tangents(to * inversesqrt(max(d2, 1e-30)), x_axis, y_axis);
    found.penumbra = is_soft ? 0.0 : -1.0;
    // A second surface, which only further points have, shows up to half a pixel from the pixel's centre.
    vec3 right = place(middle + vec2(step_.x, 0.0), depth + slope.x * step_.x);
    vec3 below = place(middle + vec2(0.0, step_.y), depth + slope.y * step_.y);
    float aside = SAMPLES > 0u && push.is_second != 0u ? 0.5 * (distance(position, right) + distance(position, below)) : 0.0;
    for (uint i = 0u; i < count; ++i) {
        vec3 from = position;
        if (SAMPLES > 0u && i > 0u) {
            vec2 offset = sample_offset((i - 1u) % SAMPLES + 1u, SAMPLES) * step_;
            float there = depth + dot(slope, offset);
            // On planes seen nearly edge-on the point may be far off; use the centre then.
            from = there > 0.5 * depth && there < 2.0 * depth ? place(middle + offset, there) : position;
        }
        // In a corner this point may lie behind the adjacent surface; ignore hits this near.
        float least = max(lift, 1.5 * (distance(from, position) + aside));
        vec3 start = from + geometric * lift;
        uint number = i * SQUARE + subset;
        uint points = max(count, rays) * SQUARE;
        vec2 weight = vec2(1.0, 0.0);
        vec3 way = to;
        float reach = 3e38; // distance to the light [lengths of `way`]
        // First rays go to a lattice that includes the light's border: an occluder covers border points first.
        vec2 lattice = vec2(uvec2(pixel) % LIGHT_FIRST_SIDE) / float(LIGHT_FIRST_SIDE - 1u) * 2.0 - 1.0;
        if (is_area) {
            vec2 on = is_first ? 0.999 * lattice : 2.0 * square_point(number, points) - 1.0;
            way = light.position + on.x * light.right + on.y * light.up - start;
            float way2 = max(dot(way, way), 1e-30);
            vec3 towards = way * inversesqrt(way2);
            float given = max(-dot(towards, light.direction), 0.0) / (way2 + cell);
            // A lobe narrower than the area of one point is widened to it.
            float k = min(exponent, 2.0 * PI * way2 / cell);
            float received = max(dot(n, towards), 0.0);
            weight = given * received * vec2(1.0, is_glossy ? cosine_power(dot(mirrored, towards), k) + 1e-4 : 0.0);
            weight *= d2;
            reach = 0.9999;
        } else {
            // Squares of the lattice become rings on the disc.
            float ring = max(abs(lattice.x), abs(lattice.y));
            vec2 on = is_first ? lattice * ring / max(length(lattice), 1e-30) : disc_point(number, points, 0.0);
            way = is_parallel ? to : light.position - start;
            way += light.radius * (x_axis * on.x + y_axis * on.y);
            reach = is_parallel ? reach : 0.99999 - light.clear / max(length(way), 1e-30);
        }
        found.all += weight;
        if (weight.x > 0.0 && dot(way, geometric) > 0.0) {
            float scale = length(way);
            Hit hit = trace(start, way, least / max(scale, 1e-30), reach, push.root, is_area ? RAY_AREA_LIGHT : 0u, true);
            if (hit.triangle == NO_HIT) {
                found.open += weight;
            } else if (is_soft) {
                // Width by similar triangles, with the blocker as apex.
                float wide = is_area ? sqrt(area) : 2.0 * light.radius;
                float ahead = is_parallel ? hit.distance : hit.distance / max(1.0 - hit.distance, 1e-3);
                found.penumbra = max(found.penumbra, wide * ahead / footprint);
            }
        }
    }
    // Normalised to the same weight for any number of rays; a first ray stands for all of them.
    found.open *= float(rays) / float(count);
    found.all *= float(rays) / float(count);
#ifdef FIRST
    firsts[at] = found.all.x <= 0.0 ? FIRST_UNKNOWN : found.open.x > 0.0 ? FIRST_OPEN : max(found.penumbra, 0.0);
    arrivals[at] = Arriving(found.open, found.all, -1.0);
#else
    arrivals[at] = Arriving(found.open, found.all, max(found.penumbra, width));
#endif
    return true;
}

#ifdef FIRST
shared uint reached;

void main() {
    uint number = gl_WorkGroupID.y * WORK_ROW + gl_WorkGroupID.x;
    if (number >= shown.count) {
        return;
    }
    uint tile = shown_tiles[number];
    ivec2 pixel = ivec2(tile & 0xffffu, tile >> 16) * 8 + ivec2(place_in_tile(gl_LocalInvocationIndex));
    if (gl_LocalInvocationIndex == 0u) {
        reached = 0u;
    }
    barrier();
    if (all(lessThan(pixel, textureSize(depth_image, 0))) && trace_from(pixel, 0.0)) {
        atomicOr(reached, 1u);
    }
    barrier();
    if (gl_LocalInvocationIndex == 0u && reached != 0u) {
        uint at = atomicAdd(work.count, 1u);
        atomicMax(work.groups_y, at / WORK_ROW + 1u);
        tiles[at] = tile;
    }
}
#else
void main() {
    uint number = (gl_WorkGroupID.y * WORK_ROW + gl_WorkGroupID.x) * 64u + gl_LocalInvocationIndex;
    if (number < work.count) {
        ivec2 pixel = ivec2(pixels[number] & 0xffffu, pixels[number] >> 16);
        trace_from(pixel, arrivals[pixel.y * textureSize(depth_image, 0).x + pixel.x].penumbra);
    }
}
#endif
