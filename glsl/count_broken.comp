// Debugging: counts impossible values in radiance, VALs, the caches' sums and proxies: NaN, infinite or negative. METHOD 4
// rules them out.
#include "shared.glsl"

layout(local_size_x = 256) in;
layout(push_constant, scalar) uniform Push { CheckPush push; };
layout(binding = 0) uniform sampler2D direct_image;
layout(binding = 1) uniform sampler2D diffuse_image;
layout(binding = 2) uniform sampler2D glossy_image;
layout(binding = 3, scalar) readonly buffer Vals { Val vals[]; };
layout(binding = 4, scalar) readonly buffer Proxies { Proxy proxies[]; };
layout(binding = 5, scalar) readonly buffer Sums { GatherSums sums[]; }; // one per part and cache
layout(binding = 6, scalar) readonly buffer Args { LiveArgs args; };
layout(binding = 7, scalar) writeonly buffer Counts { uint counts[]; }; // CHECK_GROUPS counts per target

shared uint sum;

// Tests NaN and infinity by bits: compilers may fold isnan to false, and devices flush denormals to zero.
uint endless(float v) {
    return (floatBitsToUint(v) & 0x7f800000u) == 0x7f800000u ? 1u : 0u;
}

uint endless(vec3 v) {
    return endless(v.x) + endless(v.y) + endless(v.z);
}

// NaN, infinite or negative; -0 is valid.
uint broken(float v) {
    uint bits = floatBitsToUint(v);
    return bits >= 0x7f800000u && bits != 0x80000000u ? 1u : 0u;
}

uint broken(vec3 v) {
    return broken(v.x) + broken(v.y) + broken(v.z);
}

uint broken_pixel(sampler2D image, uint pixel) {
    return broken(texelFetch(image, ivec2(pixel % push.width, pixel / push.width), 0).rgb);
}

uint broken_val(Val v) {
    return endless(v.position) + broken(v.area) + endless(v.normal) + broken(v.flux) + broken(v.weight);
}

uint broken_proxy(Proxy p) {
    return endless(p.diffuse_position) + broken(p.diffuse_distance2) + broken(p.diffuse_irradiance) + broken(p.glossy_distance2) +
           endless(p.glossy_position) + broken(p.glossy_irradiance);
}

// Positions are relative to the cache.
uint broken_sums(GatherSums s) {
    return endless(s.diffuse_position) + broken(s.diffuse_weight) + broken(s.diffuse_irradiance) + broken(s.distance2) +
           endless(s.glossy_position) + broken(s.glossy_weight) + broken(s.glossy_irradiance) + broken(s.glossy_distance2);
}

void main() {
    uint target = gl_WorkGroupID.y;
    uint items = target == CHECK_DIRECT    ? push.direct_pixels
                 : target == CHECK_DIFFUSE ? push.diffuse_pixels
                 : target == CHECK_GLOSSY  ? push.glossy_pixels
                 : target == CHECK_VALS    ? push.val_count
                 : target == CHECK_SUMS    ? (push.summed_caches > 0u ? args.groups_y * args.cache_count : 0u)
                                           : push.cache_count;
    if (gl_LocalInvocationID.x == 0u) {
        sum = 0u;
    }
    barrier();
    uint found = 0u;
    for (uint i = gl_GlobalInvocationID.x; i < items; i += 256u * CHECK_GROUPS) {
        if (target == CHECK_DIRECT) {
            found += broken_pixel(direct_image, i);
        } else if (target == CHECK_DIFFUSE) {
            found += broken_pixel(diffuse_image, i);
        } else if (target == CHECK_GLOSSY) {
            found += broken_pixel(glossy_image, i);
        } else if (target == CHECK_VALS) {
            found += broken_val(vals[i]);
        } else if (target == CHECK_SUMS) {
            found += broken_sums(sums[(push.cache_parts + i / args.cache_count) * push.summed_caches + i % args.cache_count]);
        } else {
            found += broken_proxy(proxies[i]);
        }
    }
    atomicAdd(sum, found);
    barrier();
    if (gl_LocalInvocationID.x == 0u) {
        counts[target * CHECK_GROUPS + gl_WorkGroupID.x] = sum;
    }
}
