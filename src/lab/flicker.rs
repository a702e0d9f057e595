//! Temporal stability: flicker of indirect light while a light, the camera or a model moves slowly.
//!
//! No state is kept between frames, so all flicker comes from sampling: RSM texels jump from one place to another
//! (VALs), and caches react together with their neighbours. A short sequence with steps far below a texel is drawn with
//! interpolated caches (`L_t`), by brute force on the same VALs (`B_t`), and by brute force on finer VALs (`F_t`); each
//! is the sum of both lobes of indirect radiance. The figures run over all steps, channels and pixels `p` that show the
//! same surface throughout. With `D x_t = x_{t+1} - x_t`, `D2 x_t = x_{t+1} - 2 x_t + x_{t-1}` and the root mean square
//! `rms(x)`, relative to the mean of `B`:
//!
//! - *change* `rms(D L)`, `rms(D B)`: total change, most of it legitimate;
//! - *flicker* `rms(D L - D B)`: change by caches and interpolation that the VALs do not have; also without the worst
//!   1 % of pixels, which lie in creases next to lit surfaces where a single VAL is near enough to be visible;
//! - *VALs' own* `rms(D B - D F)`: change by the VALs that finer ones do not have;
//! - *jitter* `rms(D2 L)`, `rms(D2 B)`: needs no other picture to compare with. The second difference of smoothly
//!   changing light is of the order of the squared step, almost 0; light that alternates has twice its change;
//! - *of the mean* `rms(D2 mean_p L)`, `rms(D2 mean_p B)`: the same for the picture's mean, which averages out pixel
//!   noise, but not pumping of all light.
//!
//! A moving camera sees other surface points in the same pixels, which is change, not flicker. `D L - D B` remains
//! meaningful because both pictures show the same points: it is the change of the interpolation error from a point to
//! its neighbour. The diffuse light of caches does not depend on the camera, so it cannot flicker; glossy proxies do
//! depend on it. The mean and the second differences do not depend on the point that a pixel shows, as long as the
//! whole path is at most a pixel long.

use crate::bake::CacheSet;
use crate::error::{Error, Result};
use crate::frame::{ClusterRule, View, World, world::lights};
use crate::gpu::Gpu;
use crate::lab::knobs::{Frame, Gi, Knobs, Path};
use crate::lab::shot::radiance;
use crate::scene::{LightKind, Projection, Scene, Vertex};
use crate::shared::Proxy;
use glam::{DVec3, Vec4};

/// The kind of slow motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Motion {
    /// The first light, by half a texel of the finest RSM per frame: sideways, or by rotation for parallel light.
    Light,
    /// The camera, to its right by 1/16 pixel at the distance of the scene's centre.
    Camera,
    /// A model, horizontally by as much as the light.
    Model,
    /// Everything that the animation moves: rigid, skinned and morphed models, lights, the camera.
    Animation,
}

impl Motion {
    /// Name in one word.
    pub fn name(self) -> &'static str {
        ["light", "camera", "model", "animation"][self as usize]
    }
}

/// Parameters of a measurement.
#[derive(Clone, Debug, PartialEq)]
pub struct Job {
    /// Picture \[pixels\].
    pub size: [u32; 2],
    /// Number of frames, at least 3.
    pub frames: usize,
    /// Sides \[texels\] of the RSMs; each has side^2 VALs per light.
    pub rsm: Vec<u32>,
    /// Side \[texels\] of the finer RSM used for comparison.
    pub fine: u32,
    /// Cluster rule, if caches are lit by clusters.
    pub cluster: Option<ClusterRule>,
    /// Factor on the step length; 0 stands still.
    pub pace: f64,
    /// The moving instance, see [`model`].
    pub model: Option<usize>,
    /// The animation to play.
    pub animation: Option<Played>,
}

/// Part of an animation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Played {
    /// Index among the scene's animations.
    pub index: usize,
    /// Start time \[s\].
    pub begin: f64,
    /// Time step per frame \[s\].
    pub step: f64,
}

/// One row: a motion, an RSM and a set of caches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flicker {
    /// The motion.
    pub motion: Motion,
    /// Side \[texels\] of the RSM.
    pub rsm: u32,
    /// Number of caches over all instances.
    pub caches: usize,
    /// Flicker of the light.
    pub figures: Figures,
}

/// Flicker of the light relative to the mean of brute force; see the module documentation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Figures {
    /// Share of the pixels that show the same surface throughout.
    pub kept: f64,
    /// Change between frames: caches, brute force.
    pub change: [f64; 2],
    /// Difference between the two changes.
    pub flicker: f64,
    /// The same without the worst 1 % of pixels.
    pub flicker_trimmed: f64,
    /// Difference between the changes by brute force and by brute force with finer VALs.
    pub vals_own: f64,
    /// Second difference: caches, brute force.
    pub jitter: [f64; 2],
    /// Second difference of the picture's mean: caches, brute force.
    pub of_mean: [f64; 2],
    /// Change between frames of the caches' diffuse irradiance, relative to its own mean.
    pub of_caches: f64,
}

/// Frames of one sequence: indirect radiance of every pixel.
type Sequence = Vec<Vec<DVec3>>;

/// A drawn sequence.
struct Drawn {
    frames: Sequence,
    /// Pixels that show the same surface in all frames.
    kept: Vec<bool>,
    /// See `Figures::of_caches`.
    of_caches: f64,
}

/// The default moving instance: the largest that is less than half the scene across.
pub fn model(scene: &Scene) -> Option<usize> {
    let across = |i: usize| {
        let (instance, mesh) = (&scene.instances[i], &scene.meshes[scene.instances[i].mesh]);
        let place = |v: &Vertex| instance.world_from_model.transform_point3(v.position.as_dvec3());
        let (low, high) = (mesh.vertices.iter().map(place))
            .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)));
        (high - low).max(DVec3::ZERO).length()
    };
    let (low, high) = scene.bounds()?;
    let all = (0..scene.instances.len()).map(|i| (i, across(i))).filter(|(_, size)| *size < 0.5 * low.distance(high));
    all.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(i, _)| i)
}

/// Measures a scene with each of these sets of caches, which move with their models. `progress` receives the completed
/// share, 0 to 1, and the current step.
///
/// # Errors
/// Fails if the device runs out of memory, lacks a feature, or is lost.
pub fn measure(
    gpu: &Gpu,
    scene: &Scene,
    caches: &[CacheSet],
    motion: Motion,
    job: &Job,
    progress: &dyn Fn(f32, &str),
) -> Result<Vec<Flicker>> {
    assert!(job.frames >= 3, "flicker: {} frames have no second difference", job.frames);
    let step = step(scene, motion, job)?;
    let scenes: Vec<Scene> = (0..job.frames).map(|t| moved(scene, motion, job, step * t as f64)).collect();
    let total = (1 + job.rsm.len() * (1 + caches.len())) as f32;
    let mut done = 0.0;
    let mut draw = |gi: Gi, rsm: u32, caches: Option<&CacheSet>| {
        let what = if caches.is_some() { "caches" } else { "brute force" };
        progress(done / total, &format!("{} moves: {what}, RSM {rsm}", motion.name()));
        done += 1.0;
        // No culling: caches outside the view are evaluated, too.
        let path = job.cluster.map_or(Path::Compute, Path::Clusters);
        sequence(gpu, &scenes, caches, &Knobs { gi, rsm, path, cull: false, ..Knobs::plain(job.size) })
    };
    let fine = draw(Gi::BruteForce, job.fine, None)?;
    let mut rows = Vec::new();
    for rsm in &job.rsm {
        let truth = draw(Gi::BruteForce, *rsm, None)?;
        for set in caches {
            let ours = draw(Gi::LightSkin, *rsm, Some(set))?;
            let figures = Figures {
                of_caches: ours.of_caches,
                ..Figures::new(&ours.frames, &truth.frames, &fine.frames, &truth.kept)
            };
            let caches = set.instance_model.iter().map(|m| set.models[*m].caches.len()).sum();
            rows.push(Flicker { motion, rsm: *rsm, caches, figures });
        }
    }
    progress(1.0, "measured");
    Ok(rows)
}

impl Figures {
    /// From three sequences of the same frames, over the kept pixels.
    fn new(ours: &Sequence, truth: &Sequence, fine: &Sequence, kept: &[bool]) -> Self {
        let pixels: Vec<usize> = (0..kept.len()).filter(|p| kept[*p]).collect();
        let count = pixels.len().max(1) as f64;
        let mean = |frame: &[DVec3]| pixels.iter().map(|p| frame[*p]).sum::<DVec3>() / count;
        let brightness = truth.iter().map(|frame| mean(frame).element_sum()).sum::<f64>() / (3 * truth.len()) as f64;
        // Takes the squares summed over pixels and channels for each step. Constant light gives 0, even if black.
        let relative = |squares: &mut dyn Iterator<Item = f64>, values: f64| {
            let (sum, steps) = squares.fold((0.0, 0.0), |(sum, steps), square| (sum + square, steps + 1.0));
            if sum == 0.0 { 0.0 } else { (sum / (steps * values)).sqrt() / brightness }
        };
        let over_pixels = |of: &dyn Fn(usize) -> DVec3| pixels.iter().map(|p| of(*p).length_squared()).sum::<f64>();
        let first = |s: &Sequence, t: usize, p: usize| s[t + 1][p] - s[t][p];
        let second = |s: &Sequence, t: usize, p: usize| s[t + 1][p] - 2.0 * s[t][p] + s[t - 1][p];
        let steps = truth.len() - 1;
        let change = |s: &Sequence| relative(&mut (0..steps).map(|t| over_pixels(&|p| first(s, t, p))), 3.0 * count);
        let apart = |a: &Sequence, b: &Sequence| {
            relative(&mut (0..steps).map(|t| over_pixels(&|p| first(a, t, p) - first(b, t, p))), 3.0 * count)
        };
        // The same without the worst 1 % of pixels.
        let mut worst: Vec<f64> = (pixels.iter())
            .map(|&p| (0..steps).map(|t| (first(ours, t, p) - first(truth, t, p)).length_squared()).sum())
            .collect();
        worst.sort_by(f64::total_cmp);
        worst.truncate(worst.len() * 99 / 100);
        let calm = worst.iter().sum::<f64>() / (steps * worst.len().max(1)) as f64;
        let jitter = |s: &Sequence| relative(&mut (1..steps).map(|t| over_pixels(&|p| second(s, t, p))), 3.0 * count);
        let of_mean = |s: &Sequence| {
            let means: Vec<DVec3> = s.iter().map(|frame| mean(frame)).collect();
            let bend = |t: usize| (means[t + 1] - 2.0 * means[t] + means[t - 1]).length_squared();
            relative(&mut (1..steps).map(bend), 3.0)
        };
        Self {
            kept: pixels.len() as f64 / kept.len() as f64,
            change: [change(ours), change(truth)],
            flicker: apart(ours, truth),
            flicker_trimmed: relative(&mut std::iter::once(calm), 3.0),
            vals_own: apart(truth, fine),
            jitter: [jitter(ours), jitter(truth)],
            of_mean: [of_mean(ours), of_mean(truth)],
            of_caches: 0.0,
        }
    }
}

/// Length \[m\] of a step, or its duration \[s\].
fn step(scene: &Scene, motion: Motion, job: &Job) -> Result<f64> {
    let nothing = |what: &str| Error::Nothing(format!("{}: {what}; nothing can be moved", scene.name));
    if motion == Motion::Animation {
        let played = job.animation.ok_or_else(|| nothing("the scene has no animation"))?;
        return Ok(job.pace * played.step);
    }
    let (low, high) = scene.bounds().ok_or_else(|| nothing("the scene has no triangles"))?;
    let (middle, half) = ((low + high) * 0.5, (high - low) * 0.5);
    let light = scene.lights.first().ok_or_else(|| nothing("the scene has no light"))?;
    let camera = scene.cameras.first().ok_or_else(|| nothing("the scene has no camera"))?;
    if motion == Motion::Model && job.model.is_none() {
        return Err(nothing("the scene has no model that is less than half as large as the scene"));
    }
    if motion == Motion::Camera {
        let height = match camera.projection {
            Projection::Perspective { yfov } => {
                2.0 * (0.5 * f64::from(yfov)).tan() * camera.world_from_camera.translation.distance(middle)
            }
            Projection::Orthographic { ymag } => 2.0 * f64::from(ymag),
        };
        return Ok(job.pace * height / f64::from(job.size[1]) / 16.0);
    }
    let (infos, _, views) = lights::prepare(&scene.lights[..1], middle, half);
    let finest = infos[0].rsm_size(job.rsm.iter().copied().max().unwrap_or(job.fine));
    // Lit surfaces are about as far from the light as the scene is wide.
    let distance = if light.kind == LightKind::Directional { 1.0 } else { half.length() };
    let right = views[0].right;
    Ok(job.pace * 0.5 * 2.0 * f64::from(right.length()) * distance / f64::from(finest))
}

/// The scene with the light, camera or model moved by `way` \[m\], or after `way` \[s\].
fn moved(scene: &Scene, motion: Motion, job: &Job, way: f64) -> Scene {
    let mut scene = scene.clone();
    match motion {
        Motion::Light => {
            let radius = scene.bounds().map_or(1.0, |(low, high)| 0.5 * low.distance(high));
            let light = &mut scene.lights[0];
            let direction = light.direction.as_dvec3().normalize_or(DVec3::NEG_Y);
            let aside = direction.any_orthonormal_vector();
            if light.kind == LightKind::Directional {
                // By the same distance at the scene's rim.
                light.direction = (direction + aside * (way / radius)).normalize().as_vec3();
            } else {
                light.position += aside * way;
            }
        }
        Motion::Camera => {
            let pose = &mut scene.cameras[0].world_from_camera;
            pose.translation += pose.matrix3.x_axis.normalize() * way;
        }
        Motion::Model => {
            let instance = &mut scene.instances[job.model.expect("checked by `step`")];
            instance.world_from_model.translation += DVec3::new(0.8, 0.0, 0.6) * way;
        }
        Motion::Animation => {
            let played = job.animation.expect("checked by `step`");
            scene.pose(played.index, scene.looped(played.index, played.begin + way));
        }
    }
    scene
}

/// Draws the frames of a sequence.
fn sequence(gpu: &Gpu, scenes: &[Scene], caches: Option<&CacheSet>, knobs: &Knobs) -> Result<Drawn> {
    let mut world = World::new(gpu, &scenes[0], caches)?;
    let mut frame = Frame::new(gpu, &scenes[0], &world, knobs)?;
    let mut frames = Vec::new();
    let mut kept = vec![true; (knobs.size[0] * knobs.size[1]) as usize];
    let mut last: Option<Vec<(f32, Vec4)>> = None;
    let mut last_proxies: Option<Vec<DVec3>> = None;
    let (mut squares, mut sum, mut count) = (0.0, 0.0, 0.0);
    for scene in scenes {
        world.update(gpu, scene)?;
        let view = View::new(&scene.cameras[0], knobs.size, world.origin, world.radius);
        let drawn = gpu.frame(|cmd| {
            frame.record(cmd, &world, &view);
            Ok(())
        })?;
        assert!(drawn.problems.is_empty(), "barriers: {}", drawn.problems.join("; "));
        let mut layer = vec![DVec3::ZERO; kept.len()];
        for image in frame.picture.indirect.iter().flat_map(|i| [Some(&i.diffuse), i.glossy.as_ref()]).flatten() {
            layer.iter_mut().zip(radiance(gpu, image)?).for_each(|(sum, p)| *sum += p);
        }
        frames.push(layer);
        let seen = &frame.picture.surface;
        let surface: Vec<(f32, Vec4)> =
            gpu.read_image::<f32>(&seen.depth)?.into_iter().zip(gpu.read_image::<Vec4>(&seen.normal)?).collect();
        for (i, now) in surface.iter().enumerate() {
            kept[i] &= now.0 > 0.0 && last.as_ref().is_none_or(|last| is_same_surface(last[i], *now));
        }
        last = Some(surface);
        if let Some(caches) = frame.light.caches() {
            let all: Vec<Proxy> = gpu.read(&caches.proxies.buffer)?;
            let now: Vec<DVec3> =
                all[..caches.atlas.count as usize].iter().map(|p| ({ p.diffuse_irradiance }).as_dvec3()).collect();
            if let Some(last) = &last_proxies {
                squares += now.iter().zip(last).map(|(a, b)| a.distance_squared(*b)).sum::<f64>();
                sum += now.iter().map(|p| p.element_sum()).sum::<f64>();
                count += 3.0 * now.len() as f64;
            }
            last_proxies = Some(now);
        }
    }
    let of_caches = if squares == 0.0 { 0.0 } else { (squares / count).sqrt() / (sum / count) };
    Ok(Drawn { frames, kept, of_caches })
}

/// Whether two consecutive depths and normals of a pixel belong to one surface.
fn is_same_surface(a: (f32, Vec4), b: (f32, Vec4)) -> bool {
    (a.0 - b.0).abs() < 0.01 * a.0 && a.1.truncate().dot(b.1.truncate()) > 0.99
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames of four pixels with a mean of 10; the last pixel is not kept.
    fn figures(ours: impl Fn(f64) -> f64, truth: impl Fn(f64) -> f64) -> Figures {
        let frames = |of: &dyn Fn(f64) -> f64| -> Sequence {
            (0..8)
                .map(|t| [1.0, 1.0, 1.0, 1e9 * f64::from(t)].map(|p| DVec3::splat(p * of(f64::from(t)))).to_vec())
                .collect()
        };
        let truth = frames(&truth);
        Figures::new(&frames(&ours), &truth, &truth, &[true, true, true, false])
    }

    fn near(value: f64, wanted: f64) {
        assert!((value - wanted).abs() < 1e-12, "{value} is not {wanted}");
    }

    #[test]
    fn what_changes_alike_and_evenly_does_not_flicker() {
        let f = figures(|t| 6.5 + t, |t| 6.5 + t);
        near(f.change[0], 0.1);
        near(f.change[1], 0.1);
        near(f.kept, 0.75);
        assert_eq!((f.flicker, f.vals_own, f.jitter, f.of_mean), (0.0, 0.0, [0.0; 2], [0.0; 2]));
    }

    #[test]
    fn what_jumps_to_and_fro_jitters_by_twice_its_change() {
        let to_and_fro = |t: f64| 10.0 + if t % 2.0 == 0.0 { 0.5 } else { -0.5 };
        let f = figures(to_and_fro, |_| 10.0);
        near(f.change[0], 0.1);
        near(f.flicker, 0.1);
        near(f.flicker_trimmed, 0.1);
        near(f.jitter[0], 0.2);
        near(f.of_mean[0], 0.2);
        assert_eq!((f.change[1], f.jitter[1], f.of_mean[1], f.vals_own), (0.0, 0.0, 0.0, 0.0));
    }

    #[test]
    fn pixels_that_jump_against_each_other_leave_the_mean() {
        let frame = |a: f64| vec![DVec3::splat(10.0 + a), DVec3::splat(10.0 - a)];
        let ours: Sequence = [1.0, -1.0, 1.0, -1.0].map(frame).to_vec();
        let truth: Sequence = [0.0; 4].map(frame).to_vec();
        let f = Figures::new(&ours, &truth, &truth, &[true; 2]);
        near(f.jitter[0], 0.4);
        assert_eq!(f.of_mean, [0.0; 2]);
    }

    #[test]
    fn the_worst_pixel_of_a_hundred_is_trimmed() {
        let truth: Sequence = vec![vec![DVec3::splat(10.0); 100]; 3];
        let mut ours = truth.clone();
        ours[1][7] = DVec3::splat(20.0);
        let f = Figures::new(&ours, &truth, &truth, &[true; 100]);
        near(f.flicker, 0.1);
        assert_eq!(f.flicker_trimmed, 0.0);
    }
}
