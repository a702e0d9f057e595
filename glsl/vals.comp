// Stage 4: turns each texel of an extended RSM into a virtual area light. METHOD 2, thesis 5.2.
// variant vals_inside.comp: INSIDE (where bodies are filled: also the light that enters them. METHOD 7)
#include "shared.glsl"
#include "lib/area_light.glsl"
#include "lib/light.glsl"
#include "lib/val_lobe.glsl"

layout(local_size_x = 8, local_size_y = 8) in;
layout(constant_id = 0) const uint IRRADIANCE_WEIGHTS = 1; // else form-factor weights
layout(push_constant, scalar) uniform Push { ValPush push; };
layout(binding = 0, scalar) readonly buffer Lights { Light lights[]; };
layout(binding = 1, scalar) readonly buffer Views { LightView views[]; };
layout(binding = 2) uniform sampler2D position_image;
layout(binding = 3) uniform sampler2D normal_image;
layout(binding = 4) uniform sampler2D albedo_image;
layout(binding = 5, scalar) writeonly buffer Vals { Val vals[]; };
layout(binding = 6, scalar) writeonly buffer Flags { uint flags[]; }; // 1 for VALs with light or weight
#ifdef INSIDE
layout(binding = 7) uniform sampler2D inside_image;
layout(binding = 8, scalar) writeonly buffer InnerVals { Val inner_vals[]; };
layout(binding = 9, scalar) writeonly buffer InnerFlags { uint inner_flags[]; };

// Lower bound of the cosine for a texel that hits a surface edge-on: limits its area.
const float LEAST_TILT = 0.1;
#endif

// Sub-samples of the intensity per axis of a texel: the edge of a sharp cone crosses texels.
const int SAMPLES = 4;

// If an area light fills more than 1 - UNDER of a surface's view, less and less of the surface's light gets past it.
const float UNDER = 0.05;

// Direction through a point of the view's image; u to the right, v up, both in [-1, 1].
vec3 through(LightView view, vec2 p) {
    return view.forward + view.right * p.x + view.up * p.y;
}

void main() {
    uvec2 texel = gl_GlobalInvocationID.xy;
    if (any(greaterThanEqual(texel, uvec2(push.size)))) {
        return;
    }
    Light light = lights[push.light];
    LightView view = views[push.view];
    vec4 hit = texelFetch(position_image, ivec2(texel), 0);
    vec4 normal = texelFetch(normal_image, ivec2(texel), 0);
    vec4 albedo = texelFetch(albedo_image, ivec2(texel), 0);

    float n = float(push.size);
    vec2 low = vec2(float(texel.x), n - 1.0 - float(texel.y)) * (2.0 / n) - 1.0;
    float step = 2.0 / n;
    // Footprint on a plane perpendicular to the axis, eq. 5.10; light through the texel [lm].
    float area = step * step * length(view.right) * length(view.up);
    vec3 entering;
    if (light.kind == LIGHT_DIRECTIONAL) {
        entering = light.intensity * area;
    } else {
        float z = dot(hit.xyz - view.position, view.forward);
        area *= z * z;
        float omega = solid_angle(through(view, low), through(view, low + vec2(step, 0.0)), through(view, low + step),
                                  through(view, low + vec2(0.0, step)));
        float falloff = 1.0;
        if (light.kind == LIGHT_SPOT || light.kind == LIGHT_AREA) {
            falloff = 0.0;
            for (int i = 0; i < SAMPLES * SAMPLES; ++i) {
                vec2 inside = (vec2(i % SAMPLES, i / SAMPLES) + 0.5) / float(SAMPLES);
                float cosine = dot(normalize(through(view, low + step * inside)), light.direction);
                falloff += light.kind == LIGHT_AREA ? max(cosine, 0.0)
                                                    : spot_falloff(cosine, light.cone_scale, light.cone_offset);
            }
            falloff /= float(SAMPLES * SAMPLES);
        } else if (light.kind == LIGHT_BODY) {
            vec3 away = normalize(through(view, low + 0.5 * step));
            falloff = body_falloff(away, light.right, light.up, light.lean);
        }
        if (light.kind == LIGHT_AREA) {
            falloff *= 4.0 * length(cross(light.right, light.up)) / float(light.columns * light.rows);
        }
        vec3 d = hit.xyz - view.position;
        entering = light.intensity * (falloff * omega * range_window(dot(d, d), light.range));
        // A surface directly under the light reflects light back to it.
        if (light.kind == LIGHT_AREA) {
            SeenPart part = above_horizon(light.position - hit.xyz, light.right, light.up, normal.xyz);
            entering *= min((1.0 - polygon_form_factor(part, normal.xyz)) / UNDER, 1.0);
        }
    }
    vec3 flux = hit.w > 0.0 && push.reflects != 0u ? albedo.rgb * entering : vec3(0.0);
    // Outside the cone or the range there is no light, hence no VAL. A lit black surface is one.
    bool has_light = hit.w > 0.0 && entering != vec3(0.0) && push.reflects != 0u;

    Val val;
    val.position = hit.w > 0.0 ? hit.xyz : view.position + through(view, low);
    val.area = hit.w > 0.0 ? area : 1.0;
    val.normal = hit.w > 0.0 ? normal.xyz : vec3(0.0);
    val.kind = floatBitsToUint(normal.w);
    val.flux = flux;
    float luminance = dot(flux, vec3(0.2126, 0.7152, 0.0722));
    val.weight = has_light ? (IRRADIANCE_WEIGHTS != 0u ? luminance : val.area) : 0.0;
    uint at = push.first + texel.y * push.size + texel.x;
    if (val.kind != 0u) {
        val.weight = packed_flux(has_light ? unpacked_tint(albedo.a) * entering : vec3(0.0));
    }
    vals[at] = val;
    flags[at] = val.weight != 0.0 || flux != vec3(0.0) ? 1u : 0u;
#ifdef INSIDE
    vec4 inside = texelFetch(inside_image, ivec2(texel), 0);
    val.flux = hit.w > 0.0 && inside.y > 0.0 ? entering * inside.x : vec3(0.0);
    val.area /= max(inside.z, LEAST_TILT);
    val.kind = uint(max(inside.y, 1.0)) - 1u;
    val.weight = 0.0;
    inner_vals[at] = val;
    inner_flags[at] = val.flux != vec3(0.0) ? 1u : 0u;
#endif
}
