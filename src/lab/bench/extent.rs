//! How much is measured.

/// Points of the thesis's tables, and how often each is measured.
#[derive(Clone, Debug, PartialEq)]
pub struct Extent {
    /// Name for the report.
    pub name: &'static str,
    /// Picture \[pixels\] of table 6.3 and of culling.
    pub size: [u32; 2],
    /// Picture \[pixels\] of table 6.1: what the thesis shows its scenes in; by its table 6.2 it fits the times.
    pub window: [u32; 2],
    /// Triangle counts of table 6.1.
    pub triangles: Vec<usize>,
    /// Pictures \[pixels\] of table 6.2.
    pub resolutions: Vec<[u32; 2]>,
    /// Cache counts of table 6.3.
    pub caches: Vec<usize>,
    /// Sides of the RSMs \[texels\] of table 6.3.
    pub rsm: Vec<u32>,
    /// Counts of triangles and of caches that culling is measured at.
    pub culled: Vec<(usize, usize)>,
    /// Counts of caches, and sides of RSMs \[texels\], that the gather alone is timed at, each with each.
    pub scaling: (Vec<usize>, Vec<u32>),
    /// Instances of the crowds whose motion is measured.
    pub crowds: Vec<usize>,
    /// Triangles of the scenes of tables 6.2 and 6.3.
    pub ground: usize,
    /// Frames before those that count.
    pub warm_up: usize,
    /// Frames whose median counts.
    pub frames: usize,
    /// Time \[s\] that each table may take.
    pub budget: f64,
}

impl Extent {
    /// Minutes on a software device.
    pub fn quick() -> Self {
        Self {
            name: "quick",
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
            budget: 80.0,
        }
    }

    /// Every point of the thesis, for GPUs.
    pub fn full() -> Self {
        Self {
            name: "full",
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
            budget: 1200.0,
        }
    }
}
