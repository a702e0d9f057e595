// Subsurface scattering: the dipole model and the average of proxy dipoles. METHOD 7, thesis 5.5. Twin:
// src/reference/dipole.rs.
#ifndef DIPOLE_GLSL
#define DIPOLE_GLSL
#include "lib/form_factor.glsl"

// Upper bound of a point's brightness relative to the mean of its caches, for light that falls between caches.
const float MOST_BRIGHTER = 64.0;

// Irradiance below which a cache counts as dark: f32 has no more digits for it.
const float LEAST_IRRADIANCE = 1e-37;

// Weight of a cache at this distance, independent of normals. (5.91). The bound serves a single reference, which is
// also the farthest.
float dipole_weight(float d, float d_max) {
    return max(1.0 - d / d_max, 1e-6);
}

// Part of the light of one source of each channel's dipole that leaves farther than sqrt(r2) across the surface; `d`: the
// distance of such points from the source, `decay` [1/m]. `z` is the source's distance from the surface, `widest` the
// minimal distance for the size of its texel.
vec3 source_beyond(vec3 r2, vec3 z, vec3 sigma_tr, vec3 of_source, vec3 widest, out vec3 d, out vec3 decay) {
    vec3 deep = max(z, widest);
    decay = min(sigma_tr, max(sigma_tr * z, vec3(1.0)) / deep);
    d = sqrt(r2 + deep * deep);
    return of_source * deep / d * exp(-decay * (d - deep));
}

// One source of each channel's dipole: its part of R_d [1/m^2] at the squared lateral distance `r2`. The form of (5.83).
vec3 dipole_source(vec3 r2, vec3 z, vec3 sigma_tr, vec3 of_source, vec3 widest) {
    vec3 d, decay;
    vec3 beyond = source_beyond(r2, z, sigma_tr, of_source, widest, d, decay);
    return beyond * (1.0 + decay * d) / (2.0 * PI * d * d);
}

// Diffuse reflectance R_d [1/m^2] by channel.
vec3 diffuse_reflectance(Filled f, vec3 r2, vec3 widest) {
    return dipole_source(r2, f.near, f.sigma_tr, f.of_near, widest) + dipole_source(r2, f.far, f.sigma_tr, f.of_far, widest);
}

// Minimal depth of dipole sources for texels of this area [m].
float widest_of(float area) {
    return sqrt(area);
}

// Share of R_d that caches bring. Pixels themselves reflect light that enters around them on their side of the body.
// `facing`: part of the light that entered on this side. Wide texels spread light farther: that pixels reflect it already
// counts there, too.
vec3 brought(Filled f, vec3 r2, vec3 widest, vec3 facing) {
    vec3 d, decay;
    vec3 around = vec3(f.around);
    vec3 beyond = source_beyond(around, f.near, f.sigma_tr, f.of_near, widest, d, decay)
        + source_beyond(around, f.far, f.sigma_tr, f.of_far, widest, d, decay);
    vec3 all = f.of_near + f.of_far;
    vec3 near = clamp(1.5 - r2 / around, vec3(0.0), vec3(1.0));
    vec3 within = min(f.close_by / max(all - beyond, vec3(1e-30)), vec3(1.0));
    return (1.0 - within * facing * near) * min(f.from_afar * all / max(beyond, vec3(1e-30)), vec3(1.0));
}

// 1 where light enters on the side of the body that a cache is on, by both normals; also if the cache has no normal.
float on_same_side(vec3 of_cache, vec3 of_light) {
    return dot(of_cache, of_cache) > 0.0 ? clamp(2.0 * dot(of_cache, of_light), 0.0, 1.0) : 1.0;
}

// R_d, as far as caches bring it, for light spread by this variance about its mean position.
vec3 spread_reflectance(Filled f, vec3 r2, vec3 variance, vec3 widest, vec3 facing) {
    return diffuse_reflectance(f, r2, sqrt(widest * widest + 0.5 * variance)) * brought(f, r2 + variance, widest, facing);
}

// Fresnel reflectance of a smooth dielectric boundary for unpolarised light; `ior` is the far side's index over the
// near side's.
float dielectric_fresnel(float cosine, float ior) {
    float c = min(abs(cosine), 1.0);
    float below = 1.0 - (1.0 - c * c) / (ior * ior);
    if (below <= 0.0) {
        return 1.0;
    }
    float t = sqrt(below);
    float s = (c - ior * t) / (c + ior * t);
    float p = (ior * c - t) / (ior * c + t);
    return 0.5 * (s * s + p * p);
}

// Lower bound of the cosine with the viewer: a pixel of a silhouette covers such angles, and its normal may face away.
const float LEAST_EXIT = 0.1;

// Share of light at this cosine that enters, over that of uniform light; 1 where no medium lies below the surface.
float enters(float cosine, float ior) {
    float inside = -1.44 / (ior * ior) + 0.71 / ior + 0.668 + 0.0636 * ior; // (5.77)
    return ior > 0.0 ? (1.0 - dielectric_fresnel(cosine, ior)) / (ior * ior * (1.0 - inside)) : 1.0;
}

// Share of the light from below that leaves the surface towards a viewer at this cosine.
float exits(float cosine, float ior) {
    return 1.0 - dielectric_fresnel(max(cosine, LEAST_EXIT), ior);
}

// Radiance that leaves the surface towards a viewer at this cosine, from the irradiance from below.
vec3 leaving(Filled f, float cosine, vec3 irradiance) {
    return irradiance * (exits(cosine, f.ior) / (f.entering * PI));
}

// Weighted sums over caches, by channel.
struct Dipoles {
    float all; // sum of weights
    vec3 from; // positions of caches relative to the point
    float from2; // their squared lengths
    vec3 root; // fourth root of irradiance
    vec3 lit; // sum of weights of the lit caches
    vec3 place_r; // positions of the light relative to the point
    vec3 place_g;
    vec3 place_b;
    vec3 second; // their squared lengths
    vec3 variance;
    vec3 widest;
    vec3 facing;
    vec3 follows; // 0: all caches agree on one position; 1: light comes from all around
};

Dipoles no_dipoles() {
    vec3 o = vec3(0.0);
    return Dipoles(0.0, o, 0.0, o, o, o, o, o, o, o, o, o, o);
}

// Adds a cache's proxy dipole; `from` is the cache's position relative to the point.
void take_dipole(inout Dipoles s, float w, ProxyDipole p, vec3 from) {
    vec3 lit = w * vec3(greaterThan(p.irradiance, vec3(0.0)));
    vec3 r = from + p.place_r;
    vec3 g = from + p.place_g;
    vec3 b = from + p.place_b;
    s.all += w;
    s.from += w * from;
    s.from2 += w * dot(from, from);
    s.root += w * sqrt(sqrt(p.irradiance));
    s.lit += lit;
    s.place_r += lit.r * r;
    s.place_g += lit.g * g;
    s.place_b += lit.b * b;
    s.second += lit * vec3(dot(r, r), dot(g, g), dot(b, b));
    s.variance += lit * p.variance;
    s.widest += lit * p.widest;
    s.facing += lit * p.facing;
}

// Turns sums into means: positions, `variance` (including the variance of the positions), `widest` and `facing`.
Dipoles mean_dipoles(Filled f, Dipoles s) {
    vec3 share = 1.0 / max(s.lit, vec3(1e-30));
    s.place_r *= share.r;
    s.place_g *= share.g;
    s.place_b *= share.b;
    s.widest *= share;
    s.facing *= share;
    vec3 squares = vec3(dot(s.place_r, s.place_r), dot(s.place_g, s.place_g), dot(s.place_b, s.place_b));
    vec3 between = max(s.second * share - squares, vec3(0.0));
    vec3 middle = s.from / max(s.all, 1e-30);
    float apart = max(s.from2 / max(s.all, 1e-30) - dot(middle, middle), 1e-30);
    // Light that is as wide as the surface around a point has no position, either.
    s.follows = clamp(between / apart + s.variance * share / f.around, 0.0, 1.0);
    s.variance = s.variance * share + between;
    s.second = squares;
    return s;
}

// Logarithm to base 2 of an irradiance [lx] or a reflectance [1/m^2], finite also in the dark.
vec3 log2_or_least(vec3 value) {
    return log2(max(value, vec3(LEAST_IRRADIANCE)));
}

// Logarithm of the scale of a cache's own dipole, with the width of the mean dipole; 0 for channels without light. (5.90)
vec3 own_scale(Filled f, Dipoles mean, ProxyDipole p) {
    vec3 r2 = vec3(dot(p.place_r, p.place_r), dot(p.place_g, p.place_g), dot(p.place_b, p.place_b));
    vec3 own = spread_reflectance(f, r2, mean.variance, mean.widest, p.facing);
    return (log2_or_least(p.irradiance) - log2_or_least(own)) * vec3(greaterThan(p.irradiance, vec3(0.0)));
}

// Irradiance from below at the point [lx]; `scales`: weighted sum of the caches' `own_scale`. (5.92), (5.93), with the
// geometric mean of the scales: light inside decays exponentially, so the brightest cache would outshine all others.
vec3 irradiance_below(Filled f, Dipoles mean, vec3 scales) {
    vec3 here = spread_reflectance(f, mean.second, mean.variance, mean.widest, mean.facing);
    vec3 share = 1.0 / max(mean.lit, vec3(1e-30));
    vec3 root = mean.root / max(mean.all, 1e-30);
    vec3 irradiance = root * root * root * root;
    vec3 of_lit = irradiance * mean.all * share;
    vec3 brighter = log2_or_least(here) + scales * share - log2_or_least(of_lit);
    brighter = exp2((1.0 - mean.follows) * clamp(brighter, vec3(-126.0), vec3(log2(MOST_BRIGHTER))));
    return irradiance * brighter;
}

#endif
