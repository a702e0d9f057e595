//! The benchmark: its kernels against references and the device, its scenes, and the files that it writes.

use crate::cli::{fails, folder, left};
use crate::common::frames::{SPOT, baked, corner, small};
use crate::common::{assert_clean, gpu, rounding};
use glam::{DVec3, Vec3};
use lightskin::frame::{Quality, View, Ways};
use lightskin::lab::bench::contexts::{FLOP_PER_PAIR, light_and_caches};
use lightskin::lab::bench::extent::Shown;
use lightskin::lab::bench::measure::{OnDevice, bake, settings, too_large};
use lightskin::lab::bench::native;
use lightskin::lab::bench::scaling::{Growth, Point};
use lightskin::lab::bench::table::{Cell, Table, exponent, power_law};
use lightskin::lab::bench::{self, Extent, simd, thesis};
use lightskin::lab::knobs::{Gi, Knobs};
use lightskin::lab::scenes::valley;
use lightskin::lab::shot;
use lightskin::reference::gather::val_geometry;
use lightskin::reference::phong::{cos_power, mirrored_view};
use lightskin::scene::{LightKind, Scene};
use lightskin::shared::{self, GatherSums};
use pulp::{Arch, Scalar, Simd, WithSimd};
use std::fs;

/// Evaluates exp2 and log2 of one number, in registers of any width.
#[derive(Clone, Copy)]
struct Functions(f32);

impl WithSimd for Functions {
    type Output = [f32; 2];

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> [f32; 2] {
        // The number is in the second of the two registers.
        let x = [simd.splat_f32s(1.5), simd.splat_f32s(self.0)];
        [simd::exp2(simd, x)[1], simd::log2(simd, x)[1]].map(|y| simd.reduce_max_f32s(y))
    }
}

#[test]
fn powers_and_logarithms_are_exact_to_a_millionth() {
    let mut worst = [0.0_f64; 2];
    let mut check = |which: usize, x: f32, exact: f64| {
        for found in [Arch::new().dispatch(Functions(x))[which], Functions(x).with_simd(Scalar)[which]] {
            let error = if exact == 0.0 { f64::from(found) } else { (f64::from(found) / exact - 1.0).abs() };
            assert!(error <= 1e-6, "of {x}: {found} instead of {exact}");
            worst[which] = worst[which].max(error);
        }
    };
    for i in 0..=20_000 {
        let x = -100.0 + 227.0 * i as f32 / 20_000.0;
        check(0, x, f64::from(x).exp2());
        // Values of all magnitudes, and values around 1, where the logarithm is near zero.
        for x in [(0.0122 * (i as f32 - 10_000.0)).exp2(), 1.0 + 1e-6 * (i as f32 - 10_000.0)] {
            check(1, x, f64::from(x).log2());
        }
    }
    check(0, -100.0, (-100_f64).exp2());
    // Arguments below -100 count as -100.
    let [least, less] = [-100.0, -1e9].map(|x| Arch::new().dispatch(Functions(x))[0]);
    assert_eq!(least, less);
    eprintln!("largest relative errors: exp2 {:e}, log2 {:e}", worst[0], worst[1]);
}

/// VALs, caches, eye position and proxies of a frame.
struct Gathered {
    vals: Vec<shared::Val>,
    caches: Vec<shared::Cache>,
    eye: glam::Vec4,
    proxies: Vec<shared::Proxy>,
}

fn gathered(scene: &Scene, set: &lightskin::bake::CacheSet, settings: &Knobs) -> Gathered {
    let gpu = gpu();
    let on_device = OnDevice::new(&gpu, scene, Some(set)).expect("uploaded");
    let mut frame = on_device.frame(settings).expect("a frame");
    let times = on_device.times(&mut frame, 0, 1).expect("drawn");
    assert_eq!(times.problems, [""; 0]);
    assert!(times.frame() > times.stage("gather").expect("a gather"));
    let (vals, caches) = light_and_caches(&gpu, &frame.light).expect("read back");
    let proxies = &frame.light.caches().expect("caches").proxies.buffer;
    let mut proxies: Vec<shared::Proxy> = gpu.read(proxies).expect("read back");
    proxies.truncate(caches.len());
    assert_clean(&gpu);
    let eye = View::new(&scene.cameras[0], settings.size, on_device.world.origin, on_device.world.radius).eye;
    Gathered { vals, caches, eye, proxies }
}

/// A corner under three kinds of lights. The numbers of VALs and caches are not multiples of tile sizes and register
/// widths.
fn odd_corner(exponent: f32) -> Gathered {
    let scene = corner(&[SPOT, LightKind::Point, LightKind::Directional], exponent);
    let all = gathered(&scene, &baked(&scene, 0.5, 8), &Knobs { rsm: 33, ..small() });
    assert!(
        all.vals.len().is_multiple_of(2) && !all.vals.len().is_multiple_of(256) && !all.caches.len().is_multiple_of(16)
    );
    all
}

#[test]
fn native_sums_are_the_references() {
    for exponent in [1.0, 40.0, 500.0] {
        let mut all = odd_corner(exponent);
        all.vals.pop();
        let sums = native::gather(&all.vals, &all.caches, all.eye, true);
        let mut worst = 0.0_f64;
        for (cache, sums) in all.caches.iter().zip(&sums) {
            let at = shot::cache(cache, DVec3::ZERO);
            let mirrored = mirrored_view(at.position, at.normal, all.eye.truncate().as_dvec3());
            // The exact sums, and the sums of the terms' magnitudes.
            let (mut exact, mut size) = ([0.0_f64; 15], [0.0_f64; 15]);
            for val in &all.vals {
                let weight = f64::from(val.weight);
                let val = shot::val(val, DVec3::ZERO);
                let (g, direction) = val_geometry(at.position, at.normal, &val);
                let (d, lobe) = (val.position - at.position, cos_power(at.exponent, mirrored.dot(direction)));
                let (w, e) = (weight * g, val.flux * g);
                let diffuse = [d.x * w, d.y * w, d.z * w, w, e.x, e.y, e.z, w * d.length_squared()];
                let glossy = [0, 1, 2, 3, 4, 5, 6].map(|i| diffuse[i] * lobe);
                for (i, term) in diffuse.into_iter().chain(glossy).enumerate() {
                    exact[i] += term;
                    size[i] += term.abs();
                }
            }
            let found: [f32; 16] = bytemuck::cast(*sums);
            for i in 0..15 {
                // Below 1e-20 the lobe is the kernel's smallest power of two.
                let error = (f64::from(found[i]) - exact[i]).abs() / size[i].max(1e-20);
                // The error of the cosine grows with the exponent.
                assert!(error <= 1e-5 + 1e-6 * f64::from(exponent), "sum {i}: {} instead of {}", found[i], exact[i]);
                worst = worst.max(error);
            }
        }
        assert!(sums.iter().filter(|sums| sums.glossy_weight > 1e-12).count() > 5);
        eprintln!("k {exponent}: {} caches, largest error {worst:e}", sums.len());
        let diffuse = native::gather(&all.vals, &all.caches, all.eye, false);
        for (without, with) in diffuse.iter().zip(&sums) {
            let dark =
                GatherSums { glossy_position: Vec3::ZERO, glossy_weight: 0.0, glossy_irradiance: Vec3::ZERO, ..*with };
            assert_eq!(*without, dark);
        }
    }
}

#[test]
fn native_sums_make_the_devices_proxies() {
    let bound = 1e-4 * rounding(&gpu());
    let all = odd_corner(40.0);
    let sums = native::gather(&all.vals, &all.caches, all.eye, true);
    let (mut compared, mut worst) = ([0; 2], 0.0_f64);
    for ((cache, proxy), sums) in all.caches.iter().zip(&all.proxies).zip(&sums) {
        let at = shot::cache(cache, DVec3::ZERO);
        let mirrored = mirrored_view(at.position, at.normal, all.eye.truncate().as_dvec3());
        let mut check = |lobe: usize, mean: DVec3, irradiance: DVec3, position: Vec3, facing: Vec3| {
            let direction = mean.normalize();
            let moved = (position.as_dvec3() - at.position).distance(mean) / mean.length();
            let brighter = (facing.as_dvec3() * at.normal.dot(direction)).distance(irradiance) / irradiance.length();
            assert!(
                moved.max(brighter) < bound,
                "lobe {lobe}: moved {moved:e}, relative irradiance error {brighter:e}"
            );
            compared[lobe] += 1;
            worst = worst.max(moved).max(brighter);
        };
        let irradiance = sums.diffuse_irradiance.as_dvec3();
        if proxy.diffuse_distance2 > 0.0 {
            let mean = sums.diffuse_position.as_dvec3() / f64::from(sums.diffuse_weight);
            check(0, mean, irradiance, proxy.diffuse_position, proxy.diffuse_irradiance);
        }
        // Darker lobes fall below the smallest number of the host kernel or the device.
        if proxy.glossy_distance2 > 0.0 && sums.glossy_weight > 1e-12 * sums.diffuse_weight {
            let mean = sums.glossy_position.as_dvec3() / f64::from(sums.glossy_weight);
            let lobe = cos_power(at.exponent, mirrored.dot(mean.normalize()));
            let arrived = (sums.glossy_irradiance.as_dvec3() / lobe).min(irradiance);
            check(1, mean, arrived, proxy.glossy_position, proxy.glossy_irradiance);
        }
    }
    eprintln!("{compared:?} of {} caches, largest error {worst:e}", all.caches.len());
    assert!(compared[0] * 2 > all.caches.len() && compared[1] > 10, "{compared:?} of {}", all.caches.len());
}

#[test]
fn valleys_have_the_triangles_that_are_asked_for() {
    for count in [800, 3200, 12_800, 51_200, 102_400, 150_000, 204_800] {
        let scene = valley(count, count == 800);
        assert_eq!(scene.triangle_count(), count);
        let mesh = &scene.meshes[0];
        for triangle in 0..count {
            let [a, b, c] = mesh.triangle(triangle).map(|corner| mesh.vertices[corner]);
            let cross = (b.position - a.position).cross(c.position - a.position);
            let longest = (b.position - a.position).length_squared().max((c.position - a.position).length_squared());
            assert!(cross.length() > 0.1 * longest, "{count}: sliver {triangle}");
            assert!(cross.normalize().dot(a.normal) > 0.9, "{count}: normal of {triangle}");
        }
    }
    assert_eq!(valley(801, false).triangle_count(), 800);
}

#[test]
fn every_val_of_a_valley_is_lit_and_lights() {
    for rsm in [32, 128] {
        let scene = valley(3200, true);
        let all = gathered(
            &scene,
            &bake(&scene, 60, 8).expect("baked").0,
            &settings([16, 9], Gi::LightSkin, rsm, Ways::default()),
        );
        assert_eq!(all.vals.len(), (rsm * rsm) as usize);
        assert!(all.vals.iter().all(|val| val.weight > 0.0), "{rsm}: a dark VAL");
        assert!(all.proxies.iter().all(|proxy| proxy.diffuse_distance2 > 0.0), "{rsm}: a dark cache");
    }
}

#[test]
fn numbers_of_the_thesis_are_found_by_their_row_and_column() {
    let table = |text: &'static str, key: &[u32], column: &str| thesis::frame_ms(text, key, column);
    assert_eq!(table(thesis::TRIANGLES, &[800], "LI"), Some(1000.0 / 1554.4));
    assert_eq!(table(thesis::TRIANGLES, &[6_553_600], "DG16"), Some(1000.0 / 16.2));
    assert_eq!(table(thesis::RESOLUTION, &[1280, 720], "GI"), Some(1000.0 / 414.5));
    assert_eq!(table(thesis::CACHES, &[16_000], "DG_262144"), Some(1000.0 / 5.2));
    assert_eq!(table(thesis::CACHES, &[250], "DGS_4096"), Some(1000.0 / 709.8));
    assert_eq!(table(thesis::RESOLUTION, &[1280, 721], "GI"), None);
    assert_eq!(table(thesis::TRIANGLES, &[800], "DGS"), None);
    // The thesis contains every point of the full extent.
    let Extent { triangles, resolutions, caches, rsm, .. } = Extent::full();
    assert!(triangles.iter().all(|n| table(thesis::TRIANGLES, &[*n as u32], "D8").is_some()));
    assert!(resolutions.iter().all(|size| table(thesis::RESOLUTION, size, "LI").is_some()));
    for (caches, rsm) in caches.iter().flat_map(|caches| rsm.iter().map(move |rsm| (caches, rsm))) {
        assert!(table(thesis::CACHES, &[*caches as u32], &format!("D_{}", rsm * rsm)).is_some());
    }
}

#[test]
fn exponents_of_power_laws_are_found() {
    let points: Vec<(f64, f64)> = [2.0_f64, 3.0, 10.0].map(|x| (x, 3.0 * x.powf(1.5))).into();
    assert!((exponent(&points).expect("a slope") - 1.5).abs() < 1e-12);
    assert_eq!(exponent(&[(2.0, 1.0), (2.0, 3.0)]), None);
    assert_eq!(exponent(&[]), None);
}

/// Times on the benchmark's grid, without the last `missing` points.
fn grid(ms: impl Fn(f64, f64) -> f64, missing: usize) -> Vec<Point> {
    let counts = [252.0, 1010.0, 3991.0, 15_906.0];
    let points = counts.into_iter().flat_map(|caches| [4096.0, 16_384.0, 65_536.0].map(|vals| (caches, vals)));
    points.take(12 - missing).map(|(caches, vals)| Point { caches, vals, ms: ms(caches, vals) }).collect()
}

#[test]
fn exponents_of_two_quantities_are_found() {
    // The fit finds the powers of both quantities for any missing corner of the grid, overall and in each row and
    // column.
    for (missing, [caches, vals]) in [(0, [1.0, 1.0]), (0, [0.9, 1.1]), (1, [1.02, 0.97]), (2, [0.5, 2.0])] {
        let points = grid(|c, v| 3e-6 * c.powf(caches) * v.powf(vals), missing);
        let growth = Growth::new(&points).expect("enough points");
        let found = [growth.all, [growth.of_caches[0], growth.of_vals[0]], [growth.of_caches[1], growth.of_vals[1]]];
        for [of_caches, of_vals] in found {
            assert!((of_caches - caches).abs() < 1e-9 && (of_vals - vals).abs() < 1e-9, "{missing}: {growth:?}");
        }
        assert!(growth.worst < 1.0 + 1e-9);
    }
    // Rows and columns are fitted separately: the exponent of caches is 0.8 with the fewest VALs and 1 elsewhere.
    let bent = |c: f64, v: f64| v * if v < 5000.0 { c.powf(0.8) } else { c };
    let Growth { all, of_caches, of_vals, worst } = Growth::new(&grid(bent, 0)).expect("enough points");
    assert!((of_caches[0] - 0.8).abs() < 1e-9 && (of_caches[1] - 1.0).abs() < 1e-9, "{of_caches:?}");
    assert!((all[0] - 2.8 / 3.0).abs() < 1e-9 && of_vals[0] < all[1] && all[1] < of_vals[1], "{all:?} {of_vals:?}");
    assert!(worst > 1.1, "{worst}");
    // A fixed cost of a tenth of the least time lowers exponents below 1, most where there is least work.
    let fixed = |c: f64, v: f64| c * v + 0.1 * 252.0 * 4096.0;
    let Growth { all, of_caches, .. } = Growth::new(&grid(fixed, 0)).expect("enough points");
    assert!(all.iter().all(|e| *e > 0.96 && *e < 0.999) && of_caches[0] < all[0], "{all:?} {of_caches:?}");
    // Too few points for a fit.
    assert_eq!(Growth::new(&grid(|c, v| c * v, 10)), None);
    assert_eq!(Growth::new(&[]), None);
    assert_eq!(power_law(&[[1.0, 2.0, 3.0], [2.0, 4.0, 5.0], [3.0, 6.0, 7.0]]), None);
}

/// A small extent with few points, each measured once.
fn tiny() -> Extent {
    Extent {
        name: "tiny",
        shown: Shown::Atrium,
        cell: 0.2,
        levels: vec![Quality::Low],
        level: Quality::Low,
        choices: 2,
        shown_frames: 1,
        size: [32, 18],
        window: [48, 27],
        triangles: vec![800, 3200],
        resolutions: vec![[40, 30], [256, 256]],
        caches: vec![60, 120, 250],
        rsm: vec![8, 64],
        culled: vec![(800, 100)],
        scaling: (vec![60, 120, 250], vec![8, 16, 32]),
        crowds: vec![3],
        ground: 800,
        warm_up: 0,
        frames: 1,
        pipelines: 1,
        rounds: 0.0,
        budget: 300.0,
    }
}

fn numbers(cells: &[Cell]) -> Vec<String> {
    let text = |cell: &Cell| match cell {
        Cell::Empty => String::new(),
        Cell::Text(text) => text.clone(),
        Cell::Number(number) => number.to_string(),
    };
    cells.iter().map(text).collect()
}

#[test]
fn a_bench_writes_tables_plots_and_the_same_numbers_everywhere() {
    let gpu = gpu();
    let at = folder("bench-tiny");
    let results = bench::run(&gpu, &tiny(), &|part, _| assert!((0.0..=1.0).contains(&part))).expect("measured");
    bench::write(&at, &gpu, &results).expect("written");
    assert_eq!(results.problems, [""; 0]);
    assert_clean(&gpu);

    let tables = [
        "bake",
        "caches",
        "choices",
        "culling",
        "exponents",
        "growth",
        "levels",
        "motion",
        "scaling",
        "stages",
        "pairs",
        "resolution",
        "subsurface",
        "triangles",
        "views",
    ];
    let plots = ["bake", "caches", "ratios", "resolution", "triangles"];
    let mut files: Vec<String> = tables.map(|name| format!("{name}.csv")).into();
    files.extend(plots.map(|name| format!("{name}.svg")));
    files.extend(["bench.json", "bench.md"].map(str::to_owned));
    files.sort();
    assert_eq!(left(&at), files);

    let read = |name: &str| fs::read_to_string(at.join(name)).expect("a file");
    let json: serde_json::Value = serde_json::from_str(&read("bench.json")).expect("JSON");
    assert_eq!(json["device"]["name"], gpu.report().name);
    assert_eq!(json["device"]["software"], gpu.is_software());
    let cpu = json["cpu"].as_str().expect("the CPU's name");
    assert!(!cpu.is_empty() && read("bench.md").contains(&format!("CPU: {cpu}, ")), "{cpu}");
    let counts = [
        ("levels", 1),
        ("choices", 2),
        ("subsurface", 2),
        ("triangles", 2),
        ("bake", 2),
        ("stages", 10),
        ("resolution", 2),
        ("caches", 18),
        ("pairs", 12),
        ("culling", 4),
        ("scaling", 18),
        ("growth", 4),
        ("motion", 2),
        ("views", 4),
        ("exponents", 4),
    ];
    assert_eq!(json["tables"].as_array().expect("tables").len(), counts.len());
    for (i, (name, rows)) in counts.into_iter().enumerate() {
        let (table, kept) = (&results.tables[i], &json["tables"][i]);
        assert_eq!((table.name, kept["name"].as_str()), (name, Some(name)));
        assert_eq!(table.skipped, [""; 0], "{name}");
        let csv = read(&format!("{name}.csv"));
        let lines: Vec<Vec<&str>> = csv.lines().map(|line| line.split(',').collect()).collect();
        assert_eq!(lines[0], kept["columns"].as_array().expect("columns").iter().collect::<Vec<_>>());
        assert_eq!(lines.len(), rows + 1, "{name}");
        for (line, row) in lines[1..].iter().zip(&table.rows) {
            assert_eq!(*line, numbers(row), "{name}");
        }
        for (line, row) in lines[1..].iter().zip(kept["rows"].as_array().expect("rows")) {
            for (cell, value) in line.iter().zip(row.as_array().expect("a row")) {
                match value.as_f64() {
                    Some(number) => assert_eq!(cell.parse(), Ok(number), "{name}"),
                    None => assert_eq!(*cell, value.as_str().unwrap_or_default(), "{name}"),
                }
            }
        }
    }
    // The stages of a level add up to its frame. Only a filled body has light inside it.
    let levels = results.table("levels");
    let stages = levels.columns.iter().filter(|column| column.ends_with(" [ms]") && !column.starts_with("camera"));
    let times: Vec<f64> = stages.filter_map(|stage| levels.number(0, stage)).collect();
    assert!((times[0] - times[1..].iter().sum::<f64>()).abs() < 0.002 * times[0], "{times:?}");
    let subsurface = results.table("subsurface");
    let inside = [0, 1].map(|row| subsurface.number(row, "dipole gather [ms]").is_some());
    assert_eq!(inside, [false, true]);
    assert_eq!(subsurface.number(1, "thesis [ms]"), Some(16.0));
    let page = read("bench.md");
    assert!(page.contains(&gpu.report().name) && page.contains(&gpu.report().driver), "{page}");
    assert_eq!(page.contains("**software device**"), gpu.is_software());
    for part in [
        "thesis D8 / LI",
        "column SSS (subsurface scattering)",
        "% of the arithmetic peak",
        "(triangles.svg)",
        "Gather DG grows",
    ] {
        assert!(page.contains(part), "'{part}' is not in {page}");
    }
    check_sense(&results);
}

/// Whether this cell must be empty, because the frame lacks the stage or the thesis lacks the point.
fn is_left_empty(table: &Table, row: usize, column: &str) -> bool {
    let number = |column: &str| table.number(row, column).expect("a number") as u32;
    match (table.name, column) {
        ("stages", "triangles" | "version" | "gbuffer [ms]" | "direct [ms]" | "composite [ms]") => false,
        ("stages", _) => table.has(row, "LI"),
        ("pairs", "glossy off f64") => table.has(row, "D"),
        ("resolution", _) if column.starts_with("thesis") => {
            thesis::frame_ms(thesis::RESOLUTION, &["width", "height"].map(number), "GI").is_none()
        }
        ("caches", "gather [ms]") => table.has(row, "DGS"),
        ("caches", "occlude [ms]" | "of all discs [ms]") => !table.has(row, "DGS"),
        ("caches", "thesis [ms]") => {
            let lobes = &numbers(&table.rows[row])[0];
            thesis::frame_ms(thesis::CACHES, &[number("asked")], &format!("{lobes}_{}", number("VALs"))).is_none()
        }
        // The lowest level has neither of these stages, nor rays.
        ("levels", stage) => ["edges", "mix edges", "depth images", "near rays", "short rays"]
            .iter()
            .any(|lacking| stage.starts_with(lacking)),
        ("subsurface", "dipole gather [ms]" | "scatter [ms]") => table.has(row, "stone"),
        // The thesis lacks the first point, and has fewer than two points of each line.
        ("caches", "thesis / first") | ("exponents", "thesis frame") => true,
        _ => false,
    }
}

/// Conditions that every measurement must meet.
fn check_sense(results: &bench::Results) {
    for table in &results.tables {
        for (row, (at, column)) in
            (0..table.rows.len()).flat_map(|row| table.columns.iter().enumerate().map(move |c| (row, c)))
        {
            let cell = &table.rows[row][at];
            let what = format!("{}, row {row}, {column}: {cell:?}", table.name);
            assert_eq!(*cell == Cell::Empty, is_left_empty(table, row, column), "{what}");
            let Cell::Number(value) = *cell else { continue };
            let is_slope = match table.name {
                "exponents" => column == "frame",
                "growth" => column.starts_with("of ") || column.starts_with("in the "),
                _ => false,
            };
            // A static scene may leave nothing to do.
            let may_be_none = column == "standing and skipped [ms]" && value == 0.0;
            assert!(value > 0.0 || is_slope || may_be_none, "{what}");
        }
    }
    let (triangles, pairs, caches) = (results.table("triangles"), results.table("pairs"), results.table("caches"));
    assert!(results.peak > 1e9, "{} flop/s", results.peak);
    let without_shadows = (0..caches.rows.len()).filter(|row| !caches.has(*row, "DGS"));
    assert_eq!(without_shadows.clone().count(), pairs.rows.len());
    for (row, of_caches) in without_shadows.enumerate() {
        let of = |column: &str| pairs.number(row, column).expect("a number");
        // All figures of a point come from one time, that of the faster path, up to the stored digits.
        let rate = of("compute [G pairs/s]").max(of("fragment [G pairs/s]")) * 1e9;
        let ms = caches.number(of_caches, "gather [ms]").expect("a time");
        let flop = FLOP_PER_PAIR[usize::from(pairs.has(row, "DG"))];
        let (count, share) = (of("caches") * of("VALs"), of("share of peak"));
        assert!(
            (rate * ms * 1e-3 / count - 1.0).abs() < 3e-4,
            "{count} pairs in {ms} ms do not give {rate} pairs per second"
        );
        assert!((rate * flop / results.peak / share - 1.0).abs() < 3e-4, "{share} of the peak for {rate} a second");
        // A pair takes at least the counted operations. The share can exceed 1 only if other tests slowed the
        // measurement of the peak.
        assert!(share < 1.5, "{share} of the peak");
        assert!(of("diffuse off f64") < 1e-5, "row {row}");
        assert!(pairs.number(row, "glossy off f64").is_none_or(|off| off < 1e-3), "row {row}");
    }
    assert_eq!(triangles.number(0, "thesis LI [ms]"), Some(0.64334));
    assert_eq!(caches.number(1, "VALs"), Some(4096.0));
}

#[test]
fn what_there_is_no_time_or_memory_for_is_left_out_and_told() {
    let gpu = gpu();
    let at = folder("bench-hurried");
    let results = bench::run(&gpu, &Extent { budget: 0.0, ..tiny() }, &|_, _| ()).expect("measured");
    bench::write(&at, &gpu, &results).expect("written");
    assert!(results.tables.iter().all(|table| table.rows.is_empty()));
    let page = fs::read_to_string(at.join("bench.md")).expect("a file");
    assert!(page.contains("Left out: 800, 3200 triangles: would take about"), "{page}");
    assert!(page.contains("Left out: DG, 250 caches, 64x64 VALs: would take"), "{page}");
    if cfg!(target_os = "linux") {
        assert!(
            too_large(1 << 40).expect("a message, because no machine has that much memory").contains("GiB of memory")
        );
    }
    assert_eq!(too_large(1), None);
}

#[test]
fn markdown_shows_digits_that_count() {
    let mut table = Table::new("t", "Title", "How.".into(), &["a", "b", "c", "d"]);
    table.push(vec![Cell::from(1234.56), Cell::from(12_345.0), Cell::from(f64::NAN), Cell::from("D")]);
    assert!(table.markdown().contains("| 1235 | 12345 | - | D |"), "{}", table.markdown());
    assert_eq!(table.csv(), "a,b,c,d\n1234.6,12345,,D\n");
}

#[test]
fn bench_refuses_what_it_cannot_do() {
    let at = folder("bench-refuses");
    fails(&at, &["bench", "--quick", "--full"], 2, &["cannot be used with"]);
    fs::write(at.join("file"), "").expect("a file");
    fails(&at, &["bench", "-o", "file"], 1, &["file", "name a folder"]);
    fails(&at, &["bench", "-o", "out", "--device", "no such"], 1, &["no such"]);
}
