// Stage 8, fifth: spreads the results of short rays over pixels between which indirect light cannot change much: their
// distance is small compared to that of the surfaces hit. Small bright sources are hit by few rays and would otherwise
// show as spots. Runs several times with growing steps: Dammertz et al. 2010. METHOD 11. Lobes are spread over pixels
// whose lobes look at the same place.
// variant near_spread_glossy.comp: GLOSSY (where a material has a glossy lobe)
#include "shared.glsl"
#include "lib/near_alike.glsl"
#define NEAR_BINDING 0
#define NEAR_CONSTANT 0
#include "lib/near_lights.glsl"

layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { NearSpreadPush push; };
layout(binding = 2, scalar) writeonly buffer To { NearLight to[]; };

// Facing of a pixel's surface.
Facing facing_of_light(NearLight p) {
    return facing_of(octahedral_decode(p.normal), p.geometric);
}

// Variance of a pixel's light from too few rays [lx^2]. Its light is a mean of about as many pixels as the last pass and the
// filter combined.
float variance(NearLight p) {
    return max(p.light_squared - p.light * p.light, 0.0) / float(NEAR_SIDE * NEAR_SIDE + push.step * push.step);
}

void main() {
    ivec2 at = ivec2(gl_GlobalInvocationID.xy);
    if (at.x >= int(push.width) || at.y >= int(push.height)) {
        return;
    }
    uint index = uint(at.y) * push.width + uint(at.x);
    NearLight own = near_light(index);
    NearLight sum = own;
    if (own.geometric != 0.0) {
        Facing own_facing = facing_of_light(own);
        float own_variance = variance(own);
        float weights = 1.0;
        float sky_weights = 1.0;
#ifdef GLOSSY
        float lobe_weights = 1.0;
#endif
        for (int j = 0; j < 9; ++j) {
            ivec2 offset = ivec2(j % 3, j / 3) - 1;
            ivec2 other = at + offset * int(push.step);
            if (offset == ivec2(0) || any(lessThan(other, ivec2(0))) || any(greaterThanEqual(other, ivec2(push.width, push.height)))) {
                continue;
            }
            NearLight p = near_light(uint(other.y) * push.width + uint(other.x));
            if (p.geometric == 0.0) {
                continue;
            }
            vec3 d = own.position - p.position;
            float crowding = max(own.crowding, p.crowding);
            float share = (offset.x == 0 ? 1.0 : 0.5) * (offset.y == 0 ? 1.0 : 0.5);
            share *= near_alike(d, own_facing, facing_of_light(p));
#ifdef GLOSSY
            float width = min(own.width, p.width);
            vec3 turned = own.mirrored - p.mirrored;
            float lobe_share = share * exp(-LOBE_SPREAD * lobes_apart(d, turned, max(own.nearness, p.nearness), width));
            // Lobes are not mixed if one is less than a quarter as wide as the other.
            lobe_share *= width > 0.0 ? smoothstep(0.25, 0.75, width / max(own.width, p.width)) : 0.0;
            lobe_weights += lobe_share;
            sum.glossy += lobe_share * p.glossy;
            sum.sky += lobe_share * p.sky;
#endif
            float sky_crowding = max(own.sky_crowding, p.sky_crowding);
            float sky_share = share * exp(-NEAR_SPREAD * dot(d, d) * sky_crowding * sky_crowding);
            sky_weights += sky_share;
            sum.open_sky += sky_share * p.open_sky;
            share *= exp(-NEAR_SPREAD * dot(d, d) * crowding * crowding);
            // Little is spread between bright and dark, as around the edge of an arch, if the difference is not noise.
            float stops = log2((own.light + 1e-20) / (p.light + 1e-20));
            float squared = min((own.light - p.light) * (own.light - p.light), 1e37);
            share *= exp(-stops * stops * squared / (squared + 4.0 * (own_variance + variance(p)) + 1e-37));
            sum.light += share * p.light;
            sum.light_squared += share * p.light_squared;
            weights += share;
            sum.irradiance += share * p.irradiance;
            sum.open += share * p.open;
        }
        sum.irradiance /= weights;
        sum.open /= weights;
        sum.light /= weights;
        sum.light_squared /= weights;
        sum.open_sky /= sky_weights;
#ifdef GLOSSY
        sum.glossy /= lobe_weights;
        sum.sky /= lobe_weights;
#endif
    }
    to[index] = sum;
}
