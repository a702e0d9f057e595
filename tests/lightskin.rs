//! The one integration-test binary: it links once.

#![expect(clippy::print_stdout, reason = "tests tell what they skipped and found")]

mod common;
mod malformed;
mod scene;
