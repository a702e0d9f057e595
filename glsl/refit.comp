// Before stage 1, for rays: refits triangles and boxes of deforming meshes to the posed vertices. One thread per node;
// nodes of one depth run together, deepest first. The hierarchy keeps its structure from the rest pose. METHOD 11.
#include "shared.glsl"

layout(local_size_x = 64) in;
layout(push_constant, scalar) uniform Push { RefitPush push; };
layout(binding = 0, scalar) readonly buffer List { RefitNode list[]; };
layout(binding = 1, scalar) readonly buffer Vertices { float vertices[]; };
layout(binding = 2, scalar) readonly buffer Indices { uint indices[]; };
layout(binding = 3, std430) buffer Nodes { uvec4 nodes[]; }; // as in lib/trace.glsl
layout(binding = 4, std430) buffer Triangles { vec4 triangles[]; }; // likewise
layout(binding = 5, scalar) buffer Boxes { RefitBox boxes[]; }; // exact boxes of all nodes

// Margin against rounding: boxes are widened by this share of their distance from the grid's origin.
const float WIDER = 1e-6;

const float FARTHEST = 1e30;

vec3 corner(uint vertex) {
    uint word = VERTEX_WORDS * vertex;
    return vec3(vertices[word], vertices[word + 1u], vertices[word + 2u]);
}

bool is_finite(vec3 p) {
    return all(lessThan(abs(p), vec3(FARTHEST)));
}

// Writes a posed triangle; returns its box.
RefitBox placed(uint triangle, uint first_vertex) {
    vec4 first = triangles[3u * triangle];
    uint index = floatBitsToUint(first.w);
    vec3 a = corner(first_vertex + indices[index]);
    vec3 b = corner(first_vertex + indices[index + 1u]);
    vec3 c = corner(first_vertex + indices[index + 2u]);
    // Triangles with non-finite corners become a point, which no ray hits.
    if (!is_finite(a) || !is_finite(b) || !is_finite(c)) {
        a = b = c = vec3(0.0);
    }
    triangles[3u * triangle] = vec4(a, first.w);
    triangles[3u * triangle + 1u].xyz = b;
    triangles[3u * triangle + 2u].xyz = c;
    return RefitBox(min(min(a, b), c), max(max(a, b), c));
}

// Exponent of the smallest power of two that is at least this.
uint exponent(float least) {
    uint bits = floatBitsToUint(least);
    return clamp((bits >> 23) + uint((bits & 0x007fffffu) != 0u), 20u, 230u);
}

void main() {
    uint at = (gl_WorkGroupID.y * DEFORM_ROW + gl_WorkGroupID.x) * gl_WorkGroupSize.x + gl_LocalInvocationID.x;
    if (at >= push.count) {
        return;
    }
    RefitNode own = list[push.first + at];
    uint place = nodes[5u * own.node].w;
    uvec4 base = nodes[5u * own.node + 1u];
    RefitBox children[8];
    RefitBox all_ = RefitBox(vec3(FARTHEST), vec3(-FARTHEST));
    uint inner = base.x - push.first_node;
    for (uint i = 0u; i < 8u; ++i) {
        uint meta = (i < 4u ? base.z : base.w) >> (8u * (i & 3u)) & 0xffu;
        children[i] = RefitBox(vec3(FARTHEST), vec3(-FARTHEST));
        if ((place >> (24u + i) & 1u) != 0u) {
            children[i] = boxes[inner++];
        } else {
            for (uint t = 0u; t < uint(bitCount(meta >> 5)); ++t) {
                RefitBox one = placed(base.y + (meta & 0x1fu) + t, own.first_vertex);
                children[i] = RefitBox(min(children[i].low, one.low), max(children[i].high, one.high));
            }
        }
        all_ = RefitBox(min(all_.low, children[i].low), max(all_.high, children[i].high));
    }
    boxes[own.node - push.first_node] = all_;

    vec3 least = (all_.high - all_.low) * ((1.0 + 4.0 * WIDER) / 255.0);
    uvec3 e = uvec3(exponent(least.x), exponent(least.y), exponent(least.z));
    vec3 steps = uintBitsToFloat((254u - e) << 23); // reciprocal lengths of a grid step
    uvec2 planes[6] = uvec2[6](uvec2(0u), uvec2(0u), uvec2(0u), uvec2(0u), uvec2(0u), uvec2(0u));
    for (uint i = 0u; i < 8u; ++i) {
        if (((i < 4u ? base.z : base.w) >> (8u * (i & 3u)) & 0xffu) == 0u) {
            continue; // empty child
        }
        uvec3 low = uvec3(floor((children[i].low - all_.low) * steps * (1.0 - WIDER)));
        uvec3 high = uvec3(min(ceil((children[i].high - all_.low) * steps * (1.0 + WIDER)), vec3(255.0)));
        for (uint axis = 0u; axis < 3u; ++axis) {
            planes[2u * axis][i >> 2] |= low[axis] << (8u * (i & 3u));
            planes[2u * axis + 1u][i >> 2] |= high[axis] << (8u * (i & 3u));
        }
    }
    nodes[5u * own.node] = uvec4(floatBitsToUint(all_.low), e.x | e.y << 8 | e.z << 16 | (place & 0xff000000u));
    for (uint axis = 0u; axis < 3u; ++axis) {
        nodes[5u * own.node + 2u + axis] = uvec4(planes[2u * axis], planes[2u * axis + 1u]);
    }
}
