// Stage 2: compares the first rays around each pixel. Where they agree, the pixel is done; the others are listed, for
// more rays. METHOD 14.
#include "shared.glsl"

layout(local_size_x = 8, local_size_y = 8) in;
layout(constant_id = 0) const uint IS_SOFT = 0; // 1: the light has a size
layout(binding = 0, scalar) readonly buffer Firsts { float firsts[]; }; // first ray of each pixel
layout(binding = 1, scalar) buffer Arrivals { Arriving arrivals[]; };
layout(binding = 2, scalar) readonly buffer Work { LightWork work; }; // tiles that the light reaches
layout(binding = 3, scalar) readonly buffer Tiles {
    uint width;
    uint height;
    uint tiles[];
};
layout(binding = 4, scalar) buffer Undecided { LightWork listed; };
layout(binding = 5, scalar) writeonly buffer Pixels { uint pixels[]; }; // x and y << 16

// First rays in the tile and this far around it.
const int AROUND = int(LIGHT_FIRST_SIDE) / 2;
const int SIDE = 8 + 2 * AROUND;
shared float around[SIDE * SIDE];
// For rows of 9 pixels: results that occur, as bits, and the widest penumbra.
shared uint row_results[SIDE * 8];
shared float row_widths[SIDE * 8];
shared uint undecided;
shared uint first_listed;

const uint BLOCKED = 1u;
const uint OPEN = 2u;

uint result(float first) {
    return first >= 0.0 ? BLOCKED : first == FIRST_OPEN ? OPEN : 0u;
}

// Results of the first rays this far around a pixel.
uint results(int reach) {
    ivec2 middle = ivec2(gl_LocalInvocationID.xy) + AROUND;
    uint all = 0u;
    for (int y = -reach; y <= reach; ++y) {
        for (int x = -reach; x <= reach; ++x) {
            all |= result(around[(middle.y + y) * SIDE + middle.x + x]);
        }
    }
    return all;
}

void main() {
    uint number = gl_WorkGroupID.y * WORK_ROW + gl_WorkGroupID.x;
    if (number >= work.count) {
        return;
    }
    int local = int(gl_LocalInvocationIndex);
    ivec2 corner = ivec2(tiles[number] & 0xffffu, tiles[number] >> 16) * 8;
    ivec2 size = ivec2(width, height);
    for (int i = local; i < SIDE * SIDE; i += 64) {
        ivec2 there = clamp(corner - AROUND + ivec2(i % SIDE, i / SIDE), ivec2(0), size - 1);
        around[i] = firsts[there.y * size.x + there.x];
    }
    if (local == 0) {
        undecided = 0u;
    }
    barrier();
    if (IS_SOFT != 0u) {
        for (int i = local; i < SIDE * 8; i += 64) {
            uint found = 0u;
            float wide = 0.0;
            for (int x = 0; x <= 2 * AROUND; ++x) {
                int at = i / 8 * SIDE + i % 8 + x;
                found |= result(around[at]);
                wide = max(wide, around[at]);
            }
            row_results[i] = found;
            row_widths[i] = wide;
        }
        barrier();
    }
    ivec2 pixel = corner + ivec2(gl_LocalInvocationID.xy);
    int at = pixel.y * size.x + pixel.x;
    ivec2 middle = ivec2(gl_LocalInvocationID.xy) + AROUND;
    float first = all(lessThan(pixel, size)) ? around[middle.y * SIDE + middle.x] : FIRST_NOT;
    uint occurring = BLOCKED | OPEN;
    float wide = 0.0;
    if (IS_SOFT != 0u) {
        occurring = 0u;
        for (int y = 0; y <= 2 * AROUND; ++y) {
            int row = (int(gl_LocalInvocationID.y) + y) * 8 + int(gl_LocalInvocationID.x);
            occurring |= row_results[row];
            wide = max(wide, row_widths[row]);
        }
    }
    // A penumbra does not reach farther than its width.
    int reach = int(min(1.0 + ceil(wide), float(AROUND)));
    if (occurring == (BLOCKED | OPEN) && reach < AROUND) {
        occurring = results(reach);
    }
    bool is_undecided = first != FIRST_NOT && occurring != BLOCKED && occurring != OPEN;
    if (first == FIRST_UNKNOWN && !is_undecided) {
        arrivals[at].open = vec2(occurring == OPEN ? 1.0 : 0.0);
        arrivals[at].all = vec2(1.0);
    }
    uint place = 0u;
    if (is_undecided) {
        arrivals[at].penumbra = wide;
        place = atomicAdd(undecided, 1u);
    }
    barrier();
    if (local == 0 && undecided > 0u) {
        first_listed = atomicAdd(listed.count, undecided);
        atomicMax(listed.groups_y, (first_listed + undecided - 1u) / (64u * WORK_ROW) + 1u);
    }
    barrier();
    if (is_undecided) {
        pixels[first_listed + place] = uint(pixel.x) | uint(pixel.y) << 16;
    }
}
