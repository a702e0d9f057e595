//! Flags for the gather, the stage that lights the caches.

use super::wrong_usage;
use clap::{Args, ValueEnum};
use lightskin::frame::settings::{Gather, Ways};
use lightskin::frame::{ClusterRule, Near, Shadows};

/// Flags for the gather.
#[derive(Args, Clone, Default)]
#[command(next_help_heading = "Variants of the method")]
pub(super) struct GatherArgs {
    /// Method that lights the caches from the virtual lights.
    ///
    /// The compute method measures once, within seconds, which variant is fastest on the device, and stores the result.
    #[arg(long, hide_short_help = true, value_enum, default_value_t)]
    pub(super) gather: GatherArg,
    /// Light all caches, not only those that visible surfaces use. The picture stays the same.
    #[arg(long, hide_short_help = true)]
    pub(super) no_cull: bool,
    #[command(flatten)]
    pub(super) cluster: ClusterArgs,
}

/// Flags for clusters of virtual lights.
#[derive(Args, Clone, Default)]
pub(super) struct ClusterArgs {
    /// Light a cache by a whole cluster of virtual lights if the cluster is more than C of its radii away [default:
    /// off].
    ///
    /// A larger C is more accurate and slower. 8 is a good start (docs/clustering.md).
    #[arg(long, hide_short_help = true, help_heading = "Variants of the method", value_name = "C", allow_hyphen_values = true, value_parser = super::positive)]
    pub(super) cluster: Option<f64>,
    /// Light a cache by a whole cluster if the error is at most the fraction P of the cache's light, like 0.01
    /// [default: off].
    #[arg(long, hide_short_help = true, help_heading = "Variants of the method", value_name = "P", allow_hyphen_values = true, value_parser = super::at_least_zero, conflicts_with = "cluster")]
    pub(super) cluster_error: Option<f64>,
}

impl ClusterArgs {
    pub(super) fn rule(&self) -> Option<ClusterRule> {
        let distance = self.cluster.map(|c| ClusterRule::Distance(c as f32));
        distance.or(self.cluster_error.map(|share| ClusterRule::Error(share as f32)))
    }
}

#[derive(Clone, Copy, Default, ValueEnum)]
pub(super) enum GatherArg {
    /// Compute shader over the caches that visible surfaces use.
    #[default]
    #[value(alias = "auto")]
    Compute,
    /// Additive draws into float targets, culled by the depth test. The method of the thesis.
    Fragment,
}

impl GatherArgs {
    pub(super) fn by_draws(&self) -> bool {
        matches!(self.gather, GatherArg::Fragment)
    }

    pub(super) fn by_clusters(&self) -> bool {
        self.cluster.rule().is_some()
    }

    /// Ends the process if the flags cannot be combined.
    pub(super) fn check(&self, shadows: Shadows) {
        if shadows == Shadows::PerLight && self.by_draws() {
            wrong_usage("--shadows per-light needs --gather compute: --gather fragment cannot read depth images");
        }
        if shadows == Shadows::PerLight && self.by_clusters() {
            wrong_usage("--shadows per-light tests every virtual light: remove --cluster and --cluster-error");
        }
        if matches!(self.gather, GatherArg::Fragment) && self.cluster.rule().is_some() {
            wrong_usage(
                "--cluster and --cluster-error need --gather compute: --gather fragment draws every virtual light",
            );
        }
    }

    /// Ends the process if the flags do not support more than one bounce.
    pub(super) fn check_bounces(&self) {
        if matches!(self.gather, GatherArg::Fragment) {
            wrong_usage("--bounces above 1 needs --gather compute: --gather fragment computes one bounce only");
        }
        if self.cluster.rule().is_some() {
            wrong_usage(
                "--bounces above 1 cannot be used with --cluster or --cluster-error: lit caches are not clustered",
            );
        }
    }

    /// The gather that the flags request. `check` and `check_bounces` must have accepted them.
    pub(super) fn gather(&self, ways: Ways, shadows: Shadows, near: Near, bounces: u32) -> Gather {
        let dim = shadows == Shadows::Proxy;
        match (self.cluster.rule(), self.gather) {
            (Some(rule), _) => Gather::Clusters { rule, dim },
            (None, GatherArg::Fragment) => Gather::draws(dim),
            (None, GatherArg::Compute) => Gather::Compute { ways, bounces, shadows, near },
        }
    }
}
