// Stage 1: the nearest surface of every pixel. METHOD 1, thesis 6.1.2.
// variant gbuffer_elements.frag: ELEMENTS (where caches are interpolated: also which triangle a pixel shows)
// variant layers.frag: LAYER (surfaces that are seen through: METHOD 15)
// variant layers_elements.frag: LAYER ELEMENTS (both)
// variant gbuffer_coat.frag: COAT (where a material has a clear coat or sheen: METHOD 16)
// variant gbuffer_elements_coat.frag: ELEMENTS COAT (likewise)
// variant layers_coat.frag: LAYER COAT (likewise)
// variant layers_elements_coat.frag: LAYER ELEMENTS COAT (likewise)
// variant gbuffer_pulled.frag: ELEMENTS PULLED (where the vertex shader says which triangle it is)
// variant layers_pulled.frag: LAYER ELEMENTS PULLED (likewise)
// variant gbuffer_pulled_coat.frag: ELEMENTS PULLED COAT (likewise)
// variant layers_pulled_coat.frag: LAYER ELEMENTS PULLED COAT (likewise)
#include "shared.glsl"
#include "lib/dipole.glsl"
#include "lib/octahedral.glsl"
#include "lib/surface.glsl"
#ifdef COAT
#include "lib/coat.glsl"
#endif

layout(push_constant, scalar) uniform Push { DrawPush push; };

layout(constant_id = 1) const uint POINTS = 0; // further points of a pixel, in this picture or others; textures are averaged over all
layout(constant_id = 2) const uint DAMPED = 0; // 1: widen lobes by the curvature and bumps within a pixel

layout(constant_id = 3) const uint INSIDE = 0; // stage 10 brings light from inside filled bodies: 1 from afar, 2 all
layout(constant_id = 4) const uint AVERAGED = 0; // 1: the base colour is the mean over a multisampled pixel's samples

layout(location = 0) in vec3 raster_position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec4 tangent;
layout(location = 3) in vec4 uv;
layout(location = 4) in vec4 color;
#ifdef PULLED
layout(location = 5) flat in uint triangle;
#endif

layout(location = 0) out vec4 out_normal; // shading normal, coded lobe
layout(location = 1) out vec4 out_albedo; // rho_d, x of the geometric normal
layout(location = 2) out vec4 out_specular; // rho_g or F0, y of the geometric normal
layout(location = 3) out vec4 out_radiance; // emitted [cd/m^2]; direct light is added by stage 2
#ifdef ELEMENTS
layout(location = 4) out uvec2 out_element; // draw from 1, triangle within it
#endif
#ifdef LAYER
layout(binding = 15) uniform sampler2D opaque_depth;
layout(binding = 16) uniform sampler2D depth_before; // of the previous layer; a single texel of 1 if there is none
#ifdef ELEMENTS
// Transmitted share of the background; alpha: weight of the layer's own light, negative where light bends.
layout(location = 5) out vec4 out_through;
#else
layout(location = 4) out vec4 out_through;
#endif
#endif
#ifdef COAT
#if defined(ELEMENTS) && defined(LAYER)
layout(location = 6) out uvec4 out_coat;
#elif defined(ELEMENTS) || defined(LAYER)
layout(location = 5) out uvec4 out_coat;
#else
layout(location = 4) out uvec4 out_coat;
#endif

// Coat and sheen of a material at a point with this vertex normal.
Coat coat_at(uint material, Uv here, vec3 n) {
    Material m = materials[material];
    Coat c = Coat(n, m.coat, m.coat_roughness, m.sheen_color, m.sheen_roughness);
    if (has_texture(material, TEXTURE_COAT)) {
        c.share *= sample_texture(coat_texture, material, TEXTURE_COAT, here).r;
    }
    if (has_texture(material, TEXTURE_COAT_ROUGHNESS)) {
        c.roughness *= sample_texture(coat_roughness_texture, material, TEXTURE_COAT_ROUGHNESS, here).g;
    }
    if (has_texture(material, TEXTURE_SHEEN_COLOR)) {
        c.sheen *= sample_texture(sheen_color_texture, material, TEXTURE_SHEEN_COLOR, here).rgb;
    }
    if (has_texture(material, TEXTURE_SHEEN_ROUGHNESS)) {
        c.sheen_roughness *= sample_texture(sheen_roughness_texture, material, TEXTURE_SHEEN_ROUGHNESS, here).a;
    }
    return c;
}
#endif

// Upper bounds of what curvature and bumps add to alpha^2: at silhouettes a pixel's derivatives overstate the
// curvature.
const float MOST_BENT = 0.02;
const float MOST_BUMPED = 0.25;

// Perturbs a normal by the normal map. If the file has no tangents, the frame follows from the screen derivatives of
// uv. `variance`: of the bumps within a pixel, along either tangent.
vec3 bumped(vec3 n, uint material, Uv here, vec3 px, vec3 py, out float variance) {
    vec4 texel = sample_texture(normal_texture, material, TEXTURE_NORMAL, here);
    vec3 m = texel.xyz * 2.0 - 1.0;
    float scale = materials[material].normal_scale;
    variance = texel.a * texel.a * scale * scale;
    TextureSlot slot = texture_slots[material * TEXTURE_COUNT + TEXTURE_NORMAL];
    m.xy *= scale;
    vec3 across = tangent.xyz;
    vec3 along;
    if (dot(across, across) > 0.0 && slot.uv_set == 0u) {
        across = unit_or(across - n * dot(n, across), vec3(0.0));
        along = cross(n, across) * tangent.w;
    } else {
        mat2 linear = mat2(slot.linear.xy, slot.linear.zw);
        vec2 tx = linear * (slot.uv_set == 0u ? here.dx.xy : here.dx.zw);
        vec2 ty = linear * (slot.uv_set == 0u ? here.dy.xy : here.dy.zw);
        vec3 a = cross(py, n);
        vec3 b = cross(n, px);
        // Image rows run downwards, so px, py and a normal towards the viewer are left-handed; the sign corrects this.
        float side = dot(n, cross(px, py)) < 0.0 ? -1.0 : 1.0;
        // A dent seen from behind is a bump: on a back side the whole frame is flipped, as n already is.
        side = tangent.w < 0.0 ? -side : side;
        across = side * (a * tx.x + b * ty.x);
        // glTF's v runs down the image, its bitangent up.
        along = -side * (a * tx.y + b * ty.y);
        float size = max(dot(across, across), dot(along, along));
        if (!(size > 0.0)) {
            return n;
        }
        float s = inversesqrt(size);
        across *= s;
        along *= s;
    }
    vec3 tilted = across * m.x + along * m.y + n * m.z;
    return unit_or(tilted, n);
}

void main() {
    uint material = push.material;
    // A sliver between pixel centres may come without a valid position; it faces the viewer then.
    vec3 position = any(isnan(raster_position)) ? push.eye.xyz + vec3(0.0, 0.0, 1.0) : raster_position;
    vec3 px = dFdx(position);
    vec3 py = dFdy(position);
    Uv here = uv_here(uv);
    // Each point covers its share of the pixel. Points that are shaded as one surface have one normal: then the normal
    // map is filtered over the whole pixel.
    float side = inversesqrt(float(1u + POINTS));
    Uv share = Uv(here.at, here.dx * side, here.dy * side);
    if (DAMPED == 0u) {
        here = share;
    }
    vec4 base = base_color(material, share, color);
    if (AVERAGED != 0u && has_texture(material, TEXTURE_BASE_COLOR)) {
        vec4 sum = vec4(0.0);
        for (uint i = 0u; i < 4u; i++) {
            vec4 at_sample = base_color(material, uv_at_sample(here, i), color);
            bool hole = has_holes() && at_sample.a < materials[material].seen_cutoff;
            sum += hole ? vec4(0.0) : vec4(at_sample.rgb, 1.0);
        }
        base.rgb = sum.a > 0.0 ? sum.rgb / sum.a : base.rgb;
    }
    Material m = materials[material];
    if (has_holes() && base.a < m.seen_cutoff) {
        discard;
    }
#ifdef LAYER
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    float before = texelFetch(depth_before, min(pixel, textureSize(depth_before, 0) - 1), 0).r;
    if (gl_FragCoord.z < texelFetch(opaque_depth, pixel, 0).r || gl_FragCoord.z >= before) {
        discard;
    }
#endif
    vec3 towards_viewer = -view_direction(push.eye, position);
    vec3 geometric = facing_normal(px, py, normal, towards_viewer);
    vec3 n = unit_or(normal, geometric);
    vec3 nx = dFdx(n);
    vec3 ny = dFdy(n);
#ifdef COAT
    Coat coat = coat_at(material, here, n);
#endif
    float bumps = 0.0;
    if (has_texture(material, TEXTURE_NORMAL)) {
        n = bumped(n, material, here, px, py, bumps);
    }
    Reflectance r = reflectance(material, base.rgb, share, dot(n, towards_viewer));
    if (DAMPED != 0u && r.coded < 0.0) {
        // A pixel is a box filter of variance 1/12. Tokuyoshi and Kaplanyan 2019, Toksvig 2005.
        float alpha = coded_roughness(r.coded) * coded_roughness(r.coded);
        float bent = min((dot(nx, nx) + dot(ny, ny)) / 12.0, MOST_BENT);
        float wider = alpha * alpha + bent + min(2.0 * bumps, MOST_BUMPED);
        r.coded = coded_ggx(min(sqrt(sqrt(wider)), 1.0), coded_f90(r.coded));
    }
#ifdef COAT
    if (DAMPED != 0u) {
        float rough = max(coat.roughness, LEAST_ROUGHNESS);
        float bent = min((dot(nx, nx) + dot(ny, ny)) / 12.0, MOST_BENT);
        coat.roughness = min(sqrt(sqrt(rough * rough * rough * rough + bent)), 1.0);
    }
    CoatAlbedo over = albedo_of(coat, n, -towards_viewer);
    if (over.under < 1.0) {
        r = dimmed(r, over.under, dot(n, towards_viewer));
    }
#endif
    vec3 emitted = m.emissive;
    if (has_texture(material, TEXTURE_EMISSIVE)) {
        emitted *= sample_texture(emissive_texture, material, TEXTURE_EMISSIVE, share).rgb;
    }
#ifdef LAYER
    // Light that enters the surface is either reflected diffusely or transmitted.
    float transmission = m.transmission;
    if (has_texture(material, TEXTURE_TRANSMISSION)) {
        transmission *= sample_texture(transmission_texture, material, TEXTURE_TRANSMISSION, share).r;
    }
    bool bends = m.thickness > 0.0 && m.transmission > 0.0;
    if (has_texture(material, TEXTURE_THICKNESS)) {
        bends = bends && sample_texture(thickness_texture, material, TEXTURE_THICKNESS, share).g > 0.0;
    }
    float alpha = m.blend != 0u ? clamp(base.a, 0.0, 1.0) : 1.0;
    out_through = vec4(1.0 - alpha + alpha * transmission * r.diffuse, bends ? -alpha : alpha);
    r.diffuse *= 1.0 - transmission;
#endif
#ifdef COAT
    r.diffuse += over.sheen;
    emitted *= 1.0 - over.coat;
    out_coat = pack_coat(coat);
#endif
    if (INSIDE != 0u && m.inside_ior > 0.0) {
        r.diffuse = INSIDE == 1u ? m.close_by * exits(dot(n, towards_viewer), m.inside_ior) : vec3(0.0);
        r.coded = coded_inside(r.coded, m.inside_ior);
    }
    vec2 packed_normal = octahedral_encode(geometric);
    out_normal = vec4(n, r.coded);
    out_albedo = vec4(r.diffuse, packed_normal.x);
    out_specular = vec4(r.glossy, packed_normal.y);
    out_radiance = vec4(emitted, 0.0);
#ifdef ELEMENTS
#ifdef PULLED
    out_element = uvec2(push.draw, triangle);
#else
    out_element = uvec2(push.draw, push.first_triangle + uint(gl_PrimitiveID));
#endif
#endif
}
