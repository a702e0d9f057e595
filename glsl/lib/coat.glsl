// Layers above a surface's own lobes: clear coat (KHR_materials_clearcoat) and, below it, sheen (KHR_materials_sheen).
// METHOD 16. Twins: src/reference/coat.rs, src/scene/sheen.rs.
#ifndef COAT_GLSL
#define COAT_GLSL
#include "lib/material.glsl"
#include "lib/octahedral.glsl"

// Reflectance of a coat at normal incidence, for an index of refraction of 1.5.
const float COAT_F0 = 0.04;

// Lower bound of sheen roughness: smoother sheen would show only at the very edge.
const float LEAST_SHEEN_ROUGHNESS = 0.1;

struct Coat {
    vec3 normal; // unit, of the coat
    float share; // share of the surface that is coated
    float roughness;
    vec3 sheen; // colour of the sheen
    float sheen_roughness;
};

// Packs a coat into the G-buffer format.
uvec4 pack_coat(Coat c) {
    return uvec4(packSnorm2x16(octahedral_encode(c.normal)), packUnorm2x16(vec2(c.share, c.roughness)),
                 packUnorm2x16(vec2(c.sheen_roughness, c.sheen.x)), packUnorm2x16(c.sheen.yz));
}

Coat unpack_coat(uvec4 bits) {
    vec2 coat = unpackUnorm2x16(bits.y);
    vec2 sheen = unpackUnorm2x16(bits.z);
    return Coat(octahedral_decode(unpackSnorm2x16(bits.x)), coat.x, coat.y, vec3(sheen.y, unpackUnorm2x16(bits.w)), sheen.x);
}

// The coat's lobe in the G-buffer encoding of GGX.
float coded_coat(Coat c) {
    return coded_ggx(max(c.roughness, LEAST_ROUGHNESS), 1.0);
}

// Logarithm of Lambda for cosines up to 1/2. Estevez and Kulla 2017.
float sheen_log(float alpha, float x) {
    float t = (1.0 - alpha) * (1.0 - alpha);
    float a = mix(21.5473, 25.3245, t);
    float b = mix(3.82987, 3.32435, t);
    float c = mix(0.19823, 0.16801, t);
    float d = mix(-1.97760, -1.27393, t);
    float e = mix(-4.32054, -4.85967, t);
    return a / (1.0 + b * pow(x, c)) + d * x + e;
}

// Smith's Lambda for the fibre distribution.
float sheen_lambda(float alpha, float cosine) {
    return exp(cosine < 0.5 ? sheen_log(alpha, cosine) : 2.0 * sheen_log(alpha, 0.5) - sheen_log(alpha, max(1.0 - cosine, 1e-7)));
}

// Fit by powers of ln(roughness) + 1: coefficients of 1, u, u^2, u^3, then of u^4, with u = 2 sqrt(cosine) - 1.
const vec4 SHEEN[4] = vec4[4](
    vec4(-0.8648058, -1.705422, -0.8879002, -0.7520157), vec4(0.1153187, 1.904287, 1.519958, 0.9126094),
    vec4(-0.3688529, -1.150307, -0.8343759, 0.07790181), vec4(0.2132948, 0.3470406, 0.08235765, -0.3056653));
const vec4 SHEEN_LAST = vec4(-0.5639245, 0.3321902, 0.3511139, -0.2085173);

// Albedo of white sheen under uniform light for a viewer at this cosine, by its formula: a fit, within .004 of the
// integral (absolute, or relative above 1). At the edges of smooth sheen it exceeds 1.
float sheen_whole(float roughness, float cosine) {
    float c = clamp(cosine, LEAST_COSINE, 1.0);
    float u = 2.0 * sqrt(c) - 1.0;
    float w = log(roughness) + 1.0;
    vec4 powers = vec4(1.0, w, w * w, w * w * w);
    vec4 rows = SHEEN[0] + SHEEN[1] * powers.y + SHEEN[2] * powers.z + SHEEN[3] * powers.w;
    float log_ = rows.x + u * (rows.y + u * (rows.z + u * (rows.w + u * dot(SHEEN_LAST, powers))));
    return exp(log_) / (c * (1.0 + sheen_lambda(roughness * roughness, c)));
}

// BRDF times cosine [1/sr] of white sheen for light from `towards`, which must be above the surface; `looking` is the
// unit vector from the viewer.
float sheen_formula(float roughness, vec3 n, vec3 looking, vec3 towards) {
    float facing = -dot(n, looking);
    vec3 view = facing < LEAST_COSINE ? normalize(n * (LEAST_COSINE - facing) - looking) : -looking;
    float nv = dot(n, view);
    float nl = max(dot(n, towards), 1e-7);
    float alpha = roughness * roughness;
    vec3 across = cross(n, normalize(view + towards));
    float fibres = (2.0 + 1.0 / alpha) / 6.28318531 * pow(max(dot(across, across), 1e-30), 0.5 / alpha);
    float seen = 1.0 + sheen_lambda(alpha, min(nv, 1.0)) + sheen_lambda(alpha, min(nl, 1.0));
    return fibres / (seen * 4.0 * nv);
}

// The same, scaled down where the formula would reflect more light than arrives.
float sheen_reflected(float roughness, vec3 n, vec3 looking, vec3 towards) {
    return sheen_formula(roughness, n, looking, towards) / max(sheen_whole(roughness, -dot(n, looking)), 1.0);
}

// Albedo of a full coat under uniform light for a viewer at this cosine.
float coat_albedo(float roughness, float cosine) {
    roughness = max(roughness, LEAST_ROUGHNESS);
    return ggx_albedo(vec3(COAT_F0), 1.0, scattered_once(roughness, cosine)).x;
}

// Reflectance of coat and sheen under uniform light.
struct CoatAlbedo {
    float coat;
    vec3 sheen; // below the coat
    float under; // share of the base layer's light that passes both
};

CoatAlbedo albedo_of(Coat c, vec3 n, vec3 looking) {
    CoatAlbedo a = CoatAlbedo(0.0, vec3(0.0), 1.0);
    if (c.share > 0.0) {
        a.coat = c.share * coat_albedo(c.roughness, -dot(c.normal, looking));
    }
    float most = max(c.sheen.x, max(c.sheen.y, c.sheen.z));
    if (most > 0.0) {
        float whole = min(sheen_whole(max(c.sheen_roughness, LEAST_SHEEN_ROUGHNESS), -dot(n, looking)), 1.0);
        a.sheen = c.sheen * (whole * (1.0 - a.coat));
        a.under -= most * whole;
    }
    a.under *= 1.0 - a.coat;
    return a;
}

// A surface's own lobes at this cosine, dimmed to `share` of their light. GGX's multiple scattering makes its light
// quadratic in F0, so F0 is solved for.
Reflectance dimmed(Reflectance r, float share, float cosine) {
    r.diffuse *= share;
    if (r.coded >= 0.0) {
        r.glossy *= share;
        return r;
    }
    vec2 once = scattered_once(coded_roughness(r.coded), cosine);
    float more = 1.0 / (once.x + once.y) - 1.0;
    vec3 again = 1.0 + more * r.glossy;
    vec3 wanted = share * r.glossy * again;
    r.glossy = 2.0 * wanted / (1.0 + sqrt(1.0 + 4.0 * more * wanted));
    vec3 ratio = again / (1.0 + more * r.glossy);
    // One F90 must serve three channels.
    float between = 0.5 * (min(ratio.x, min(ratio.y, ratio.z)) + max(ratio.x, max(ratio.y, ratio.z)));
    float f90 = share * coded_f90(r.coded) * between;
    r.coded = coded_ggx(coded_roughness(r.coded), min(f90, 1.0));
    return r;
}

// Diffuse albedo without sheen. The G-buffer's diffuse albedo includes the sheen's reflectance under uniform light.
vec3 without_sheen(vec3 albedo, CoatAlbedo a) {
    return max(albedo - a.sheen, vec3(0.0));
}

// BRDF times cosine [1/sr] of sheen and coat for light from `towards`.
vec3 coat_reflected(Coat c, CoatAlbedo a, vec3 n, vec3 looking, vec3 towards) {
    vec3 sum = vec3(0.0);
    if (a.sheen != vec3(0.0) && dot(n, towards) > 0.0) {
        float roughness = max(c.sheen_roughness, LEAST_SHEEN_ROUGHNESS);
        sum += c.sheen * ((1.0 - a.coat) * sheen_reflected(roughness, n, looking, towards));
    }
    float cosine = dot(c.normal, towards);
    if (c.share > 0.0 && cosine > 0.0) {
        float roughness = max(c.roughness, LEAST_ROUGHNESS);
        sum += ggx_lobe(vec3(COAT_F0), 1.0, roughness, c.normal, looking, towards) * (c.share * cosine);
    }
    return sum;
}

#endif
