//! The one integration-test binary: it links once.

mod analytic;
mod bake;
mod cli;
mod common;
mod frame;
mod gather;
mod generated;
mod guards;
mod house;
mod malformed;
mod nets;
mod proxies;
mod quality;
mod scene;
mod shaders;
