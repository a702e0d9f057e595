// Structs and constants for rays, shared by shaders and Rust: part of shared.glsl, same rules.
#ifndef SHARED_RAYS_GLSL
#define SHARED_RAYS_GLSL

// Flags of a ray tracing triangle, stored in the bits below its instance number (or RAY_MODEL): it has an alpha mask,
// it is two-sided, it belongs to an area light, its instance mirrors, it is one of the two sides of a surface in a mesh
// that bends, it also stands for the second side of its surface, whose indices follow its own. The fourth flag is set
// only for triangles in world space.
const uint RAY_HOLES = 1u;
const uint RAY_TWO_SIDED = 2u;
const uint RAY_AREA_LIGHT = 4u;
const uint RAY_MIRRORED = 8u;
const uint RAY_ONE_SIDE = 16u;
const uint RAY_TWIN = 32u;
const uint RAY_KIND_BITS = 6u;

// In place of an instance number: the triangle is in model space and several instances may share it.
const uint RAY_MODEL = 0x03ffffffu;

// Instance number of all static geometry.
const uint RAY_STILL = 0xfffffffeu;

// A node of a deforming mesh's hierarchy.
struct RefitNode {
    uint node; // index of the node
    uint first_vertex; // first posed vertex of the instance
};

// A box in model space.
struct RefitBox {
    vec3 low;
    vec3 high;
};

// Push constants of the pass that refits triangles and boxes of deforming meshes.
struct RefitPush {
    uint first; // first entry of the list
    uint count; // number of nodes, all of one depth
    uint first_node; // first node of all deforming meshes
};

// Side of the square of pixels that share a set of short rays, each pixel with its own directions.
const uint NEAR_SIDE = 4u;

// A material's texture as rays look it up: RGBA8 texels in a buffer, level after level.
struct HitTexture {
    uint first; // index of the list of the levels' first texels, the finest first
    uint width; // of the finest level [texels]
    uint height; // likewise
    uint how; // bits 0-1, 2-3: wrapping along u, v (0 repeats, 1 mirrors, 2 clamps); bit 4: RGB are square roots;
              // bit 5: texels stay square
};

// Side of the octahedral map of the world that holds a cache's light by direction, and its number of directions.
const uint DIRECTION_SIDE = 12u;
const uint DIRECTIONS = 144u;

// Parts of equal illuminance into which a cache's light is divided, in the order of directions. Guided rays follow them.
const uint GUIDES = 32u;

// What guides the rays of pixels, per cache: a word per direction, then the directions of all parts, a byte each. A
// direction's word is a float, the greatest luminance of it and its neighbours [cd/m^2]; its low 8 bits are the
// direction's number of parts instead.
const uint GUIDE_WORDS = 152u;

// Direction of a part of a cache without light.
const uint NO_DIRECTION = 255u;

// A latitude-longitude grid of a sky.
struct SkyLevel {
    uint first; // into all texels
    uint width;
    uint height;
    float turn; // rotation about +Y [rad]
};

// Indices of the grids: irradiance by normal, the sky itself, then the sky filtered by Phong lobes. The first lobe has
// the exponent SKY_EXPONENT / 2 and each further one half of the previous, SKY_LOBES in all. Caches look the sky up in
// grid SKY_OF_CACHES.
const uint SKY_IRRADIANCE = 0u;
const uint SKY_ITSELF = 1u;
const float SKY_EXPONENT = 4096.0;
const uint SKY_LOBES = 12u;
const uint SKY_OF_CACHES = 5u;

// Sky light at a cache.
struct SkySeen {
    vec3 share; // relative to an open surface, without occluders near enough for short rays
    vec3 irradiance; // of all sky light that arrives [lx]
};

// Push constants of the pass that computes `SkySeen`.
struct SkySeenPush {
    uint cache_count;
    uint root; // of the hierarchy
    float reach; // distance at which a cache's rays start [m]
    float least; // irradiance of the unoccluded sky below which light does not define the share [lx]
};

// Rays of a pixel's lobe, at most.
const uint LOBE_RAYS = 4u;

// A short ray: where it starts and what it hits. Passes hand it on.
struct NearRay {
    vec3 start; // [m]; near_hits.comp replaces it by the radiance that the ray brings [cd/m^2]
    float spread; // width of the ray's cone by distance; negative for a ray without end; 0: the pixel does not trace it
    vec3 direction; // unit
    float distance; // of the hit [m]
    vec2 weights; // of the hit triangle's second and third corner
    uint triangle; // as in Hit
    uint instance;
};

// Result of the short rays of one pixel.
struct NearPixel {
    vec3 irradiance; // from the surfaces hit [lx]
    float open; // share of the rays about the normal that hit nothing
    vec3 far; // irradiance by the caches' radiance along the rays that hit nothing and on which caches agree [lx]
    float geometric; // unit normal of the triangle, as of coded_normal; 0: the pixel shows no surface
    vec3 all; // irradiance by the caches' radiance along all rays [lx]
    float crowding; // mean reciprocal length of the rays about the normal, up to their hit or one cache spacing [1/m]
    vec3 position; // of the surface
    float nearness; // reciprocal length of the lobe's ray [1/m]
    vec3 normal; // unit vertex normal
    float width; // of the lobe [rad]; 0: no lobe
    vec3 glossy; // mean radiance that all rays bring to the lobe [cd/m^2]
    float sky; // luminance of the sky that the lobe receives [cd/m^2]
    vec3 mirrored; // unit axis of the lobe
    float sky_all; // as `sky`, without occlusion
    vec3 open_sky; // irradiance by the sky along the rays that reach it [lx]
    vec3 all_sky; // as `open_sky`, along all rays
    vec2 hidden_sky; // luminance of the sky behind surfaces hit [cd/m^2], and its sum over their distance [cd/m^3]
};

// Spreading weight of diffuse results: e^-1 at 1 / sqrt of this, in units of the distance of the surfaces hit.
const float NEAR_SPREAD = 25.0;

// The same for lobes, in units of their width.
const float LOBE_SPREAD = 8.0;

// Push constants of the pass that spreads the results of short rays.
struct NearSpreadPush {
    uint width; // pixels with rays per row
    uint height; // rows of pixels with rays
    uint step; // distance between the pixels that are combined
};

// Filtered result of the short rays around one pixel.
struct NearLight {
    vec3 irradiance; // from the surfaces hit [lx]
    float geometric; // unit normal of the triangle, as of coded_normal; 0: the pixel shows no surface
    vec3 open; // share of the caches' light along rays that hit nothing
    float sky; // share of the sky's light that reaches the lobe
    vec3 glossy; // radiance that the lobe receives [cd/m^2]
    float width; // of the lobe [rad]; 0: no lobe
    vec3 position; // of the surface
    float nearness; // mean reciprocal length of the lobe's rays [1/m]
    vec2 normal; // unit vertex normal, as of octahedral_encode
    float crowding; // as in NearPixel
    float light_squared; // mean square of single pixels' light [lx^2]
    vec3 mirrored; // unit axis of the lobe
    vec3 open_sky; // share of the sky's light along the rays that reach it
    float sky_crowding; // mean reciprocal distance of what hides the sky [1/m]
    float light; // luminance of the irradiance from surfaces hit and from caches along other rays [lx]
};

// Where to find the caches of a surface that a ray hits.
struct InstanceCaches {
    uint reference_base; // first of the model's references, in pairs; NO_REFERENCES if it has no caches
    uint cache_base; // atlas index of the instance's first cache
    uint grid; // of the model, for the references of points
    uint first_rest; // first vertex of the mesh as it was when caches were placed
};

// Push constants of the pass that traces caches' depth images.
struct TraceImagesPush {
    float reach; // distance at which rays start [m]
    float cache_reach; // distance up to which caches count at a point [m]
    float seen_lift; // of both ends of a ray between a hit and a cache [m]
    uint root; // of the hierarchy
};

// Push constants of the passes that trace short rays and add up what they bring.
struct NearRaysPush {
    mat4 clip_from_world;
    vec4 eye; // as in DrawPush
    float cache_reach; // distance up to which caches count at a point [m]
    float reach; // length of the rays [m]
    uint root; // of the hierarchy
    uint width; // pixels with rays per row
    uint height;
    uint every; // distance between them, in columns and rows
    uint first_group; // of all workgroups of the picture; this dispatch's first
    float turn; // of all directions about normals [rad]
};

// Push constants of the pass that lights what short rays hit.
struct NearHitsPush {
    float cache_reach; // distance up to which caches count at a point [m]
    float seen_lift; // of both ends of a ray between a hit and a cache [m]
    uint root; // of the hierarchy
    uint rays; // per pixel, without guided ones and those of its lobe
    uint guided; // rays per pixel, without those of its lobe
    uint slots; // rays that a pixel may have
    uint light_count;
    uint reflects; // 1: hit surfaces reflect the lights
    uint first_sky_light; // first light that stands for a sky; hit surfaces get that light from caches instead
    uint sky_light_count;
    float turn; // as in NearRaysPush
};

// Push constants of the pass that follows rays through bodies of glass.
struct RefractPush {
    mat4 world_from_clip;
    vec4 eye; // as in DrawPush
    uint root; // of the hierarchy
    uint light_count;
    uint first_sky_light; // first light that stands for a sky; surfaces get that light from caches instead
    uint sky_light_count;
    float cache_reach; // distance up to which caches count at a point [m]
    float seen_lift; // of both ends of a ray between a surface and a cache [m]
    uint sky_width; // of the grid of the sky that shows; 0: none does
    uint sky_height;
    float sky_turn; // rotation about +Y [rad]
};

// VALs per row of the dispatch that traces an area light's VALs.
const uint AREA_VALS_ROW = 65536u;

// Push constants of the pass that traces an area light's VALs.
struct AreaValsPush {
    uint light;
    uint first; // first VAL of the light
    uint count;
    uint root; // of the hierarchy
    float close; // a surface nearer to the light than this [m] is as good as covered by it
};

// Rays per cache that find out whether it is hidden.
const uint HIDDEN_RAYS = 32u;

// Push constants of the pass that finds hidden caches.
struct HiddenPush {
    uint cache_count;
    uint root; // of the hierarchy
    float gap; // distance below which a surface closes a gap [m]
};

// Push constants of the pass that combines the rays of neighbouring pixels.
struct NearFilterPush {
    uint width; // pixels with rays per row
    uint height;
};

// Push constants of the pass that sorts the light of caches by direction.
struct DirectionsPush {
    float near_begin; // as in GatherPush
    float near_scale;
    uint together; // consecutive VALs merged into one
};

// Push constants of passes that shade pixels with the results of short rays.
struct NearPush {
    mat4 clip_from_world;
    vec4 eye; // as in DrawPush
    float reach; // as in InterpolatePush
    uint first_proxy; // first proxy of the eye
    uint width; // pixels with rays per row
    uint height;
    uint every; // distance between them, in columns and rows
};

// Pixels per row with different points of a light; a square of this side covers all points.
const uint LIGHT_SIDE = 4;

// Side of the square of pixels whose first rays go to different points of a light.
const uint LIGHT_FIRST_SIDE = 8;

// Penumbra widths [pixels]: up to the first a pixel's own rays suffice, from the second on only the neighbourhood's
// mean counts.
const float PENUMBRA_NARROW = 4.0;
const float PENUMBRA_WIDE = 12.0;

// First ray of a pixel to a light: the width of the penumbra that it met [pixels] if it was blocked, else one of these.
const float FIRST_NOT = -1.0; // the light does not reach the pixel at all, or the pixel has no surface
const float FIRST_UNKNOWN = -2.0; // the light shines there, but the ray's point on it is below the horizon
const float FIRST_OPEN = -3.0;

// Light that arrives at a pixel: sums over open rays and over all rays, for the diffuse and the glossy lobe.
struct Arriving {
    vec2 open;
    vec2 all;
    float penumbra; // largest penumbra width met by a ray [pixels]; -1 if all first rays around agree with the pixel's
};

// Groups per row of an indirect dispatch. Devices allow at least 65535 rows: enough for 2^28 pixels.
const uint WORK_ROW = 64;

// A list of tiles of 8 x 8 pixels, or of pixels, as arguments of indirect calls.
struct LightWork {
    uint groups_x; // one per tile or per 64 pixels, in rows of WORK_ROW
    uint groups_y;
    uint groups_z;
    uint vertices; // of a tile's two triangles
    uint count; // of tiles or pixels; instances of a draw
    uint first_vertex;
    uint first_instance;
};

// Push constants of the passes that trace rays to a light.
struct LightRaysPush {
    mat4 world_from_clip;
    vec4 eye; // as in DrawPush
    uint light;
    uint root;
    uint is_second; // 1: for the pixels' second surfaces, which show away from the pixel's centre
};

#endif
