//! The one integration-test binary: it links once.

mod common;
mod malformed;
mod scene;
