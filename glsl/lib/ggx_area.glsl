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
// cosine lobe about z. METHOD 3 has its error.
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

// Form factor, on a surface with the normal +z, of what a map makes of a polygon. It is cut at z = 0 edge by edge.
float mapped_form_factor(SeenPart part, mat3 map) {
    const vec3 UP = vec3(0.0, 0.0, 1.0);
    float sum = 0.0;
    bool is_cut = false;
    vec3 leaves = vec3(0.0);
    vec3 enters = vec3(0.0);
    vec3 before = map * part.corners[part.count - 1];
    [[dont_unroll]] for (int i = 0; i < part.count; ++i) {
        vec3 here = map * part.corners[i];
        if (before.z > 0.0 || here.z > 0.0) {
            vec3 at_zero = before + (here - before) * (before.z / (before.z - here.z));
            vec3 a = before.z > 0.0 ? before : at_zero;
            vec3 b = here.z > 0.0 ? here : at_zero;
            sum += lambert_edge(a, b, UP);
            enters = before.z > 0.0 ? enters : a;
            leaves = here.z > 0.0 ? leaves : b;
            is_cut = is_cut || here.z <= 0.0;
        }
        before = here;
    }
    sum += is_cut ? lambert_edge(leaves, enters, UP) : 0.0;
    return abs(sum) / TWO_PI;
}

// Agreement of a sum over points and an integral below which the points miss too much of a lobe, and above which they
// are as good.
const vec2 AGREEMENT = vec2(0.5, 0.9);

// Shares of the mapped lobe below which its integral says nothing of GGX, whose tails are longer.
const float LEAST_SHARE = 1e-5;

// Shares of a polygon that the two parts of a GGX lobe reflect, normalised. Mapped lobes, with the shares `shares`, are
// wrong far from their peaks. Sums over points correct them, where the points see the mapped lobe as it is.
vec2 corrected_shares(SeenPart part, vec3 n, vec3 looking, float roughness, vec2 once, mat3 maps[2], vec2 shares) {
    vec3 view = seen_from(n, looking);
    vec3 middle = middle_of(part);
    vec2 scale = vec2(determinant(maps[0]), determinant(maps[1])) * (2.0 / TWO_PI);
    vec2 exact = vec2(0.0);
    vec2 mapped = vec2(0.0);
    [[dont_unroll]] for (int i = 0; i < part.count; ++i) {
        [[dont_unroll]] for (int point = 0; point < 3; ++point) {
            vec4 towards = point_of_part(part, middle, i, point);
            exact += towards.w * max(dot(n, towards.xyz), 0.0) * ggx_parts(roughness, n, view, towards.xyz);
            vec3 first = maps[0] * towards.xyz;
            vec3 second = maps[1] * towards.xyz;
            vec2 d2 = vec2(dot(first, first), dot(second, second));
            mapped += towards.w * max(vec2(first.z, second.z), 0.0) * scale / max(d2 * d2, 1e-30);
        }
    }
    exact /= max(once, vec2(1e-6));
    mapped += LEAST_SHARE;
    vec2 whole = shares + LEAST_SHARE;
    vec2 agreement = min(mapped, whole) / max(mapped, whole);
    return mix(shares, exact * whole / mapped, smoothstep(AGREEMENT.x, AGREEMENT.y, agreement));
}

// Share of a polygon's radiance that a GGX lobe reflects. `part`: above the horizon of n, with at least 3 corners;
// `looking`: unit, from the viewer.
vec3 polygon_ggx(SeenPart part, vec3 n, vec3 looking, vec3 f0, float coded) {
    float roughness = coded_roughness(coded);
    float cosine = clamp(-dot(n, looking), LEAST_COSINE, 1.0);
    vec3 x = -looking - n * dot(n, -looking);
    if (dot(x, x) < 1e-8) {
        x = cross(n, abs(n.x) < 0.7 ? vec3(1.0, 0.0, 0.0) : vec3(0.0, 1.0, 0.0)); // straight on the lobe is round
    }
    x = normalize(x);
    mat3 to_view = transpose(mat3(x, cross(n, x), n));
    vec2 once = scattered_once(roughness, cosine);
    vec2 shares;
    mat3 maps[2];
    [[dont_unroll]] for (uint i = 0u; i < 2u; ++i) {
        maps[i] = cosine_from_view(i, roughness, cosine) * to_view;
        shares[i] = mapped_form_factor(part, maps[i]);
    }
    vec2 reflected = once * corrected_shares(part, n, looking, roughness, once, maps, shares);
    return (f0 * reflected.x + coded_f90(coded) * reflected.y) * scattered_again(f0, once);
}

#endif
