//! The one integration-test binary: it links once.
#![allow(clippy::print_stdout, reason = "tests print the figures they judge by")]

mod analytic;
mod animation;
mod bake;
mod bench;
mod bounce;
mod choices;
mod cli;
mod cluster;
mod common;
mod compare;
mod cull;
mod emissive;
mod energy;
mod eval;
mod flicker;
mod frame;
mod gather;
mod generated;
mod gpu;
mod guards;
mod hard_cases;
mod hierarchy;
mod host;
mod house;
mod interpolate;
mod layout;
mod malformed;
mod moving;
mod nets;
mod normal_maps;
mod occlude;
mod path_trace;
mod proxies;
mod quality;
mod scene;

mod shaders;
mod shadows_light;
mod sky;
mod sources;
mod tessellate;
mod texel;
mod timing;
