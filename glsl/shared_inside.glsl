// Structs and constants for subsurface scattering, shared by shaders and Rust: part of shared.glsl, same rules.
#ifndef SHARED_INSIDE_GLSL
#define SHARED_INSIDE_GLSL

// Threads that sum one cache's dipole.
const uint DIPOLE_THREADS = 64u;

// Inner VALs summed per pass of brute force: lavapipe ends loops at 65 535.
const uint INNER_RUN = 32768u;

// Marks a surface that no medium fills.
const uint HOLLOW = 0xffffffffu;

// A part of an instance filled by one medium: parameters of the dipole model, by channel.
struct Filled {
    vec3 near; // distance of the near source from the surface [m]
    float entering; // share of uniform light that enters
    vec3 far; // distance of the far source
    float ior;
    vec3 sigma_tr; // effective extinction [1/m]
    vec3 of_near; // integral of the near source over the plane: a share of the entering light
    vec3 of_far;
    vec3 close_by; // share of the entering light that pixels reflect themselves
    vec3 from_afar; // share of the leaving light that they do not reflect
    float around; // squared radius of the surface around a point whose light it reflects itself [m^2]
};

// A cache on a filled part.
struct FilledCache {
    uint cache; // of the atlas
    uint filled; // index of the filled part
};

// Light inside a body as one of its caches receives it: a proxy dipole, by channel.
struct ProxyDipole {
    vec3 irradiance; // from below [lx]
    uint filled; // index of the cache's filled part, or HOLLOW
    vec3 place_r; // mean position of the light on the surface, relative to the cache [m]
    vec3 place_g;
    vec3 place_b;
    vec3 variance; // of these positions [m^2]
    vec3 widest; // by how much the size of texels widens the dipole [m]
    vec3 facing; // share of the light that entered on the cache's side of the body
};

// Push constants of the dipole gather.
struct DipolePush {
    uint count; // caches on filled parts
};

// Push constants of the pass that sums inner VALs at each pixel.
struct InnerPush {
    mat4 world_from_clip;
    vec4 eye; // as in DrawPush
    uint first; // first inner VAL of this pass
};

#endif
