// Stage 6, before the gather: builds one level of the pyramids over the VALs of all views. METHOD 9, thesis listing
// 6.6.
#include "shared.glsl"

layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { PyramidPush push; };
layout(binding = 0, scalar) readonly buffer Views { ClusterView views[]; };
layout(binding = 1, scalar) readonly buffer Vals { Val vals[]; };
layout(binding = 2, scalar) readonly buffer Below { ClusterNode below[]; }; // the previous level, view by view, row by row
layout(binding = 3, scalar) writeonly buffer Level { ClusterNode cells[]; }; // this level, read by the next
layout(binding = 4, scalar) writeonly buffer Nodes { ClusterNode nodes[]; }; // all nodes, depth first

// Number of cells of a level that cover this many texels.
uvec2 cells_of(uvec2 texels, uint level) {
    return (texels + ((1u << level) - 1u)) >> level;
}

// Number of nodes over a cell's VALs, `2^level` texels a side: the node and its descendants, as far as the cell lies in
// the view.
uint nodes_of(uint size, uint level, uvec2 cell) {
    uvec2 corner = cell << level;
    if (any(greaterThanEqual(corner, uvec2(size)))) {
        return 0u;
    }
    uvec2 texels = min(uvec2(size) - corner, uvec2(1u << level));
    uint count = 0u;
    for (uint i = 1u; i <= level; ++i) {
        uvec2 side = cells_of(texels, i);
        count += side.x * side.y;
    }
    return count;
}

// Index of a cell's node in depth-first order: descends from the view's last level, skipping earlier siblings.
uint index_of(ClusterView view, uint level, uvec2 cell) {
    uint index = view.first_node;
    for (uint above = view.levels; above > level; --above) {
        uvec2 way = cell >> (above - 1u - level);
        uvec2 corner = way & ~uvec2(1u);
        index += 1u;
        for (uint i = 0u; i < (way.x & 1u) + 2u * (way.y & 1u); ++i) {
            index += nodes_of(view.size, above - 1u, corner + uvec2(i & 1u, i >> 1));
        }
    }
    return index;
}

// A single VAL as a node.
ClusterNode single(Val val) {
    return ClusterNode(val.position, 0.0, val.normal, 0.0, val.flux, val.area, val.weight, 0.0, 0u, 0u, 0u, 0u, 0u, 0u);
}

void main() {
    uvec2 cell = gl_GlobalInvocationID.xy;
    ClusterView view = views[gl_GlobalInvocationID.z];
    if (push.level > view.levels || any(greaterThanEqual(cell << push.level, uvec2(view.size)))) {
        return;
    }
    uint index = index_of(view, push.level, cell);
    ClusterNode node = ClusterNode(vec3(0.0), 0.0, vec3(0.0), 0.0, vec3(0.0), 0.0, 0.0, 0.0, 0u, 0u, 0u, 0u, 0u, 0u);
    node.skip = index + nodes_of(view.size, push.level, cell);

    // Children: VALs, or cells of the level below, as far as they lie in the view.
    ClusterNode parts[4];
    uint count = 0u;
    uvec2 side = cells_of(uvec2(view.size), push.level - 1u);
    if (push.level == 1u) {
        node.first = view.first_val + 2u * cell.y * view.size + 2u * cell.x;
        node.row = view.size;
    }
    for (uint i = 0u; i < 4u; ++i) {
        uvec2 place = 2u * cell + uvec2(i & 1u, i >> 1);
        if (any(greaterThanEqual(place, side))) {
            continue;
        }
        uint at = place.y * side.x + place.x;
        ClusterNode part;
        if (push.level == 1u) {
            part = single(vals[view.first_val + at]);
        } else {
            part = below[view.first_node + at];
        }
        if (part.weight > 0.0) {
            parts[count++] = part;
            node.alive |= push.level == 1u ? 1u << i : 0u;
        }
    }

    // Relative to the first child, so that precision does not depend on the block's place.
    for (uint i = 0u; i < count; ++i) {
        node.weight += parts[i].weight;
        node.flux += parts[i].flux;
        node.area += parts[i].weight * parts[i].area;
        node.normal += parts[i].weight * parts[i].normal;
        node.position += parts[i].weight * (parts[i].position - parts[0].position);
    }
    if (count > 0u) {
        node.area /= node.weight;
        node.position = parts[0].position + node.position / node.weight;
        float norm = length(node.normal);
        node.normal = norm > 0.0 ? node.normal / norm : parts[0].normal;
    }
    for (uint i = 0u; i < count; ++i) {
        vec3 offset = parts[i].position - node.position;
        node.radius = max(node.radius, length(offset) + parts[i].radius);
        node.spread = max(node.spread, distance(parts[i].normal, node.normal) + parts[i].spread);
        // Extent of the child along the normal. Vector products, because 1 - cos^2 loses small angles.
        float reach = parts[i].thickness * abs(dot(parts[i].normal, node.normal))
            + parts[i].radius * length(cross(parts[i].normal, node.normal));
        node.thickness = max(node.thickness, abs(dot(offset, node.normal)) + reach);
    }
    nodes[index] = node;
    cells[view.first_node + cell.y * cells_of(uvec2(view.size), push.level).x + cell.x] = node;
}
