//! The stages that compute light, on the CPU in f64: what the shaders and the measurements are compared with.
//!
//! Written from METHOD, not from the shaders; the same function has the same name in both. Units are SI, colours are
//! linear Rec.709, equation numbers are those of Lensing's dissertation (2014).

/// What a point receives from a rectangle that shines.
pub mod area_light;
/// Lit caches as VALs of the next bounce.
pub mod bounce;
/// The glossy lobe of a surface, evaluated, sampled and integrated.
pub mod brdf;
/// Radiance from every VAL without caches: the ground truth of the interpolation.
pub mod brute_force;
/// Pyramids of VALs and the cuts that caches take of them.
pub mod cluster;
pub mod coat;
/// What a cache sees of the discs around it.
pub mod depth_image;
pub mod dipole;
/// Exact integrals over a disc or a polygon.
pub mod disc;
/// Form factor between a point and a disc, eq. 5.7.
pub mod false_color;
pub mod form_factor;
/// VALs to proxy lights at one cache, stage 6.
pub mod gather;
/// Proxy lights of several caches to radiance at a point, stage 8.
pub mod interpolate;
/// Punctual lights as KHR_lights_punctual defines them, stage 2.
pub mod light;
/// One diffuse bounce by random sampling: the truth behind the VALs.
pub mod monte_carlo;
pub mod near;
/// Discs of caches in the way of proxy lights, stage 7.
pub mod occlude;
/// Light paths drawn at random: the truth behind all of it.
pub mod path_trace;
/// Diffuse and modified Phong reflection.
pub mod phong;
/// A primary light's view of the scene to VALs, stage 4.
pub mod rsm;
pub mod sky;
/// Scene-linear colour to the display, stage 11.
pub mod tonemap;
/// Triangles and the nearest one along a ray.
pub mod triangle;
pub mod volume;
/// Rays against a whole scene.
pub mod world;
