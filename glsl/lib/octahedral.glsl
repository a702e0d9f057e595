// Octahedral encoding of unit vectors.
#ifndef OCTAHEDRAL_GLSL
#define OCTAHEDRAL_GLSL

vec2 octahedral_encode(vec3 n) {
    n /= abs(n.x) + abs(n.y) + abs(n.z);
    vec2 folded = (1.0 - abs(n.yx)) * vec2(n.x >= 0.0 ? 1.0 : -1.0, n.y >= 0.0 ? 1.0 : -1.0);
    return n.z >= 0.0 ? n.xy : folded;
}

vec3 octahedral_decode(vec2 e) {
    vec3 n = vec3(e, 1.0 - abs(e.x) - abs(e.y));
    float t = max(-n.z, 0.0);
    n.x += n.x >= 0.0 ? -t : t;
    n.y += n.y >= 0.0 ? -t : t;
    return normalize(n);
}

// A unit vector in the 24 bits that a float holds exactly.
float coded_normal(vec3 n) {
    vec2 bits = round(octahedral_encode(n) * 2047.0 + 2048.0);
    return bits.x + 4096.0 * bits.y;
}

vec3 decoded_normal(float code) {
    uint bits = uint(code);
    return octahedral_decode((vec2(bits & 4095u, bits >> 12) - 2048.0) / 2047.0);
}

#endif
