//! CPU references in f64 of all stages that compute light: the ground truth for shaders and measurements.
//!
//! Written from METHOD, not from the shaders; corresponding functions have the same name in both. Units are SI, colours
//! are linear Rec.709, equation numbers are those of Lensing's dissertation (2014).

/// Light from an emitting rectangle at a point.
pub mod area_light;
/// Lit caches as VALs of the next bounce.
pub mod bounce;
/// The glossy lobe of a surface, evaluated, sampled and integrated.
pub mod brdf;
/// Radiance from every VAL without caches: the ground truth of interpolation.
pub mod brute_force;
/// Pyramids of VALs and the cuts through them.
pub mod cluster;
pub mod coat;
/// A cache's view of the occluders around it.
pub mod depth_image;
pub mod dipole;
/// Exact integrals over a disc or a polygon.
pub mod disc;
/// False colours for display.
pub mod false_color;
pub mod form_factor;
/// Proxy lights of one cache from VALs, stage 6.
pub mod gather;
pub mod hidden;
pub mod hit_caches;
/// Radiance at a point from the proxy lights of several caches, stage 8.
pub mod interpolate;
/// Punctual lights as KHR_lights_punctual defines them, stage 2.
pub mod light;
/// One diffuse bounce by random sampling: the ground truth of VALs.
pub mod monte_carlo;
pub mod near;
/// Occlusion of proxy lights by the discs of caches, stage 7.
pub mod occlude;
/// Path tracing: the ground truth of the whole engine.
pub mod path_trace;
/// Diffuse and modified Phong reflection.
pub mod phong;
/// VALs from a primary light's view of the scene, stage 4.
pub mod rsm;
pub mod sky;
/// Tone mapping from scene-linear colour to the display, stage 11.
pub mod tonemap;
/// Triangles and the nearest hit of a ray.
pub mod triangle;
pub mod volume;
/// Rays against a whole scene.
pub mod world;
