//! Everything may change between two frames. After each edit the engine shows the same picture, bit by bit, as an
//! engine made from scratch, and hundreds of changes leave no resources behind.

use glam::{DAffine3, Vec3, dvec3, vec3};
use lightskin::bake::{self, Density};
use lightskin::frame::engine::Loaded;
use lightskin::frame::{
    Antialiasing, Engine, Exposure, LightShadows, Look, Near, Picture, Quality, Settings, Shadows, Tonemap,
};
use lightskin::gpu::{Counters, Gpu};
use lightskin::lab::knobs::{Gi, Knobs, Path};
use lightskin::scene::build::{quad, sphere};
use lightskin::scene::{Image, Light, LightKind, Scene, Texture};

use crate::cli::{folder, works};
use crate::common::frames::{add, baked, corner, phong, small};
use crate::common::{assert_clean, gpu};
use crate::moving::{bend, world};

/// Instance of a rigid ball in `world`.
const BALL: usize = 2;

fn loaded(scene: &Scene, spacing: f64) -> Loaded {
    Loaded { scene: scene.clone(), caches: Some(baked(scene, spacing, 8)) }
}

/// Fits, draws and reads all layers. The result is empty for a picture without pixels.
fn shown(gpu: &Gpu, engine: &mut Engine, picture: &mut Picture, size: [u32; 2], look: &Look) -> Vec<Vec<u32>> {
    engine.fit(gpu, &mut [(picture, size)]).expect("fits");
    let camera = engine.scene().cameras[0].clone();
    let view = engine.view(&camera, size);
    let drawn = gpu.frame(|cmd| {
        engine.record(cmd, &mut [(view, picture)], look);
        Ok(())
    });
    assert_eq!(drawn.expect("drawn").problems, [""; 0]);
    if picture.is_empty() {
        return Vec::new();
    }
    let Picture { surface, indirect, output, .. } = picture;
    let mut images = vec![&surface.radiance, &surface.normal, &output.picture];
    images.extend(indirect.iter().flat_map(|i| [Some(&i.diffuse), i.glossy.as_ref()]).flatten());
    images.into_iter().map(|image| gpu.read_image(image).expect("read")).collect()
}

/// Pseudorandom numbers, the same in every run.
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % n
    }
    fn number(&mut self) -> f32 {
        self.below(1 << 16) as f32 / 65_536.0
    }
}

fn lamp(random: &mut Random) -> Light {
    Light {
        name: "lamp".into(),
        kind: [LightKind::Point, LightKind::Directional, LightKind::Spot { inner: 0.3, outer: 0.7 }][random.below(3)],
        color: vec3(random.number(), 0.5, random.number()),
        intensity: 10.0,
        range: None,
        radius: 0.0,
        position: dvec3(random.number().into(), 1.5, random.number().into()),
        direction: vec3(random.number() - 0.5, -1.0, random.number() - 0.5).normalize(),
    }
}

/// Applies edit number `what` to the scene. Returns true if the edit needs other caches.
fn edit(scene: &mut Scene, random: &mut Random, what: usize) -> bool {
    let material = &mut scene.materials[1];
    match what {
        0 => scene.lights.push(lamp(random)),
        1 => drop(scene.lights.pop()),
        2 if !scene.lights.is_empty() => scene.lights[0] = lamp(random),
        3 => material.base_color = vec3(random.number(), random.number(), 0.5).extend(1.0),
        4 => material.alpha_cutoff = if material.alpha_cutoff.is_some() { None } else { Some(0.5) },
        5 => {
            material.phong =
                Some(lightskin::scene::Phong { specular: Vec3::splat(0.2 * random.number()), exponent: 9.0 })
        }
        6 => {
            let texels = (0..64).map(|_| (random.number() * 255.0) as u8).collect();
            scene.images.push(Image { name: "noise".into(), width: 4, height: 4, rgba: texels });
            material.base_color_texture = Some(Texture {
                image: scene.images.len() - 1,
                uv_set: 0,
                transform: glam::Affine2::IDENTITY,
                sampler: Default::default(),
            });
        }
        7 => material.emissive = Vec3::splat(if material.emissive == Vec3::ZERO { 50.0 } else { 0.0 }),
        8 => scene.instances[BALL].world_from_model.translation.x += 0.1 * f64::from(random.number() - 0.5),
        9 => bend(scene, f64::from(random.number()), random.number()),
        10 => {
            let place = DAffine3::from_translation(dvec3(random.number().into(), 0.4, random.number().into()));
            add(scene, sphere(0.15, 4), phong([0.6, 0.2, 0.2], [0.1; 3], 12.0), place);
            return true;
        }
        11 => {
            let mut instance = scene.instances[BALL].clone();
            instance.world_from_model.translation.z += 0.5;
            scene.instances.push(instance);
            return true;
        }
        12 => {
            if scene.instances.len() > 5 {
                scene.instances.pop();
            }
            return true;
        }
        _ => {}
    }
    false
}

/// Settings of every kind.
fn kinds() -> Vec<Settings> {
    let base = Knobs { cull: true, reuse: true, rsm: 16, light_shadows: LightShadows::Maps(64), ..small() };
    let knobs = [
        base,
        Knobs { shadows: Shadows::PerLight, ..base },
        Knobs { shadows: Shadows::Proxy, rsm: 24, ..base },
        Knobs { path: Path::DRAWS, ..base },
        Knobs { path: Path::Clusters(lightskin::frame::ClusterRule::Distance(4.0)), ..base },
        Knobs { bounces: 2, ..base },
        Knobs { gi: Gi::BruteForce, ..base },
        Knobs { gi: Gi::Off, light_shadows: LightShadows::Maps(128), ..base },
        Knobs { cull: false, ..base },
        Knobs { shadows: Shadows::PerLight, near: Near::Rays { per_pixel: 4, every: 2 }, ..base },
        Knobs { antialiasing: Antialiasing::Four, near: Near::Rays { per_pixel: 4, every: 2 }, ..base },
        Knobs { gi: Gi::Off, antialiasing: Antialiasing::Eight, ..base },
        Knobs { antialiasing: Antialiasing::Fast, ..base },
        Knobs { light_shadows: LightShadows::Rays, ..base },
        Knobs { gi: Gi::Off, light_shadows: LightShadows::Rays, antialiasing: Antialiasing::Four, ..base },
    ];
    knobs.iter().map(Knobs::settings).collect()
}

/// A random walk through scenes, caches, settings, sizes and looks. After each step the picture must be that of a new
/// engine.
#[test]
fn edits_at_run_time_show_what_a_new_engine_shows() {
    let gpu = gpu();
    let mut random = Random(5);
    let kinds = kinds();
    let sizes = [[40, 30], [40, 30], [64, 20], [0, 0], [17, 0], [8, 96]];
    let looks = [
        Look::default(),
        Look { tonemap: Tonemap::Agx, exposure: Exposure::Ev(3.0), ..Look::default() },
        Look { tonemap: Tonemap::Linear, exposure: Exposure::Ev(6.0), ..Look::default() },
    ];
    let mut spacing = 0.4;
    let mut now = loaded(&world(), spacing);
    let (mut settings, mut size, mut look) = (kinds[0], sizes[0], looks[0]);
    let clone = |l: &Loaded| Loaded { scene: l.scene.clone(), caches: l.caches.clone() };
    let mut engine = Engine::new(&gpu, clone(&now), &settings).expect("made");
    let mut picture = engine.picture(&gpu, size).expect("made");
    for step in 0..60 {
        match random.below(8) {
            0..=3 => {
                let what = random.below(13);
                let mut scene = now.scene.clone();
                if edit(&mut scene, &mut random, what) {
                    // Other models need other caches. They are placed in the background while the old scene is shown.
                    now = loaded(&scene, spacing);
                    engine.start(move |progress| {
                        let settings = bake_settings(spacing);
                        let caches = bake::bake(&scene, &settings, &|done, what| progress.set(done, what))?;
                        Ok(Loaded { scene, caches: Some(caches) })
                    });
                    assert!(engine.progress().is_some());
                    shown(&gpu, &mut engine, &mut picture, size, &look);
                    assert!(engine.wait(&gpu).expect("baked"));
                } else {
                    engine.edit(&gpu, |scene_now| *scene_now = scene.clone()).expect("edited");
                    now.scene = scene;
                }
            }
            4 => settings = kinds[random.below(kinds.len())],
            5 => size = sizes[random.below(sizes.len())],
            6 => look = looks[random.below(looks.len())],
            _ => {
                spacing = [0.3, 0.4, 0.6][random.below(3)];
                now.caches = Some(baked(&now.scene, spacing, 8));
                let scene = engine.scene().clone();
                engine.start(move |_| {
                    let caches = bake::bake(&scene, &bake_settings(spacing), &|_, _| {})?;
                    Ok(Loaded { scene: (*scene).clone(), caches: Some(caches) })
                });
                while !engine.poll(&gpu).expect("baked") {
                    shown(&gpu, &mut engine, &mut picture, size, &look);
                }
            }
        }
        engine.set(&settings);
        let found = shown(&gpu, &mut engine, &mut picture, size, &look);
        let mut scratch = Engine::new(&gpu, clone(&now), &settings).expect("made");
        let mut other = scratch.picture(&gpu, size).expect("made");
        assert!(found == shown(&gpu, &mut scratch, &mut other, size, &look), "step {step}: {settings:?} {size:?}");
    }
    assert_clean(&gpu);
}

fn bake_settings(spacing: f64) -> bake::BakeSettings {
    bake::BakeSettings { density: Density::Spacing(spacing), angle: 0.5 * std::f32::consts::FRAC_PI_2, references: 8 }
}

/// Loads another scene, which is shown at once, and then the first one again.
#[test]
fn another_scene_is_shown_at_once() {
    let gpu = gpu();
    let mut room = Scene { cameras: world().cameras, ..Scene::default() };
    add(
        &mut room,
        quad(vec3(-1.0, 0.0, -1.0), Vec3::X * 2.0, Vec3::Z * -2.0, 0.5),
        phong([0.5; 3], [0.0; 3], 1.0),
        DAffine3::IDENTITY,
    );
    room.lights.push(lamp(&mut Random(1)));
    let settings = kinds()[1];
    let (look, size) = (Look::default(), [32, 24]);
    let mut engine = Engine::new(&gpu, loaded(&world(), 0.4), &settings).expect("made");
    let mut picture = engine.picture(&gpu, size).expect("made");
    let before = shown(&gpu, &mut engine, &mut picture, size, &look);
    engine.load(&gpu, loaded(&room, 0.3)).expect("loaded");
    let of_room = shown(&gpu, &mut engine, &mut picture, size, &look);
    let mut scratch = Engine::new(&gpu, loaded(&room, 0.3), &settings).expect("made");
    let mut other = scratch.picture(&gpu, size).expect("made");
    assert!(of_room == shown(&gpu, &mut scratch, &mut other, size, &look));
    engine.load(&gpu, loaded(&world(), 0.4)).expect("loaded");
    assert!(before == shown(&gpu, &mut engine, &mut picture, size, &look));
    // A scene with nothing to draw is refused, and the old one stays.
    let nothing = Loaded { scene: Scene::default(), caches: None };
    assert!(engine.load(&gpu, nothing).is_err());
    assert!(before == shown(&gpu, &mut engine, &mut picture, size, &look));
    // Other models without other caches are refused, too.
    assert!(engine.edit(&gpu, |scene| drop(scene.instances.pop())).is_err());
    assert_clean(&gpu);
}

#[test]
fn a_job_that_fails_changes_nothing() {
    let gpu = gpu();
    let (settings, look, size) = (kinds()[0], Look::default(), [16, 16]);
    let mut engine = Engine::new(&gpu, loaded(&world(), 0.5), &settings).expect("made");
    let mut picture = engine.picture(&gpu, size).expect("made");
    let before = shown(&gpu, &mut engine, &mut picture, size, &look);
    engine.start(|_| Err(lightskin::Error::Nothing("no such file".into())));
    assert!(engine.wait(&gpu).is_err());
    assert!(engine.progress().is_none() && !engine.wait(&gpu).expect("nothing to wait for"));
    assert!(before == shown(&gpu, &mut engine, &mut picture, size, &look));
}

/// Sizes from one pixel to 8K, then many small ones, then many settings. Descriptor sets, pools,
/// pipelines and memory do not grow after the first round of each.
#[test]
fn a_hundred_changes_leave_nothing_behind() {
    let gpu = gpu();
    let kinds = kinds();
    let mut engine = Engine::new(&gpu, loaded(&world(), 0.7), &kinds[1]).expect("made");
    let mut picture = engine.picture(&gpu, [1, 1]).expect("made");
    let look = Look::default();
    for size in [[1, 1], [7680, 4320], [0, 0], [3, 1]] {
        engine.fit(&gpu, &mut [(&mut picture, size)]).expect("fits");
    }
    let look_at = |engine: &mut Engine, picture: &mut Picture, size: [u32; 2]| {
        engine.fit(&gpu, &mut [(picture, size)]).expect("fits");
        let camera = engine.scene().cameras[0].clone();
        let view = engine.view(&camera, size);
        let drawn = gpu.frame(|cmd| {
            engine.record(cmd, &mut [(view, picture)], &look);
            Ok(())
        });
        assert_eq!(drawn.expect("drawn").problems, [""; 0]);
    };
    let held = || -> Counters {
        gpu.wait().expect("done");
        gpu.counters()
    };
    let mut after_ten = None;
    for i in 0..60_u32 {
        look_at(&mut engine, &mut picture, [8 + i % 5, 8 + i % 3]);
        if i == 15 {
            after_ten = Some(held());
        }
    }
    assert_eq!(Some(held()), after_ten, "after 60 sizes");
    let mut after_ten = None;
    for i in 0..4 * kinds.len() {
        engine.set(&kinds[i % kinds.len()]);
        look_at(&mut engine, &mut picture, [8, 8]);
        if i + 1 == 2 * kinds.len() {
            after_ten = Some(held());
        }
    }
    // The last settings are of the same kinds as at the first measurement.
    assert_eq!(Some(held()), after_ten, "after four rounds of settings");
    assert_clean(&gpu);
}

#[test]
fn what_a_slider_moves_makes_no_pipeline() {
    let gpu = gpu();
    let settings = Settings { rsm: 32, light_shadows: LightShadows::Maps(64), ..Settings::at(Quality::High, 100) };
    let mut engine = Engine::new(&gpu, loaded(&world(), 0.5), &settings).expect("made");
    let mut picture = engine.picture(&gpu, [16, 16]).expect("made");
    let size = [16, 16];
    shown(&gpu, &mut engine, &mut picture, size, &Look::default());
    let before = gpu.counters().pipelines_made;
    for ev in 0..5 {
        let look = Look { exposure: Exposure::Ev(ev as f32), tonemap: Tonemap::Aces, ..Look::default() };
        shown(&gpu, &mut engine, &mut picture, size, &look);
    }
    for tonemap in [Tonemap::PbrNeutral, Tonemap::Agx, Tonemap::Linear] {
        shown(&gpu, &mut engine, &mut picture, size, &Look { tonemap, ..Look::default() });
    }
    let mut random = Random(3);
    for what in [0, 2, 3, 5, 8, 9, 1] {
        engine
            .edit(&gpu, |scene| {
                edit(scene, &mut random, what);
            })
            .expect("edited");
        shown(&gpu, &mut engine, &mut picture, size, &Look::default());
    }
    // Other sizes of maps and pictures create no pipeline, either.
    engine.set(&Settings { rsm: 48, light_shadows: LightShadows::Maps(128), ..settings });
    shown(&gpu, &mut engine, &mut picture, [30, 20], &Look::default());
    assert_eq!(gpu.counters().pipelines_made, before);
    assert_clean(&gpu);
}

/// Another thread can make the pipelines that other settings need. Light with these settings then makes none, and shows
/// what a new engine shows.
#[test]
fn pipelines_of_other_settings_are_made_ahead() {
    let gpu = gpu();
    gpu.forget_pipelines();
    let (all, size, look) = (kinds(), [16, 16], Look::default());
    let mut engine = Engine::new(&gpu, loaded(&world(), 0.5), &all[0]).expect("made");
    let mut picture = engine.picture(&gpu, size).expect("made");
    shown(&gpu, &mut engine, &mut picture, size, &look);
    let (first, mut ahead) = (gpu.counters().pipelines_made, 0);
    for settings in &all[1..] {
        let before = gpu.counters();
        let missing = engine.missing(&gpu, settings, Some(size)).expect("found");
        assert_eq!(gpu.counters().pipelines_made, before.pipelines_made, "a search makes nothing");
        ahead += u32::from(!missing.is_empty());
        let device = gpu.device().clone();
        std::thread::spawn(move || device.make(missing)).join().expect("ended").expect("made");
        let made = gpu.counters().pipelines_made;
        engine.set(settings);
        let seen = shown(&gpu, &mut engine, &mut picture, size, &look);
        assert_eq!(gpu.counters().pipelines_made, made, "{settings:?}");
        assert!(engine.missing(&gpu, settings, Some(size)).expect("found").is_empty());
        let mut new = Engine::new(&gpu, loaded(&world(), 0.5), settings).expect("made");
        let mut other = new.picture(&gpu, size).expect("made");
        assert!(seen == shown(&gpu, &mut new, &mut other, size, &look), "{settings:?}");
    }
    let made = gpu.counters().pipelines_made - first;
    println!("{made} pipelines made ahead for {ahead} of {} settings", all.len() - 1);
    assert!(ahead > 6 && made > 20, "{ahead} settings, {made} pipelines");
    assert_clean(&gpu);
}

/// Frames with moving and bending bodies create no device objects, including those for short rays. This also holds for
/// a body whose `moves` flag is unset, after it has moved once.
#[test]
fn what_moves_makes_nothing_in_the_frame_loop() {
    let gpu = gpu();
    let settings =
        Settings { rsm: 32, light_shadows: LightShadows::Maps(64), reuse: true, ..Settings::at(Quality::High, 100) };
    for (seed, says_so) in [(1, true), (2, false)] {
        let mut scene = world();
        scene.instances[BALL].moves = says_so;
        let mut engine = Engine::new(&gpu, loaded(&scene, 0.5), &settings).expect("made");
        let mut picture = engine.picture(&gpu, [24, 16]).expect("made");
        let mut random = Random(seed);
        let mut frame = |what: usize| {
            engine.edit(&gpu, |scene| _ = edit(scene, &mut random, what)).expect("edited");
            let camera = engine.scene().cameras[0].clone();
            let view = engine.view(&camera, [24, 16]);
            engine.fit(&gpu, &mut [(&mut picture, [24, 16])]).expect("fits");
            let drawn = gpu.frame(|cmd| {
                engine.record(cmd, &mut [(view, &mut picture)], &Look::default());
                Ok(())
            });
            assert_eq!(drawn.expect("drawn").problems, [""; 0]);
        };
        frame(13);
        if !says_so {
            frame(8);
        }
        (0..3).for_each(|_| frame(13));
        gpu.wait().expect("done");
        let before = gpu.counters();
        for step in 0..8 {
            frame([8, 9][step % 2]);
            assert_eq!(gpu.counters(), before, "step {step}");
        }
    }
    assert_clean(&gpu);
}

#[test]
fn the_librarys_picture_is_renders() {
    let folder = folder("the_librarys_picture_is_renders");
    // One room that is divided, and one that lacks camera and light. The place of the kept bakes must not matter.
    let room = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/cornell_glossy.glb");
    let mut bare = corner(&[], 40.0);
    bare.cameras.clear();
    let lacking = folder.join("lacking.glb");
    lightskin::scene::write::write_glb(&bare, &lacking).expect("written");
    let gpu = gpu();
    for (file, quality, flag) in [(&room, Quality::High, "high"), (&lacking, Quality::Low, "low")] {
        let out = folder.join("render.png");
        let name = file.to_str().expect("a name");
        works(&folder, &["render", name, "--quality", flag, "--size", "48x27", "-o", "render.png"]);
        let loaded = Loaded::open(file, quality, &|_, _| {}).expect("loaded");
        let settings = loaded.settings(quality);
        let mut engine = Engine::new(&gpu, loaded, &settings).expect("an engine");
        let mut picture = engine.picture(&gpu, [48, 27]).expect("a picture");
        shown(&gpu, &mut engine, &mut picture, [48, 27], &Look::default());
        let drawn: Vec<u8> = gpu.read_image(&picture.output.picture).expect("read");
        let file = image::open(out).expect("a PNG").to_rgba8().into_raw();
        assert_eq!(file, drawn);
    }
    assert_clean(&gpu);
}
