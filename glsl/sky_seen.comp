// Stage 6, last: what each live cache sees of the sky by its depth image: the share that arrives of what an open surface would
// receive. METHOD 12. Twin: src/reference/sky.rs.
// variant sky_seen_directed.comp: DIRECTED (where short rays ask for light by directions: adds that of the sky)
#include "shared.glsl"
#include "lib/depth_image.glsl"

layout(local_size_x = 64) in;
layout(push_constant, scalar) uniform Push { SkySeenPush push; };
layout(binding = 0, scalar) readonly buffer Caches { Cache caches[]; };
layout(binding = 1, scalar) readonly buffer Live { uint live[]; };
layout(binding = 2, scalar) readonly buffer Args { LiveArgs args; };
layout(binding = 3, scalar) readonly buffer Images { float images[]; };
#define SKY_BINDING 4
#include "lib/sky.glsl"
layout(binding = 6, scalar) writeonly buffer Seen { vec3 seen[]; }; // of each cache
#ifdef DIRECTED
#include "lib/directions.glsl"
layout(binding = 7, scalar) buffer Radiances { uint radiances[]; }; // DIRECTIONS of each cache [cd/m^2]
#endif

const uint THREADS = gl_WorkGroupSize.x;
const float HALF = 0.5 * float(DEPTH_IMAGE_SIDE);

shared vec3 arriving[THREADS];
shared vec3 from_all[THREADS];
shared vec2 counts[THREADS]; // of open texels, of all on the disc

void main() {
    uint slot = gl_WorkGroupID.y * DEPTH_IMAGE_ROW + gl_WorkGroupID.x;
    if (slot >= args.cache_count) {
        return;
    }
    uint thread = gl_LocalInvocationID.x;
    uint cache = live[slot];
    vec3 n = caches[cache].normal;
    vec3 tangent, bitangent;
    tangents(n, tangent, bitangent);
    vec3 open = vec3(0.0);
    vec3 all = vec3(0.0);
    vec2 count = vec2(0.0);
    // Texels of the disc have equal shares of irradiance.
    for (uint texel = thread; texel < DEPTH_IMAGE_TEXELS; texel += THREADS) {
        vec2 p = (vec2(texel % DEPTH_IMAGE_SIDE, texel / DEPTH_IMAGE_SIDE) + 0.5) / HALF - 1.0;
        float z2 = 1.0 - dot(p, p);
        if (z2 > 0.0) {
            vec3 radiance = sky_at(SKY_OF_CACHES, tangent * p.x + bitangent * p.y + n * sqrt(z2));
            bool is_open = images[slot * DEPTH_IMAGE_TEXELS + texel] == 0.0;
            all += radiance;
            open += is_open ? radiance : vec3(0.0);
            count += vec2(is_open ? 1.0 : 0.0, 1.0);
        }
    }
    arriving[thread] = open;
    from_all[thread] = all;
    counts[thread] = count;
    barrier();
    if (thread == 0u) {
        for (uint i = 1u; i < THREADS; ++i) {
            open += arriving[i];
            all += from_all[i];
            count += counts[i];
        }
        // A surface that faces darkness has the share of its directions.
        float least = push.least * count.y / 3.14159265;
        seen[cache] = (open + least * count.x / count.y) / max(all + least, 1e-37);
    }
#ifdef DIRECTED
    for (uint direction = thread; direction < DIRECTIONS; direction += THREADS) {
        vec3 sum = vec3(0.0);
        for (uint part = 0u; part < 4u; ++part) {
            vec2 at = vec2(direction % DIRECTION_SIDE, direction / DIRECTION_SIDE) + 0.25 + 0.5 * vec2(part & 1u, part >> 1);
            vec3 d = octahedral_decode(at * (2.0 / float(DIRECTION_SIDE)) - 1.0);
            if (dot(d, n) > 0.0) {
                uvec2 texel = uvec2(clamp(vec2(dot(tangent, d), dot(bitangent, d)) * HALF + HALF, 0.0, 2.0 * HALF - 0.5));
                bool is_open = images[slot * DEPTH_IMAGE_TEXELS + texel.y * DEPTH_IMAGE_SIDE + texel.x] == 0.0;
                sum += is_open ? sky_at(SKY_OF_CACHES, d) : vec3(0.0);
            }
        }
        uint at = cache * DIRECTIONS + direction;
        radiances[at] = pack_radiance(unpack_radiance(radiances[at]) + 0.25 * sum);
    }
#endif
}
