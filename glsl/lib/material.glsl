// glTF's metallic-roughness material as a diffuse and a glossy lobe. Twin: src/scene/material.rs.
#ifndef MATERIAL_GLSL
#define MATERIAL_GLSL
#include "lib/brdf.glsl"

struct Reflectance {
    vec3 diffuse; // rho_d
    vec3 glossy; // rho_g, or F0
    float coded; // Phong exponent k, or encoded GGX parameters: lib/brdf.glsl
};

// For a viewer at this cosine. Light that the dielectric lobe reflects does not reach the diffuse lobe below. A surface
// that reflects less than 2 % at normal incidence is also darker at grazing angles; one that reflects nothing has no
// lobe.
Reflectance metallic_roughness(vec3 base, float metallic, float roughness, float ior, float specular, vec3 specular_color,
                               float cosine) {
    float f = (ior - 1.0) / (ior + 1.0);
    vec3 dielectric = min(f * f * specular_color, vec3(1.0));
    float most = max(dielectric.x, max(dielectric.y, dielectric.z));
    float f90 = specular * min(50.0 * most, 1.0);
    roughness = clamp(roughness, LEAST_ROUGHNESS, 1.0);
    dielectric *= specular;
    float horizon = mix(f90, 1.0, metallic);
    Reflectance r;
    r.glossy = mix(dielectric, base, metallic);
    r.coded = coded_ggx(roughness, horizon);
    vec2 once = scattered_once(roughness, cosine);
    float under = 1.0 - ggx_albedo(vec3(most * specular), f90, once).x;
    // Microfacets of the mixed parts exchange more light than the mixed F0 accounts for; the difference becomes
    // diffuse.
    vec3 parts = mix(ggx_albedo(dielectric, f90, once), ggx_albedo(base, 1.0, once), metallic);
    vec3 more = parts - ggx_albedo(r.glossy, horizon, once);
    r.diffuse = base * ((1.0 - metallic) * clamp(under, 0.0, 1.0)) + max(more, vec3(0.0));
    return r;
}

// Light that a surface reflects by both lobes together, as if it were diffuse: the mean over viewers, at most 1. Its
// diffuse lobe must be the one at MEAN_COSINE.
vec3 sent_on(Reflectance r) {
    vec3 glossy = r.coded < 0.0
        ? ggx_albedo(r.glossy, coded_f90(r.coded), scattered_once(coded_roughness(r.coded), MEAN_COSINE))
        : r.glossy * phong_albedo(r.coded, MEAN_PHONG_COSINE);
    return max(r.diffuse, min(r.diffuse + glossy, vec3(1.0)));
}

// The two shares of light from a direction at this cosine that a surface reflects: diffusely, and in its lobe. Its diffuse
// lobe must be the one at MEAN_COSINE; the more the lobe reflects, the less is left for it.
void reflected_from(Reflectance r, float cosine, out vec3 diffuse, out vec3 glossy) {
    cosine = clamp(cosine, LEAST_COSINE, 1.0);
    glossy = lobe_albedo(r.glossy, r.coded, cosine, cosine);
    diffuse = r.diffuse;
    if (r.coded < 0.0) {
        vec3 mean = lobe_albedo(r.glossy, r.coded, MEAN_COSINE, MEAN_COSINE);
        float most = max(glossy.x, max(glossy.y, glossy.z));
        float most_of_mean = max(mean.x, max(mean.y, mean.z));
        diffuse *= clamp((1.0 - most) / max(1.0 - most_of_mean, 1e-3), 0.0, 1.5);
    }
    glossy = min(glossy, max(1.0 - diffuse, 0.0));
}

#endif
