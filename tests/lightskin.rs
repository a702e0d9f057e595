//! The only integration-test binary, so that tests link once.
#![allow(clippy::print_stdout, reason = "tests print the figures that they check")]

mod analytic;
mod animation;
#[cfg(feature = "app")]
mod app;
#[cfg(feature = "app")]
mod app_controls;
#[cfg(feature = "app")]
mod app_failures;
#[cfg(feature = "app")]
mod app_lights;
#[cfg(feature = "app")]
mod app_soak;
#[cfg(feature = "app")]
mod app_tools;
#[cfg(feature = "app")]
mod app_wayland;
mod area_lights;
mod bake;
mod bench;
mod bodies;
mod bounce;
mod bounded;
mod brdf;
mod cli;
mod cluster;
mod coat;
mod common;
mod compare;
mod compressed;
#[cfg(feature = "app")]
mod config;
mod crease;
mod cull;
mod curved;
mod debug_views;
mod devices;
mod draws;
mod edges;
mod emissive;
mod energy;
mod engine;
mod eval;
mod exposure;
mod files;
mod flicker;
mod frame;
#[cfg(feature = "app")]
mod fuzz;
mod gather;
mod generated;
mod goldens;
mod gpu;
mod guards;
mod hard_cases;
mod hidden;
mod host;
mod house;
mod insets;
mod interpolate;
mod known_issues;
mod layers;
mod layout;
mod lifetimes;
mod light_rays;
mod malformed;
mod media;
mod moving;
mod near;
mod near_rays;
mod nets;
mod normal_maps;
mod occlude;
mod path_trace;
mod path_trace_sky;
mod pixel;
mod proxies;
mod quality;
mod rays;
mod refraction;
mod scene;
mod sessions;
mod shaders;
mod shadows_light;
mod sheet;
#[cfg(feature = "glsl")]
mod shipped;
mod showpiece;
mod sky;
mod sky_light;
mod sources;
mod stage;
mod subsurface;
mod sun;
mod tessellate;
mod texel;
mod timing;
mod traced_images;
mod val_lobes;
mod views;
