// Structs and constants of both sides that rays need: the second part of shared.glsl, under the same rules.
#ifndef SHARED_RAYS_GLSL
#define SHARED_RAYS_GLSL

// What a triangle that rays meet is, in bits below its instance's number, or RAY_MODEL: it has holes, both its sides are surface,
// it is of an area light, its instance mirrors, which is said of triangles in the world alone.
const uint RAY_HOLES = 1u;
const uint RAY_TWO_SIDED = 2u;
const uint RAY_AREA_LIGHT = 4u;
const uint RAY_MIRRORED = 8u;
const uint RAY_KIND_BITS = 4u;

// Instead of an instance's number: of triangles in model space, which several instances may share.
const uint RAY_MODEL = 0x0fffffffu;

// The instance of everything that stands still.
const uint RAY_STILL = 0xfffffffeu;

// A node of the hierarchy about a mesh that bends.
struct RefitNode {
    uint node; // which
    uint first_vertex; // posed, of the instance
};

// A box in model space.
struct RefitBox {
    vec3 low;
    vec3 high;
};

// Push constants of the pass that fits triangles and boxes to what bends.
struct RefitPush {
    uint first; // of the list
    uint count; // nodes of one depth
    uint first_node; // of all that bends
};

// Pixels that share their short rays: a square of so many a side, each with directions of its own.
const uint NEAR_SIDE = 4u;

// A texture of a material as rays look it up: RGBA8 texels in a buffer, level after level.
struct HitTexture {
    uint first; // texel of the finest level
    uint width; // of that [texels]
    uint height; // likewise
    uint how; // wrapping along u, along v in bits 0-1 and 2-3: 0 repeats, 1 mirrors, 2 clamps; bit 4: RGB are square roots;
              // bit 5: texels stay square
};

// Directions of a cache's light: an octahedral map of the world of so many a side, and all of them.
const uint DIRECTION_SIDE = 12u;
const uint DIRECTIONS = 144u;

// A grid of a sky, by longitude and latitude.
struct SkyLevel {
    uint first; // of all texels
    uint width;
    uint height;
    float turn; // about +Y [rad]
};

// Which grid is which: irradiance by normal; the sky itself; after it what Phong lobes take of it, the first with an exponent of
// SKY_EXPONENT / 2, each next with half of the exponent before, so many of them. Caches look it up through one of these.
const uint SKY_IRRADIANCE = 0u;
const uint SKY_ITSELF = 1u;
const float SKY_EXPONENT = 4096.0;
const uint SKY_LOBES = 12u;
const uint SKY_OF_CACHES = 5u;

// What a cache sees of a sky.
struct SkySeen {
    vec3 share; // of what an open surface would receive, less what is in the way near enough for short rays
    vec3 irradiance; // of all that arrives [lx]
};

// Push constants of the pass that finds it.
struct SkySeenPush {
    uint cache_count;
    uint root; // of the hierarchy
    float reach; // where a cache's rays begin [m]
    float least; // below which light from all around says nothing of shares [lx]
};

// What the short rays of a pixel found.
struct NearPixel {
    vec3 irradiance; // of what they met [lx]
    float open; // share of them that met nothing
    vec3 far; // sum of the caches' radiance along those that met nothing [cd/m^2]
    vec3 all; // along all of them
    vec3 position; // of the surface
    uint is_surface; // 0: nothing is there
    vec3 normal; // unit vertex normal
    vec3 glossy; // mean over the lobe of what all rays bring it [cd/m^2]
    vec3 mirrored; // unit axis of the lobe
    float width; // of the lobe [rad]; 0: there is none
    float nearness; // one over the length of the lobe's ray [1/m]
    float sky; // luminance of the sky that a lobe takes [cd/m^2]
    float sky_all; // of that without anything in the way
    float crowding; // mean of one over the rays' lengths, up to what they meet or their reach [1/m]
};

// Shares fall off by e at one over the root of this, in units of the distance of what rays meet.
const float NEAR_SPREAD = 25.0;

// The same of lobes, in units of their width.
const float LOBE_SPREAD = 8.0;

// Push constants of the pass that spreads what rays found.
struct NearSpreadPush {
    uint width; // pixels with rays in a row
    uint height; // rows of them
    uint step; // from one of the pixels that are taken together to the next
};

// What the short rays around a pixel found together.
struct NearLight {
    vec3 irradiance; // of what they met [lx]
    uint is_surface; // 0: nothing is there
    vec3 open; // share of the caches' light that comes along rays that met nothing
    vec3 glossy; // what a lobe takes [cd/m^2]
    vec3 position; // of the surface
    vec3 normal; // unit vertex normal
    uint mirrored; // unit axis of the lobe, on the octahedron
    float width; // of the lobe [rad]; 0: there is none
    float nearness; // mean of one over the lengths of the lobe's rays [1/m]
    float sky; // share of the sky's light that arrives at a lobe
    float crowding; // as in NearPixel
};

// Where the caches of what rays meet are found.
struct InstanceCaches {
    uint reference_base; // first of the model's references, in pairs; NO_REFERENCES without caches
    uint cache_base; // atlas index of the instance's first cache
    uint grid; // of the model, where pixels look references up
    uint first_rest; // first vertex of the mesh as it was when caches were placed
};

// Push constants of the passes that trace rays from surfaces and caches.
struct TracePush {
    mat4 clip_from_world;
    vec4 eye; // as in DrawPush
    float cache_reach; // how far caches say something of a point [m]
    float reach; // of short rays; of a cache's rays where they begin [m]
    uint root; // of the hierarchy
    uint width; // [pixels], each with rays
    uint height;
    uint light_count;
    uint reflects; // 1: what rays meet reflects the lights
    uint first_sky_light; // the lights that stand for a sky which caches see: what rays meet has its light from these
    uint sky_light_count;
};

// Push constants of the pass that takes the rays of pixels together.
struct NearFilterPush {
    uint width; // [pixels], each with rays
    uint height;
};

// Push constants of the pass that sorts the light of caches by directions.
struct DirectionsPush {
    float near_begin; // as in GatherPush
    float near_scale;
    uint together; // VALs that are taken as one
};

// Push constants of the passes that shade pixels with what short rays have found.
struct NearPush {
    mat4 clip_from_world;
    vec4 eye; // as in DrawPush
    float reach; // as in InterpolatePush
    uint first_proxy; // of the eye
    uint width; // [pixels], each with rays
    uint height;
};

// Pixels in a row that have different points of a light; a square of them has all.
const uint LIGHT_SIDE = 4;

// Width of penumbrae up to which pixels have rays enough of their own, and from which on those of neighbours alone count [pixels].
const float PENUMBRA_NARROW = 4.0;
const float PENUMBRA_WIDE = 12.0;

const float ARRIVING_NOT = -1.0; // the light does not shine there at all
const float ARRIVING_UNKNOWN = -2.0; // it does, but the ray's point of it is below the horizon

// What of a light arrives at a pixel: for its diffuse and its glossy lobe what open rays and what all rays would give.
struct Arriving {
    vec2 open;
    vec2 all;
    float penumbra; // width of the widest that a ray has met [pixels]; -1 where all about it say what the first ray says
    float width; // of the penumbra that the first ray has met [pixels]
    float first; // of the first ray: 1 where it is open, 0 where something is in its way, ARRIVING_...
};

// Push constants of the pass that traces rays to a light.
struct LightRaysPush {
    mat4 world_from_clip;
    vec4 eye; // as in DrawPush
    uint light;
    uint root;
    uint is_first; // one ray a pixel; then more where those of neighbours differ
    uint is_second; // of pixels' second surfaces, which show beside the pixel's middle
};

#endif
