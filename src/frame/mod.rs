//! The frame: METHOD's eleven stages in order, each in the file of its name.
//!
//! Three lifetimes: a [`World`] is a scene on the device; a [`Light`] is its light, once for all views; a [`Picture`] is what
//! one view sees. [`Settings`] shape light and pictures, a [`Look`] is given to each frame. [`Engine`] holds a world and its
//! light and lets all of it change between two frames.

pub mod atlas;
pub mod background;
pub mod bounce;
pub mod brute_force;
pub mod caches;
pub mod check;
pub mod composite;
pub mod cull;
pub mod depth_images;
pub mod direct;
mod directions;
pub mod edges;
pub mod engine;
pub mod gather;
pub mod gather_clusters;
pub mod gather_draws;
pub mod gbuffer;
pub mod inside;
pub mod interpolate;
pub mod layers;
pub mod light;
pub mod live;
pub mod near;
pub mod occlude;
pub mod pack;
pub mod picture;
pub mod plan;
pub mod pose;
pub mod proxies;
pub mod pyramid;
mod record;
pub mod refit;
mod revision;
pub mod rsm;
pub mod settings;
pub mod sky_light;
pub mod sky_seen;
mod sums;
pub mod tune;
pub mod vals;
pub mod view;
pub mod visible;
pub mod world;

pub use engine::Engine;
pub use light::{Counts, Light};
pub use picture::Picture;
pub use plan::{Features, Plan};
pub use record::{record, record_rows};
pub use settings::{
    Antialiasing, Behind, ClusterRule, DrawSource, Exposure, Indirect, Interpolation, LightShadows, Look, Near,
    ProxyWeight, Quality, Settings, Shadows, Tonemap, ValSource, Ways,
};
pub use view::View;
pub use world::{AreaLight, World};
