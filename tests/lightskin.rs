//! The one integration-test binary: it links once.

mod analytic;
mod bake;
mod common;
mod energy;
mod gather;
mod generated;
mod guards;
mod interpolate;
mod malformed;
mod proxies;
mod scene;
mod shaders;
