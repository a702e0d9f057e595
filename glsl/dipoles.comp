// Stage 9: condenses all light inside a body into one dipole per channel at each of its caches. METHOD 7, thesis 5.5.4.
// Light enters through the RSMs' texels and, around caches, as the light that they receive. One workgroup per cache;
// sums have a fixed order.
#include "shared.glsl"
#include "lib/dipole.glsl"
#include "lib/phong.glsl"

layout(local_size_x = DIPOLE_THREADS) in;
layout(push_constant, scalar) uniform Push { DipolePush push; };
layout(binding = 0, scalar) readonly buffer Caches { Cache caches[]; };
layout(binding = 1, scalar) readonly buffer FilledCaches { FilledCache filled_caches[]; };
layout(binding = 2, scalar) readonly buffer FilledParts { Filled filled[]; };
layout(binding = 3, scalar) readonly buffer InnerVals { Val inner_vals[]; };
layout(binding = 4, scalar) readonly buffer InnerCount { uint inner_count; };
layout(binding = 5, scalar) readonly buffer Proxies { Proxy proxies[]; };
layout(binding = 6, scalar) writeonly buffer ProxyDipoles { ProxyDipole dipoles[]; };

struct Sums {
    vec3 irradiance;
    vec3 second;
    vec3 widest;
    vec3 facing;
    vec3 place_r;
    vec3 place_g;
    vec3 place_b;
    vec3 whole; // response of the body if every cache received 1
};
shared Sums sums[DIPOLE_THREADS];

// Irradiance that a cache receives through its surface: reflected light and light from emitters.
vec3 received(Cache c, Proxy p) {
    vec3 towards = unit_or(p.diffuse_position - c.position, c.normal);
    return p.diffuse_distance2 > 0.0 ? p.diffuse_irradiance * max(dot(towards, c.normal), 0.0) : vec3(0.0);
}

// Adds the part of `given` that caches bring.
void take(inout Sums s, Filled f, vec3 d, vec3 given, float widest, float facing) {
    given *= brought(f, vec3(dot(d, d)), vec3(widest), vec3(facing));
    s.irradiance += given;
    s.second += given * dot(d, d);
    s.widest += given * widest;
    s.facing += given * facing;
    s.place_r += given.r * d;
    s.place_g += given.g * d;
    s.place_b += given.b * d;
}

void main() {
    uint thread = gl_LocalInvocationID.x;
    uint at = gl_WorkGroupID.x + gl_WorkGroupID.y * gl_NumWorkGroups.x;
    bool is_there = at < push.count;
    FilledCache own = filled_caches[min(at, push.count - 1u)];
    Filled f = filled[own.filled];
    vec3 here = caches[own.cache].position;
    vec3 normal = caches[own.cache].normal;
    vec3 o = vec3(0.0);
    Sums s = Sums(o, o, o, o, o, o, o, o);
    for (uint i = thread; i < inner_count; i += DIPOLE_THREADS) {
        Val val = inner_vals[i];
        if (val.kind == own.filled) {
            vec3 d = val.position - here;
            float widest = widest_of(val.area);
            vec3 given = val.flux * diffuse_reflectance(f, vec3(dot(d, d)), vec3(widest));
            take(s, f, d, given, widest, on_same_side(normal, val.normal));
        }
    }
    for (uint i = thread; i < push.count; i += DIPOLE_THREADS) {
        FilledCache other = filled_caches[i];
        if (other.filled == own.filled) {
            Cache c = caches[other.cache];
            vec3 d = c.position - here;
            float widest = widest_of(c.area);
            vec3 given = c.area * diffuse_reflectance(f, vec3(dot(d, d)), vec3(widest));
            s.whole += given;
            given *= f.entering * received(c, proxies[other.cache]);
            take(s, f, d, given, widest, on_same_side(normal, c.normal));
        }
    }
    sums[thread] = s;
    barrier();
    for (uint step = DIPOLE_THREADS / 2u; step > 0u; step /= 2u) {
        if (thread < step) {
            sums[thread].irradiance += sums[thread + step].irradiance;
            sums[thread].second += sums[thread + step].second;
            sums[thread].widest += sums[thread + step].widest;
            sums[thread].facing += sums[thread + step].facing;
            sums[thread].place_r += sums[thread + step].place_r;
            sums[thread].place_g += sums[thread + step].place_g;
            sums[thread].place_b += sums[thread + step].place_b;
            sums[thread].whole += sums[thread + step].whole;
        }
        barrier();
    }
    if (thread > 0u || !is_there) {
        return;
    }
    s = sums[0];
    // Channels without light still need a finite position.
    bvec3 is_lit = greaterThan(s.irradiance, vec3(LEAST_IRRADIANCE));
    vec3 share = mix(vec3(0.0), 1.0 / max(s.irradiance, vec3(LEAST_IRRADIANCE)), is_lit);
    ProxyDipole p;
    // Bound for thin bodies: no part may send on more light than arrives.
    p.irradiance = mix(vec3(0.0), s.irradiance / max(s.whole, vec3(1.0)), is_lit);
    p.filled = own.filled;
    p.place_r = s.place_r * share.r;
    p.place_g = s.place_g * share.g;
    p.place_b = s.place_b * share.b;
    vec3 squares = vec3(dot(p.place_r, p.place_r), dot(p.place_g, p.place_g), dot(p.place_b, p.place_b));
    p.variance = max(s.second * share - squares, vec3(0.0));
    p.widest = s.widest * share;
    p.facing = s.facing * share;
    dipoles[own.cache] = p;
}
