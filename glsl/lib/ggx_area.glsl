// Reflection of a polygon of uniform radiance by glTF's GGX lobe. A linear map turns the lobe into a cosine lobe, under
// which the polygon's share is its form factor: linearly transformed cosines, Heitz et al. 2016. Fresnel's two parts
// have one map each, since the part of F90 leans towards the horizon. Uses binding 9.
#ifndef GGX_AREA_GLSL
#define GGX_AREA_GLSL
#include "lib/area_light.glsl"
#include "lib/brdf.glsl"

layout(binding = 9, scalar) readonly buffer GgxArea { vec4 ggx_area[]; }; // src/frame/ggx_area.rs

// Nodes of the table per axis.
const uint GGX_AREA_SIDE = 16u;

// Map from directions in the frame of the view (x towards the viewer along the surface, z the normal) to those of a
// cosine lobe about z. Fits of the lobe's parts, within .03 of it (L2, relative) straight on, .14 at a cosine of .3.
mat3 cosine_from_view(uint part, float roughness, float cosine) {
    const float LAST = float(GGX_AREA_SIDE - 1u);
    vec2 at = min(vec2(roughness, sqrt(cosine)), vec2(1.0)) * LAST;
    vec2 node = min(floor(at), vec2(LAST - 1.0));
    vec2 f = at - node;
    uint first = (part * GGX_AREA_SIDE + uint(node.x)) * GGX_AREA_SIDE + uint(node.y);
    vec4 off = mix(mix(ggx_area[first], ggx_area[first + 1u], f.y),
                   mix(ggx_area[first + GGX_AREA_SIDE], ggx_area[first + GGX_AREA_SIDE + 1u], f.y), f.x);
    // A mirror's limit plus the table's differences.
    float c = cosine;
    float sine = sqrt(max(1.0 - c * c, 0.0));
    float alpha = roughness * roughness;
    float along = c + off.x;
    vec3 x = vec3(along * along, 0.0, sine * (c + off.y));
    vec3 z = alpha * vec3(-sine * (c + c * c * c + off.z), 0.0, 1.0 + c * c * c * c + off.w);
    return transpose(mat3(x, vec3(0.0, 1.0, 0.0), z));
}

// Share of a polygon's radiance that a GGX lobe reflects. `part`: above the horizon of n; `looking`: unit, from the
// viewer.
vec3 polygon_ggx(SeenPart part, vec3 n, vec3 looking, vec3 f0, float coded) {
    float roughness = coded_roughness(coded);
    float cosine = clamp(-dot(n, looking), LEAST_COSINE, 1.0);
    vec3 x = -looking - n * dot(n, -looking);
    if (dot(x, x) < 1e-8) {
        x = cross(n, abs(n.x) < 0.7 ? vec3(1.0, 0.0, 0.0) : vec3(0.0, 1.0, 0.0)); // straight on the lobe is round
    }
    x = normalize(x);
    vec2 once = scattered_once(roughness, cosine);
    vec2 shares;
    for (uint i = 0u; i < 2u; ++i) {
        mat3 to_cosine = cosine_from_view(i, roughness, cosine) * transpose(mat3(x, cross(n, x), n));
        SeenPart mapped = part;
        for (int corner = 0; corner < part.count; ++corner) {
            mapped.corners[corner] = to_cosine * part.corners[corner];
        }
        mapped = above_plane(mapped, vec3(0.0, 0.0, 1.0));
        shares[i] = polygon_form_factor(mapped, vec3(0.0, 0.0, 1.0));
    }
    return (f0 * (once.x * shares.x) + coded_f90(coded) * once.y * shares.y) * scattered_again(f0, once);
}

#endif
