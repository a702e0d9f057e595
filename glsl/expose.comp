// Stage 11: automatic exposure from the picture's luminance, out of a histogram. METHOD 10. Integer sums: results do not
// depend on the order of additions. Twin: automatic_ev in src/reference/tonemap.rs.
// variant expose_bins.comp: FILL (first: fills the histogram, by many workgroups)
#include "shared.glsl"

layout(local_size_x = 256) in;
layout(push_constant, scalar) uniform Push { CompositePush push; };
#ifdef FILL
layout(constant_id = 0) const uint DIFFUSE = 1;
layout(constant_id = 1) const uint GLOSSY = 1;
layout(binding = 0) uniform sampler2D direct_image;
layout(binding = 1) uniform sampler2D diffuse_image;
layout(binding = 2) uniform sampler2D glossy_image;
layout(binding = 3) uniform sampler2D depth_image;
layout(binding = 4, scalar) buffer Bins { uint bins[]; };
#else
layout(binding = 0, scalar) writeonly buffer Exposure { float ev; };
layout(binding = 1, scalar) buffer Bins { uint bins[]; }; // all 0 between frames
#endif

// Histogram of log2 luminance [cd/m^2] with bins of 1/16 stop; each bin also keeps its mean, to 1/16 of a bin.
const uint BINS = EXPOSURE_BINS;
const float LEAST = -32.0;
const float BINS_PER_STOP = 16.0;
const float PARTS = 16.0;
// Weight of a pixel at the picture's centre. Sums over 2^18 pixels still fit.
const float MOST_WEIGHT = 256.0;

#ifdef FILL
// Weights of the bins, then the sums of their parts: for pixels that show a surface, then for the others.
shared uint own[4u * BINS];

float luminance(ivec2 at) {
    vec3 c = texelFetch(direct_image, at, 0).rgb;
    if (DIFFUSE != 0u) {
        c += texelFetch(diffuse_image, at, 0).rgb;
    }
    if (GLOSSY != 0u) {
        c += texelFetch(glossy_image, at, 0).rgb;
    }
    return dot(c, vec3(0.2126, 0.7152, 0.0722));
}

void main() {
    for (uint i = gl_LocalInvocationID.x; i < 4u * BINS; i += 256u) {
        own[i] = 0u;
    }
    barrier();
    vec2 size = vec2(push.width, push.height);
    uvec2 count = (uvec2(push.width, push.height) + push.step - 1u) / push.step;
    for (uint i = gl_GlobalInvocationID.x; i < count.x * count.y; i += 256u * gl_NumWorkGroups.x) {
        ivec2 at = ivec2(i % count.x, i / count.x) * int(push.step);
        float l = luminance(at);
        if (!(l > 0.0)) {
            continue;
        }
        vec2 from_centre = (vec2(at) + 0.5) / size * 2.0 - 1.0;
        vec2 window = 1.0 - 0.75 * from_centre * from_centre;
        uint weight = uint(MOST_WEIGHT * window.x * window.y + 0.5);
        float place = clamp((log2(l) - LEAST) * BINS_PER_STOP, 0.0, float(BINS) - 0.001);
        uint bin = uint(place) + (texelFetch(depth_image, at, 0).r != 0.0 ? 0u : 2u * BINS);
        atomicAdd(own[bin], weight);
        atomicAdd(own[bin + BINS], weight * uint(fract(place) * PARTS));
    }
    barrier();
    for (uint i = gl_LocalInvocationID.x; i < 4u * BINS; i += 256u) {
        if (own[i] != 0u) {
            atomicAdd(bins[i], own[i]);
        }
    }
}
#else
shared uint weights[BINS];
shared uint parts[BINS];
shared uint total;

// Takes the bins of the pixels that show a surface, or of those that show none; returns their total weight.
uint take_bins(uint first) {
    barrier();
    if (gl_LocalInvocationID.x == 0u) {
        total = 0u;
    }
    barrier();
    uint own_total = 0u;
    for (uint bin = gl_LocalInvocationID.x; bin < BINS; bin += 256u) {
        weights[bin] = bins[first + bin];
        parts[bin] = bins[first + BINS + bin];
        own_total += weights[bin];
    }
    atomicAdd(total, own_total);
    barrier();
    return total;
}

// Mean log2 luminance of a non-empty bin.
float bin_mean(uint bin) {
    float part = (float(parts[bin]) / float(weights[bin]) + 0.5) / PARTS;
    return LEAST + (float(bin) + part) / BINS_PER_STOP;
}

// Bin that is the brightest without the brightest tenth of this weight.
uint brightest_of(uint whole) {
    uint last = BINS - 1u;
    for (uint above = weights[last]; above <= whole / 10u; above += weights[last]) {
        last -= 1u;
    }
    return last;
}

// Mean log2 luminance without the darkest and the brightest tenth. What is 16 stops darker than the rest is black. Values
// more than five stops below the brightest remaining bin are raised to that level, so that nearly black areas do not
// overexpose the picture.
float clipped_mean() {
    const uint BLACK = 16u * uint(BINS_PER_STOP);
    uint last = brightest_of(total);
    uint first = last - min(last, BLACK);
    uint lit = 0u;
    for (uint bin = first; bin < BINS; bin += 1u) {
        lit += weights[bin];
    }
    uint tail = lit / 10u;
    last = brightest_of(lit);
    float darkest = bin_mean(last) - 5.0;
    float sum = 0.0;
    uint end = 0u;
    for (uint bin = first; bin <= last; bin += 1u) {
        uint start = max(end, tail);
        end += weights[bin];
        uint counted = min(end, lit - tail);
        if (counted > start) {
            sum += float(counted - start) * max(bin_mean(bin), darkest);
        }
    }
    return sum / float(lit - 2u * tail);
}

void main() {
    if (push.automatic == 0u) {
        if (gl_LocalInvocationID.x == 0u) {
            ev = push.ev;
        }
        return;
    }
    // The background counts only if no lit surface is visible.
    bool is_lit = take_bins(0u) > 0u;
    if (!is_lit) {
        is_lit = take_bins(2u * BINS) > 0u;
    }
    for (uint i = gl_LocalInvocationID.x; i < 4u * BINS; i += 256u) {
        bins[i] = 0u;
    }
    if (gl_LocalInvocationID.x == 0u) {
        // The mean becomes middle grey: exposure is 1 / (1.2 * 2^EV), and the mean must map to 0.18.
        ev = is_lit ? clipped_mean() - log2(1.2 * 0.18) : 0.0;
    }
}
#endif
