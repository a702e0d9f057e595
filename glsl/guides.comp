// Stage 6, last: lists where most of the light of each live cache comes from, for guided rays to follow. One workgroup per
// cache. METHOD 11.
// variant guides_sky.comp: SKY (where caches see a sky)
#include "shared.glsl"
#include "lib/depth_image.glsl"
#include "lib/directions.glsl"

layout(local_size_x = 64) in;
layout(binding = 0, scalar) readonly buffer Caches { Cache caches[]; };
layout(binding = 1, scalar) readonly buffer Live { uint live[]; };
layout(binding = 2, scalar) readonly buffer Args { LiveArgs args; };
layout(binding = 3, scalar) readonly buffer Radiances { uint radiances[]; }; // DIRECTIONS values per cache [cd/m^2]
layout(binding = 4, scalar) writeonly buffer Guides { uint guides[]; }; // GUIDE_WORDS values per cache
#ifdef SKY
layout(binding = 5, scalar) readonly buffer Open { uint open_parts[]; }; // per cache and direction: open quarters, 8 bits each
#define SKY_BINDING 6
#include "lib/sky.glsl"
#endif

const uint THREADS = gl_WorkGroupSize.x;
const vec3 LUMINANCE = vec3(0.2126, 0.7152, 0.0722);

// Least cosine with which light counts for guided rays.
const float LEAST_FACING = 0.1;

// By direction: luminance [cd/m^2], and its light at the cache's surface [lx].
shared float luminances[DIRECTIONS];
shared float surface_light[DIRECTIONS];

// By part: its direction.
shared uint part_directions[GUIDES];

// Neighbour `i` of 9 of a direction, itself included.
uint beside(uint direction, int i) {
    const int SIDE = int(DIRECTION_SIDE);
    ivec2 at = ivec2(direction % DIRECTION_SIDE, direction / DIRECTION_SIDE) + ivec2(i % 3, i / 3) - 1;
    // Each half of the map's edge continues at its other half.
    if (at.x < 0 || at.x >= SIDE) {
        at = ivec2(clamp(at.x, 0, SIDE - 1), SIDE - 1 - at.y);
    }
    if (at.y < 0 || at.y >= SIDE) {
        at = ivec2(SIDE - 1 - at.x, clamp(at.y, 0, SIDE - 1));
    }
    return uint(at.y * SIDE + at.x);
}

// Greatest luminance [cd/m^2] of a direction and its eight neighbours.
float luminance_about(uint direction) {
    float most = 0.0;
    for (int i = 0; i < 9; ++i) {
        most = max(most, luminances[beside(direction, i)]);
    }
    return most;
}

#ifdef SKY
// Share of a direction that is open to the sky; 0 where the sky around it is open, too: there caches know the sky.
float open_share(uint cache, uint direction) {
    uint least = 4u;
    uint own;
    for (int i = 0; i < 9; ++i) {
        uint at = beside(direction, i);
        uint open = open_parts[cache * (DIRECTIONS / 4u) + at / 4u] >> (8u * (at % 4u)) & 0xffu;
        own = i == 4 ? open : own;
        least = min(least, open);
    }
    return least == 4u ? 0.0 : 0.25 * float(own);
}
#endif

void main() {
    uint slot = gl_WorkGroupID.y * DEPTH_IMAGE_ROW + gl_WorkGroupID.x;
    if (slot >= args.cache_count) {
        return;
    }
    uint thread = gl_LocalInvocationID.x;
    uint cache = live[slot];
    vec3 normal = caches[cache].normal;
    for (uint direction = thread; direction < DIRECTIONS; direction += THREADS) {
        luminances[direction] = dot(unpack_radiance(radiances[cache * DIRECTIONS + direction]), LUMINANCE);
        vec2 at = vec2(direction % DIRECTION_SIDE, direction / DIRECTION_SIDE) + 0.5;
        vec3 way = octahedral_decode(at * (2.0 / float(DIRECTION_SIDE)) - 1.0);
        float from = luminances[direction];
#ifdef SKY
        from += open_share(cache, direction) * dot(sky_at(SKY_OF_CACHES, way), LUMINANCE);
#endif
        // Pixels about the cache face other ways, too.
        surface_light[direction] = from * direction_solid_angle(direction) * max(dot(normal, way), LEAST_FACING);
    }
    for (uint part = thread; part < GUIDES; part += THREADS) {
        part_directions[part] = NO_DIRECTION;
    }
    barrier();
    float total = 0.0;
    for (uint i = 0u; i < DIRECTIONS; ++i) {
        total += surface_light[i];
    }
    float parts_per_light = total > 1e-30 && total < 1e30 ? float(GUIDES) / total : 0.0;
    for (uint direction = thread; direction < DIRECTIONS; direction += THREADS) {
        float before = 0.0;
        for (uint i = 0u; i < direction; ++i) {
            before += surface_light[i];
        }
        uint first = min(uint(before * parts_per_light + 0.5), GUIDES);
        uint end = min(uint((before + surface_light[direction]) * parts_per_light + 0.5), GUIDES);
        for (uint part = first; part < end; ++part) {
            part_directions[part] = direction;
        }
        uint about = floatBitsToUint(luminance_about(direction));
        guides[cache * GUIDE_WORDS + direction] = (about & ~0xffu) | (end - first);
    }
    barrier();
    for (uint four = thread; four < GUIDES / 4u; four += THREADS) {
        uint word = 0u;
        for (uint i = 0u; i < 4u; ++i) {
            word |= part_directions[4u * four + i] << (8u * i);
        }
        guides[cache * GUIDE_WORDS + DIRECTIONS + four] = word;
    }
}
