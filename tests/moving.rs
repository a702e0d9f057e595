//! Everything moves: poses on the device against the host's, and frames that skip unchanged stages against frames made
//! from scratch, bit by bit.

use glam::{DAffine3, DQuat, DVec3, Vec3, dvec3, vec3};
use lightskin::bake::{self, CacheSet};
use lightskin::frame::{Antialiasing, ClusterRule, LightShadows, Near, Picture, Shadows, View, World};
use lightskin::gpu::Gpu;
use lightskin::lab::knobs::{Frame, Gi, Knobs, Path};
use lightskin::lab::worlds::{SPOT, add, camera, corner, phong};
use lightskin::scene::build::sphere;
use lightskin::scene::defaults::Ground;
use lightskin::scene::deform::{Bind, Deform, Displacement, Follower, Influence, Pose};
use lightskin::scene::{LightKind, Scene};
use lightskin::scene::{defaults, gltf};
use lightskin::shared::Cache;

use crate::common::frames::{baked, small};
use crate::common::{assert_clean, data, gltf_files, gpu, rounding};

/// Instances: one that moves as a whole, one that bends, one that emits.
const BALL: usize = 2;
const BENT: usize = 3;
const LAMP: usize = 4;

/// The corner with its ball, a ball that bends and bulges, and an emissive ball.
pub(crate) fn world() -> Scene {
    let mut scene = corner(&[SPOT, LightKind::Point], 20.0);
    add(&mut scene, sphere(0.25, 6), phong([0.3, 0.7, 0.3], [0.1, 0.1, 0.1], 20.0), DAffine3::IDENTITY);
    let mut glow = phong([0.1; 3], [0.0; 3], 1.0);
    glow.emissive = vec3(300.0, 200.0, 100.0);
    add(&mut scene, sphere(0.06, 3), glow, DAffine3::from_translation(dvec3(0.4, 1.2, -0.5)));
    let mesh = &mut scene.meshes[BENT];
    // The top follows the second joint. The last vertices follow triangles of the other vertices, some with flat
    // normals.
    let followers = 20;
    let bound = mesh.vertices.len() - followers;
    let mut deform = Deform::default();
    let mut bulge = Vec::new();
    for (i, vertex) in mesh.vertices[..bound].iter().enumerate() {
        let share = (0.5 + 2.0 * vertex.position.y).clamp(0.0, 1.0);
        deform.bind.push(Bind {
            position: vertex.position,
            normal: vertex.normal,
            tangent: vertex.tangent,
            first_influence: 2 * i as u32,
            influence_count: 2,
        });
        deform.influences.push(Influence { joint: 0, weight: 1.0 - share });
        deform.influences.push(Influence { joint: 1, weight: share });
        let position = 0.3 * vertex.normal * (1.0 - vertex.position.y.abs());
        bulge.push(Displacement { position, normal: 0.2 * Vec3::X, tangent: Vec3::ZERO });
    }
    deform.targets.push(bulge);
    for at in 0..followers as u32 {
        let corners = [3 * at, 3 * at + 4, 3 * at + 11].map(|i| i % bound as u32);
        let weights = [0.2 + 0.01 * at as f32, 0.3];
        deform.followers.push(Follower { vertex: bound as u32 + at, corners, weights, flat: at % 2 });
    }
    mesh.deform = Some(deform);
    let pose = Pose { joints: vec![DAffine3::IDENTITY; 2], weights: vec![0.0] };
    mesh.vertices = mesh.posed(&pose);
    scene.instances[BENT].world_from_model = DAffine3::from_translation(dvec3(0.5, 0.4, 0.3));
    scene.instances[BENT].pose = Some(pose);
    [BALL, LAMP].into_iter().for_each(|i| scene.instances[i].moves = true);
    scene.extent = Some((dvec3(-1.5, -0.5, -1.5), dvec3(1.5, 2.5, 1.5)));
    scene
}

/// Poses the bending ball: its top is turned and shifted, and it bulges.
pub(crate) fn bend(scene: &mut Scene, turn: f64, bulge: f32) {
    let pose = scene.instances[BENT].pose.as_mut().expect("bends");
    let rotation = DQuat::from_axis_angle(dvec3(0.3, 0.1, 1.0).normalize(), turn);
    pose.joints[1] = DAffine3::from_scale_rotation_translation(
        DVec3::splat(1.0 + 0.3 * turn),
        rotation,
        dvec3(0.1 * turn, 0.05, 0.0),
    );
    pose.weights[0] = bulge;
}

fn record(gpu: &Gpu, frame: &mut Frame, buffers: &World, scene: &Scene, size: [u32; 2]) {
    let view = View::new(&scene.cameras[0], size, buffers.origin, buffers.radius);
    let drawn = gpu.frame(|cmd| {
        frame.record(cmd, buffers, &view);
        Ok(())
    });
    assert_eq!(drawn.expect("drawn").problems, [""; 0]);
}

/// All layers as raw bits.
fn layers(gpu: &Gpu, frame: &Frame) -> Vec<Vec<u32>> {
    let Picture { surface, indirect, output, .. } = &frame.picture;
    let mut images = vec![&surface.radiance, &surface.normal];
    images.extend(indirect.iter().flat_map(|i| [Some(&i.diffuse), i.glossy.as_ref()]).flatten());
    let mut all: Vec<Vec<u32>> = images.into_iter().map(|image| gpu.read_image(image).expect("read")).collect();
    all.push(gpu.read_image(&output.picture).expect("read"));
    all
}

#[test]
fn poses_are_those_of_the_host() {
    let gpu = gpu();
    let mut scene = world();
    let caches = baked(&scene, 0.3, 8);
    let settings = small();
    let mut buffers = World::new(&gpu, &scene, Some(&caches)).expect("uploaded");
    let mut frame = Frame::new(&gpu, &scene, &buffers, &settings).expect("made");
    for step in 0..6 {
        bend(&mut scene, 0.4 * f64::from(step), 0.3 * step as f32);
        scene.instances[BALL].world_from_model.translation.y += 0.1;
        scene.instances[BALL].world_from_model.matrix3 *= 1.1;
        buffers.update(&gpu, &scene).expect("the same scene");
        record(&gpu, &mut frame, &buffers, &scene, settings.size);
        let found: Vec<Cache> = gpu.read(&frame.light.caches().expect("caches").atlas.caches).expect("read");
        let mut at = 0;
        for (i, model) in caches.instance_model.iter().enumerate() {
            let model = &caches.models[*model];
            let mesh = &scene.meshes[model.mesh];
            let instance = &scene.instances[i];
            let posed = instance.pose.as_ref().map_or_else(|| mesh.vertices.clone(), |pose| mesh.posed(pose));
            for cache in &model.caches {
                let corners = mesh.triangle(cache.triangle as usize);
                let [b, c] = cache.barycentric.map(f64::from);
                let weights = [1.0 - b - c, b, c];
                let mean = |of: &dyn Fn(usize) -> DVec3| (0..3).map(|k| weights[k] * of(corners[k])).sum::<DVec3>();
                let linear = instance.world_from_model.matrix3;
                let position = instance.world_from_model.transform_point3(mean(&|v| posed[v].position.as_dvec3()));
                let [p, q, r] = corners.map(|v| linear * posed[v].position.as_dvec3());
                let normal = (q - p).cross(r - p).normalize();
                let side = linear.inverse().transpose() * mean(&|v| posed[v].normal.as_dvec3());
                let normal = if normal.dot(side) < 0.0 { -normal } else { normal };
                let either = normal.dot(side).abs() < 1e-6 * side.length(); // rounding decides the side
                // A cache's area scales with its triangle.
                let area = |linear: glam::DMat3, vertices: &[lightskin::scene::Vertex]| {
                    let [a, b, c] = corners.map(|v| linear * vertices[v].position.as_dvec3());
                    (b - a).cross(c - a).length()
                };
                let grown = area(linear, &posed) / area(model.linear, &mesh.vertices);
                let device = found[at];
                assert!((device.position.as_dvec3() + buffers.origin).distance(position) < 2e-6, "{i}: {position}");
                let found = device.normal.as_dvec3();
                let off =
                    if either { found.distance(normal).min(found.distance(-normal)) } else { found.distance(normal) };
                assert!(off < if rounding(&gpu) > 1.0 { 4e-5 } else { 1e-5 }, "{i}: {found} instead of {normal}");
                let wanted = f64::from(cache.area) * grown;
                assert!((f64::from(device.area) - wanted).abs() < 1e-4 * wanted, "{i}: {} {wanted}", device.area);
                at += 1;
            }
        }
        assert_eq!(at, found.len());
    }
    assert_clean(&gpu);
}

/// Every animated file of the shared data, at one or two times of each animation. The device's vertices and caches must
/// equal those of `Mesh::posed`, which tests/animation.rs compares with a second reader.
#[test]
fn animated_files_stand_on_the_device_as_on_the_host() {
    let Some(data) = data() else { return };
    let gpu = gpu();
    let mut files = 0;
    for path in gltf_files(&data.join("scenes")) {
        // Search the text first, because it is faster than loading all static files.
        let text = std::fs::read(&path).expect("a file");
        let says = |word: &str| text.windows(word.len()).any(|part| part == word.as_bytes());
        if !["\"animations\"", "\"skins\"", "\"targets\""].into_iter().any(says) {
            continue;
        }
        let Ok(mut scene) = gltf::load(&path) else { continue };
        if scene.rig.is_none() {
            continue;
        }
        files += 1;
        defaults::complete(&mut scene, Ground::Auto);
        let settings = bake::BakeSettings { density: bake::Density::Count(60), angle: 1.0, references: 8 };
        let caches = bake::bake(&scene, &settings, &|_, _| {}).expect("bakes");
        let settings = Knobs { size: [16, 16], rsm: 8, light_shadows: LightShadows::Maps(16), ..small() };
        let mut buffers = World::new(&gpu, &scene, Some(&caches)).expect("uploaded");
        let mut frame = Frame::new(&gpu, &scene, &buffers, &settings).expect("made");
        let spans: Vec<(f64, f64)> = scene.animations().map(|(_, begin, end)| (begin, end)).collect();
        let (mut vertices, mut of_caches) = (0.0_f64, 0.0_f64);
        for (animation, (begin, end)) in spans.into_iter().enumerate() {
            // Between two keys, and for the first animation at its end, too.
            for part in [0.45, 1.0].into_iter().take(if animation == 0 { 2 } else { 1 }) {
                scene.pose(animation, begin + (end - begin) * part);
                buffers.update(&gpu, &scene).expect("the same scene");
                record(&gpu, &mut frame, &buffers, &scene, settings.size);
                let atlas: Vec<Cache> = gpu.read(&frame.light.caches().expect("caches").atlas.caches).expect("read");
                let mut at = 0;
                for (i, instance) in scene.instances.iter().enumerate() {
                    let mesh = &scene.meshes[instance.mesh];
                    let posed = instance.pose.as_ref().map_or_else(|| mesh.vertices.clone(), |pose| mesh.posed(pose));
                    let low = posed.iter().map(|v| v.position).reduce(Vec3::min).expect("vertices");
                    let high = posed.iter().map(|v| v.position).reduce(Vec3::max).expect("vertices");
                    let size = f64::from((high - low).length());
                    for (device, host) in buffers.read_vertices(&gpu, &scene, i).expect("read").iter().zip(&posed) {
                        vertices = vertices.max(f64::from(device.position.distance(host.position)) / size);
                        assert!(device.normal.distance(host.normal) < 2e-3, "{}: {host:?}", path.display());
                    }
                    let place = |v: usize| instance.world_from_model.transform_point3(posed[v].position.as_dvec3());
                    let grown = instance.world_from_model.matrix3.determinant().abs().cbrt();
                    for cache in &caches.models[caches.instance_model[i]].caches {
                        let corners = mesh.triangle(cache.triangle as usize).map(place);
                        let [b, c] = cache.barycentric.map(f64::from);
                        let position = (1.0 - b - c) * corners[0] + b * corners[1] + c * corners[2];
                        let device = atlas[at].position.as_dvec3() + buffers.origin;
                        of_caches = of_caches.max(device.distance(position) / (size * grown.max(1e-3)));
                        at += 1;
                    }
                }
            }
        }
        println!("{}: vertices {vertices:.1e}, caches {of_caches:.1e} of the model's size", scene.name);
        assert!(vertices < 1e-4 && of_caches < 1e-4, "{}: {vertices} {of_caches}", path.display());
    }
    assert!(files > 20, "{files} animated files");
    assert_clean(&gpu);
}

/// Pseudorandom numbers, the same in every run.
struct Random(u64);

impl Random {
    /// A number from 0 to 1.
    fn number(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// Applies a random edit to the scene.
fn edit(scene: &mut Scene, random: &mut Random) {
    let mut some = |size: f64| size * (random.number() - 0.5);
    match (some(9.0) + 4.5) as usize {
        0 | 1 => {
            let eye = dvec3(1.4 + some(1.0), 1.5 + some(0.5), 2.0 + some(0.5));
            scene.cameras[0] = camera(eye, dvec3(-0.3, 0.5, -0.1), 0.8);
        }
        2 => scene.lights[0].position += dvec3(some(0.3), some(0.1), some(0.3)),
        3 => scene.lights[1].color = vec3(0.5 + some(0.9) as f32, 0.5, 0.5 + some(0.9) as f32),
        4 => scene.instances[BALL].world_from_model.translation += dvec3(some(0.2), some(0.1), some(0.2)),
        5 => {
            let (turn, bulge) = (some(3.0), some(1.0) as f32);
            bend(scene, turn, bulge);
        }
        6 => {
            let color = vec3(0.5 + some(0.9) as f32, 0.5, 0.5 + some(0.9) as f32);
            scene.materials[1].base_color = color.extend(1.0);
            let lobe = scene.materials[0].phong.as_mut().expect("has one");
            lobe.exponent = 5.0 + 40.0 * color.x;
        }
        7 => scene.instances[BENT].hidden = !scene.instances[BENT].hidden,
        8 => scene.instances[LAMP].world_from_model.translation += dvec3(some(0.3), some(0.1), some(0.3)),
        _ => {
            let (turn, aside) = (some(2.0), some(0.4));
            bend(scene, turn, 0.2);
            scene.lights[0].position.x += aside;
            scene.materials[LAMP].emissive = Vec3::splat(200.0 + some(300.0) as f32);
        }
    }
}

fn walk(settings: Knobs, cells: bool, steps: usize, seed: u64) {
    walk_of(world(), settings, cells, steps, seed);
}

/// Edits a scene (`world`, possibly with other materials) and draws each step twice: with unchanged stages skipped, and
/// from scratch.
pub(crate) fn walk_of(mut scene: Scene, settings: Knobs, cells: bool, steps: usize, seed: u64) {
    let gpu = gpu();
    let mut caches = baked(&scene, 0.3, 8);
    if cells {
        caches = caches.with_cells(&scene).expect("cells");
    }
    let caches: Option<&CacheSet> = (settings.gi == Gi::LightSkin).then_some(&caches);
    let upload = |scene: &Scene| World::new(&gpu, scene, caches).expect("uploaded");
    let mut buffers = upload(&scene);
    let mut frame = Frame::new(&gpu, &scene, &buffers, &Knobs { reuse: true, ..settings }).expect("made");
    let mut random = Random(seed);
    let mut skipped = std::collections::BTreeSet::new();
    for step in 0..steps {
        // In some steps nothing moves.
        if step % 8 != 3 {
            edit(&mut scene, &mut random);
        }
        buffers.update(&gpu, &scene).expect("the same scene");
        record(&gpu, &mut frame, &buffers, &scene, settings.size);
        skipped.insert(frame.light.skipped());
        let anew = upload(&scene);
        let mut scratch = Frame::new(&gpu, &scene, &anew, &settings).expect("made");
        record(&gpu, &mut scratch, &anew, &scene, settings.size);
        assert!(scratch.light.skipped().is_empty());
        assert!(layers(&gpu, &frame) == layers(&gpu, &scratch), "step {step} differs");
        let lit = [&frame, &scratch].map(|frame| frame.light.counts(&gpu).expect("counts").caches);
        assert_eq!(lit[0], lit[1], "numbers of lit caches at step {step}");
    }
    assert!(skipped.len() >= 2, "{skipped:?}");
    assert_clean(&gpu);
}

pub(crate) fn with(shadows: Shadows) -> Knobs {
    Knobs { shadows, size: [48, 32], rsm: 24, light_shadows: LightShadows::Maps(64), ..small() }
}

#[test]
fn fifty_edits_leave_nothing_stale() {
    walk(with(Shadows::PerLight), false, 50, 7);
}

#[test]
fn edits_leave_nothing_stale_in_any_kind_of_frame() {
    walk(with(Shadows::Proxy), false, 10, 1);
    walk(Knobs { cull: false, ..with(Shadows::Off) }, false, 10, 2);
    walk(Knobs { path: Path::DRAWS, ..with(Shadows::Off) }, false, 10, 3);
    walk(Knobs { bounces: 3, ..with(Shadows::Off) }, false, 10, 4);
    walk(Knobs { gi: Gi::BruteForce, ..with(Shadows::Off) }, false, 10, 5);
    walk(Knobs { gi: Gi::Off, ..with(Shadows::Off) }, false, 10, 6);
    walk(Knobs { antialiasing: Antialiasing::Four, ..with(Shadows::PerLight) }, false, 10, 9);
    walk(Knobs { path: Path::Clusters(ClusterRule::Distance(6.0)), ..with(Shadows::Off) }, false, 10, 8);
    walk(with(Shadows::PerLight), true, 10, 9);
}

/// Short rays hit what has moved, bit by bit as with hierarchies built from the current scene.
#[test]
fn short_rays_leave_nothing_stale() {
    let near = Near::Rays { per_pixel: 4, every: 2 };
    walk(Knobs { near, ..with(Shadows::PerLight) }, false, 8, 10);
    walk(Knobs { near, bounces: 3, ..with(Shadows::PerLight) }, true, 6, 11);
    walk(Knobs { near, ..with(Shadows::Proxy) }, true, 5, 12);
    let antialiasing = Antialiasing::Four;
    walk(Knobs { light_shadows: LightShadows::Rays, antialiasing, ..with(Shadows::Off) }, false, 6, 13);
}
