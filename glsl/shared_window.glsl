// Structs and constants for the window, shared by shaders and Rust: part of shared.glsl, same rules.
#ifndef SHARED_WINDOW_GLSL
#define SHARED_WINDOW_GLSL

// Push constants of the window's panels.
struct UiPush {
    vec2 scale; // from points to clip space
};

// Push constants of a debug view of one layer, or of a part of another image.
struct LayerPush {
    uint how; // one of LAYER_*
    uint tonemap;
    uint left; // corner of the view in the window [pixels]
    uint top;
    uint first_column; // of the image's shown part [texels]
    uint first_row;
    float texels; // per pixel; the texel at a pixel's centre is shown
    uint parts; // number of images to sum, 1 to 3
    float low; // values at the two ends of the false-colour scale
    float high;
    vec4 depth; // (x + y d) / (z + w d) is the distance [m] that the image's value d stands for
};

const uint LAYER_RADIANCE = 0u; // exposed and tone-mapped like the picture
const uint LAYER_REFLECTANCE = 1u; // neither exposed nor tone-mapped
const uint LAYER_DIRECTION = 2u; // -1 is dark, 1 bright
const uint LAYER_COLOR = 3u; // a display colour
const uint LAYER_LUMINANCE = 4u; // in false colours
const uint LAYER_DEPTH = 5u; // likewise, for depths
const uint LAYER_BROKEN = 6u; // grey, except for values that no radiance can have

// Push constants of marks over the picture: caches and VALs as discs, proxy lights as lines.
struct MarkPush {
    mat4 clip_from_world;
    vec4 eye; // position and 1, or direction towards the viewer and 0
    float size; // radius of a disc, or length of a line, in radii of the cache's or VAL's area
    float pixel; // size of a pixel at a clip-space w of 1 [m]
    uint how; // one of MARK_*
    uint live; // 1: only live caches
    uint tonemap;
    uint left; // corner of the picture in the window [pixels]
    uint top;
};

const uint MARK_HUE = 0u; // caches in arbitrary colours
const uint MARK_DARK = 1u; // caches in dark grey
const uint MARK_LIGHT = 2u; // caches by their diffuse light, exposed and tone-mapped like the picture
const uint MARK_RIMMED = 3u; // VALs and lines in the hue of their light, with a black rim or beginning

// Push constants of the search for the cache nearest to a pixel's surface.
struct NearestPush {
    mat4 world_from_clip;
    uint column; // of the pixel
    uint row;
    uint are_planes; // 1: the depth images are traced
};

// The cache nearest to a pixel's surface, of those that light its side.
struct NearestCache {
    uint number; // in the atlas, from 1; 0 without a surface or such a cache
    vec3 position;
    vec3 normal;
    float distance; // from the pixel's surface [m]
};

// Push constants of the list of a pixel's caches.
struct PixelPush {
    mat4 clip_from_world;
    vec4 eye; // position and 1, or direction towards the viewer and 0
    float reach; // distance of the farthest cache that a pixel averages [m]
    uint references; // per vertex or cell
    uint printed; // 1: weights of the thesis
    uint column; // of the pixel
    uint row;
};

// A cache whose light a pixel averages.
struct PixelCache {
    uint number; // in the atlas, from 1; 0: unused entry
    float weight; // of all caches' together
    vec3 irradiance; // from its diffuse proxy light, on a plane that faces it, times the weight [lx]
    vec3 position;
    vec3 normal;
};

#endif
