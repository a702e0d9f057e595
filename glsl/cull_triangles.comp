// Before stages 1 and 4: copies the indices of triangles that a view may show. The others become points of one vertex,
// which the device neither shades nor fills, so that triangles keep their order and number. METHOD 9.
#include "shared.glsl"

layout(local_size_x = 64) in;
layout(push_constant, scalar) uniform Push { CullTrianglesPush push; };
layout(binding = 0, scalar) readonly buffer Blocks { CullBlock blocks[]; };
layout(binding = 1, scalar) readonly buffer Draws { DrawRecord draws[]; };
layout(binding = 2, scalar) readonly buffer Instances { Instance instances[]; };
layout(binding = 3, scalar) readonly buffer Vertices { float vertex_words[]; };
layout(binding = 4, scalar) readonly buffer Indices { uint indices[]; };
layout(binding = 5, scalar) writeonly buffer Shown { uint shown[]; };

// Bound of the rounding errors of a transformed coordinate, relative to the sum of the magnitudes of its terms.
const float ROUNDING = 2e-6;

// Devices move corners by up to half of their subpixel step, at most 1/32 pixel. [pixels]
const float SNAPPED = 1.0 / 16.0;

// A corner in the view: x, y, w in clip space, and bounds of their errors.
struct Corner3 {
    vec3 at;
    vec3 error;
};

// Magnitudes of a matrix's elements.
mat4 magnitudes(mat4 m) {
    return mat4(abs(m[0]), abs(m[1]), abs(m[2]), abs(m[3]));
}

void main() {
    uint block = gl_WorkGroupID.y * DEFORM_ROW + gl_WorkGroupID.x;
    if (block >= push.block_count) {
        return;
    }
    CullBlock b = blocks[block];
    DrawRecord draw = draws[b.draw];
    mat4 world_from_model = instances[draw.instance].world_from_model;
    mat4 world_sizes = magnitudes(world_from_model);
    mat4 clip_sizes = magnitudes(push.clip_from_world);
    mat3 linear = mat3(world_from_model);
    // Positive: front faces are counter-clockwise. Where the sign is uncertain, both faces stay.
    float turn = determinant(linear);
    float volume = length(linear[0]) * length(linear[1]) * length(linear[2]);
    bool backs = push.backs != 0u && abs(turn) > 1e-4 * volume;
    for (uint first = b.first + 3u * gl_LocalInvocationID.x; first < b.end; first += 3u * gl_WorkGroupSize.x) {
        uint corners[3];
        vec3 at[3];
        vec3 error[3];
        for (uint i = 0u; i < 3u; ++i) {
            corners[i] = indices[draw.first_index + first + i];
            uint word = VERTEX_WORDS * (draw.first_vertex + corners[i]);
            vec3 model = vec3(vertex_words[word], vertex_words[word + 1u], vertex_words[word + 2u]);
            vec4 clip = push.clip_from_world * vec4((world_from_model * vec4(model, 1.0)).xyz, 1.0);
            vec4 sizes = clip_sizes * vec4((world_sizes * vec4(abs(model), 1.0)).xyz, 1.0);
            at[i] = clip.xyw;
            error[i] = ROUNDING * sizes.xyw;
        }
        // Comparisons with NaN are false and keep the triangle.
        bvec4 beyond = bvec4(true);
        bool behind = true;
        bool before = true;
        for (uint i = 0u; i < 3u; ++i) {
            vec2 slack = error[i].xy + error[i].z;
            beyond.x = beyond.x && at[i].z + at[i].x < -slack.x;
            beyond.y = beyond.y && at[i].z - at[i].x < -slack.x;
            beyond.z = beyond.z && at[i].z + at[i].y < -slack.y;
            beyond.w = beyond.w && at[i].z - at[i].y < -slack.y;
            behind = behind && at[i].z < -error[i].z;
            before = before && at[i].z > 8.0 * error[i].z;
        }
        bool hidden = behind || any(beyond);
        if (before) {
            vec2 pixel[3];
            vec2 low = vec2(3e38);
            vec2 high = vec2(-3e38);
            float off = 0.0;
            for (uint i = 0u; i < 3u; ++i) {
                vec2 ndc = at[i].xy / at[i].z;
                pixel[i] = (ndc + 1.0) * push.half_size;
                vec2 slack = 1.25 * (error[i].xy + abs(ndc) * error[i].z) / at[i].z * push.half_size;
                slack += 1e-6 * (abs(pixel[i]) + push.half_size) + SNAPPED;
                low = min(low, pixel[i] - slack);
                high = max(high, pixel[i] + slack);
                off = max(off, max(slack.x, slack.y));
            }
            // No pixel's centre lies within the bounds.
            hidden = hidden || any(greaterThan(ceil(low - 0.5), high - 0.5));
            vec2 u = pixel[1] - pixel[0];
            vec2 v = pixel[2] - pixel[0];
            float clockwise = u.x * v.y - u.y * v.x;
            float doubt = 2.0 * off * (abs(u.x) + abs(u.y) + abs(v.x) + abs(v.y)) + 8.0 * off * off;
            hidden = hidden || (backs && (turn < 0.0 ? -clockwise : clockwise) > doubt + 1e-5 * abs(clockwise));
        }
        uint to = b.to + first;
        uint nothing = indices[draw.first_index];
        shown[to] = hidden ? nothing : corners[0];
        shown[to + 1u] = hidden ? nothing : corners[1];
        shown[to + 2u] = hidden ? nothing : corners[2];
    }
}
