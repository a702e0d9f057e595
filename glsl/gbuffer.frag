// Stage 1: the nearest surface of every pixel. METHOD 1, thesis 6.1.2.
#include "shared.glsl"
#include "lib/octahedral.glsl"
#include "lib/surface.glsl"

layout(push_constant, scalar) uniform Push { DrawPush push; };

layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec4 tangent;
layout(location = 3) in vec4 uv;
layout(location = 4) in vec4 color;

layout(location = 0) out vec4 out_normal; // shading normal, Phong exponent
layout(location = 1) out vec4 out_albedo; // rho_d, x of the geometric normal
layout(location = 2) out vec4 out_specular; // rho_g, y of the geometric normal
layout(location = 3) out vec4 out_radiance; // emitted [cd/m^2]; direct light is added by stage 2

// The normal map's tilt. Without tangents in the file the frame follows from how uv changes over the picture.
vec3 bumped(vec3 n, uint material) {
    vec2 t = texture_uv(material, TEXTURE_NORMAL, uv);
    vec3 m = texture(normal_texture, t).xyz * 2.0 - 1.0;
    m.xy *= materials[material].normal_scale;
    vec3 across = tangent.xyz;
    vec3 along;
    if (dot(across, across) > 0.0 && texture_slots[material * TEXTURE_COUNT + TEXTURE_NORMAL].uv_set == 0u) {
        across = normalize(across - n * dot(n, across));
        along = cross(n, across) * tangent.w;
    } else {
        vec3 px = dFdx(position);
        vec3 py = dFdy(position);
        vec2 tx = dFdx(t);
        vec2 ty = dFdy(t);
        vec3 a = cross(py, n);
        vec3 b = cross(n, px);
        across = a * tx.x + b * ty.x;
        // glTF's v runs down the image, its bitangent up.
        along = -(a * tx.y + b * ty.y);
        float size = max(dot(across, across), dot(along, along));
        if (!(size > 0.0)) {
            return n;
        }
        float s = inversesqrt(size);
        across *= s;
        along *= s;
    }
    vec3 tilted = across * m.x + along * m.y + n * m.z;
    float size = dot(tilted, tilted);
    return size > 1e-12 ? tilted * inversesqrt(size) : n;
}

void main() {
    uint material = push.material;
    vec4 base = base_color(material, uv, color);
    Material m = materials[material];
    if (base.a < m.alpha_cutoff) {
        discard;
    }
    Reflectance r = reflectance(material, base.rgb, uv);
    vec3 towards_viewer = -view_direction(push.eye, position);
    vec3 geometric = cross(dFdx(position), dFdy(position));
    geometric *= inversesqrt(max(dot(geometric, geometric), 1e-37));
    geometric = dot(geometric, towards_viewer) < 0.0 ? -geometric : geometric;
    vec3 n = normalize(normal);
    if (has_texture(material, TEXTURE_NORMAL)) {
        n = bumped(n, material);
    }
    vec3 emitted = m.emissive;
    if (has_texture(material, TEXTURE_EMISSIVE)) {
        emitted *= texture(emissive_texture, texture_uv(material, TEXTURE_EMISSIVE, uv)).rgb;
    }
    vec2 packed_normal = octahedral_encode(geometric);
    out_normal = vec4(n, r.exponent);
    out_albedo = vec4(r.diffuse, packed_normal.x);
    out_specular = vec4(r.glossy, packed_normal.y);
    out_radiance = vec4(emitted, 0.0);
}
