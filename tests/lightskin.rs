//! The one integration-test binary: it links once.
#![allow(clippy::print_stdout, reason = "tests print the figures they judge by")]

mod analytic;
mod bake;
mod choices;
mod cli;
mod common;
mod energy;
mod frame;
mod gather;
mod generated;
mod guards;
mod house;
mod interpolate;
mod layout;
mod malformed;
mod nets;
mod normal_maps;
mod proxies;
mod quality;
mod scene;
mod shaders;
mod tessellate;
