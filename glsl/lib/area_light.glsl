// Exact contour integrals over rectangles of uniform radiance. Twin: src/reference/area_light.rs.
#ifndef AREA_LIGHT_GLSL
#define AREA_LIGHT_GLSL

#include "lib/phong.glsl"

const float TWO_PI = 6.28318530717959;

// The part of a rectangle above a point's horizon: corners relative to the point, in order.
struct SeenPart {
    vec3 corners[5];
    int count;
};

// Clips a rectangle to the half space above the plane through the point with normal n.
SeenPart above_horizon(vec3 middle, vec3 right, vec3 up, vec3 n) {
    vec3 corner[4] = vec3[4](middle - right - up, middle + right - up, middle + right + up, middle - right + up);
    SeenPart part;
    part.count = 0;
    vec3 before = corner[3];
    float before_height = dot(n, before);
    for (int i = 0; i < 4; ++i) {
        vec3 here = corner[i];
        float height = dot(n, here);
        if ((before_height > 0.0) != (height > 0.0) && part.count < 5) {
            part.corners[part.count++] = before + (here - before) * (before_height / (before_height - height));
        }
        if (height > 0.0 && part.count < 5) {
            part.corners[part.count++] = here;
        }
        before = here;
        before_height = height;
    }
    return part;
}

// Mean of a polygon's corners.
vec3 middle_of(SeenPart part) {
    vec3 sum = vec3(0.0);
    for (int i = 0; i < part.count; ++i) {
        sum += part.corners[i];
    }
    return sum / float(part.count);
}

// Direction to one of the 3 points of a polygon's triangle `i` about its middle, and the solid angle [sr] that the point
// stands for. The points of all triangles integrate over the polygon what is smooth there.
vec4 point_of_part(SeenPart part, vec3 middle, int i, int point) {
    vec3 a = part.corners[i];
    vec3 b = part.corners[i + 1 < part.count ? i + 1 : 0];
    vec3 d = (middle + a + b) / 6.0 + 0.5 * (point == 0 ? middle : point == 1 ? a : b);
    float closeness = inversesqrt(max(dot(d, d), 1e-30));
    float volume = abs(dot(middle, cross(a - middle, b - middle))); // twice the area times the height over its plane
    return vec4(d * closeness, volume / 6.0 * closeness * closeness * closeness);
}

// Part of an edge in Lambert's sum: its angle seen from the point, times the cosine between n and the normal of the plane
// of edge and point.
float lambert_edge(vec3 a, vec3 b, vec3 n) {
    vec3 across = cross(a, b);
    float size = length(across);
    return size > 0.0 ? atan(size, dot(a, b)) * dot(n, across) / size : 0.0;
}

// Form factor from a point with normal n to the visible part of a polygon: Lambert's sum over 2 pi.
float polygon_form_factor(SeenPart part, vec3 n) {
    float sum = 0.0;
    for (int i = 0; i < part.count; ++i) {
        sum += lambert_edge(part.corners[i], part.corners[i + 1 < part.count ? i + 1 : 0], n);
    }
    return abs(sum) / TWO_PI;
}

// Abscissae (positive half) and weights of the 8-point Gauss-Legendre rule on [-1, 1].
const float NODES[4] = float[4](0.183434642, 0.525532410, 0.796666477, 0.960289856);
const float NODE_WEIGHTS[4] = float[4](0.362683783, 0.313706646, 0.222381034, 0.101228536);

// Integrals of c^k along the arc from a to b (unit vectors) on the circle with axis m, where c is the cosine with r:
// over the azimuth about r, and over the arc length.
vec2 arc_integrals(vec3 a, vec3 b, vec3 m, vec3 r, float k) {
    float h = dot(m, r);
    float nearest = sqrt(max(1.0 - h * h, 0.0));
    if (k * log2(max(nearest, 1e-30)) < -16.0) {
        return vec2(0.0); // the whole circle lies outside the lobe
    }
    // Angles along the arc, measured from its closest point to r. The lobe lies within `reach` of that point.
    vec3 foot = (r - h * m) / max(nearest, 1e-6);
    vec3 onwards = cross(m, foot);
    float first = atan(dot(a, onwards), dot(a, foot));
    float last = first + atan(length(cross(a, b)), dot(a, b));
    if (first > 0.25 * TWO_PI) {
        first -= TWO_PI;
        last -= TWO_PI;
    }
    float reach = min(0.25 * TWO_PI, 4.0 * inversesqrt(max(k, 1e-6)));
    first = clamp(first, -reach, reach);
    last = clamp(last, -reach, reach);
    if (last <= first) {
        return vec2(0.0);
    }
    // Azimuth: tan = sin s / (|h| cos s).
    float size = abs(h);
    float begin = atan(sin(first), size * cos(first));
    float end = atan(sin(last), size * cos(last));
    vec2 sum = vec2(0.0);
    for (int i = 0; i < 8; ++i) {
        float x = i < 4 ? NODES[i] : -NODES[i - 4];
        float weight = NODE_WEIGHTS[i & 3];
        float azimuth = 0.5 * (begin + end + x * (end - begin));
        float along = cos(azimuth);
        float across = size * sin(azimuth);
        float c = along * nearest * inversesqrt(max(along * along + across * across, 1e-30));
        sum.x += weight * cosine_power(c, k);
        sum.y += weight * cosine_power(nearest * cos(0.5 * (first + last + x * (last - first))), k);
    }
    return 0.5 * sum * vec2((end - begin) * (h < 0.0 ? -1.0 : 1.0), last - first);
}

// Share of the normalised Phong lobe about r that a polygon fills, weighted by the cosine with n: the integral of (k +
// 2)/(2 pi) (r.w)^k (n.w) over directions w. By Gauss's theorem on the sphere, (k + 2) times the integral of (r.w)^k
// (n.w) is (r.n) (2 pi [r inside] - sum of azimuth integrals of c^k) + sum of (n.m_i) times arc integrals of c^k; Arvo
// 1995, extended to any k.
float polygon_lobe(SeenPart part, vec3 n, vec3 r, float k) {
    vec3 unit[5];
    vec3 middle = vec3(0.0);
    for (int i = 0; i < part.count; ++i) {
        unit[i] = normalize(part.corners[i]);
        middle += unit[i];
    }
    float azimuths = 0.0;
    float arcs = 0.0;
    bool inside = true;
    for (int i = 0; i < part.count; ++i) {
        vec3 a = unit[i];
        vec3 b = unit[i + 1 < part.count ? i + 1 : 0];
        vec3 across = cross(part.corners[i], part.corners[i + 1 < part.count ? i + 1 : 0]);
        if (dot(across, across) == 0.0) {
            continue;
        }
        // m points inwards; the arc runs around the polygon in the matching direction.
        vec3 m = normalize(across);
        bool turned = dot(m, middle) < 0.0;
        m = turned ? -m : m;
        vec2 integrals = turned ? arc_integrals(b, a, m, r, k) : arc_integrals(a, b, m, r, k);
        inside = inside && dot(m, r) > 0.0;
        azimuths += integrals.x;
        arcs += dot(n, m) * integrals.y;
    }
    float whole = inside && part.count > 0 ? TWO_PI : 0.0;
    return max((dot(r, n) * (whole - azimuths) + arcs) / TWO_PI, 0.0);
}

#endif
