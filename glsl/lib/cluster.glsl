// Conservative bounds on the light that a pyramid node gives a cache, for any arrangement of its VALs. METHOD 9. Twin:
// `Node` in src/reference.
#ifndef CLUSTER_GLSL
#define CLUSTER_GLSL

// Bounds of a node, as the traversal needs them. The caller has the offset from cache to node.
struct Bounds {
    vec3 normal;
    float radius;
    float thickness;
    float spread;
};

// Smallest cosine that counts as lit, as in the twin: VALs and caches on one wall do not see each other.
const float CLUSTER_RIM = 1e-5;

// Upper bounds of the VALs' extent along the cache's normal, and along their own normals towards the cache.
vec2 cluster_reach(Bounds b, vec3 offset, float distance, vec3 normal) {
    float across = b.thickness * abs(dot(b.normal, normal)) + b.radius * length(cross(b.normal, normal));
    return vec2(dot(normal, offset) + across,
                -dot(b.normal, offset) + b.thickness + b.spread * (distance + b.radius));
}

// Whether no VAL can light the cache: all lie below its horizon, or all face away.
bool is_dark(vec2 reach, float distance) {
    return min(reach.x, reach.y) <= CLUSTER_RIM * distance;
}

// Upper bound of the irradiance from a flux.
float brightest(vec2 reach, float distance, float radius, float flux) {
    float nearest = distance - radius;
    if (nearest <= 0.0) {
        return 3.4e38;
    }
    vec2 cosines = clamp(reach / nearest, 0.0, 1.0);
    return flux * cosines.x * cosines.y / (3.14159265358979 * nearest * nearest);
}

#endif
