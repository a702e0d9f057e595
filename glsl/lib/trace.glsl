// Ray tracing against the scene's triangles with compressed eight-wide BVHs; Ylitie, Karras and Laine 2017. Static
// geometry has one BVH in world space. If anything moves, a top level is over it and the BVHs of moving instances.
// Triangles use the watertight edge test of Woop, Benthin and Wald 2013: two triangles decide alike about a shared
// edge. Uses bindings 0 to 4. Twin: src/reference/world.rs. Data written by src/frame/world/rays.rs.
#ifndef TRACE_GLSL
#define TRACE_GLSL
#include "shared.glsl"

layout(constant_id = 0) const uint STACK = 40; // entries; at least as many as the BVH needs
layout(constant_id = 1) const uint LEVELS = 1; // 2: the root is a top level over instances
layout(constant_id = 2) const uint AS_TEXELS = 0; // 1: nodes and triangles are read as texels
layout(constant_id = 3) const uint HAS_HOLES = 1; // 0: no material has an alpha mask

// Five words per node: origin of the boxes' grid and three exponents; first child, first triangle and child
// descriptors; then for x, y and z eight lower and eight upper planes.
layout(binding = 0, std430) readonly buffer RayNodes { uvec4 ray_nodes[]; };
layout(binding = 1) uniform samplerBuffer ray_node_texels;
// Three words per triangle: its corners. The w components hold its index offset, its material, and its instance with
// flags.
layout(binding = 2, std430) readonly buffer RayTriangles { vec4 ray_triangles[]; };
layout(binding = 3) uniform samplerBuffer ray_triangle_texels;
// Four words per moving instance: rows of model_from_world; root node, instance number.
layout(binding = 4, std430) readonly buffer RayInstances { vec4 ray_instances[]; };

const uint NO_HIT = 0xffffffffu;

// First hit of a ray.
struct Hit {
    float distance; // in multiples of the direction's length
    vec2 weights; // of the second and third corner
    uint triangle; // index of the triangle; NO_HIT for a miss
    uint instance;
};

uvec4 ray_node(uint i) {
    return AS_TEXELS != 0u ? floatBitsToUint(texelFetch(ray_node_texels, int(i))) : ray_nodes[i];
}

vec4 ray_triangle(uint i) {
    return AS_TEXELS != 0u ? texelFetch(ray_triangle_texels, int(i)) : ray_triangles[i];
}

// Ray parameters for box and triangle tests, in one space.
struct Path {
    vec3 origin;
    vec3 direction;
    vec3 inverse;
    uint octant;
    // The axis of the ray's largest component; it is rotated to the last place.
    uint axis;
    vec2 shear;
};

vec3 turned(vec3 v, uint axis) {
    return axis == 0u ? v.yzx : axis == 1u ? v.zxy : v;
}

Path path_of(vec3 origin, vec3 direction) {
    // Avoids infinities: 0 times infinity is NaN.
    const float LEAST = 1e-18;
    vec3 sign_ = mix(vec3(LEAST), vec3(-LEAST), lessThan(direction, vec3(0.0)));
    vec3 inverse = 1.0 / mix(direction, sign_, lessThan(abs(direction), vec3(LEAST)));
    uint octant = (direction.x < 0.0 ? 0u : 0x04040404u) | (direction.y < 0.0 ? 0u : 0x02020202u)
                | (direction.z < 0.0 ? 0u : 0x01010101u);
    vec3 a = abs(direction);
    uint axis = a.x > a.y ? (a.x > a.z ? 0u : 2u) : (a.y > a.z ? 1u : 2u);
    vec3 d = turned(direction, axis);
    return Path(origin, direction, inverse, octant, axis, d.xy / d.z);
}

// Children of a node that a ray hits between two distances: inner nodes in the high byte, nearest first; triangles in
// the low 24 bits.
uint children_met(uint at, Path path, float from, float to, out uvec2 first, out uint inner_nodes) {
    uvec4 place = ray_node(at);
    uvec4 base = ray_node(at + 1u);
    uvec4 qx = ray_node(at + 2u);
    uvec4 qy = ray_node(at + 3u);
    uvec4 qz = ray_node(at + 4u);
    first = base.xy;
    inner_nodes = place.w >> 24;
    vec3 size = uintBitsToFloat(uvec3(place.w & 0xffu, place.w >> 8 & 0xffu, place.w >> 16 & 0xffu) << 23);
    vec3 step_ = size * path.inverse;
    vec3 start = (uintBitsToFloat(place.xyz) - path.origin) * path.inverse;
    // The position of a plane near the origin is a difference of large numbers: the box grows by their rounding error.
    vec3 slack = (abs(start) + 255.0 * abs(step_)) * 5e-7;
    vec3 sooner = start - slack;
    vec3 later = start + slack;
    bvec3 negative = lessThan(path.direction, vec3(0.0));
    uvec2 low_x = negative.x ? qx.zw : qx.xy;
    uvec2 high_x = negative.x ? qx.xy : qx.zw;
    uvec2 low_y = negative.y ? qy.zw : qy.xy;
    uvec2 high_y = negative.y ? qy.xy : qy.zw;
    uvec2 low_z = negative.z ? qz.zw : qz.xy;
    uvec2 high_z = negative.z ? qz.xy : qz.zw;
    uint met = 0u;
    [[unroll]] for (uint half_ = 0u; half_ < 2u; ++half_) {
        uint meta = half_ == 0u ? base.z : base.w;
        // Bits 3 and 4 of a byte are both set for inner nodes, never for triangles.
        uint inner = (meta & (meta << 1)) & 0x10101010u;
        uint index = (meta ^ (path.octant & (inner >> 4) * 0xffu)) & 0x1f1f1f1fu;
        uint bits = meta >> 5 & 0x07070707u;
        uvec3 low = half_ == 0u ? uvec3(low_x.x, low_y.x, low_z.x) : uvec3(low_x.y, low_y.y, low_z.y);
        uvec3 high = half_ == 0u ? uvec3(high_x.x, high_y.x, high_z.x) : uvec3(high_x.y, high_y.y, high_z.y);
        [[unroll]] for (uint i = 0u; i < 4u; ++i) {
            uint s = 8u * i;
            vec3 enter = vec3(low >> s & 0xffu) * step_ + sooner;
            vec3 leave = vec3(high >> s & 0xffu) * step_ + later;
            if (max(max(enter.x, enter.y), max(enter.z, from)) <= min(min(leave.x, leave.y), min(leave.z, to))) {
                met |= (bits >> s & 0xffu) << (index >> s & 0xffu);
            }
        }
    }
    return met;
}

// Whether the alpha mask keeps a triangle at a point.
bool is_there(uint at, vec2 weights, uint instance);

// Intersects a ray with a triangle between two distances; writes `hit` if it hits. `passed`: RAY_* flags of triangles
// to ignore.
bool meets(Path path, uint at, float from, float to, uint passed, uint moving, inout Hit hit) {
    vec4 first = ray_triangle(3u * at);
    vec4 second = ray_triangle(3u * at + 1u);
    vec4 third = ray_triangle(3u * at + 2u);
    // `precise`: two triangles round a shared edge's test alike. A fused multiply-add rounds only one of the two products,
    // and rays would pass between the triangles.
    precise vec3 a = turned(first.xyz - path.origin, path.axis);
    precise vec3 b = turned(second.xyz - path.origin, path.axis);
    precise vec3 c = turned(third.xyz - path.origin, path.axis);
    a.xy -= path.shear * a.z;
    b.xy -= path.shear * b.z;
    c.xy -= path.shear * c.z;
    precise vec3 edges = vec3(c.x * b.y - c.y * b.x, a.x * c.y - a.y * c.x, b.x * a.y - b.y * a.x);
    float sum = edges.x + edges.y + edges.z;
    bool inside = min(min(edges.x, edges.y), edges.z) >= 0.0 || max(max(edges.x, edges.y), edges.z) <= 0.0;
    // Distance to the plane: its rounding error scales with the triangle's size. A weighted mean of the corners'
    // distances would round with the distance.
    vec3 n = cross(second.xyz - first.xyz, third.xyz - first.xyz);
    float along = dot(path.direction, n);
    float distance_ = dot(first.xyz - path.origin, n) / along;
    // A degenerate triangle yields NaN, which fails the range test.
    if (!(inside && sum != 0.0 && distance_ >= from && distance_ < to)) {
        return false;
    }
    uint what = floatBitsToUint(third.w);
    // From behind, a ray meets the other side of the surface, whose caches are on the ray's side.
    bool is_behind = LEVELS == 2u && (what & RAY_ONE_SIDE) != 0u && along >= 0.0;
    if ((what & passed) != 0u || is_behind) {
        return false;
    }
    vec2 weights = edges.yz / sum;
    uint instance = moving == NO_HIT ? what >> RAY_KIND_BITS : moving;
    if (HAS_HOLES != 0u && (what & RAY_HOLES) != 0u && !is_there(at, weights, instance)) {
        return false;
    }
    hit = Hit(distance_, weights, at, instance);
    return true;
}

// First hit of the ray from `origin` along `direction` between two distances [lengths of the direction]; with `any` an
// arbitrary hit. `passed`: RAY_* flags of triangles to ignore.
Hit trace(vec3 origin, vec3 direction, float from, float to, uint root, uint passed, bool any) {
    Hit hit = Hit(to, vec2(0.0), NO_HIT, NO_HIT);
    uvec2 stack[STACK];
    uint top = 0u;
    Path path = path_of(origin, direction);
    uint moving = NO_HIT; // the instance whose space the path is in, or NO_HIT
    uint bottom = 0u; // stack height at entry into that instance
    // First child of a node group, and its remaining members: hit nodes in the high byte, inner-node mask in the low
    // byte.
    uvec2 nodes = uvec2(root, 0x80000000u);
    // First triangle of a group, and its remaining triangles.
    uvec2 leaves = uvec2(0u);
    while (true) {
        if (nodes.y > 0x00ffffffu) {
            uint bit = uint(findMSB(nodes.y));
            nodes.y &= ~(1u << bit);
            uint slot = (bit - 24u) ^ (path.octant & 0xffu);
            uint at = nodes.x + uint(bitCount(nodes.y & ~(0xffffffffu << slot) & 0xffu));
            if (nodes.y > 0x00ffffffu && top < STACK) {
                stack[top++] = nodes;
            }
            uvec2 first;
            uint inner;
            uint met = children_met(5u * at, path, from, hit.distance, first, inner);
            nodes = uvec2(first.x, (met & 0xff000000u) | inner);
            leaves = uvec2(first.y, met & 0x00ffffffu);
        } else {
            leaves = nodes;
            nodes = uvec2(0u);
        }
        while (leaves.y != 0u) {
            uint i = uint(findMSB(leaves.y));
            leaves.y &= ~(1u << i);
            uint at = leaves.x + i;
            if (LEVELS == 2u && moving == NO_HIT) {
                // Enter an instance; push the remaining work.
                if (nodes.y > 0x00ffffffu && top < STACK) {
                    stack[top++] = nodes;
                }
                if (leaves.y != 0u && top < STACK) {
                    stack[top++] = leaves;
                }
                bottom = top;
                vec4 x = ray_instances[4u * at];
                vec4 y = ray_instances[4u * at + 1u];
                vec4 z = ray_instances[4u * at + 2u];
                uvec2 what = floatBitsToUint(ray_instances[4u * at + 3u].xy);
                vec4 o = vec4(origin, 1.0);
                path = path_of(vec3(dot(x, o), dot(y, o), dot(z, o)),
                               vec3(dot(x.xyz, direction), dot(y.xyz, direction), dot(z.xyz, direction)));
                moving = what.y;
                nodes = uvec2(what.x, 0x80000000u);
                leaves.y = 0u;
            } else if (meets(path, at, from, hit.distance, passed, LEVELS == 2u && moving != RAY_STILL ? moving : NO_HIT, hit)
                       && any) {
                return hit;
            }
        }
        if (nodes.y <= 0x00ffffffu) {
            if (LEVELS == 2u && moving != NO_HIT && top == bottom) {
                moving = NO_HIT;
                path = path_of(origin, direction);
            }
            if (top == 0u) {
                return hit;
            }
            nodes = stack[--top];
        }
    }
    return hit;
}

#endif
