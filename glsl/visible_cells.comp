// Stage 5 at texel level: finds the cell of the model's surface at each pixel, and lists all visible cells, each once.
// METHOD 5 and 9.
#include "shared.glsl"
#include "lib/triangle.glsl"
#define CELL_BINDINGS 5
#include "lib/cells.glsl"

layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { VisibleCellsPush push; };
layout(binding = 0) uniform usampler2D element_image;
layout(binding = 1, scalar) readonly buffer Draws { DrawRecord draws[]; };
layout(binding = 2, scalar) readonly buffer Indices { uint indices[]; };
layout(binding = 3, scalar) readonly buffer Instances { Instance instances[]; };
layout(binding = 4, scalar) readonly buffer Corners { Corner corners[]; };
layout(binding = 7, scalar) buffer Seen { uint seen[]; }; // per cell of each instance: last frame that showed it
layout(binding = 8, scalar) writeonly buffer Visible { VisibleVertex visible[]; };
layout(binding = 9, scalar) buffer Args { VisibleArgs args; };
layout(binding = 10, scalar) writeonly buffer Rows { uint rows[]; }; // per pixel, row by row

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    ivec2 size = textureSize(element_image, 0);
    if (any(greaterThanEqual(pixel, size))) {
        return;
    }
    uvec2 element = texelFetch(element_image, pixel, 0).xy;
    uint row = NO_REFERENCES;
    if (element.x != 0u && draws[element.x - 1u].reference_base != NO_REFERENCES) {
        DrawRecord draw = draws[element.x - 1u];
        CellGrid grid = grids[draw.grid];
        mat4 clip_from_model = push.clip_from_world * instances[draw.instance].world_from_model;
        vec3 corner[3];
        vec4 clip[3];
        for (uint i = 0u; i < 3u; ++i) {
            uint vertex = indices[draw.first_index + 3u * element.y + i];
            clip[i] = clip_from_model * vec4(corners[draw.first_vertex + vertex].position, 1.0);
            // Cells belong to the model's rest pose.
            corner[i] = corners[draw.first_rest + vertex].position;
        }
        vec2 place = (vec2(pixel) + 0.5) / vec2(size) * 2.0 - 1.0;
        vec3 w = weights_at(place, clip[0], clip[1], clip[2]);
        row = row_at(grid, w.x * (corner[0] - grid.centre) + w.y * (corner[1] - grid.centre) + w.z * (corner[2] - grid.centre));
        uint slot = draw.first_slot + row;
        // Test before the atomic exchange, which costs more: most pixels are not the first of their cell.
        if (row != NO_REFERENCES && seen[slot] != push.frame && atomicExchange(seen[slot], push.frame) != push.frame) {
            uint at = atomicAdd(args.count, 1u);
            visible[at] = VisibleVertex(element.x - 1u, row);
            if (at % 64u == 0u) {
                atomicAdd(args.groups_x, 1u);
            }
        }
    }
    rows[pixel.y * size.x + pixel.x] = row;
}
