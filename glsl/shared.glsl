// Structs and constants shared by shaders and Rust. build.rs translates this file: one member or constant per line.
// The layout is `scalar`: no padding. Positions are relative to the scene's origin, which the host chooses near the
// scene.
#ifndef SHARED_GLSL
#define SHARED_GLSL

// Most columns of 8 x 8 blocks in the accumulation images of the fragment gather (see lib/atlas.glsl).
const uint ATLAS_COLUMNS = 128u;

// Caches per texel of these images: one read of a VAL serves all of them.
const uint TEXEL_CACHES = 2u;

// VALs per tile; the list is padded with dark VALs to a multiple of it. 12 KiB fit the 16 KiB uniform buffer of every
// device.
const uint VAL_TILE = 256u;

// Items per workgroup of the compaction passes, and threads that process them.
const uint PACK_BLOCK = 1024u;
const uint PACK_THREADS = 64u;

// Where the gather shaders read VALs from.
const uint VALS_TEXELS = 0u;
const uint VALS_STORAGE = 1u;
const uint VALS_SHARED = 2u;

// Consecutive caches of the atlas that stage 7 tests and skips as a group.
const uint OCCLUDER_GROUP = 32u;

// Caches per workgroup of stage 7, and threads that share the discs of each cache.
const uint OCCLUDE_RECEIVERS = 8u;
const uint OCCLUDE_PARTS = 8u;

// Threads per workgroup of the gather.
const uint GATHER_THREADS = 64u;

// Consecutive caches of the atlas that traverse the VAL pyramids together.
const uint CLUSTER_GROUP = 32u;

// Rules for accepting a cluster.
const uint CLUSTER_DISTANCE = 0u;
const uint CLUSTER_BOUND = 1u;

// 32-bit words of a `ClusterNode` (a whole number of texels), and the word that holds its `skip`.
const uint CLUSTER_NODE_WORDS = 20u;
const uint CLUSTER_SKIP_WORD = 14u;

// Side of a cache's depth image [texels], its number of texels, and workgroups per row of the dispatch that draws the
// images.
const uint DEPTH_IMAGE_SIDE = 24u;
const uint DEPTH_IMAGE_TEXELS = 576u;
const uint DEPTH_IMAGE_ROW = 65535u;

// The model has no caches here.
const uint NO_REFERENCES = 0xffffffffu;

// A ray of a cache hit a surface without a cache on that side.
const uint UNKNOWN_CACHE = 0xfffffffeu;

// Depth that marks a pixel without a second surface.
const float NO_SURFACE = -1.0;

// Marks an unused entry of a reference list.
const uint NO_CACHE = 65535u;

// Contents of the caches' VALs for further bounces: areas, for the sums of form factors; the light received from the
// primary lights' VALs; the same plus the previous bounce; only the light of emitting surfaces from the last gather; or,
// instead of the first, only the sky's light. All but the areas include the sky's light, if caches see a sky.
const uint BOUNCE_AREAS = 0u;
const uint BOUNCE_FIRST = 1u;
const uint BOUNCE_AGAIN = 2u;
const uint BOUNCE_EMITTED = 3u;
const uint BOUNCE_SKY = 4u;

// Light types.
const uint LIGHT_DIRECTIONAL = 0u;
const uint LIGHT_POINT = 1u;
const uint LIGHT_SPOT = 2u;
const uint LIGHT_AREA = 3u;
const uint LIGHT_BODY = 4u; // a small emissive body

// Cube faces rendered for each sample of an area light: all but the one behind.
const uint AREA_VIEWS = 5u;

// Data that the check for broken values inspects, and workgroups per kind.
const uint CHECK_DIRECT = 0u;
const uint CHECK_DIFFUSE = 1u;
const uint CHECK_GLOSSY = 2u;
const uint CHECK_VALS = 3u;
const uint CHECK_SUMS = 4u;
const uint CHECK_PROXIES = 5u;
const uint CHECK_TARGETS = 6u;
const uint CHECK_GROUPS = 64u;

// Arithmetic peak benchmark: steps of each chain (lavapipe ends loops at 65 535), and chains per invocation.
const uint PEAK_STEPS = 16384u;
const uint PEAK_CHAINS = 12u;

// 32-bit words of a drawn vertex; position, normal and tangent are the first ten.
const uint VERTEX_WORDS = 15u;

// Marks an instance without posed vertices.
const uint RIGID = 0xffffffffu;

// Workgroups per row of the dispatches that pose meshes.
const uint DEFORM_ROW = 32768u;

// A mesh placed in the world.
struct Instance {
    mat4 world_from_model;
    mat4 world_from_normal; // inverse transpose of the linear part, up to a factor
    float growth; // largest length scale relative to when the caches were placed
    float area_scale; // factor of `world_from_normal` relative to cache placement; 1 on a deforming mesh, 0 if hidden
    uint first_index; // first index of its mesh in the shared index buffer
    uint first_vertex; // first of its posed vertices in the shared vertex buffer; RIGID for a rigid instance
    uint drawn_vertex; // first vertex to draw
};

// A vertex of a deforming mesh, before morphing and skinning.
struct BindVertex {
    vec3 position;
    vec3 normal;
    vec4 tangent;
    uint first_influence; // into all influences
    uint influence_count; // 0: the mesh has no skin
};

// Weight of one joint at a vertex.
struct Influence {
    uint joint; // index within the skin
    float weight;
};

// Offsets that a morph target of weight 1 adds to a vertex.
struct Displacement {
    vec3 position;
    vec3 normal;
    vec3 tangent;
};

// A vertex that follows a triangle of other vertices.
struct Follower {
    uint vertex; // index within the mesh
    uint a; // corners of the triangle: vertices of the mesh
    uint b;
    uint c;
    vec2 weights; // of b and c
    uint is_flat; // 1: the normal is the triangle's, without a tangent
};

// A joint's matrix from bind space to model space, row by row.
struct Joint {
    vec4 x;
    vec4 y;
    vec4 z;
};

// An instance of a deforming mesh.
struct Body {
    uint first_bind; // into all bind vertices
    uint bind_count;
    uint first_vertex; // first posed vertex, into all vertices
    uint first_follower;
    uint follower_count;
    uint first_displacement; // stored target by target, `bind_count` each
    uint target_count;
    uint first_joint;
    uint first_weight; // of the morph targets' weights
};

// Work of one workgroup of the posing passes: up to 64 vertices or followers of a body.
struct BodyBlock {
    uint body;
    uint first;
};

// A punctual light (KHR_lights_punctual) or an emitting rectangle (area light).
struct Light {
    vec3 position; // of a rectangle: its centre
    uint kind;
    vec3 direction; // unit vector of emission
    float range; // [m]; 0: infinite
    vec3 intensity; // [cd]; directional: illuminance [lx]; rectangle: radiance [cd/m^2]
    float cone_scale; // the extension's lightAngleScale
    float cone_offset; // the extension's lightAngleOffset
    uint first_view;
    uint view_count; // 1, or 6 faces in the order +x -x +y -y +z -z; of a rectangle the first 5 for each sample
    vec3 right; // of a rectangle: from its centre to an edge [m]
    vec3 up; // likewise, perpendicular to `right`
    uint columns; // samples of a rectangle along `right`
    uint rows; // samples along `up`
    float radius; // of a spherical lamp [m]; directional: tangent of its angular radius
    vec3 lean; // of a small emissive body, as are `right` and `up`: lib/light.glsl
    float clear; // of such a body: nothing within this distance of its centre blocks its light [m]
};

// One frustum of a light, for its shadow map and RSM.
struct LightView {
    mat4 clip_from_world;
    vec3 right; // to the right edge of the image at distance 1; of a directional light [m]
    vec3 up; // likewise
    vec3 forward; // unit
    vec3 position; // viewpoint; unused by parallel light
};

// A virtual area light (VAL): one RSM texel as a homogeneous diffuse disc.
struct Val {
    vec3 position;
    float area; // [m^2], eq. 5.10
    vec3 normal; // unit, on the lit side
    uint kind; // of light inside bodies: the filled part; else the shape of a lobe, lib/val_lobe.glsl, or 0
    vec3 flux; // reflected flux [lm]
    float weight; // with a lobe: its packed flux; else the weight in the proxy's mean position before the geometry factor
};

// One node for the VALs of a square block of texels. Nodes are stored depth first, view after view. After a node that
// is accepted or dark, traversal continues at `skip`; after any other node, at the next one. The finest nodes hold 2 x
// 2 VALs, which are not nodes themselves.
struct ClusterNode {
    vec3 position; // weighted mean
    float radius; // of a sphere about `position` that holds all VALs; d_val of the thesis
    vec3 normal; // weighted mean, unit
    float thickness; // largest distance of a VAL from the plane through `position` perpendicular to `normal`
    vec3 flux; // sum [lm]
    float area; // weighted mean [m^2]
    float weight; // sum; 0 where no VAL is alive
    float spread; // largest difference between a VAL's normal and the node's, as distance on the unit sphere
    uint skip; // the node after all descendants
    uint first; // of a finest node: its first VAL
    uint row; // of a finest node: offset from `first` to the VAL in the next row
    uint alive; // of a finest node: bit mask of its lit VALs, row by row; 0 in all other nodes
    uint unused; // pads the node to whole texels
    uint unused_too;
};

// Where the VALs and nodes of one RSM are stored.
struct ClusterView {
    uint first_val;
    uint size; // side of the RSM [texels]
    uint first_node;
    uint levels; // levels above the VALs
};

// A baked cache in model space. `area` is in [m^2] as long as the instance's normal matrix preserves the normal's
// length.
// On a deforming model the cache is a point on a triangle: `position` holds the weights of the triangle's second and
// third corner and the triangle's number, and `area` is a share of the triangle's area. `middle` (relative to the
// cache) and `axis` are combinations of the triangle's two edges from its first corner and of its normal. `normal` is
// unused.
struct ModelCache {
    vec3 position;
    float exponent;
    vec3 normal;
    float area;
    vec3 middle; // centre of the rectangle that represents its share of the surface as an occluder
    float breadth; // product of the rectangle's half sides, divided by the area
    vec3 axis; // from the centre to an edge, perpendicular to the normal
    uint instance;
};

// A cache in the world: four texels of four values.
struct Cache {
    vec3 position;
    float exponent; // of its material's Phong lobe
    vec3 normal; // zero if the cache is hidden
    float area; // [m^2]
    vec3 middle; // centre of the rectangle that represents its share of the surface as an occluder
    float breadth; // half the rectangle's size across its axis [m]
    vec3 axis; // from the centre to an edge [m], perpendicular to the normal
    float radius; // of the circle with the cache's area [m]
};

// The two proxy lights of a cache: for each lobe the facing irradiance I = E / (N.w) [lx] and the light's position.
struct Proxy {
    vec3 diffuse_position;
    float diffuse_distance2; // mean squared distance of the VALs [m^2]; 0 if none reaches the lobe
    vec3 diffuse_irradiance;
    float glossy_distance2; // likewise; 1 if the lobe is lit and no pass needs the distance
    vec3 glossy_position;
    vec3 glossy_irradiance;
};

// A draw, as read by passes that look up a visible triangle.
struct DrawRecord {
    uint first_index; // into all indices
    uint first_vertex; // of the mesh (rigid) or of the instance (deforming), into all vertices
    uint first_slot; // of the instance, into the slots for all instances' vertices or cells
    uint instance;
    uint reference_base; // first of the model's references, in pairs; NO_REFERENCES if it has no caches
    uint cache_base; // atlas index of the instance's first cache
    uint grid; // of the model, for the references of pixels
    uint first_rest; // first vertex of the mesh as it was when caches were placed
};

// Cell grid of a model: maps a point in model space to its row of references.
struct CellGrid {
    mat4 cell_from_offset; // from a point relative to `centre` to cells of side 1
    vec3 centre; // of the model
    uint first_entry; // into all models' hash table entries
    uint entry_mask; // number of entries, a power of two, minus 1
};

// A cell in a hash table with linear probing.
struct CellEntry {
    uint xy; // cell coordinates, 16 bits each
    uint z;
    uint row; // row of the model's references; NO_REFERENCES if the entry is free
};

// A vertex in model space, as read by stage 8.
struct Corner {
    vec3 position;
    vec3 normal;
};

// A corner of a visible triangle, or a visible cell.
struct VisibleVertex {
    uint draw;
    uint vertex; // of the mesh; of a cell: its row of references
};

// Number of visible vertices or cells, and the arguments of a dispatch over them.
struct VisibleArgs {
    uint count;
    uint groups_x;
    uint groups_y;
    uint groups_z;
};

// The averaged light of a vertex's caches, for each lobe.
struct VertexLight {
    vec3 position; // of the vertex in the world
    vec3 diffuse_position;
    vec3 diffuse_irradiance; // facing irradiance; in the thesis's scheme flux / (4 pi)
    vec3 glossy_position;
    vec3 glossy_irradiance;
};

// Live caches (or, with clusters, groups of them): number and dispatch arguments of the gather.
struct LiveArgs {
    uint groups_x;
    uint groups_y; // parts that the VALs or cluster nodes are split into
    uint groups_z;
    uint cache_count;
    uint images_x; // workgroups of the pass that draws depth images, one cache each
    uint images_y;
    uint images_z;
};

// Bounds of consecutive caches of the atlas as occluders.
struct OccluderGroup {
    vec3 position; // centre of their bounds
    float radius; // of a sphere about `position` that holds the caches' positions
    float area; // largest [m^2]
    float reach; // radius of a sphere about `position` that holds their rectangles
};

// Sums over VALs at one cache. Positions are relative to the cache.
struct GatherSums {
    vec3 diffuse_position; // sum of w d
    float diffuse_weight; // sum of w
    vec3 diffuse_irradiance; // sum of phi G [lx]
    float distance2; // sum of w d^2
    vec3 glossy_position; // sum of w d cos^k; the next three likewise
    float glossy_weight;
    vec3 glossy_irradiance;
    float glossy_distance2; // only with proxy shadows
};

// The glossy part of `GatherSums`, for a second eye.
struct GlossySums {
    vec3 position;
    float weight;
    vec3 irradiance;
    float distance2;
};

// Push constants of passes that draw the scene's triangles.
struct DrawPush {
    mat4 clip_from_world;
    uint instance;
    uint material;
    uint draw; // number of the draw, from 1
    uint first_triangle; // first triangle, if only a part of the draw is drawn
    vec4 eye; // viewer: position and 1, or unit direction towards it and 0
};

// Push constants of full-screen passes that reconstruct world positions.
struct ScreenPush {
    mat4 world_from_clip;
    vec4 eye; // as in DrawPush
    uint light;
    uint shadow_size; // side of one view of the shadow map [texels]
    uint first_val; // first VAL of this tile
};

// Push constants of the area light pass.
struct AreaPush {
    mat4 world_from_clip;
    vec4 eye; // as in DrawPush
    uint light;
    uint face_size; // side of one face of a sample's shadow map [texels]
    uint columns; // samples side by side in the shadow map, each three faces wide
};

// Push constants of the sky pass.
struct SkyPush {
    mat4 world_from_clip;
    vec4 eye; // as in DrawPush
    uint width; // of the sky's grid
    uint height;
    float turn; // rotation about +Y [rad]
};

// 4-bit codes: which surface each further point of a pixel shows.
const uint SHOWS_FIRST = 0u; // the pixel's first surface
const uint SHOWS_SECOND = 1u;
const uint SHOWS_AROUND = 2u; // to 9: the first surface of one of the 8 pixels around, row by row
const uint SHOWS_ANOTHER = 15u; // none of these

// Push constants of the pass that adds one more sample to every pixel.
struct EdgesPush {
    mat4 world_from_clip;
    vec2 offset; // of the sample from the pixel's centre [pixels]
    uint point; // index of the sample, from 0
};

// Push constants of the pass that finds the surfaces of samples.
struct SamplesPush {
    mat4 world_from_clip;
};

// Push constants of the pass that turns RSM texels into VALs.
struct ValPush {
    uint light;
    uint view;
    uint size; // side of the RSM [texels]
    uint first; // first VAL of this RSM
    uint reflects; // 0: its VALs only light the inside of bodies
};

// Push constants of the pass that finds visible vertices.
struct VisiblePush {
    uint frame; // frame number, never 0
};

// Push constants of the pass that finds visible cells.
struct VisibleCellsPush {
    mat4 clip_from_world;
    uint frame; // frame number, never 0
};

// Push constants of the pass that averages lights at vertices.
struct AveragePush {
    vec4 eye; // as in DrawPush
    uint first_proxy; // first proxy of the eye
};

// Push constants of the interpolation passes.
struct InterpolatePush {
    mat4 clip_from_world;
    vec4 eye; // as in DrawPush
    float reach; // distance of the farthest cache in a pixel's references, for averaging at pixels
    uint first_proxy; // first proxy of the eye
};

// Push constants of the pass that draws references into the atlas.
struct AtlasPush {
    uint columns; // block columns
    uint rows; // texel rows
};

// Push constants of the posing passes.
struct DeformPush {
    uint block_count;
};

// Push constants of the pass that places caches in the world.
struct PlacePush {
    uint cache_count;
};

// Push constants of the pass that builds one level of the VAL pyramids.
struct PyramidPush {
    uint level; // 1 is the level above the VALs
};

// Push constants of the gather.
struct GatherPush {
    uint cache_count;
    uint first; // first VAL of this tile
    uint tile; // VALs in this tile
    uint split; // VALs summed by one thread of the compute gather
    uint columns; // block columns of the fragment gather's images
    uint cache_parts; // number of parts from caches (bounces), stored before the primary lights' parts
    uint first_proxy; // first proxy of the eye
    uint second_proxy; // first proxy of the second eye
    vec4 eye; // as in DrawPush
    vec4 second_eye; // if two eyes are gathered at once
    float near_begin; // squared distance at which VALs begin to count; nearer ones are left to short rays [m^2]
    float near_scale; // weight of a VAL per [m^2] of squared distance beyond `near_begin`, up to 1
};

// Push constants of the pass that turns lit caches into VALs.
struct BouncePush {
    uint cache_count;
    uint cache_parts; // as in GatherPush
    uint step; // BOUNCE_AREAS to BOUNCE_SKY
};

// Push constants of stage 7 (occlusion).
struct OccludePush {
    uint cache_count;
    uint group_count;
    uint first_proxy; // first proxy of the eye
};

// Push constants of the cluster gather.
struct ClusterPush {
    vec4 eye; // as in DrawPush
    uint cache_count;
    uint node_count;
    uint split; // nodes per part
    float limit; // distance in radii of a node, or error as a share of a cache's light
    float spread; // largest spread of a node's normals, or the unit that the spread is measured in
};

// Push constants of the pass that draws depth images.
struct DepthImagePush {
    uint cache_count;
    uint first; // cache to draw, or first cache of the group if each thread draws an image
    uint count; // caches of the group, if each thread draws an image
};

// Push constants of the compaction passes.
struct PackPush {
    uint count; // items
    uint per_thread; // items per thread
    uint cache_count; // all caches, if there is no culling
    uint caches_per_group;
    uint split; // as in GatherPush
};

// Bins of the exposure's histogram.
const uint EXPOSURE_BINS = 1024u;

// Push constants of composite and exposure.
struct CompositePush {
    float ev; // fixed exposure value at ISO 100
    uint automatic; // 1: measure the exposure instead
    uint tonemap;
    uint width;
    uint height;
    uint step; // distance between the pixels, and rows, whose luminance is measured
    uint replaced; // 1: `behind` shows where there is no surface
    vec4 behind; // linear display colour
};

// Push constants of the check for broken values; counts are 0 for data that the frame lacks.
struct CheckPush {
    uint width;
    uint direct_pixels;
    uint diffuse_pixels;
    uint glossy_pixels;
    uint val_count;
    uint cache_count;
    uint summed_caches; // sums per part; 0: there are no sums
    uint cache_parts; // parts before those of the VALs
};

#include "shared_material.glsl"
#include "shared_rays.glsl"
#include "shared_inside.glsl"
#include "shared_window.glsl"

#endif
