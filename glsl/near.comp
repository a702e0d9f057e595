// Stage 6, beside the caches: rays of one cache spacing from surfaces that pixels show. What they meet gives its light, and
// hides what caches say of that direction. A pixel has few rays; a square of NEAR_SIDE^2 pixels has all directions, which
// stage 8 takes together. METHOD 11.
#extension GL_EXT_control_flow_attributes : require
#include "lib/hit_light.glsl"
#include "lib/triangle.glsl"
#include "lib/depth_image.glsl"

layout(local_size_x = 64) in;
layout(constant_id = 4) const uint RAYS = 8; // of a pixel
layout(constant_id = 5) const uint EVERY = 2; // pixels and rows from one with rays to the next
layout(push_constant, scalar) uniform Push { TracePush push; };
layout(binding = 13) uniform usampler2D element_image;
layout(binding = 14, scalar) readonly buffer Draws { DrawRecord draws[]; };
layout(binding = 15, scalar) readonly buffer Directions { vec3 directions[]; }; // about +z, by cosine
layout(binding = 16, scalar) writeonly buffer Near { NearPixel near_pixels[]; };

void main() {
    // Threads side by side have the same directions: they go the same way through the hierarchy.
    const uint ALL = NEAR_SIDE * NEAR_SIDE;
    uint subset = gl_WorkGroupID.x % ALL;
    uvec2 block = uvec2(gl_WorkGroupID.x / ALL, gl_WorkGroupID.y) * (NEAR_SIDE * 8u);
    uvec2 within = uvec2(gl_LocalInvocationID.x % 8u, gl_LocalInvocationID.x / 8u) * NEAR_SIDE;
    uvec2 at = block + within + uvec2(subset % NEAR_SIDE, subset / NEAR_SIDE);
    if (at.x >= push.width || at.y >= push.height) {
        return;
    }
    ivec2 size = textureSize(element_image, 0);
    ivec2 pixel = min(ivec2(at * EVERY), size - 1);
    uvec2 element = texelFetch(element_image, pixel, 0).xy;
    NearPixel found = NearPixel(vec3(0.0), 0xffffffffu, vec3(0.0), 0u, vec3(0.0));
    if (element.x == 0u) {
        near_pixels[at.y * push.width + at.x] = found;
        return;
    }
    DrawRecord draw = draws[element.x - 1u];
    Instance instance = hit_instances[draw.instance];
    vec3 place[3], facing[3];
    vec4 clip[3];
    for (uint i = 0u; i < 3u; ++i) {
        uint vertex = draw.first_vertex + hit_indices[draw.first_index + 3u * element.y + i];
        place[i] = (instance.world_from_model * vec4(corner_vector(vertex, 0u), 1.0)).xyz;
        facing[i] = mat3(instance.world_from_normal) * corner_vector(vertex, 3u);
        clip[i] = push.clip_from_world * vec4(place[i], 1.0);
    }
    vec2 ndc = (vec2(pixel) + 0.5) / vec2(size) * 2.0 - 1.0;
    vec3 w = weights_at(ndc, clip[0], clip[1], clip[2]);
    found.position = w.x * place[0] + w.y * place[1] + w.z * place[2];
    vec3 towards_eye = -view_direction(push.eye, found.position);
    vec3 geometric = cross(place[1] - place[0], place[2] - place[0]);
    float largest = max(max(abs(geometric.x), abs(geometric.y)), max(abs(geometric.z), 1e-37));
    geometric = normalize(geometric / largest + vec3(0.0, 1e-30, 0.0));
    geometric = dot(geometric, towards_eye) < 0.0 ? -geometric : geometric;
    vec3 n = w.x * facing[0] + w.y * facing[1] + w.z * facing[2];
    n = dot(n, n) > 0.0 ? normalize(n) : geometric;
    found.normal = n;
    found.is_surface = 1u;
    float from_eye = push.eye.w > 0.0 ? distance(push.eye.xyz, found.position) : 0.0;
    vec3 start = found.position + geometric * lift_at(found.position, from_eye);
    vec3 tangent, bitangent;
    tangents(n, tangent, bitangent);

    found.open = 0u;
    for (uint i = 0u; i < RAYS; ++i) {
        uint number = i * ALL + subset;
        vec3 local = directions[number];
        vec3 direction = tangent * local.x + bitangent * local.y + n * local.z;
        // Below the surface itself there is nothing to be seen: such rays are turned up.
        float above = dot(direction, geometric);
        direction -= above < 0.0 ? 2.0 * above * geometric : vec3(0.0);
        Hit hit = trace(start, direction, 0.0, push.reach, push.root, 0u, false);
        if (hit.triangle == NO_HIT) {
            found.open |= 1u << i;
            continue;
        }
        // The ray stands for a cone: pi over the number of rays that are taken together.
        HitSurface s = surface_at(hit, start, direction, 2.0 * inversesqrt(float(RAYS * ALL)));
        vec3 chance = fract(0.5 + float(number) * vec3(0.8191725134, 0.6710436067, 0.5497004779));
        found.irradiance += s.emission + reflected_direct(s, push.light_count, push.root, chance);
    }
    found.irradiance *= PI / float(RAYS);
    near_pixels[at.y * push.width + at.x] = found;
}
