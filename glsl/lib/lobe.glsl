// A visible surface's glossy lobe for ray tracing: sampled directions, their density, and the weight of each direction.
// Everything is normalised to an albedo of 1 under uniform light, so that a lobe takes a mean of radiance. The
// including shader has PI and tangents().
#ifndef LOBE_GLSL
#define LOBE_GLSL
#include "lib/brdf.glsl"

struct Lobe {
    vec3 n; // unit normal
    vec3 view; // unit vector to the viewer, clamped to above the surface
    vec3 mirrored; // unit axis of the lobe
    float exponent; // of the Phong lobe of equal width
    float alpha; // GGX alpha; negative for a Phong lobe
    float f0, f90; // luminance of the reflectance at normal and at grazing incidence, divided by the albedo
};

// For `specular` and `coded` see lib/brdf.glsl.
Lobe lobe_of(vec3 specular, float coded, vec3 n, vec3 towards_eye) {
    float facing = dot(n, towards_eye);
    vec3 view = facing < LEAST_COSINE ? normalize(n * (LEAST_COSINE - facing) + towards_eye) : towards_eye;
    vec3 mirrored = lobe_axis(coded, n, -towards_eye);
    float k = fitted_exponent(coded);
    if (coded >= 0.0) {
        return Lobe(n, view, mirrored, k, -1.0, 1.0 / phong_albedo(k, clamp(dot(n, mirrored), LEAST_COSINE, 1.0)), 0.0);
    }
    float roughness = coded_roughness(coded);
    vec2 once = scattered_once(roughness, dot(n, view));
    float f0 = dot(specular, vec3(0.2126, 0.7152, 0.0722));
    float whole = f0 * once.x + coded_f90(coded) * once.y;
    return Lobe(n, view, mirrored, k, roughness * roughness, f0 / whole, coded_f90(coded) / whole);
}

// Smith's masking term: share of microfacets visible at a cosine.
float seen_share(float cosine, float alpha) {
    return 2.0 * cosine / (cosine + sqrt(alpha * alpha + (1.0 - alpha * alpha) * cosine * cosine));
}

// Weight of a direction that the lobe has sampled: BRDF times cosine over density.
float lobe_weight(Lobe lobe, vec3 direction) {
    float nl = max(dot(lobe.n, direction), 0.0);
    if (lobe.alpha < 0.0) {
        return lobe.f0 * (lobe.exponent + 2.0) / (lobe.exponent + 1.0) * nl;
    }
    float nv = dot(lobe.n, lobe.view);
    float a2 = lobe.alpha * lobe.alpha;
    float meets = nl * sqrt(a2 + (1.0 - a2) * nv * nv) + nv * sqrt(a2 + (1.0 - a2) * nl * nl);
    float missed = 1.0 - clamp(dot(lobe.view, normalize(lobe.view + direction)), 0.0, 1.0);
    float fresnel = lobe.f0 + (lobe.f90 - lobe.f0) * ((missed * missed) * (missed * missed) * missed);
    return fresnel * (2.0 * nl * nv / max(meets, 1e-30)) / seen_share(nv, lobe.alpha);
}

// Probability density with which a lobe samples a direction [1/sr].
float lobe_density(Lobe lobe, vec3 direction) {
    if (lobe.alpha < 0.0) {
        return (lobe.exponent + 1.0) * (0.5 / PI) * cosine_power(max(dot(direction, lobe.mirrored), 0.0), lobe.exponent);
    }
    vec3 h = normalize(lobe.view + direction);
    vec3 across = cross(lobe.n, h);
    float nh = dot(lobe.n, h);
    float nv = dot(lobe.n, lobe.view);
    float narrow = lobe.alpha / (dot(across, across) + lobe.alpha * lobe.alpha * nh * nh);
    return narrow * narrow / PI * seen_share(nv, lobe.alpha) / (4.0 * nv);
}

// Samples a direction of a lobe; `chance`: a number in (0, 1) and an angle [rad]. GGX by visible normals: Dupuy and
// Benyoub 2023.
vec3 lobe_direction(Lobe lobe, vec2 chance) {
    vec3 tangent, bitangent;
    if (lobe.alpha < 0.0) {
        float up = pow(chance.x, 1.0 / (lobe.exponent + 1.0));
        float aside = sqrt(max(1.0 - up * up, 0.0));
        tangents(lobe.mirrored, tangent, bitangent);
        return tangent * (aside * cos(chance.y)) + bitangent * (aside * sin(chance.y)) + lobe.mirrored * up;
    }
    tangents(lobe.n, tangent, bitangent);
    vec3 view = vec3(dot(lobe.view, tangent), dot(lobe.view, bitangent), dot(lobe.view, lobe.n));
    vec3 stretched = normalize(vec3(lobe.alpha * view.xy, view.z));
    float z = 1.0 - chance.x * (1.0 + stretched.z);
    float aside = sqrt(clamp(1.0 - z * z, 0.0, 1.0));
    vec3 facet = vec3(aside * cos(chance.y), aside * sin(chance.y), z) + stretched;
    facet = normalize(vec3(lobe.alpha * facet.xy, max(facet.z, 0.0)));
    vec3 h = tangent * facet.x + bitangent * facet.y + lobe.n * facet.z;
    return reflect(-lobe.view, h);
}

#endif
