//! The frame: METHOD's eleven stages in order, each in a file of the same name.
//!
//! There are three lifetimes. A [`World`] is a scene on the device. A [`Light`] is the light of a world, shared by all
//! views. A [`Picture`] holds the targets and results of one view. [`Settings`] determine light and pictures; each
//! frame takes its own [`Look`]. An [`Engine`] holds a world and its light and allows both to change between two
//! frames.

mod arrivals;
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
mod ggx_area;
pub mod hidden_caches;
pub mod inside;
pub mod interpolate;
pub mod layers;
pub mod light;
mod light_rays;
pub mod live;
pub mod near;
pub mod occlude;
pub mod pack;
pub mod picture;
pub mod pixel;
pub mod plan;
pub mod pose;
pub mod proxies;
pub mod pyramid;
mod record;
pub mod refit;
mod refract;
mod revision;
pub mod rsm;
mod samples;
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
pub use record::{Part, record, record_part};
pub use settings::{
    Antialiasing, Behind, ClusterRule, DrawSource, Exposure, Indirect, Interpolation, LightShadows, Look, Near,
    ProxyWeight, Quality, SUPERSAMPLES, Settings, Shadows, Tonemap, ValSource, Ways,
};
pub use view::View;
pub use world::{AreaLight, BodyLight, World};
