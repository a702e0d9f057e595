//! What frames of the product cost; then the thesis's measurements on generated scenes, next to its figures: frame times
//! over triangles, resolution, caches and VALs, and how close the gather comes to the peak of the device and to
//! hand-written CPU code.

pub mod accuracy;
pub mod contexts;
pub mod extent;
pub mod measure;
pub mod motion;
pub mod native;
pub mod peak;
pub mod product;
pub mod report;
pub mod scaling;
pub mod simd;
pub mod table;
pub mod thesis;
pub mod views;

pub use extent::Extent;
pub use report::write;

use crate::error::Result;
use crate::frame::tune;
use crate::gpu::Gpu;
use contexts::Contexts;
use scaling::exponents;
use std::time::Instant;
use table::Table;

/// All results of a benchmark.
pub struct Results {
    /// Name of the extent.
    pub extent: &'static str,
    /// Arithmetic peak of the device [flop/s].
    pub peak: f64,
    /// Duration of the whole benchmark \[s\].
    pub seconds: f64,
    /// All tables, in the order of the report.
    pub tables: Vec<Table>,
    /// Missing and superfluous barriers, with `Validation::Sync`.
    pub problems: Vec<String>,
}

impl Results {
    /// The table of this name, which must exist.
    pub fn table(&self, name: &str) -> &Table {
        self.tables.iter().find(|table| table.name == name).expect("a table")
    }
}

/// Measures everything. `progress` receives the completed share, 0 to 1, and the current step.
///
/// # Errors
/// Fails if the device runs out of memory, lacks a feature, or is lost.
pub fn run(gpu: &Gpu, extent: &Extent, progress: &dyn Fn(f32, &str)) -> Result<Results> {
    let start = Instant::now();
    progress(0.0, "arithmetic peak");
    let peak = peak::measure(gpu)?;
    let tuned = tune::fastest(gpu)?;
    // Approximate shares of the total time.
    let part = |from: f32, to: f32| move |part: f32, what: &str| progress(from + (to - from) * part, what);
    let parts = [
        part(0.0, 0.3),
        part(0.3, 0.5),
        part(0.5, 0.57),
        part(0.57, 0.78),
        part(0.78, 0.82),
        part(0.82, 0.95),
        part(0.95, 0.98),
        part(0.98, 1.0),
    ];
    let mut work = Contexts { gpu, extent, peak, tuned, progress: &parts[0], problems: Vec::new() };
    let mut tables = Vec::from(work.product()?);
    work.progress = &parts[1];
    tables.extend(work.triangles()?);
    work.progress = &parts[2];
    tables.push(work.resolution()?);
    work.progress = &parts[3];
    tables.extend(work.caches()?);
    work.progress = &parts[4];
    tables.push(work.culling()?);
    work.progress = &parts[5];
    tables.extend(work.scaling()?);
    work.progress = &parts[6];
    tables.push(work.motion()?);
    work.progress = &parts[7];
    tables.push(work.views()?);
    let problems = work.problems;
    let grown = exponents(tables.iter().find(|table| table.name == "caches").expect("just made"));
    tables.push(grown);
    progress(1.0, "done");
    Ok(Results { extent: extent.name, peak, seconds: start.elapsed().as_secs_f64(), tables, problems })
}
