// Averages the lights of caches at a point: the core of stage 8. METHOD 5, thesis listing 5.2. Twin:
// src/reference/interpolate.rs. The including shader declares `GLOSSY` and `PRINTED`.
#ifndef AVERAGE_GLSL
#define AVERAGE_GLSL

#include "lib/interpolation.glsl"
#include "lib/phong.glsl"

// The point at which caches are averaged.
struct Point {
    vec3 position;
    vec3 normal;
    vec3 mirrored; // view direction reflected about the normal
    vec4 eye;
    float d_max; // distance at which weights reach 0
};

// Sums for one lobe: irradiance over all caches that take part, position over the lit ones.
struct Sums {
    vec3 irradiance;
    float weight;
    vec3 position;
    float lit;
};

struct Averages {
    Sums diffuse;
    Sums glossy;
    vec3 glossy_plain; // facing irradiance and exponent, not weighted by the lobe
    float exponent;
};

Averages no_caches() {
    Sums none = Sums(vec3(0.0), 0.0, vec3(0.0), 0.0);
    return Averages(none, none, vec3(0.0), 0.0);
}

void add(inout Sums s, float w, float lit, vec3 irradiance, vec3 position) {
    s.irradiance += w * irradiance;
    s.weight += w;
    s.position += (w * lit) * position;
    s.lit += w * lit;
}

// As printed in the thesis: averages flux (here over 4 pi) and position.
void add_printed(inout Sums s, float w, float lit, vec3 irradiance, vec3 proxy, vec3 cache) {
    vec3 d = proxy - cache;
    add(s, w, lit, irradiance * dot(d, d), proxy);
}

// Lobes without any positive weight in the first round. A second round weights their caches by distance alone.
bvec2 left_over(Averages a) {
    return bvec2(a.diffuse.weight <= 0.0, GLOSSY != 0u && a.glossy.weight <= 0.0);
}

// Adds a cache to the requested `lobes`: diffuse, glossy.
void take(inout Averages a, Point x, Cache c, Proxy p, bool by_distance, bvec2 lobes) {
    float d = distance(x.position, c.position);
    float apart = distance_weight(d, x.d_max);
    float diffuse_lit = p.diffuse_distance2 > 0.0 ? 1.0 : 0.0;
    if (PRINTED != 0u) {
        if (lobes.x) {
            float w = by_distance ? apart : printed_weight(d, x.d_max, dot(x.normal, c.normal));
            add_printed(a.diffuse, w, diffuse_lit, p.diffuse_irradiance, p.diffuse_position, c.position);
        }
        if (lobes.y) {
            vec3 r = reflect(view_direction(x.eye, c.position), c.normal);
            float w = by_distance ? apart : printed_weight(d, x.d_max, dot(x.mirrored, r));
            add_printed(a.glossy, w, p.glossy_distance2 > 0.0 ? 1.0 : 0.0, p.glossy_irradiance, p.glossy_position, c.position);
        }
        return;
    }
    float w = by_distance ? apart : facing_weight(d, x.d_max, dot(x.normal, c.normal));
    if (lobes.x) {
        vec3 there = p.diffuse_position - c.position;
        vec3 here = p.diffuse_position - x.position;
        float left = falloff(p.diffuse_distance2, dot(there, there), dot(here, here));
        add(a.diffuse, w, diffuse_lit, p.diffuse_irradiance * left, p.diffuse_position);
    }
    // A cache whose glossy lobe receives no light takes no part.
    if (lobes.y && p.glossy_distance2 > 0.0) {
        vec3 towards = p.glossy_position - x.position;
        float cosine = dot(x.mirrored, towards) * inversesqrt(max(dot(towards, towards), 1e-30));
        float steps = c.exponent * log2(max(cosine, LEAST_LOBE_COSINE));
        add(a.glossy, w, exp2(steps) + LEAST_PULL, p.glossy_irradiance * exp2(WEIGHED_SHARE * steps), p.glossy_position);
        a.glossy_plain += w * p.glossy_irradiance;
        a.exponent += w * c.exponent;
    }
}

VertexLight averaged(Averages a, Point x) {
    VertexLight light;
    light.position = x.position;
    light.diffuse_irradiance = a.diffuse.weight > 0.0 ? a.diffuse.irradiance / a.diffuse.weight : vec3(0.0);
    light.diffuse_position = a.diffuse.lit > 0.0 ? a.diffuse.position / a.diffuse.lit : x.position + x.normal;
    light.glossy_irradiance = a.glossy.weight > 0.0 ? a.glossy.irradiance / a.glossy.weight : vec3(0.0);
    light.glossy_position = a.glossy.lit > 0.0 ? a.glossy.position / a.glossy.lit : x.position + x.normal;
    if (GLOSSY != 0u && PRINTED == 0u && a.glossy.weight > 0.0) {
        // The averaged light must give the lobe what the single proxies give it on average, but never more than the
        // plain mean.
        vec3 towards = light.glossy_position - x.position;
        float cosine = dot(x.mirrored, towards) * inversesqrt(max(dot(towards, towards), 1e-30));
        float seen = cosine_power(max(cosine, LEAST_LOBE_COSINE), WEIGHED_SHARE * a.exponent / a.glossy.weight);
        light.glossy_irradiance = min(light.glossy_irradiance / max(seen, 1e-30), a.glossy_plain / a.glossy.weight);
    }
    return light;
}

#endif
