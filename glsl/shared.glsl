// Structs and constants of both sides. build.rs turns this file into Rust: one member or constant a line.
// Layout is `scalar`: no padding. Positions are relative to the scene's origin, which the host chooses near the scene.
#ifndef SHARED_GLSL
#define SHARED_GLSL

// Most columns of blocks in the images that the fragment path sums in (see lib/atlas.glsl).
const uint ATLAS_COLUMNS = 128u;

// Caches of a texel there: what is read of a VAL serves as many.
const uint TEXEL_CACHES = 2u;

// VALs are padded with dark ones to a multiple of this: 12 KiB, within the 16 KiB of uniform buffer that every device has.
const uint VAL_TILE = 256u;

// Items that a workgroup of the compacting passes looks at, and threads that do it.
const uint PACK_BLOCK = 1024u;
const uint PACK_THREADS = 64u;

// Where the gather's shaders read VALs from.
const uint VALS_TEXELS = 0u;
const uint VALS_STORAGE = 1u;
const uint VALS_SHARED = 2u;

// Consecutive caches of the atlas that stage 7 skips together.
const uint OCCLUDER_GROUP = 32u;

// Caches that a workgroup of stage 7 dims, and threads that share the discs for each.
const uint OCCLUDE_RECEIVERS = 8u;
const uint OCCLUDE_PARTS = 8u;

// Threads of a gather's workgroup.
const uint GATHER_THREADS = 64u;

// Caches that walk down the pyramids together: consecutive ones of the atlas.
const uint CLUSTER_GROUP = 32u;

// Rules of clustering.
const uint CLUSTER_DISTANCE = 0u;
const uint CLUSTER_BOUND = 1u;

// 32-bit words of a `ClusterNode`, whole texels, and where its `skip` is.
const uint CLUSTER_NODE_WORDS = 20u;
const uint CLUSTER_SKIP_WORD = 14u;

// Texels of a side of a cache's depth image, of the image, and workgroups in a row of the dispatch that draws them.
const uint DEPTH_IMAGE_SIDE = 24u;
const uint DEPTH_IMAGE_TEXELS = 576u;
const uint DEPTH_IMAGE_ROW = 65535u;

// No model has caches here.
const uint NO_REFERENCES = 0xffffffffu;

// Depth where a pixel has no second surface.
const float NO_SURFACE = -1.0;

// Marks an unused entry of a list of references.
const uint NO_CACHE = 65535u;

// What the caches' VALs of a further bounce carry: their areas, which the sums of form factors are made of; the light of the
// primary lights' VALs; that and the light of the bounce before; what the last gather alone has brought, of surfaces that emit.
const uint BOUNCE_AREAS = 0u;
const uint BOUNCE_FIRST = 1u;
const uint BOUNCE_AGAIN = 2u;
const uint BOUNCE_EMITTED = 3u;

// Kinds of light.
const uint LIGHT_DIRECTIONAL = 0u;
const uint LIGHT_POINT = 1u;
const uint LIGHT_SPOT = 2u;
const uint LIGHT_AREA = 3u;

// Faces of a cube that each sample of an area light looks through: all but the one behind.
const uint AREA_VIEWS = 5u;

// What the check for broken values looks at, and workgroups that share each.
const uint CHECK_DIRECT = 0u;
const uint CHECK_DIFFUSE = 1u;
const uint CHECK_GLOSSY = 2u;
const uint CHECK_VALS = 3u;
const uint CHECK_PROXIES = 4u;
const uint CHECK_TARGETS = 5u;
const uint CHECK_GROUPS = 64u;

// Kernel of the arithmetic peak: steps of each chain (lavapipe ends loops at 65 535), and chains of each invocation.
const uint PEAK_STEPS = 16384u;
const uint PEAK_CHAINS = 12u;

// Words of a vertex as draws read it; position, normal and tangent are the first ten.
const uint VERTEX_WORDS = 15u;

// Has no posed vertices.
const uint RIGID = 0xffffffffu;

// Workgroups in a row of the dispatches that pose meshes.
const uint DEFORM_ROW = 32768u;

// A mesh in the world.
struct Instance {
    mat4 world_from_model;
    mat4 world_from_normal; // inverse transpose of the linear part, up to a factor
    float growth; // most that lengths are of what they were when caches were placed
    float area_scale; // that factor, against the one the caches were placed with; 0 of a hidden instance
    uint first_index; // of its mesh, among all indices
    uint first_vertex; // of its posed vertices, among all; RIGID where it does not bend
    uint drawn_vertex; // first of the vertices that are drawn
};

// A vertex of a mesh that bends, before morphing and skinning.
struct BindVertex {
    vec3 position;
    vec3 normal;
    vec4 tangent;
    uint first_influence; // of all influences
    uint influence_count; // 0: the mesh has no skin
};

// How strongly a joint moves a vertex.
struct Influence {
    uint joint; // of the skin
    float weight;
};

// What a morph target of weight 1 adds to a vertex.
struct Displacement {
    vec3 position;
    vec3 normal;
    vec3 tangent;
};

// A vertex that goes with a triangle of others.
struct Follower {
    uint vertex; // of the mesh
    uint a; // corners: vertices of the mesh
    uint b;
    uint c;
    vec2 weights; // of b and c
    uint is_flat; // 1: the normal is the triangle's, and there is no tangent
};

// A joint's matrix from bind to model space, row by row.
struct Joint {
    vec4 x;
    vec4 y;
    vec4 z;
};

// An instance of a mesh that bends.
struct Body {
    uint first_bind; // of all bind vertices
    uint bind_count;
    uint first_vertex; // of all vertices: where the posed ones are
    uint first_follower;
    uint follower_count;
    uint first_displacement; // target by target, `bind_count` of each
    uint target_count;
    uint first_joint;
    uint first_weight; // of the morph targets'
};

// What a workgroup of the posing passes does: up to 64 vertices, or followers, of a body.
struct BodyBlock {
    uint body;
    uint first;
};

// A punctual light, KHR_lights_punctual, or a rectangle of a surface that emits.
struct Light {
    vec3 position; // of a rectangle its middle
    uint kind;
    vec3 direction; // unit, in which it shines
    float range; // [m]; 0: infinite
    vec3 intensity; // [cd]; of a directional light [lx]; of a rectangle its radiance [cd/m^2]
    float cone_scale; // the extension's lightAngleScale
    float cone_offset; // the extension's lightAngleOffset
    uint first_view;
    uint view_count; // 1, or 6 faces in the order +x -x +y -y +z -z; of a rectangle the first 5 for each sample
    vec3 right; // of a rectangle from its middle to an edge [m]
    vec3 up; // likewise, square to that
    uint columns; // of its samples, along `right`
    uint rows; // likewise
    float radius; // of a ball that shines [m]; of directional light the tangent of its half angle
};

// One frustum of a light, for its shadow map and its RSM.
struct LightView {
    mat4 clip_from_world;
    vec3 right; // to the right edge of the picture at distance 1, or [m] of a directional light
    vec3 up; // likewise
    vec3 forward; // unit
    vec3 position; // that it is seen from; of parallel light nothing
};

// A virtual area light: one RSM texel, a homogeneous diffuse disc.
struct Val {
    vec3 position;
    float area; // [m^2], eq. 5.10
    vec3 normal; // unit, on the side that faces the light
    uint material;
    vec3 flux; // reflected, [lm]
    float weight; // its pull on the proxy's position before the geometry factor; 0 where the texel hit nothing
};

// The VALs of a square block of texels, together as one. Nodes lie depth first, view after view: one that is used, or
// holds nothing, is followed by `skip`, any other by the next. The finest hold 2 x 2 VALs, which are no nodes themselves.
struct ClusterNode {
    vec3 position; // mean by weight
    float radius; // of a sphere about it that holds all VALs; d_val of the thesis
    vec3 normal; // mean by weight, unit
    float thickness; // farthest VAL from the plane square to the normal through the position
    vec3 flux; // sum [lm]
    float area; // mean by weight [m^2]
    float weight; // sum; 0 where no VAL is alive
    float spread; // farthest normal of a VAL from the node's, as points on the unit sphere
    uint skip; // the node after all that are below
    uint first; // of a finest node: its first VAL
    uint row; // likewise: from it to the VAL in the next row
    uint alive; // likewise: which of the four are alive, in bits, row by row; 0 of all other nodes
    uint unused; // texels are whole
    uint unused_too;
};

// Where the VALs and nodes of one RSM lie.
struct ClusterView {
    uint first_val;
    uint size; // [texels] of its side
    uint first_node;
    uint levels; // above the VALs
};

// A cache as it was baked, in model space. Its area counts [m^2] where the instance's normal matrix keeps the normal's length.
// Where the model bends, it is a point on a triangle: `position` is the weights of the triangle's second and third corner
// and the number of the triangle, `area` a share of the triangle's, `middle` (from the cache) and `axis` are combinations of
// the triangle's two edges from its first corner and of its normal, and `normal` says nothing.
struct ModelCache {
    vec3 position;
    float exponent;
    vec3 normal;
    float area;
    vec3 middle; // of the rectangle that stands for its share of the surface when it is in the way of light
    float breadth; // product of the rectangle's half sides, over the area
    vec3 axis; // from the middle to an edge, square to the normal
    uint instance;
};

// A cache in the world: four texels of four values.
struct Cache {
    vec3 position;
    float exponent; // Phong exponent of its material
    vec3 normal;
    float area; // [m^2]
    vec3 middle; // of the rectangle that stands for its share of the surface when it is in the way of light
    float breadth; // half of it across its axis [m]
    vec3 axis; // from the middle to an edge [m], square to the normal
    float radius; // of the circle of its area [m]
};

// Both proxy lights of a cache: per lobe the facing irradiance I = E / (N.w) [lx] and where it comes from.
struct Proxy {
    vec3 diffuse_position;
    float diffuse_distance2; // mean squared distance of the VALs [m^2]; 0 where none reaches the lobe
    vec3 diffuse_irradiance;
    float glossy_distance2; // likewise; 1 where it is lit and nobody asks how far from
    vec3 glossy_position;
    vec3 glossy_irradiance;
};

// A draw, as those read it who look up a visible triangle.
struct DrawRecord {
    uint first_index; // into all indices
    uint first_vertex; // of the mesh, or of the instance where it bends, into all vertices
    uint first_slot; // of the instance, into the slots of all instances' vertices, or cells
    uint instance;
    uint reference_base; // first of the model's references, in pairs; NO_REFERENCES without caches
    uint cache_base; // atlas index of the instance's first cache
    uint grid; // of the model, where pixels look references up
    uint first_rest; // of the mesh, into all vertices: as it was when caches were placed
};

// Cells of a model: from a point in model space to where its references are.
struct CellGrid {
    mat4 cell_from_offset; // of a point from `centre`; a cell's side is 1
    vec3 centre; // of the model
    uint first_entry; // into the entries of all models
    uint entry_mask; // their number, a power of two, less 1
};

// A cell in a hash table, in the first free place from its own on.
struct CellEntry {
    uint xy; // 16 bits each
    uint z;
    uint row; // of references of the model; NO_REFERENCES where the place is free
};

// A vertex in model space, as stage 8 reads it.
struct Corner {
    vec3 position;
    vec3 normal;
};

// A corner of a visible triangle, or a cell that is seen.
struct VisibleVertex {
    uint draw;
    uint vertex; // of the mesh; of a cell the row of references
};

// How many visible vertices, or cells, there are, and a dispatch over them.
struct VisibleArgs {
    uint count;
    uint groups_x;
    uint groups_y;
    uint groups_z;
};

// What the caches of a vertex make together: a light of each lobe.
struct VertexLight {
    vec3 position; // of the vertex, in the world
    vec3 diffuse_position;
    vec3 diffuse_irradiance; // facing irradiance; by the thesis's scheme flux / (4 pi)
    vec3 glossy_position;
    vec3 glossy_irradiance;
};

// Live caches, or groups of them with clusters, as arguments of the gather's dispatch and as their number.
struct LiveArgs {
    uint groups_x;
    uint groups_y; // parts that the VALs, or the nodes over them, are split into
    uint groups_z;
    uint cache_count;
    uint images_x; // workgroups of one cache each, of the pass that draws depth images
    uint images_y;
    uint images_z;
};

// Consecutive caches of the atlas as discs: what bounds the squares of all of them.
struct OccluderGroup {
    vec3 position; // middle of their bounds
    float radius; // of a sphere about it that holds their positions
    float area; // largest [m^2]
    float reach; // of a sphere about it that holds their rectangles
};

// Sums over VALs at one cache, relative to its position.
struct GatherSums {
    vec3 diffuse_position; // sum of w d
    float diffuse_weight; // sum of w
    vec3 diffuse_irradiance; // sum of phi G [lx]
    float distance2; // sum of w d^2
    vec3 glossy_position; // the same times cos^k
    float glossy_weight;
    vec3 glossy_irradiance;
    float glossy_distance2; // only with shadows of proxies
};

// The glossy part of GatherSums, for a second eye.
struct GlossySums {
    vec3 position;
    float weight;
    vec3 irradiance;
    float distance2;
};

// Push constants of everything that draws the scene's triangles.
struct DrawPush {
    mat4 clip_from_world;
    uint instance;
    uint material;
    uint draw; // which, from 1
    uint first_triangle; // of it, where only a part of it is drawn
    vec4 eye; // the viewer: position and 1, or the unit direction towards it and 0
};

// Push constants of full-screen passes that need the world position of a pixel.
struct ScreenPush {
    mat4 world_from_clip;
    vec4 eye; // as in DrawPush
    uint light;
    uint shadow_size; // [texels] of one view of the shadow map
    uint first_val; // of this tile
};

// Push constants of the pass that shades by an area light.
struct AreaPush {
    mat4 world_from_clip;
    vec4 eye; // as in DrawPush
    uint light;
    uint face_size; // [texels] of one face of a sample's shadow map
    uint columns; // samples that lie side by side in the shadow map, three faces each
};

// Push constants of the pass that draws the sky.
struct SkyPush {
    mat4 world_from_clip;
    vec4 eye; // as in DrawPush
    uint width; // of its grid
    uint height;
    float turn; // about +Y [rad]
};

// Codes of 4 bits a point of a pixel: what it shows.
const uint SHOWS_FIRST = 0u; // the pixel's first surface
const uint SHOWS_SECOND = 1u;
const uint SHOWS_AROUND = 2u; // to 9: the first of one of the 3 x 3 pixels around, row by row without the middle
const uint SHOWS_ANOTHER = 15u; // none of these

// Push constants of the pass that takes in one more sample of every pixel.
struct EdgesPush {
    mat4 world_from_clip;
    vec2 offset; // of the sample from the pixel's middle [pixels]
    uint point; // which one, from 0
};

// Push constants of the pass that makes VALs of RSM texels.
struct ValPush {
    uint light;
    uint view;
    uint size; // [texels] of the RSM's side
    uint first; // where its VALs begin
};

// Push constants of the pass that finds visible vertices.
struct VisiblePush {
    uint frame; // its number, never 0
};

// Push constants of the pass that finds visible cells.
struct VisibleCellsPush {
    mat4 clip_from_world;
    uint frame; // its number, never 0
};

// Push constants of the pass that averages the lights of vertices.
struct AveragePush {
    vec4 eye; // as in DrawPush
    uint first_proxy; // of the eye
};

// Push constants of the passes that shade pixels.
struct InterpolatePush {
    mat4 clip_from_world;
    vec4 eye; // as in DrawPush
    float reach; // distance of the farthest cache that a pixel refers to, where it does so itself
    uint first_proxy; // of the eye
};

// Push constants of the pass that draws references into the atlas.
struct AtlasPush {
    uint columns; // of blocks
    uint rows; // of texels
};

// Push constants of posing meshes.
struct DeformPush {
    uint block_count;
};

// Push constants of placing the caches.
struct PlacePush {
    uint cache_count;
};

// Push constants of the pass that builds a level of the pyramids.
struct PyramidPush {
    uint level; // 1 is over the VALs
};

// Push constants of the gather.
struct GatherPush {
    uint cache_count;
    uint first; // VAL of this tile
    uint tile; // VALs in it
    uint split; // VALs that one thread of the compute path adds up
    uint columns; // of blocks of the fragment path's images
    uint cache_parts; // parts before the primary lights': what caches send to caches
    uint first_proxy; // of the eye
    uint second_proxy; // first one of the second eye
    vec4 eye; // as in DrawPush
    vec4 second_eye; // where two are gathered for at once
    float near_begin; // square of the distance within which VALs are left to short rays [m^2]
    float near_scale; // of what is beyond it, up to 1
};

// Push constants of the pass that makes VALs of lit caches.
struct BouncePush {
    uint cache_count;
    uint cache_parts; // as in GatherPush
    uint step; // BOUNCE_AREAS, ..
};

// Push constants of stage 7.
struct OccludePush {
    uint cache_count;
    uint group_count;
    uint first_proxy; // of the eye
};

// Push constants of the gather by clusters.
struct ClusterPush {
    vec4 eye; // as in DrawPush
    uint cache_count;
    uint node_count;
    uint split; // nodes of a part
    float limit; // distance in radii of a node, or share of a cache's light
    float spread; // most that a node's normals may differ by, or what its spread counts in units of
};

// Push constants of drawing depth images.
struct DepthImagePush {
    uint cache_count;
    uint first; // cache to draw, of a group the first, where a thread draws an image
    uint count; // of caches, likewise
};

// Push constants of the compacting passes.
struct PackPush {
    uint count; // items
    uint per_thread; // items of a thread
    uint cache_count; // all caches, where none is culled
    uint caches_per_group;
    uint split; // as in GatherPush
};

// Push constants of composite and exposure.
struct CompositePush {
    float ev; // fixed exposure value at ISO 100
    uint automatic; // 1: measure it instead
    uint tonemap;
    uint width;
    uint height;
    uint step; // every how many pixels and rows luminance is measured
    uint replaced; // 1: where no surface is, `behind` shows
    vec4 behind; // linear, of the display
};

// Push constants of the window's panels.
struct UiPush {
    vec2 scale; // points to clip space
};

// Push constants of a layer that the window shows alone.
struct LayerPush {
    uint how; // one of LAYER_*
    uint tonemap;
    uint left; // corner of the picture in the window [pixels]
    uint top;
    uint parts; // images whose sum it is, 1 to 3
    float low; // what is at either end of the false colours
    float high;
    vec4 depth; // (x + y d) / (z + w d) is the distance [m] of the depth d from the camera's plane
};

// Push constants of caches as discs.
struct DiscPush {
    mat4 clip_from_world;
    vec4 eye; // position and 1, or direction towards the viewer and 0
    float size; // radius, as a share of that of a cache's area
    uint left; // corner of the picture in the window [pixels]
    uint top;
};

const uint DISC_CORNERS = 16u;

const uint LAYER_RADIANCE = 0u; // exposed and tone-mapped like the picture
const uint LAYER_REFLECTANCE = 1u; // as it is
const uint LAYER_DIRECTION = 2u; // -1 dark, 1 bright
const uint LAYER_COLOR = 3u; // a colour of the display
const uint LAYER_LUMINANCE = 4u; // in false colours
const uint LAYER_DEPTH = 5u; // likewise, of depths
const uint LAYER_BROKEN = 6u; // grey, but for what no radiance can be

// Push constants of the check for broken values; what the frame has not counts 0.
struct CheckPush {
    uint width;
    uint direct_pixels;
    uint diffuse_pixels;
    uint glossy_pixels;
    uint val_count;
    uint cache_count;
};

#include "shared_material.glsl"
#include "shared_rays.glsl"
#include "shared_inside.glsl"

#endif
