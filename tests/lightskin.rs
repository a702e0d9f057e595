//! The one integration-test binary: it links once.

mod analytic;
mod bake;
mod common;
mod energy;
mod frame;
mod gather;
mod generated;
mod guards;
mod interpolate;
mod malformed;
mod nets;
mod proxies;
mod quality;
mod scene;
mod shaders;
