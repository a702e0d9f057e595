//! Files of the benchmark: `bench.json`, a CSV for each table, `bench.md`, plots.

use super::Results;
use super::contexts::VERSIONS;
use super::native;
use super::scaling;
use super::table::{Cell, Table};
use super::thesis;
use super::{motion, product, views};
use crate::error::Result;
use crate::files;
use crate::gpu::Gpu;
use crate::lab::eval::references::make_folder;
use crate::lab::plot::{Axis, Mark, Plot, Series, short};
use serde_json::json;
use std::path::Path;

/// Creates the folder and checks that the report can be written there, before the long measurement starts.
///
/// # Errors
/// Fails if a folder or file cannot be written.
pub fn check_writable(folder: &Path) -> Result<()> {
    make_folder(folder)?;
    files::check_writable(&folder.join("bench.md"))
}

/// Writes the report into a folder.
///
/// # Errors
/// Fails if a folder or file cannot be written.
pub fn write(folder: &Path, gpu: &Gpu, results: &Results) -> Result<()> {
    make_folder(folder)?;
    let text = |name: &str, content: &str| files::write(&folder.join(name), content.as_bytes());
    for table in &results.tables {
        text(&format!("{}.csv", table.name), &table.csv())?;
    }
    for (name, plot) in plots(gpu, results) {
        text(&format!("{name}.svg"), &plot.svg())?;
    }
    let device = gpu.report();
    let tables: Vec<_> = results.tables.iter().map(Table::json).collect();
    let all = json!({
        "schema": 1,
        "device": { "name": device.name, "driver": device.driver, "kind": device.kind, "software": gpu.is_software() },
        "cpu": native::cpu(), "cpu_threads": rayon::current_num_threads(), "cpu_registers": native::registers().0,
        "extent": results.extent, "seconds": results.seconds, "peak_flop_per_s": results.peak,
        "headlines": headlines(gpu, results), "tables": tables,
    });
    text("bench.json", &format!("{all:#}\n"))?;
    text("bench.md", &markdown(gpu, results))
}

/// The device as named in the report.
fn device(gpu: &Gpu) -> String {
    let report = gpu.report();
    format!("{} ({}, {})", report.name, report.kind, report.driver)
}

fn markdown(gpu: &Gpu, results: &Results) -> String {
    let (cpu, threads) = (native::cpu(), rayon::current_num_threads());
    let device = device(gpu);
    let mut page = format!(
        "# lightskin bench\n\nDevice: {device}. CPU: {cpu}, {threads} threads. Extent: {}, which took {:.0} s.\n\n",
        results.extent, results.seconds
    );
    if gpu.is_software() {
        page += "This is a **software device**: ratios are meaningful, absolute times hardly. The thesis's times are from a GeForce GTX \
                 780 and only show how times grow.\n\n";
    } else {
        page += "The thesis's times are from a GeForce GTX 780.\n\n";
    }
    for line in headlines(gpu, results) {
        page += &format!("- {line}\n");
    }
    for table in &results.tables {
        page += &format!("\n{}", table.markdown());
    }
    for (name, plot) in plots(gpu, results) {
        page += &format!("\n![{}]({name}.svg)\n", plot.title);
    }
    page
}

/// Summary sentences: ratios, and on GPUs frames per second.
pub fn headlines(gpu: &Gpu, results: &Results) -> Vec<String> {
    let mut lines = product::headlines(results.table("levels"), results.table("choices"));
    let triangles = results.table("triangles");
    if let Some(last) = triangles.rows.len().checked_sub(1) {
        let of = |column: &str| triangles.number(last, column);
        let ratio = |version: &str| {
            let thesis = of(&format!("thesis {version} / LI")).map_or("-".into(), short);
            format!("{version} {} (thesis {thesis})", of(&format!("{version} / LI")).map_or("-".into(), short))
        };
        let all = VERSIONS.map(|version| ratio(version.0)).join(", ");
        lines.push(format!(
            "{} triangles, frame time relative to direct light only: {all}.",
            of("triangles").unwrap_or(0.0)
        ));
        if let (false, Some(ms), Some(thesis)) = (gpu.is_software(), of("DG8 [ms]"), of("thesis DG8 [ms]")) {
            lines.push(format!(
                "At this count DG8 runs at {} frames/s (thesis {}).",
                short(1e3 / ms),
                short(1e3 / thesis)
            ));
        }
    }
    let pairs = results.table("pairs");
    for lobes in ["D", "DG"] {
        let rows = (0..pairs.rows.len()).filter(|row| pairs.has(*row, lobes));
        let rate = |row: &usize| pairs.number(*row, "compute [G pairs/s]").unwrap_or(0.0);
        if let Some(best) = rows.max_by(|a, b| rate(a).total_cmp(&rate(b))) {
            let of = |column: &str| pairs.number(best, column).unwrap_or(0.0);
            let thesis = thesis::pairs_per_flop().filter(|_| lobes == "D");
            let thesis =
                thesis.map_or(String::new(), |thesis| format!("; thesis, whole frames: {}", short(1e3 * thesis)));
            lines.push(format!(
                "Gather {lobes}, compute, at best ({} caches, {} VALs): {} G pairs/s, {} % of the arithmetic peak ({} G pairs/s per \
                 TFLOP/s{thesis}), {} % of the native kernel's {}; fragment {} %.",
                of("caches"),
                of("VALs"),
                short(rate(&best)),
                short(100.0 * of("share of peak")),
                short(rate(&best) * 1e12 / results.peak),
                short(100.0 * of("compute / native")),
                short(of("native [G pairs/s]")),
                short(100.0 * of("fragment / native"))
            ));
        }
    }
    lines.extend(scaling::headlines(results.table("growth")));
    lines.extend(small_scenes(pairs));
    lines.extend(culling(results.table("culling")));
    lines.extend(motion::headlines(results.table("motion")));
    lines.extend(views::headlines(results.table("views")));
    lines
}

/// How well few caches occupy the device.
fn small_scenes(pairs: &Table) -> Option<String> {
    let with = |row: usize| Some((pairs.number(row, "caches")?, pairs.number(row, "compute [G pairs/s]")?));
    let usual = |row: &usize| pairs.has(*row, "DG") && pairs.number(*row, "VALs") == Some(16_384.0);
    let rows: Vec<(f64, f64)> = (0..pairs.rows.len()).filter(usual).filter_map(with).collect();
    let (least, best) = (rows.first()?, rows.iter().map(|row| row.1).fold(0.0, f64::max));
    let share = short(100.0 * least.1 / best);
    Some(format!(
        "Gather DG, compute, 16 384 VALs: {} caches reach {share} % of the best count's pairs per second.",
        least.0
    ))
}

/// Cost of culling and gather for the largest cache count, if a part of the caches is live.
fn culling(table: &Table) -> Option<String> {
    let most = (0..table.rows.len()).filter_map(|row| table.number(row, "caches")).fold(0.0, f64::max);
    let of = |order: &str, path: &str| {
        let is_it =
            |row: &usize| table.number(*row, "caches") == Some(most) && table.has(*row, order) && table.has(*row, path);
        let row = (0..table.rows.len()).find(is_it)?;
        Some((short(100.0 * table.number(row, "share")?), short(100.0 * table.number(row, "(cull + gather) / all")?)))
    };
    let ((share, compute), (_, near)) = (of("random", "compute")?, of("near", "compute")?);
    let ((texels, fragment), (_, fragment_near)) = (of("random", "fragment")?, of("near", "fragment")?);
    Some(format!(
        "With {share} % of {most} caches live in random order, culling and gather take {compute} % of the time for lighting all \
         caches by compute, and {fragment} % by fragments, which light {texels} % of them (two per texel); in the bake's order \
         {near} % and {fragment_near} %."
    ))
}

fn plots(gpu: &Gpu, results: &Results) -> Vec<(&'static str, Plot)> {
    let device = if gpu.is_software() { format!("{}, software", gpu.report().name) } else { gpu.report().name.clone() };
    let plot = |title: &str, x: &str, y: &str, series: Vec<Series>| {
        let axis = |label: &str| Axis { label: label.into(), names: Vec::new() };
        Plot { title: title.into(), x: axis(x), y: axis(y), series, front: false, size: [760.0, 420.0] }
    };
    let line = |table: &Table, name: String, x: &str, y: &str, color: usize, wanted: &dyn Fn(usize) -> bool| {
        let marks = table.pairs(x, y, wanted).into_iter().map(|(x, y)| Mark { x, y, label: String::new() }).collect();
        Series { name, marks, line: true, color }
    };
    let all = |_: usize| true;

    let triangles = results.table("triangles");
    let names = ["LI"].into_iter().chain(VERSIONS.map(|version| version.0));
    let times = names
        .enumerate()
        .map(|(color, name)| line(triangles, name.into(), "triangles", &format!("{name} [ms]"), color, &all));
    let ratios = VERSIONS.iter().enumerate().flat_map(|(i, (name, ..))| {
        let column = format!("{name} / LI");
        let thesis = format!("thesis {column}");
        [
            line(triangles, (*name).into(), "triangles", &column, i, &all),
            line(triangles, format!("thesis {name}"), "triangles", &thesis, i + 4, &all),
        ]
    });
    let bakes = ["bake of 8 [s]", "bake of 16 [s]"].into_iter().enumerate().map(|(color, column)| {
        let name = column.trim_end_matches(" [s]").to_owned();
        line(results.table("bake"), name, "triangles", column, color, &all)
    });
    let resolution = with_pixels(results.table("resolution"));
    let sizes = ["LI", "GI", "thesis LI", "thesis GI"]
        .into_iter()
        .enumerate()
        .map(|(color, name)| line(&resolution, name.into(), "pixels", &format!("{name} [ms]"), color, &all));
    let caches = results.table("caches");
    let mut counts: Vec<f64> = (0..caches.rows.len()).filter_map(|row| caches.number(row, "VALs")).collect();
    counts.sort_by(f64::total_cmp);
    counts.dedup();
    let gathers = ["D", "DG"].into_iter().enumerate().flat_map(|(i, lobes)| {
        let all: Vec<Series> = counts
            .iter()
            .enumerate()
            .map(|(j, vals)| {
                let wanted = |row| caches.has(row, lobes) && caches.number(row, "VALs") == Some(*vals);
                line(caches, format!("{lobes}, {vals} VALs"), "caches", "gather [ms]", 4 * i + j % 4, &wanted)
            })
            .collect();
        all
    });
    let on_device = |title: &str| format!("{title}: {device}");
    let mut all = vec![
        ("triangles", plot(&on_device("Triangles"), "triangles", "GPU time [ms]", times.collect())),
        ("ratios", plot(&on_device("Frame time over direct light only"), "triangles", "ratio", ratios.collect())),
        ("bake", plot("Bake, on the CPU", "triangles", "time [s]", bakes.collect())),
        ("resolution", plot(&on_device("Resolution"), "pixels", "GPU time [ms]", sizes.collect())),
        ("caches", plot(&on_device("Gather"), "caches", "GPU time [ms]", gathers.collect())),
    ];
    all.iter_mut().for_each(|(_, plot)| plot.series.retain(|series| !series.marks.is_empty()));
    all
}

/// The table of resolutions with an added column of pixel counts.
fn with_pixels(table: &Table) -> Table {
    let mut table = table.clone();
    table.columns.push("pixels".into());
    for row in 0..table.rows.len() {
        let pixels = table.number(row, "width").zip(table.number(row, "height")).map(|(w, h)| w * h);
        table.rows[row].push(Cell::from(pixels));
    }
    table
}
