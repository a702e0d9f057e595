// Pixels with short rays: the surface that each shows, and the slots of its rays. METHOD 11. The including shader has
// lib/hit.glsl. Uses bindings 13 to 15, 17 to 23 and 35, with GLOSSY 24 and 25, and with SKY 28; constants 4 to 8.
#ifndef NEAR_RAYS_GLSL
#define NEAR_RAYS_GLSL
#include "lib/triangle.glsl"
#include "lib/depth_image.glsl"
#include "lib/directions.glsl"
#include "lib/tile.glsl"
#include "lib/form_factor.glsl"
#ifdef GLOSSY
#include "lib/lobe.glsl"
#endif

layout(constant_id = 4) const uint RAYS = 8; // per pixel about its normal
layout(constant_id = 5) const uint REFERENCES = 8;
layout(constant_id = 6) const uint BY_CELLS = 0; // 1: references are stored per cell
layout(constant_id = 7) const uint ENDLESS = 0; // 1: all rays go on to the first surface, whatever caches know
layout(constant_id = 8) const uint GUIDED = 2; // per pixel that follow the light of caches
layout(push_constant, scalar) uniform Push { NearRaysPush push; };
layout(binding = 13) uniform usampler2D element_image;
layout(binding = 14, scalar) readonly buffer Draws { DrawRecord draws[]; };
layout(binding = 15, scalar) readonly buffer Directions { vec3 directions[]; }; // about +z, with cosine density
layout(binding = 18, scalar) readonly buffer Caches { Cache caches[]; };
#define REFERENCE_BINDINGS 19
#include "lib/hit_caches.glsl"
#ifdef GLOSSY
layout(binding = 24) uniform sampler2D normal_image;
layout(binding = 25) uniform sampler2D specular_image;
#endif
#ifdef SKY
layout(binding = 28, scalar) readonly buffer Open { uint open_parts[]; }; // per cache and direction: open quarters, 8 bits each
#endif

layout(binding = 17, scalar) readonly buffer Radiances { uint radiances[]; }; // per cache and direction [cd/m^2]
layout(binding = 35, scalar) readonly buffer Guides { uint guides[]; }; // GUIDE_WORDS values per cache
const vec3 LUMINANCE = vec3(0.2126, 0.7152, 0.0722);

// Caches disagree on a direction if one of them finds, in it and around it, less than this share of the greatest luminance
// that one finds in it.
const float AGREE = 0.3;

// Pixels of a square that has all directions.
const uint ALL = NEAR_SIDE * NEAR_SIDE;

// This thread's place among the pixels with rays. `subset`: the number of its directions among those of a square. All
// threads of a workgroup trace the same directions, so that they visit similar nodes of the hierarchy.
uvec2 traced_pixel(out uint subset) {
    const uint SIDE = NEAR_SIDE * 8u;
    uint group = push.first_group + gl_WorkGroupID.x;
    subset = group % ALL;
    uint block = group / ALL;
    uint across = (push.width + SIDE - 1u) / SIDE;
    uvec2 within = place_in_tile(gl_LocalInvocationID.x) * NEAR_SIDE + uvec2(subset % NEAR_SIDE, subset / NEAR_SIDE);
    return uvec2(block % across, block / across) * SIDE + within;
}

// Rays that a pixel may have.
#ifdef GLOSSY
const uint SLOTS = RAYS + GUIDED + LOBE_RAYS;
#else
const uint SLOTS = RAYS + GUIDED;
#endif

// Index of one of this pixel's rays. Neighbouring threads have neighbouring indices.
uint ray_slot(uint i) {
    return (gl_WorkGroupID.x * SLOTS + i) * gl_WorkGroupSize.x + gl_LocalInvocationID.x;
}

// A ray's direction about the vertex normal `n`.
vec3 direction_about(vec3 n, uint i, uint subset) {
    vec3 local = directions[i * ALL + subset];
    vec2 turned = vec2(cos(push.turn), sin(push.turn));
    local.xy = mat2(turned, vec2(-turned.y, turned.x)) * local.xy;
    vec3 tangent, bitangent;
    tangents(n, tangent, bitangent);
    return tangent * local.x + bitangent * local.y + n * local.z;
}

// The surface that a traced pixel shows.
struct NearSurface {
    vec3 position; // [m]
    vec3 normal; // unit vertex normal
    vec3 geometric; // unit normal of the triangle, on the eye's side
    vec3 towards_eye; // unit
    float from_eye; // distance from the eye [m]; 0 for parallel views
    float depth; // fourth clip coordinate
    uint instance;
    uvec3 corners; // vertices within the mesh
    vec3 weights; // barycentric
    ivec2 pixel; // in full resolution
};

// False if the pixel shows no surface.
bool surface_shown(uvec2 at, out NearSurface s) {
    ivec2 size = textureSize(element_image, 0);
    s.pixel = min(ivec2(at * push.every), size - 1);
    uvec2 element = texelFetch(element_image, s.pixel, 0).xy;
    if (at.x >= push.width || at.y >= push.height || element.x == 0u) {
        return false;
    }
    DrawRecord draw = draws[element.x - 1u];
    Instance instance = hit_instances[draw.instance];
    vec3 place[3], facing[3];
    vec4 clip[3];
    for (uint i = 0u; i < 3u; ++i) {
        s.corners[i] = hit_indices[draw.first_index + 3u * element.y + i];
        uint vertex = draw.first_vertex + s.corners[i];
        place[i] = (instance.world_from_model * vec4(corner_vector(vertex, 0u), 1.0)).xyz;
        facing[i] = mat3(instance.world_from_normal) * corner_vector(vertex, 3u);
        clip[i] = push.clip_from_world * vec4(place[i], 1.0);
    }
    vec2 ndc = (vec2(s.pixel) + 0.5) / vec2(size) * 2.0 - 1.0;
    vec3 w = weights_at(ndc, clip[0], clip[1], clip[2]);
    s.instance = draw.instance;
    s.weights = w;
    s.position = w.x * place[0] + w.y * place[1] + w.z * place[2];
    s.depth = dot(w, vec3(clip[0].w, clip[1].w, clip[2].w));
    s.towards_eye = -view_direction(push.eye, s.position);
    s.from_eye = push.eye.w > 0.0 ? distance(push.eye.xyz, s.position) : 0.0;
    vec3 geometric = cross(place[1] - place[0], place[2] - place[0]);
    float largest = max(max(abs(geometric.x), abs(geometric.y)), max(abs(geometric.z), 1e-37));
    geometric = normalize(geometric / largest + vec3(0.0, 1e-30, 0.0));
    s.geometric = dot(geometric, s.towards_eye) < 0.0 ? -geometric : geometric;
    vec3 n = w.x * facing[0] + w.y * facing[1] + w.z * facing[2];
    s.normal = dot(n, n) > 0.0 ? normalize(n) : s.geometric;
    return true;
}

#ifdef GLOSSY
// Rays of lobes whose albedo is greater than MUCH, as of metals, are LOBE_RAYS; other lobes have one.
const float MUCH = 0.3;

// The glossy lobe of a traced pixel and its rays.
struct NearLobe {
    Lobe lobe;
    uint rays; // 0: the surface has no lobe
    float narrow; // share of the lobe that its own rays find; caches know far light well enough for wide lobes
    float width; // [rad]
};

NearLobe lobe_shown(NearSurface s) {
    NearLobe l;
    vec4 normal_coded = texelFetch(normal_image, s.pixel, 0);
    vec3 specular = texelFetch(specular_image, s.pixel, 0).rgb;
    l.lobe = lobe_of(specular, normal_coded.w, normal_coded.xyz, s.towards_eye);
    l.narrow = smoothstep(3.0, 5.0, log2(max(l.lobe.exponent, 1.0)));
    l.width = inversesqrt(0.5 * (l.lobe.exponent + 1.0));
    l.rays = specular == vec3(0.0) ? 0u : l.narrow > 0.0 && dot(specular, LUMINANCE) > MUCH ? LOBE_RAYS : 1u;
    return l;
}
#endif

// What caches know of far surfaces in a direction.
struct FarLight {
    vec3 radiance; // [cd/m^2]
    bool unsure; // whether the caches disagree, or count for nothing
    float guided; // density of a guided ray [1/sr]
};

// Weighted sum over the caches `at` with weights `w`.
FarLight far_light(uvec3 at, vec3 w, vec3 direction) {
    uint index = direction_index(direction);
    FarLight far = FarLight(vec3(0.0), false, 0.0);
    float least = 3e38;
    float most = 0.0;
    for (uint i = 0u; i < 3u; ++i) {
        if (at[i] != NO_REFERENCES && w[i] > 0.0) {
            vec3 radiance = unpack_radiance(radiances[at[i] * DIRECTIONS + index]);
            uint guide = guides[at[i] * GUIDE_WORDS + index];
            far.radiance += w[i] * radiance;
            far.guided += w[i] * float(guide & 0xffu);
            most = max(most, dot(radiance, LUMINANCE));
            least = min(least, uintBitsToFloat(guide & ~0xffu));
        }
    }
    far.unsure = ENDLESS == 1u || least < AGREE * most;
    far.guided *= directions_per_solid_angle(direction) / float(GUIDES);
    return far;
}

// Direction of a guided ray, by the caches `at` with weights `w`; zero if the chosen cache has no light. The rays of a
// square of pixels are spread evenly over a cache's parts. `square`: its column and row. Each square has its own directions:
// with the same ones everywhere, some light would never be found. The same holds for each view of a reference.
vec3 guided_direction(uvec3 at, vec3 w, uint i, uint subset, uvec2 square) {
    const vec4 STEP = vec4(0.8566748838, 0.7338918566, 0.6287067210, 0.5385968675);
    uint number = i * ALL + subset;
    vec4 chance = 0.5 + float(number) * STEP + float(square.x) * STEP.wxyz + float(square.y) * STEP.zwxy;
    // Different multiples: with equal ones, all views would lie on one diagonal.
    chance = fract(chance + push.turn / (2.0 * PI) * vec4(1.0, 7.0, 19.0, 43.0));
    uint cache = chance.x < w.x ? at.x : chance.x < w.x + w.y ? at.y : at.z;
    uint part = min(uint((float(number) + chance.y) * (float(GUIDES) / float(GUIDED * ALL))), GUIDES - 1u);
    if (cache == NO_REFERENCES) {
        return vec3(0.0);
    }
    uint index = guides[cache * GUIDE_WORDS + DIRECTIONS + part / 4u] >> (8u * (part % 4u)) & 0xffu;
    if (index == NO_DIRECTION) {
        return vec3(0.0);
    }
    vec2 place = vec2(index % DIRECTION_SIDE, index / DIRECTION_SIDE) + chance.zw;
    return octahedral_decode(place * (2.0 / float(DIRECTION_SIDE)) - 1.0);
}

#ifdef SKY
// Share of a direction that is open to the sky, by the caches `at` with weights `w`. Without caches nothing is known: a
// half.
float sky_open(uvec3 at, vec3 w, vec3 direction) {
    uint index = direction_index(direction);
    if (at.x == NO_REFERENCES) {
        return 0.5;
    }
    float sum = 0.0;
    for (uint i = 0u; i < 3u; ++i) {
        if (at[i] != NO_REFERENCES) {
            uint parts = open_parts[at[i] * (DIRECTIONS / 4u) + index / 4u] >> (8u * (index % 4u)) & 0xffu;
            sum += 0.25 * w[i] * float(parts);
        }
    }
    return sum;
}

// Whether caches call a direction partly open. There the ray goes on without end and decides.
bool ray_decides(float open) {
    return abs(open - 0.5) < 0.4999;
}
#endif

#endif
