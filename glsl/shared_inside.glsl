// Structs and constants of both sides that light below surfaces needs: a part of shared.glsl, under the same rules.
#ifndef SHARED_INSIDE_GLSL
#define SHARED_INSIDE_GLSL

// Threads that sum up a cache's dipole.
const uint DIPOLE_THREADS = 64u;

// Inner VALs that a pass of brute force adds up: lavapipe ends loops at 65 535.
const uint INNER_RUN = 32768u;

// Not filled with anything.
const uint HOLLOW = 0xffffffffu;

// A part of an instance that one medium fills, and that in the dipole model, by channel.
struct Filled {
    vec3 z_r; // depth of the real source [m]
    float entering; // share of even light that enters
    vec3 z_v; // height of the virtual source [m]
    float ior;
    vec3 sigma_tr; // effective extinction [1/m]
    vec3 of_real; // what the real source sends of what enters, before its distance counts
    vec3 of_virtual;
};

// A cache of a filled part.
struct FilledCache {
    uint cache; // of the atlas
    uint filled; // which part
};

// The light inside a body as one of its caches receives it, by channel: a dipole that stands for all of it.
struct ProxyDipole {
    vec3 irradiance; // from below [lx]
    uint filled; // which part the cache is of, or HOLLOW
    vec3 place_r; // mean place of the light on the surface, from the cache [m]
    vec3 place_g;
    vec3 place_b;
    vec3 variance; // of these [m^2]
    vec3 widest; // by how much texels widen the dipole [m]
};

// Push constants of the dipole gather.
struct DipolePush {
    uint count; // caches of filled parts
};

// Push constants of adding up inner VALs at each pixel.
struct InnerPush {
    mat4 world_from_clip;
    vec4 eye; // as in DrawPush
    uint first; // inner VAL of this run
};

#endif
