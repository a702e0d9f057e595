// The glossy lobe of a surface as stored in the G-buffer: `specular` and one number `coded`. If `coded` >= 0 it is the
// exponent of a modified Phong lobe with albedo `specular`. If negative, it encodes glTF 2.0's lobe with F0 =
// `specular`: GGX, Smith's height-correlated shadowing, Schlick's Fresnel and multiple scattering. Twins:
// src/reference/brdf.rs, src/scene/ggx.rs.
#ifndef BRDF_GLSL
#define BRDF_GLSL
#include "lib/phong.glsl"

// Lower bound of roughness: keeps the highlight of a light without size finite.
const float LEAST_ROUGHNESS = 0.045;

// Least roughness of surfaces that send light on to caches or rays: few virtual lights or rays meet a narrower lobe.
const float LEAST_LOBE = 0.35;

// Lower bound of the cosine with the viewer: a normal from a normal map may even face away.
const float LEAST_COSINE = 0.01;

// Cosine at which a dielectric lobe's reflectance is about its mean over the hemisphere.
const float MEAN_COSINE = 0.475;

// The same for a Phong lobe; exact for narrow lobes.
const float MEAN_PHONG_COSINE = 0.6666667;

// Exponent above which a lobe is narrower than caches can resolve.
const float CACHE_EXPONENT = 2048.0;

// Packs roughness in [LEAST_ROUGHNESS, 1] and the reflectance at grazing incidence into one negative number.
float coded_ggx(float roughness, float f90) {
    return -(floor((1.0 - f90) * 255.0 + 0.5) + 0.5 * roughness);
}

float coded_roughness(float coded) {
    return 2.0 * fract(-coded);
}

float coded_f90(float coded) {
    // Devices may round 255 / 255 to more than 1. A negative reflectance would make light negative.
    return max(1.0 - float(uint(-coded) & 255u) / 255.0, 0.0);
}

// Adds the index of a medium below the surface to a lobe of glTF, in steps of 0.1 from 1 to 2.5.
float coded_inside(float coded, float ior) {
    return coded < 0.0 ? coded - 256.0 * clamp(round(10.0 * ior - 9.0), 1.0, 16.0) : coded;
}

// The index of that medium; 0 if there is none.
float coded_ior(float coded) {
    uint step = uint(max(-coded, 0.0)) >> 8;
    return step > 0u ? 0.9 + 0.1 * float(step) : 0.0;
}

// Fit by powers of cosine / (cosine + alpha): coefficients of 1, alpha, alpha^2, alpha^3.
const vec4 WHOLE[6] = vec4[6](
    vec4(0.9760314, 0.1620926, -0.2620544, 0.1039931), vec4(0.1939374, -3.278414, 0.3070236, -0.3667155),
    vec4(-1.88827, 17.98381, -8.505335, 2.695105), vec4(2.219887, -39.50036, 5.196035, 3.272633),
    vec4(0.8242185, 39.14375, 8.987958, -3.34294), vec4(-1.329452, -14.78641, -4.205442, -9.211608));

// Fit by powers of the cosine, the last row by cosine / (cosine + alpha): coefficients of roughness^1 to ^4, then of 1.
const vec4 MEETING[5] = vec4[5](
    vec4(0.6119457, 0.03954586, -0.09075218, -0.08407662), vec4(1.661892, -15.3, 15.61723, -3.295657),
    vec4(1.745568, 11.67772, -20.20051, 7.251153), vec4(-4.235289, 3.581084, 0.3299611, 0.1033743),
    vec4(-0.6735195, -0.7388668, 8.464338, -6.21879));
const float MEETING_FIRST[5] = float[5](-0.02288454, 0.9627351, -0.1903572, 0.2899276, 0.02710257);

// Single-scattering reflectance of a lobe under uniform light, as factors of F0 and of F90. Fits of their sum and of
// the mean cosine at the microfacets; within .004 of the integrals for cosines >= .01.
vec2 scattered_once(float roughness, float cosine) {
    float c = clamp(cosine, LEAST_COSINE, 1.0);
    float a = roughness * roughness;
    float p = c / (c + a);
    vec4 powers = vec4(1.0, a, a * a, a * a * a);
    float whole = 0.0;
    for (int i = 5; i >= 0; --i) {
        whole = whole * p + dot(WHOLE[i], powers);
    }
    whole = min(whole, 1.0);
    powers = roughness * vec4(1.0, roughness, a, a * roughness);
    float met = 0.0;
    for (int i = 3; i >= 0; --i) {
        met = met * c + dot(MEETING[i], powers) + MEETING_FIRST[i];
    }
    met += p * (dot(MEETING[4], powers) + MEETING_FIRST[4]);
    float missed = clamp(1.0 - met, 0.0, 1.0);
    float at_edges = whole * (missed * missed) * (missed * missed) * missed;
    return vec2(whole - at_edges, at_edges);
}

// Factor by which multiple scattering brightens a lobe; Turquin 2019.
vec3 scattered_again(vec3 f0, vec2 once) {
    return 1.0 + f0 * (1.0 / (once.x + once.y) - 1.0);
}

// Albedo of a lobe under uniform light.
vec3 ggx_albedo(vec3 f0, float f90, vec2 once) {
    return (f0 * once.x + f90 * once.y) * scattered_again(f0, once);
}

// Unit vector to the viewer, from the surface's side that it sees.
vec3 seen_from(vec3 n, vec3 looking) {
    float facing = -dot(n, looking);
    return facing < LEAST_COSINE ? normalize(n * (LEAST_COSINE - facing) - looking) : -looking;
}

// GGX BRDF [1/sr] that scatters once, for light from direction `towards`: factors of F0 and of F90.
vec2 ggx_parts(float roughness, vec3 n, vec3 view, vec3 towards) {
    float nv = dot(n, view);
    float nl = dot(n, towards);
    vec3 h = normalize(view + towards);
    float a = roughness * roughness;
    // The sine from a cross product keeps its precision in narrow lobes.
    vec3 across = cross(n, h);
    float nh = dot(n, h);
    float narrow = a / (dot(across, across) + a * a * nh * nh);
    float spread = 1.0 - a * a;
    float seen = nl * sqrt(a * a + spread * nv * nv) + nv * sqrt(a * a + spread * nl * nl);
    float missed = 1.0 - clamp(dot(view, h), 0.0, 1.0);
    float at_edge = (missed * missed) * (missed * missed) * missed;
    return vec2(1.0 - at_edge, at_edge) * (narrow * narrow * (0.5 / 3.14159265) / max(seen, 1e-30));
}

// GGX BRDF [1/sr] for light from direction `towards`; `looking` is the unit vector from the viewer.
vec3 ggx_lobe(vec3 f0, float f90, float roughness, vec3 n, vec3 looking, vec3 towards) {
    vec3 view = seen_from(n, looking);
    vec2 parts = ggx_parts(roughness, n, view, towards);
    return (f0 * parts.x + f90 * parts.y) * scattered_again(f0, scattered_once(roughness, dot(n, view)));
}

// BRDF [1/sr] of either lobe type for light from `towards`, which must be above the surface.
vec3 glossy_lobe(vec3 specular, float coded, vec3 n, vec3 looking, vec3 towards) {
    if (coded < 0.0) {
        return ggx_lobe(specular, coded_f90(coded), coded_roughness(coded), n, looking, towards);
    }
    return specular * phong_lobe(coded, dot(reflect(looking, n), towards));
}

// A modified Phong lobe.
struct PhongLobe {
    vec3 albedo; // rho_g
    float exponent; // k
};

// Albedo of a Phong lobe with rho_g = 1 under uniform light: the cosine-weighted part above the surface. Within .5 %.
float phong_albedo(float k, float cosine) {
    float flat2 = 1.0 / (6.28318531 * k + 3.14159265 + 0.85840735 / (1.0 + 0.95 * k)); // at the horizon, squared
    float c2 = cosine * cosine;
    return 0.5 * (cosine + sqrt(c2 + 4.0 * flat2 * (1.0 - c2) * exp2(-0.81 * k * c2)));
}

// Exponent of the Phong lobe of equal width. For GGX 1/2 (1/alpha^2 - 1): both peaks have the same height.
float fitted_exponent(float coded) {
    float a = coded_roughness(coded) * coded_roughness(coded);
    return coded < 0.0 ? max(0.5 * (1.0 / (a * a) - 1.0), 0.25) : coded;
}

// Unit axis of a lobe: the mirrored view direction, which for GGX bends towards the normal with growing roughness.
// Lagarde and de Rousiers 2014, 4.9.3, reduced at grazing views.
vec3 lobe_axis(float coded, vec3 n, vec3 looking) {
    vec3 mirrored = reflect(looking, n);
    if (coded >= 0.0) {
        return mirrored;
    }
    float a = coded_roughness(coded) * coded_roughness(coded);
    float c = clamp(-dot(n, looking), 0.0, 1.0);
    return normalize(mix(n, mirrored, (1.0 - a) * (sqrt(1.0 - a) + a) * (1.0 - min(a, 0.54) * (1.0 - c))));
}

// Albedo of either lobe type under uniform light, at the viewer's cosine; of a Phong lobe, with its axis at the cosine
// `axis`.
vec3 lobe_albedo(vec3 specular, float coded, float cosine, float axis) {
    return coded < 0.0 ? ggx_albedo(specular, coded_f90(coded), scattered_once(coded_roughness(coded), cosine))
                       : specular * phong_albedo(coded, axis);
}

// Phong lobe that approximates either lobe type about an axis; `axis` is the axis's cosine with the normal. It has
// GGX's width, an exponent of at most `most`, and GGX's albedo under uniform light at the viewer's cosine.
PhongLobe fitted_about(vec3 specular, float coded, float cosine, float axis, float most) {
    if (coded >= 0.0) {
        return PhongLobe(specular, coded);
    }
    float k = min(fitted_exponent(coded), most);
    return PhongLobe(lobe_albedo(specular, coded, cosine, axis) / phong_albedo(k, clamp(axis, LEAST_COSINE, 1.0)), k);
}

// The same about the mirrored view direction, with an exponent that caches can resolve.
PhongLobe fitted_lobe(vec3 specular, float coded, float cosine) {
    return fitted_about(specular, coded, cosine, cosine, CACHE_EXPONENT);
}

#endif
