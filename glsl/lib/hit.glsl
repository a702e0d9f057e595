// The surface where a ray hits a triangle. All textures are in one buffer, since not every device can select an image
// per thread. Uses bindings 5 to 11. Twin: src/reference/world.rs.
#ifndef HIT_GLSL
#define HIT_GLSL
#include "lib/trace.glsl"
#include "lib/material.glsl"

layout(binding = 5, scalar) readonly buffer HitVertices { float vertex_words[]; };
layout(binding = 6, scalar) readonly buffer HitIndices { uint hit_indices[]; };
layout(binding = 7, scalar) readonly buffer HitInstances { Instance hit_instances[]; };
layout(binding = 8, scalar) readonly buffer Materials { Material materials[]; };
layout(binding = 9, scalar) readonly buffer TextureSlots { TextureSlot texture_slots[]; };
layout(binding = 10, scalar) readonly buffer HitTextures { HitTexture hit_textures[]; };
layout(binding = 11, scalar) readonly buffer HitTexels { uint hit_texels[]; };

vec3 corner_vector(uint vertex, uint word) {
    uint at = vertex * VERTEX_WORDS + word;
    return vec3(vertex_words[at], vertex_words[at + 1u], vertex_words[at + 2u]);
}

vec4 corner_uv(uint vertex) {
    uint at = vertex * VERTEX_WORDS + 10u;
    return vec4(vertex_words[at], vertex_words[at + 1u], vertex_words[at + 2u], vertex_words[at + 3u]);
}

vec4 corner_color(uint vertex) {
    return unpackUnorm4x8(floatBitsToUint(vertex_words[vertex * VERTEX_WORDS + 14u]));
}

// Indices of a triangle's vertices.
uvec3 corners_of(uint triangle, uint instance) {
    uint first = floatBitsToUint(ray_triangle(3u * triangle).w);
    uint base = hit_instances[instance].drawn_vertex;
    return base + uvec3(hit_indices[first], hit_indices[first + 1u], hit_indices[first + 2u]);
}

int wrapped(int i, int size, uint how) {
    if (how == 2u) {
        return clamp(i, 0, size - 1);
    }
    int period = how == 1u ? 2 * size : size;
    i -= period * int(floor(float(i) / float(period)));
    // Devices may round the quotient to the wrong side of a whole number.
    i += i < 0 ? period : i >= period ? -period : 0;
    return i >= size ? 2 * size - 1 - i : i;
}

// Samples a material's texture at `uv`, filtered over a width in texture coordinates.
vec4 hit_texture(uint material, uint which, vec4 uv, float width) {
    TextureSlot slot = texture_slots[material * TEXTURE_COUNT + which];
    HitTexture texture_ = hit_textures[material * TEXTURE_COUNT + which];
    vec2 t = slot.uv_set == 0u ? uv.xy : uv.zw;
    t = slot.linear.xy * t.x + slot.linear.zw * t.y + slot.translation;
    float stretch = max(length(slot.linear.xy), length(slot.linear.zw));
    ivec2 size = ivec2(texture_.width, texture_.height);
    // The level follows from the exponent of the width in texels. It is looked up: where lavapipe 22.3 runs a loop whose
    // length differs between threads inside another loop, it mixes up what they have computed.
    int side = max(size.x, size.y);
    int level = (floatBitsToInt(width * stretch * float(side)) >> 23 & 0xff) - 127;
    level = clamp(level, 0, findMSB(side));
    uint first = hit_texels[texture_.first + uint(level)];
    size = max(size >> level, ivec2(1));
    bool square = (texture_.how & 32u) != 0u;
    vec2 at = clamp(t, -1e4, 1e4) * vec2(size) - (square ? 0.0 : 0.5);
    vec2 f = square ? vec2(0.0) : fract(at);
    ivec2 low = ivec2(floor(at));
    vec4 sum = vec4(0.0);
    for (int i = 0; i < 4; ++i) {
        int x = wrapped(low.x + (i & 1), size.x, texture_.how & 3u);
        int y = wrapped(low.y + (i >> 1), size.y, texture_.how >> 2 & 3u);
        vec4 texel = unpackUnorm4x8(hit_texels[first + uint(y * size.x + x)]);
        texel.rgb = (texture_.how & 16u) != 0u ? texel.rgb * texel.rgb : texel.rgb;
        sum += texel * ((i & 1) != 0 ? f.x : 1.0 - f.x) * ((i & 2) != 0 ? f.y : 1.0 - f.y);
    }
    return sum;
}

bool has_hit_texture(uint material, uint which) {
    return texture_slots[material * TEXTURE_COUNT + which].present != 0u;
}

vec4 hit_base_color(uint material, vec4 uv, vec4 color, float width) {
    vec4 base = materials[material].base_color * color;
    return has_hit_texture(material, TEXTURE_BASE_COLOR) ? base * hit_texture(material, TEXTURE_BASE_COLOR, uv, width) : base;
}

#ifdef LOOKS
bool looks = false; // whether rays see what a viewer sees; otherwise they carry light
#endif

bool is_there(uint at, vec2 weights, uint instance) {
    uint material = floatBitsToUint(ray_triangle(3u * at + 1u).w);
    uvec3 v = corners_of(at, instance);
    vec3 w = vec3(1.0 - weights.x - weights.y, weights);
    vec4 uv = w.x * corner_uv(v.x) + w.y * corner_uv(v.y) + w.z * corner_uv(v.z);
    vec4 color = w.x * corner_color(v.x) + w.y * corner_color(v.y) + w.z * corner_color(v.z);
    float alpha = hit_base_color(material, uv, color, 0.0).a;
#ifdef LOOKS
    return alpha >= (looks ? materials[material].seen_cutoff : materials[material].alpha_cutoff);
#else
    return alpha >= materials[material].alpha_cutoff;
#endif
}

// Surface point that a ray hits.
struct HitSurface {
    float alpha; // of the base colour
    vec3 position;
    vec3 geometric; // unit normal of the triangle, on the ray's side
    vec3 normal; // unit vertex normal, on the same side
    Reflectance lobes; // for a mean viewer
    vec3 diffuse; // albedo of both lobes together, as if diffuse
    vec3 emission; // with LOOKS also that of area lights [cd/m^2]
};

// Normal of the triangle that a ray hits, in world space and of any length, as its corners turn. `what`: its flags.
vec3 hit_cross(Hit hit, out uint what) {
    vec3 a = ray_triangle(3u * hit.triangle).xyz;
    vec3 b = ray_triangle(3u * hit.triangle + 1u).xyz;
    vec4 third = ray_triangle(3u * hit.triangle + 2u);
    what = floatBitsToUint(third.w);
    vec3 n = cross(b - a, third.xyz - a);
    if (LEVELS == 2u && what >> RAY_KIND_BITS == RAY_MODEL) {
        n = mat3(hit_instances[hit.instance].world_from_normal) * n;
    }
    return n;
}

// Unit normal of a triangle in world space, on the side that faces against `direction`. `front`: whether the ray hits
// the front, or the triangle is two-sided.
vec3 hit_geometric(Hit hit, vec3 direction, out bool front) {
    uint what;
    vec3 n = hit_cross(hit, what);
    front = (dot(n, direction) < 0.0) != ((what & RAY_MIRRORED) != 0u);
    front = front || (what & RAY_TWO_SIDED) != 0u;
    n = n / max(max(abs(n.x), abs(n.y)), max(abs(n.z), 1e-30));
    n *= inversesqrt(max(dot(n, n), 1e-30));
    return dot(n, direction) < 0.0 ? n : -n;
}

// Indices of the vertices of the side that a ray hits, in the order of the hit's weights.
uvec3 corners_hit(Hit hit, vec3 direction) {
    uint what;
    vec3 n = hit_cross(hit, what);
    bool front = (dot(n, direction) < 0.0) != ((what & RAY_MIRRORED) != 0u);
    if (front || (what & RAY_TWIN) == 0u) {
        return corners_of(hit.triangle, hit.instance);
    }
    // The second side's triangle follows. Its corners have the opposite order.
    uint first = floatBitsToUint(ray_triangle(3u * hit.triangle).w) + 3u;
    uint base = hit_instances[hit.instance].drawn_vertex;
    return base + uvec3(hit_indices[first], hit_indices[first + 2u], hit_indices[first + 1u]);
}

// Unit vertex normal at a hit, on the side of this unit normal of the triangle.
vec3 hit_normal(Hit hit, vec3 geometric) {
    uvec3 v = corners_of(hit.triangle, hit.instance);
    vec3 w = vec3(1.0 - hit.weights.x - hit.weights.y, hit.weights);
    vec3 n = w.x * corner_vector(v.x, 3u) + w.y * corner_vector(v.y, 3u) + w.z * corner_vector(v.z, 3u);
    n = mat3(hit_instances[hit.instance].world_from_normal) * n;
    n = dot(n, n) > 0.0 ? normalize(n) : geometric;
    return dot(n, geometric) < 0.0 ? -n : n;
}

// The surface at a hit; `spread`: width of the ray's cone by distance.
HitSurface surface_at(Hit hit, vec3 origin, vec3 direction, float spread) {
    HitSurface s;
    bool front;
    s.geometric = hit_geometric(hit, direction, front);
    s.position = origin + hit.distance * direction;
    uint material = floatBitsToUint(ray_triangle(3u * hit.triangle + 1u).w);
    uint what = floatBitsToUint(ray_triangle(3u * hit.triangle + 2u).w);
    uvec3 v = corners_of(hit.triangle, hit.instance);
    vec3 w = vec3(1.0 - hit.weights.x - hit.weights.y, hit.weights);
    s.normal = hit_normal(hit, s.geometric);

    vec4 uva = corner_uv(v.x);
    vec4 uvb = corner_uv(v.y);
    vec4 uvc = corner_uv(v.z);
    vec4 uv = w.x * uva + w.y * uvb + w.z * uvc;
    vec4 color = w.x * corner_color(v.x) + w.y * corner_color(v.y) + w.z * corner_color(v.z);
    // Texture coordinates per metre, from the ratio of areas.
    vec3 p = corner_vector(v.x, 0u);
    mat3 linear = mat3(hit_instances[hit.instance].world_from_model);
    vec3 across = cross(linear * (corner_vector(v.y, 0u) - p), linear * (corner_vector(v.z, 0u) - p));
    vec4 u1 = uvb - uva;
    vec4 u2 = uvc - uva;
    float in_texture = max(abs(u1.x * u2.y - u1.y * u2.x), abs(u1.z * u2.w - u1.w * u2.z));
    float width = spread * hit.distance * sqrt(in_texture / max(length(across), 1e-30));

    Material m = materials[material];
    vec4 whole = hit_base_color(material, uv, color, width);
    vec3 base = whole.rgb;
    s.alpha = whole.a;
    Reflectance r = Reflectance(base, m.phong_specular, m.phong_exponent);
    if (m.phong_exponent < 0.0) {
        float metallic = m.metallic;
        float roughness = m.roughness;
        if (has_hit_texture(material, TEXTURE_METALLIC_ROUGHNESS)) {
            vec4 t = hit_texture(material, TEXTURE_METALLIC_ROUGHNESS, uv, width);
            metallic *= t.b;
            roughness *= t.g;
        }
        float specular = m.specular;
        if (has_hit_texture(material, TEXTURE_SPECULAR)) {
            specular *= hit_texture(material, TEXTURE_SPECULAR, uv, width).a;
        }
        vec3 specular_color = m.specular_color;
        if (has_hit_texture(material, TEXTURE_SPECULAR_COLOR)) {
            specular_color *= hit_texture(material, TEXTURE_SPECULAR_COLOR, uv, width).rgb;
        }
        r = metallic_roughness(base, metallic, roughness, m.ior, specular, specular_color, MEAN_COSINE);
    }
    s.lobes = r;
    s.diffuse = sent_on(r);
    s.emission = vec3(0.0);
#ifdef LOOKS
    bool emits = front;
#else
    bool emits = front && (what & RAY_AREA_LIGHT) == 0u;
#endif
    if (emits && m.emissive != vec3(0.0)) {
        s.emission = m.emissive;
        if (has_hit_texture(material, TEXTURE_EMISSIVE)) {
            s.emission *= hit_texture(material, TEXTURE_EMISSIVE, uv, width).rgb;
        }
    }
    return s;
}

// Offset of a ray's start from its surface: more than the rounding error of positions.
float lift_at(vec3 position, float from_eye) {
    return 1e-5 * (max(abs(position.x), max(abs(position.y), abs(position.z))) + from_eye);
}

#endif
