//! Golden pictures: small pictures of our own scenes in `tests/goldens`, compared by FLIP. They check what no formula
//! covers: whether a whole picture still looks the same.
//!
//! `LIGHTSKIN_BLESS=1 cargo test --test lightskin -- goldens` renews them. Look at them before committing. Other
//! drivers round differently, so pictures are compared only on the driver that drew them, which `driver.txt` names.

use glam::{DAffine3, Vec3, vec3};
use lightskin::bake::{self, Density};
use lightskin::frame::{LightShadows, Shadows, View, World};
use lightskin::gpu::Gpu;
use lightskin::image::{read_picture, write_png};
use lightskin::lab::knobs::{Frame, Gi, Knobs};
use lightskin::lab::scenes::{Shadowed, moving};
use lightskin::metrics::display::Values;
use lightskin::metrics::flip::{PIXELS_PER_DEGREE, flip};
use lightskin::metrics::heat::{Scale, colors};
use lightskin::scene::build::{CornellSurface, atrium, cornell, quad};
use lightskin::scene::sky::Sky;
use lightskin::scene::{Material, Scene, tessellate};
use std::fs;
use std::path::{Path, PathBuf};

use crate::common::frames::{add, corner, phong};
use crate::common::{assert_clean, gpu};

/// Largest mean FLIP of an unchanged picture. The same driver gives the same bits, and FLIP is 0. A software driver,
/// however, compiles for the CPU it runs on and rounds differently on another CPU: up to 0.0035 between two machines.
/// The limit allows codes that are off by one in a fifth of the pixels. Off by one in all pixels is 0.03, and one
/// percent more light is 0.02.
const MOST: f64 = 0.006;

/// Largest size of all pictures together [bytes]. They stay in the repository's history.
const MOST_BYTES: u64 = 64 << 10;

/// Width and height of the pictures [pixels].
const SIZE: [u32; 2] = [96, 64];

/// Requested number of caches.
const CACHES: usize = 300;

/// One golden picture.
struct Golden {
    /// Name of its file, without extension.
    name: &'static str,
    scene: Scene,
    /// Time in the first animation [s]. At rest if there is none.
    time: Option<f64>,
    knobs: Knobs,
    /// Whether caches are averaged at pixels.
    cells: bool,
}

/// The Cornell box, lit only by an emissive surface below its ceiling.
fn lamp_in_a_room() -> Scene {
    let mut scene = cornell(CornellSurface::Diffuse, 0.1);
    scene.lights.clear();
    let lamp = quad(vec3(-0.3, 1.95, -0.3), Vec3::X * 0.6, Vec3::Z * 0.6, 0.6);
    let shining = Material { emissive: Vec3::splat(100.0), ..phong([0.0; 3], [0.0; 3], 1.0) };
    add(&mut scene, lamp, shining, DAffine3::IDENTITY);
    scene
}

/// A floor, a wall and a ball under a sky that is brighter at the top.
fn corner_under_a_sky() -> Scene {
    let mut scene = corner(&[], 30.0);
    let row = |y: u32| if y < 8 { vec3(1000.0, 2000.0, 4000.0) } else { Vec3::splat(300.0) };
    Sky::new(32, 16, (0..32 * 16).map(|i| row(i / 32)), 0.0).put_over(&mut scene, 16);
    scene
}

fn goldens() -> Vec<Golden> {
    let default = Knobs { rsm: 64, light_shadows: LightShadows::Maps(512), ..Knobs::plain(SIZE) };
    let per_light = Knobs { shadows: Shadows::PerLight, ..default };
    let golden = |name, scene, knobs| Golden { name, scene, time: None, knobs, cells: false };
    let (glossy, diffuse) = (cornell(CornellSurface::Glossy, 0.1), cornell(CornellSurface::Diffuse, 0.1));
    let brute_force = Knobs { gi: Gi::BruteForce, ..default };
    let bounces = Knobs { bounces: 3, ..default };
    let proxy = Knobs { shadows: Shadows::Proxy, ..default };
    vec![
        golden("atrium", atrium(), per_light),
        golden("cornell", glossy.clone(), default),
        golden("cornell_brute_force", glossy, brute_force),
        Golden { cells: true, ..golden("cornell_texel_bounces", diffuse, bounces) },
        golden("columns_proxy_shadows", Shadowed::Columns.scene(), proxy),
        golden("lamp", lamp_in_a_room(), per_light),
        golden("sky", corner_under_a_sky(), default),
        Golden { time: Some(1.3), ..golden("moving", moving(0.1), per_light) },
    ]
}

/// Draws a golden picture and returns its RGBA bytes.
fn draw(gpu: &Gpu, golden: Golden) -> Vec<u8> {
    let Golden { name, mut scene, time, knobs, cells } = golden;
    let spacing = tessellate::expected_spacing(&scene, CACHES);
    tessellate::divide(&mut scene, spacing, None);
    let density = Density::Count(CACHES);
    let bake = bake::BakeSettings { density, angle: 60_f32.to_radians(), references: 8 };
    let mut caches = bake::bake(&scene, &bake, &|_, _| {}).expect(name);
    if cells {
        caches = caches.with_cells(&scene).expect(name);
    }
    if let Some(time) = time {
        scene.pose(0, time);
    }
    let world = World::new(gpu, &scene, Some(&caches)).expect(name);
    let mut frame = Frame::new(gpu, &scene, &world, &knobs).expect(name);
    let view = View::new(&scene.cameras[0], knobs.size, world.origin, world.radius);
    let drawn = gpu.frame(|cmd| {
        frame.record(cmd, &world, &view);
        Ok(())
    });
    assert_eq!(drawn.expect(name).problems, [""; 0]);
    gpu.read_image(&frame.picture.output.picture).expect(name)
}

/// Folder of the golden pictures.
fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/goldens")
}

/// Device and driver, as in `driver.txt`.
fn driver(gpu: &Gpu) -> String {
    let report = gpu.report();
    format!("{}\n{}\n", report.name, report.driver)
}

/// Mean FLIP of a picture against its golden. If it is too large, writes a heat map, and the error names the files to
/// look at.
fn compare(picture: &Path, golden: &Path) -> Result<f64, String> {
    let read = |path: &Path| read_picture(path, None).map_err(|error| error.to_string());
    let (shown, kept) = (read(picture)?, read(golden)?);
    if [shown.width, shown.height] != [kept.width, kept.height] {
        return Err(format!("{} differs in size from {}", picture.display(), golden.display()));
    }
    let map = flip(&shown.rgb, &kept.rgb, [kept.width, kept.height], Values::Display, PIXELS_PER_DEGREE);
    let mean = map.iter().sum::<f64>() / map.len() as f64;
    if mean <= MOST {
        return Ok(mean);
    }
    let heat = picture.with_extension("flip.png");
    write_png(&heat, kept.width, kept.height, &colors(&map, Scale::Linear(1.0))).map_err(|error| error.to_string())?;
    let [picture, golden, heat] = [picture, golden, &heat].map(Path::display);
    Err(format!("mean FLIP {mean:.5} above {MOST}\n  now  {picture}\n  kept {golden}\n  FLIP {heat}"))
}

#[test]
fn pictures_look_as_they_did() {
    let gpu = gpu();
    let driver = driver(&gpu);
    let bless = std::env::var_os("LIGHTSKIN_BLESS").is_some();
    let drawn_by = fs::read_to_string(folder().join("driver.txt")).unwrap_or_default();
    if !bless && drawn_by != driver {
        println!(
            "skipped: the goldens were drawn by {drawn_by:?}, but this is {driver:?}; LIGHTSKIN_BLESS=1 renews them"
        );
        return;
    }
    let out = if bless { folder() } else { Path::new(env!("CARGO_TARGET_TMPDIR")).join("goldens") };
    fs::create_dir_all(&out).expect("a folder for pictures");
    let mut wrong = Vec::new();
    for golden in goldens() {
        let (name, [width, height]) = (golden.name, golden.knobs.size);
        let picture = out.join(format!("{name}.png"));
        write_png(&picture, width, height, &draw(&gpu, golden)).expect(name);
        match compare(&picture, &folder().join(format!("{name}.png"))) {
            Ok(mean) => println!("{name}: mean FLIP {mean:.6}"),
            Err(why) => wrong.push(format!("{name}: {why}")),
        }
    }
    assert_clean(&gpu);
    if bless {
        fs::write(folder().join("driver.txt"), driver).expect("driver.txt");
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn goldens_are_few_and_small() {
    let names: Vec<String> = goldens().iter().map(|golden| format!("{}.png", golden.name)).collect();
    let mut bytes = 0;
    for entry in fs::read_dir(folder()).expect("tests/goldens") {
        let entry = entry.expect("an entry");
        let name = entry.file_name().into_string().expect("a plain name");
        assert!(name == "driver.txt" || names.contains(&name), "tests/goldens/{name} belongs to no golden: delete it");
        bytes += entry.metadata().expect("a file").len();
    }
    assert!(bytes <= MOST_BYTES, "the goldens have {bytes} bytes: at most {MOST_BYTES}");
}
