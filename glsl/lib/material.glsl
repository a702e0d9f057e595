// glTF's metallic-roughness material in the method's terms. Twin: src/scene/material.rs.
#ifndef MATERIAL_GLSL
#define MATERIAL_GLSL
#include "lib/phong.glsl"

struct Reflectance {
    vec3 diffuse; // rho_d
    vec3 glossy; // rho_g
    float exponent; // k
};

// rho_d = base (1 - metallic), rho_g = F0; where both together would exceed 1 they are scaled to 1.
Reflectance metallic_roughness(vec3 base, float metallic, float roughness, float ior, float specular, vec3 specular_color) {
    float f = (ior - 1.0) / (ior + 1.0);
    vec3 dielectric = min(f * f * specular_color, vec3(1.0)) * specular;
    Reflectance r;
    r.diffuse = base * (1.0 - metallic);
    r.glossy = mix(dielectric, base, metallic);
    vec3 sum = r.diffuse + r.glossy;
    float s = max(1.0, max(sum.x, max(sum.y, sum.z)));
    r.diffuse /= s;
    r.glossy /= s;
    r.exponent = exponent_from_roughness(roughness);
    return r;
}

#endif
