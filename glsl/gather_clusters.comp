// Stage 6 by clusters: a group of neighbouring caches traverses the pyramids together. It takes light from a node if
// all of its caches can, and from single VALs otherwise. METHOD 9, thesis listing 6.6.
// A workgroup traverses the nodes of one part of the list. It also decides on their ancestors, without taking light
// from them, so that the cut does not depend on the parts or on other caches.
// variant gather_clusters_votes.comp: VOTES (a workgroup is a subgroup that can vote)
#extension GL_EXT_control_flow_attributes : require
#ifdef VOTES
#extension GL_KHR_shader_subgroup_vote : require
#endif
#include "shared.glsl"
#include "lib/cluster.glsl"

layout(local_size_x_id = 3) in;
layout(constant_id = 0) const uint GLOSSY = 1;
layout(constant_id = 1) const uint RULE = CLUSTER_DISTANCE;
layout(constant_id = 2) const uint CACHES = 1; // per thread; all threads together have CLUSTER_GROUP
layout(constant_id = 4) const uint SPREAD = 0; // 1: stage 7 needs the distances of glossy VALs
layout(constant_id = 5) const uint BY_HAND = 0; // 1: the device is a CPU
layout(push_constant, scalar) uniform Push { ClusterPush push; };
layout(binding = 0, scalar) readonly buffer Caches { Cache caches[]; };
layout(binding = 1, scalar) readonly buffer Live { uint live[]; }; // groups
layout(binding = 2) uniform samplerBuffer node_texels;
layout(binding = 3, scalar) readonly buffer Nodes { uint node_words[]; }; // the same data
layout(binding = 4) uniform samplerBuffer val_texels;
layout(binding = 5, scalar) readonly buffer Totals { float totals[]; }; // illuminance of each slot from the coarse cut [lx]
layout(binding = 6, scalar) writeonly buffer Parts { GatherSums parts[]; };
layout(binding = 7, scalar) buffer Pairs { uint pairs[]; };

#include "lib/gather.glsl"

Receiver receivers[CACHES];
GatherSums sums[CACHES];

const uint LIT = 1u; // some cache may receive light from the node
const uint NEAR = 2u; // and needs its children

#ifdef VOTES
// Combines the bits of all caches; the workgroup is a subgroup.
uint all_bits(uint mine) {
    return (subgroupAny(mine != 0u) ? LIT : 0u) | (subgroupAny((mine & NEAR) != 0u) ? NEAR : 0u);
}
#else
// Three words in rotation: one is written while another is cleared, with one barrier per round.
shared uint asked[3];
uint turn = 0u;

uint all_bits(uint mine) {
    atomicOr(asked[turn], mine);
    barrier();
    uint bits = asked[turn];
    if (gl_LocalInvocationID.x == 0u) {
        asked[(turn + 2u) % 3u] = 0u; // last round's word: all threads have read it
    }
    turn = (turn + 1u) % 3u;
    return bits;
}
#endif

void add(FourVals v) {
    [[unroll]] for (uint j = 0u; j < CACHES; ++j) {
        accumulate(sums[j], receivers[j], v, vec4(1.0), vec4(1.0));
    }
}

void put_node(inout FourVals v, uint i, uint node, float lit) {
    int at = int(node * CLUSTER_NODE_WORDS / 4u);
    vec4 place = texelFetch(node_texels, at); // and radius
    vec4 flux = texelFetch(node_texels, at + 2); // and area
    float weight = texelFetch(node_texels, at + 3).x;
    put(v, i, vec4(place.xyz, flux.w), texelFetch(node_texels, at + 1), lit * vec4(flux.rgb, weight));
}

void put_val(inout FourVals v, uint i, uint val, float lit) {
    int at = int(3u * val);
    put(v, i, texelFetch(val_texels, at), texelFetch(val_texels, at + 1), lit * texelFetch(val_texels, at + 2));
}

// Nodes and VALs found but not yet added. Adding them in batches suits devices that execute both sides of a branch. All
// threads write the same values and stay in step, because they decide on every node together.
const uint FOUND = 64u;
shared uint found_nodes[FOUND];
shared uint found_vals[FOUND];

// Decision bits of one cache for a node.
uint bits_of(Receiver c, float total, Bounds b, vec3 position, float flux) {
    vec3 offset = position - c.position;
    float distance = length(offset);
    vec2 reach = cluster_reach(b, offset, distance, -c.against);
    if (is_dark(reach, distance)) {
        return 0u;
    }
    bool near;
    if (RULE == CLUSTER_DISTANCE) {
        near = !(distance > push.limit * b.radius) || b.spread > push.spread;
    } else {
        near = brightest(reach, distance, b.radius, flux) * (b.radius / distance + b.spread / push.spread)
            > push.limit * total;
    }
    return near ? LIT | NEAR : LIT;
}

void main() {
    uint group = live[gl_WorkGroupID.x];
    uint lane = gl_LocalInvocationID.x * CACHES;
    uint slot = gl_WorkGroupID.x * CLUSTER_GROUP + lane;
    float total[CACHES];
    [[unroll]] for (uint j = 0u; j < CACHES; ++j) {
        // The last group repeats its last cache, which changes no decision.
        uint cache = min(group * CLUSTER_GROUP + lane + j, push.cache_count - 1u);
        receivers[j] = receiver(caches[cache], push.eye);
        sums[j] = no_light();
        uint own = gl_WorkGroupID.x * CLUSTER_GROUP + cache - group * CLUSTER_GROUP;
        total[j] = RULE == CLUSTER_BOUND ? totals[own] : 0.0;
    }
#ifndef VOTES
    if (gl_LocalInvocationID.x < 3u) {
        asked[gl_LocalInvocationID.x] = 0u;
    }
    barrier();
#endif
    uint first = gl_WorkGroupID.y * push.split;
    uint end = min(first + push.split, push.node_count);
    uint added = 0u;
    // An invocation's rounds are the part's nodes, a few ancestors, and the additions; older lavapipe versions end
    // loops after 65 535.
    for (uint index = 0u; index < end;) {
        uint nodes = 0u;
        uint vals = 0u;
        while (index < end && nodes < FOUND && vals + 4u <= FOUND) {
            uint words = index * CLUSTER_NODE_WORDS;
            uint skip = node_words[words + CLUSTER_SKIP_WORD];
            int at = int(words / 4u);
            vec4 place = texelFetch(node_texels, at); // and radius
            vec4 facing = texelFetch(node_texels, at + 1); // and thickness
            vec4 flux = texelFetch(node_texels, at + 2);
            vec4 more = texelFetch(node_texels, at + 3); // weight, spread
            Bounds b = Bounds(facing.xyz, place.w, facing.w, more.y);
            float brightness = dot(flux.rgb, vec3(0.2126, 0.7152, 0.0722));
            uint bits = 0u;
            [[unroll]] for (uint j = 0u; j < CACHES; ++j) {
                bits |= bits_of(receivers[j], total[j], b, place.xyz, brightness);
            }
            bits = all_bits(bits);
            if (more.x == 0.0 || skip <= first) {
                bits = 0u; // empty, or entirely before this part
            }
            if (bits == LIT && index >= first) {
                found_nodes[nodes++] = index;
            }
            if ((bits & NEAR) == 0u) {
                index = skip;
                continue;
            }
            uint links = words + CLUSTER_SKIP_WORD;
            uint alive = node_words[links + 3u];
            uint row = node_words[links + 2u];
            uint val = node_words[links + 1u];
            [[unroll]] for (uint i = 0u; i < 4u; ++i) {
                if ((alive & (1u << i)) != 0u) {
                    found_vals[vals++] = val + (i >> 1) * row + (i & 1u);
                }
            }
            index += 1u;
        }
        // Unused places of the last batch repeat its last entry without light.
        FourVals v;
        for (uint from = 0u; from < nodes; from += AT_ONCE) {
            [[unroll]] for (uint i = 0u; i < AT_ONCE; ++i) {
                put_node(v, i, found_nodes[min(from + i, nodes - 1u)], from + i < nodes ? 1.0 : 0.0);
            }
            add(v);
        }
        for (uint from = 0u; from < vals; from += AT_ONCE) {
            [[unroll]] for (uint i = 0u; i < AT_ONCE; ++i) {
                put_val(v, i, found_vals[min(from + i, vals - 1u)], from + i < vals ? 1.0 : 0.0);
            }
            add(v);
        }
        added += nodes + vals;
    }
    [[unroll]] for (uint j = 0u; j < CACHES; ++j) {
        if (group * CLUSTER_GROUP + lane + j < push.cache_count) {
            parts[gl_WorkGroupID.y * push.cache_count + slot + j] = sums[j];
        }
    }
    if (gl_LocalInvocationID.x == 0u) {
        uint counter = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
        uint mine = added * min(push.cache_count - group * CLUSTER_GROUP, CLUSTER_GROUP);
        // The pairs of the coarse cut count, too.
        pairs[counter] = RULE == CLUSTER_BOUND ? pairs[counter] + mine : mine;
    }
}
