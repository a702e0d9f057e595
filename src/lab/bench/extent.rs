//! Extent of the benchmark: which points are measured, and how often.

use crate::frame::{Quality, tune};
use crate::scene::build::Fineness;

/// Scene whose frames are measured as `render` draws them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shown {
    /// The default scene of `render`.
    Showpiece,
    /// A simpler scene.
    Atrium,
}

/// Points of the thesis's tables, and the number of frames per point.
#[derive(Clone, Debug, PartialEq)]
pub struct Extent {
    /// Name for the report.
    pub name: &'static str,
    /// Scene of the quality levels and their choices.
    pub shown: Shown,
    /// Side of the cells of the statue's surface nets \[m\].
    pub cell: f32,
    /// Quality levels.
    pub levels: Vec<Quality>,
    /// Quality level whose choices are measured.
    pub level: Quality,
    /// Number of choices.
    pub choices: usize,
    /// Frames of levels and choices of which the median is taken.
    pub shown_frames: usize,
    /// Picture \[pixels\] for quality levels, table 6.3 and culling.
    pub size: [u32; 2],
    /// Picture \[pixels\] for table 6.1. The thesis shows its scenes at this size, and the times in its table 6.2 agree
    /// with it.
    pub window: [u32; 2],
    /// Triangle counts of table 6.1.
    pub triangles: Vec<usize>,
    /// Pictures \[pixels\] of table 6.2.
    pub resolutions: Vec<[u32; 2]>,
    /// Cache counts of table 6.3.
    pub caches: Vec<usize>,
    /// Sides of the RSMs \[texels\] of table 6.3.
    pub rsm: Vec<u32>,
    /// Triangle and cache counts for culling.
    pub culled: Vec<(usize, usize)>,
    /// Cache counts and RSM sides \[texels\] for timing the gather alone, in all combinations.
    pub scaling: (Vec<usize>, Vec<u32>),
    /// Instance counts of the crowds for the motion table.
    pub crowds: Vec<usize>,
    /// Triangles of the scenes for tables 6.2 and 6.3.
    pub ground: usize,
    /// Warm-up frames.
    pub warm_up: usize,
    /// Frames of which the median is taken.
    pub frames: usize,
    /// Pipelines of identical code that are timed in turn: they can differ in speed.
    pub pipelines: usize,
    /// Pairs of caches and VALs are measured in rounds until this much time has passed \[s\].
    pub rounds: f64,
    /// Time limit of each table \[s\].
    pub budget: f64,
}

impl Extent {
    /// Takes minutes on a software device.
    pub fn quick() -> Self {
        Self {
            name: "quick",
            shown: Shown::Atrium,
            cell: 0.03,
            levels: vec![Quality::Low, Quality::Medium, Quality::High],
            level: Quality::High,
            choices: usize::MAX,
            shown_frames: 1,
            size: [320, 180],
            window: [1280, 720],
            triangles: vec![800, 12_800, 51_200, 204_800, 819_200],
            resolutions: vec![[256, 256], [512, 512], [800, 600], [1280, 720]],
            caches: vec![250, 1000, 4000, 16_000],
            rsm: vec![64, 128, 256],
            culled: vec![(51_200, 1000), (51_200, 4000), (51_200, 16_000), (819_200, 1000)],
            scaling: (vec![250, 1000, 4000, 16_000], vec![64, 128, 256]),
            crowds: vec![1000],
            ground: 51_200,
            warm_up: 1,
            frames: 3,
            pipelines: tune::PIPELINES,
            rounds: 0.8,
            budget: 80.0,
        }
    }

    /// All points of the thesis, for GPUs.
    pub fn full() -> Self {
        Self {
            name: "full",
            shown: Shown::Showpiece,
            cell: Fineness::default().cell,
            levels: Quality::ALL.to_vec(),
            level: Quality::High,
            choices: usize::MAX,
            shown_frames: 50,
            size: [1280, 720],
            window: [1280, 720],
            triangles: vec![
                800, 3200, 12_800, 51_200, 102_400, 204_800, 409_600, 819_200, 1_638_400, 2_457_600, 3_276_800,
                4_096_000, 4_915_200, 5_734_400, 6_553_600,
            ],
            resolutions: vec![
                [256, 256],
                [320, 240],
                [512, 512],
                [640, 480],
                [800, 600],
                [1024, 768],
                [1280, 720],
                [1024, 1024],
                [1920, 1080],
                [2048, 2048],
                [4096, 4096],
            ],
            caches: [250, 500].into_iter().chain((1..=16).map(|k| 1000 * k)).collect(),
            rsm: vec![64, 128, 256, 512],
            culled: vec![(150_000, 1000), (150_000, 4000), (150_000, 16_000), (819_200, 1000)],
            scaling: (vec![250, 1000, 4000, 16_000], vec![64, 128, 256, 512]),
            crowds: vec![1000, 4000],
            ground: 150_000,
            warm_up: 20,
            frames: 50,
            pipelines: tune::PIPELINES,
            rounds: 0.8,
            budget: 1200.0,
        }
    }
}
