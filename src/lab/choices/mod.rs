//! Measures the choices that METHOD leaves open on a scene in f64: variants of proxies, interpolation, references and
//! VALs. Light is interpolated at the vertices as in the engine. The ground truth is brute force with the same VALs, or
//! unshadowed light paths, the limit of infinitely many VALs. Runs on the CPU only.

mod study;
mod variants;

pub use study::{Study, StudySettings};

use rayon::prelude::*;

use crate::metrics::{Metrics, metrics, relative_squares};
use crate::reference::gather::{Gathered, Lobe, ProxyWeight, gather};
use crate::reference::interpolate::Scheme;
use crate::reference::path_trace::{self, PASS_SAMPLES, PathTrace};
use study::Vertex;
use variants::{Carried, Kernel, Variant};

/// One row of a table.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// The variation.
    pub name: String,
    /// Errors against the table's truth.
    pub metrics: Metrics,
    /// Relative error of the mean, without the worst 1 % of pixels by relative squared error.
    pub trimmed_bias: f64,
}

/// Location of the squared error of one lobe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Worst {
    /// Share of the sum of relative squared errors in the worst 1 % of pixels.
    pub share: f64,
    /// Share of these pixels with a VAL nearer than the local distance between VALs (the root of its area).
    pub near_val: f64,
    /// Share of these pixels that are too bright.
    pub too_bright: f64,
    /// Mean radiance [cd/m^2] of these pixels: interpolated, by brute force, and by light paths.
    pub radiance: [f64; 3],
}

/// Samples per pixel for light paths.
const SAMPLES: u32 = 256;

impl Row {
    fn new(name: impl Into<String>, image: &[[f32; 3]], truth: &[[f32; 3]]) -> Self {
        let order = by_error(image, truth);
        let kept = &order[..(order.len() * 99 / 100).max(1)];
        let (found, wanted) = (sum(image, kept), sum(truth, kept));
        let trimmed_bias = if wanted == 0.0 { 0.0 } else { found / wanted - 1.0 };
        Self { name: name.into(), metrics: metrics(image, truth), trimmed_bias }
    }
}

/// Pixels by increasing relative squared error.
fn by_error(image: &[[f32; 3]], truth: &[[f32; 3]]) -> Vec<usize> {
    let squares = relative_squares(image, truth);
    let mut order: Vec<usize> = (0..squares.len()).collect();
    order.sort_by(|a, b| squares[*a].total_cmp(&squares[*b]));
    order
}

/// Sum over pixels and channels.
fn sum(image: &[[f32; 3]], pixels: &[usize]) -> f64 {
    pixels.iter().flat_map(|pixel| image[*pixel]).map(f64::from).sum()
}

impl Study<'_> {
    /// Variations of weights, quantities and kernels for the diffuse lobe, against brute force.
    pub fn diffuse(&self) -> Vec<Row> {
        let base = Variant::DIFFUSE;
        let irradiance: Vec<(String, Variant)> = vec![
            ("default: facing irradiance with falloff".into(), base),
            ("without falloff".into(), Variant::FACING),
            ("twice the falloff".into(), Variant { falloff: 2.0, ..base }),
            ("printed: flux".into(), Variant::PRINTED),
            ("printed, pushed out".into(), Variant { carried: Carried::PushedFlux, ..Variant::PRINTED }),
            ("flux, faster kernel".into(), Variant { carried: Carried::Flux, ..Variant::FACING }),
            ("facing, printed kernel".into(), Variant { kernel: Kernel::Of(Scheme::Printed), ..Variant::FACING }),
            ("half light vector".into(), Variant { vector: 0.5, ..base }),
            ("light vector".into(), Variant { vector: 1.0, ..base }),
            ("unlit caches count with a position".into(), Variant { unlit: 2, ..base }),
            ("unlit caches left out".into(), Variant { unlit: 0, ..base }),
        ];
        let kernels = [(2.0, 2.0), (8.0, 2.0), (4.0, 1.0), (4.0, 3.0)].map(|(normal, distance)| {
            let name = format!("kernel cos^{normal}, t^-{distance}");
            (name, Variant { kernel: Kernel::Powers(normal, distance), ..base })
        });
        let planes = ("kernel with plane distance".into(), Variant { kernel: Kernel::Planes(4.0), ..base });
        let all: Vec<_> = irradiance.into_iter().chain(kernels).chain([planes]).collect();
        let mut rows = self.rows(false, ProxyWeight::Irradiance, &all);
        rows.extend(self.rows(false, ProxyWeight::FormFactor, &[("form-factor weights".into(), base)]));
        rows
    }

    /// The same for the glossy lobe.
    pub fn glossy(&self) -> Vec<Row> {
        let base = Variant::GLOSSY;
        let plain = Variant { unlit: 0, by_view: true, ..Variant::FACING };
        let by_view = Kernel::Of(Scheme::Printed);
        let mut all = vec![
            ("default: position by lobe response".into(), base),
            ("plain averages, kernel on mirrored views".into(), plain),
            ("plain averages, kernel on normals".into(), Variant { by_view: false, ..plain }),
            ("plain averages, unlit caches count".into(), Variant { unlit: 1, ..plain }),
            ("printed: flux".into(), Variant { by_view: true, ..Variant::PRINTED }),
            ("printed kernel".into(), Variant { kernel: by_view, by_view: true, ..base }),
            ("kernel on mirrored views".into(), Variant { by_view: true, ..base }),
            ("with falloff".into(), Variant { falloff: 1.0, ..base }),
        ];
        for weighed in [0.0, 0.05, 0.25, 1.0] {
            all.push((format!("irradiance by lobe response ^{weighed}"), Variant { weighed, ..base }));
        }
        for pull in [0.5, 2.0] {
            all.push((format!("position by lobe response ^{pull}"), Variant { pull, ..base }));
        }
        let mut rows = self.rows(true, ProxyWeight::Irradiance, &all);
        let form_factor = [("form-factor weights".into(), base), ("form-factor weights, plain averages".into(), plain)];
        rows.extend(self.rows(true, ProxyWeight::FormFactor, &form_factor));
        rows
    }

    /// Selections of the caches that a vertex refers to, with the engine's interpolation of one lobe.
    pub fn references(&self, is_glossy: bool) -> Vec<Row> {
        type Error = fn(f64, f64, f64) -> f64;
        let errors: [(&str, Error); 7] = [
            ("d + sqrt(1 - cos)", |d, c, _| d + (1.0 - c).sqrt()),
            ("d", |d, _, _| d),
            ("d + sqrt(1 - cos) / 2", |d, c, _| d + 0.5 * (1.0 - c).sqrt()),
            ("d + 2 sqrt(1 - cos)", |d, c, _| d + 2.0 * (1.0 - c).sqrt()),
            ("d + 1 - cos", |d, c, _| d + 1.0 - c),
            ("d^2 + 1 - cos", |d, c, _| d * d + 1.0 - c),
            ("d + sqrt(1 - cos) + plane distance", |d, c, plane| d + (1.0 - c).sqrt() + plane),
        ];
        let variant = if is_glossy { Variant::GLOSSY } else { Variant::DIFFUSE };
        let gathered = self.gather(ProxyWeight::Irradiance);
        let proxies = self.proxies(&gathered, lobe(is_glossy));
        let mut rows = Vec::new();
        for count in [8, 16] {
            for (name, error) in errors {
                for spread in [0.0, 0.5] {
                    let choose = |vertex: &Vertex| self.choose(vertex, count, error, spread);
                    let references: Vec<Vec<usize>> = self.vertices.par_iter().map(choose).collect();
                    let image = self.render_with(&variant, &proxies, is_glossy, &references);
                    let spread = if spread > 0.0 { ", spread in angle" } else { "" };
                    rows.push(Row::new(
                        format!("{count} by {name}{spread}"),
                        &image,
                        &self.truth[usize::from(is_glossy)],
                    ));
                }
            }
        }
        rows
    }

    /// The `count` caches of least error. With `spread` they are chosen one by one, and each choice raises the error of
    /// caches in its direction by this share.
    fn choose(&self, vertex: &Vertex, count: usize, error: fn(f64, f64, f64) -> f64, spread: f64) -> Vec<usize> {
        let errors = vertex.own.clone().map(|index| {
            let cache = &self.caches[index];
            let offset = (cache.position - vertex.position) / self.spacing;
            let plane = vertex.normal.dot(offset).abs().max(cache.normal.dot(offset).abs());
            (error(offset.length(), vertex.normal.dot(cache.normal).clamp(0.0, 1.0), plane), index)
        });
        let mut errors: Vec<_> = errors.collect();
        errors.sort_by(|a, b| a.0.total_cmp(&b.0));
        // Only the best four times as many are considered.
        errors.truncate(if spread > 0.0 { 4 * count } else { count });
        let mut chosen = Vec::new();
        while chosen.len() < count && !errors.is_empty() {
            let best = (0..errors.len()).min_by(|a, b| errors[*a].0.total_cmp(&errors[*b].0)).unwrap_or_default();
            let (_, index) = errors.remove(best);
            let direction = (self.caches[index].position - vertex.position).normalize_or_zero();
            for (error, other) in &mut errors {
                let towards = (self.caches[*other].position - vertex.position).normalize_or_zero();
                *error *= 1.0 + spread * towards.dot(direction).max(0.0).powi(2);
            }
            chosen.push(index);
        }
        chosen
    }

    /// Areas of VALs against light paths: diffuse and glossy lobe, and the mean relative standard error of the paths,
    /// below which no error can be resolved.
    pub fn areas(&self) -> ([Vec<Row>; 2], f64) {
        let (truth, noise) = self.light_paths();
        let mut rows = [Vec::new(), Vec::new()];
        for rsm in [32, 64, 128] {
            for tilted in [None, Some(1.0), Some(2.0), Some(4.0), Some(8.0)] {
                let name = match tilted {
                    None => format!("{rsm}^2, square to the axis"),
                    Some(limit) => format!("{rsm}^2, tilted at most {limit}-fold"),
                };
                let image = self.by_vals(&study::vals(self.scene, &self.world, rsm, tilted));
                for lobe in 0..2 {
                    rows[lobe].push(Row::new(name.clone(), &image[lobe], &truth[lobe]));
                }
            }
        }
        (rows, noise)
    }

    /// Location of the engine's squared error for one lobe.
    pub fn worst(&self, is_glossy: bool) -> Worst {
        let (variant, lobe_index) =
            (if is_glossy { Variant::GLOSSY } else { Variant::DIFFUSE }, usize::from(is_glossy));
        let gathered = self.gather(ProxyWeight::Irradiance);
        let image = self.render(&variant, &self.proxies(&gathered, lobe(is_glossy)), is_glossy);
        let truth = &self.truth[lobe_index];
        let paths = &self.light_paths().0[lobe_index];
        let order = by_error(&image, truth);
        let worst = &order[order.len() * 99 / 100..];
        let squares = relative_squares(&image, truth);
        let share = |is: &dyn Fn(usize) -> bool| {
            worst.iter().filter(|pixel| is(**pixel)).count() as f64 / worst.len().max(1) as f64
        };
        let mean = |image: &[[f32; 3]]| sum(image, worst) / (3 * worst.len().max(1)) as f64;
        Worst {
            share: worst.iter().map(|pixel| squares[*pixel]).sum::<f64>() / squares.iter().sum::<f64>(),
            near_val: share(&|pixel| {
                let near = |val: &crate::reference::rsm::Val| {
                    val.position.distance_squared(self.pixels[pixel].position) < val.area
                };
                self.vals.iter().any(near)
            }),
            too_bright: share(&|pixel| sum(&image, &[pixel]) > sum(truth, &[pixel])),
            radiance: [mean(&image), mean(truth), mean(paths)],
        }
    }

    fn rows(&self, is_glossy: bool, weight: ProxyWeight, variants: &[(String, Variant)]) -> Vec<Row> {
        let gathered = self.gather(weight);
        let proxies = self.proxies(&gathered, lobe(is_glossy));
        let row = |(name, variant): &(String, Variant)| {
            Row::new(name, &self.render(variant, &proxies, is_glossy), &self.truth[usize::from(is_glossy)])
        };
        variants.iter().map(row).collect()
    }

    fn gather(&self, weight: ProxyWeight) -> Vec<Gathered> {
        let eye = self.is_glossy().then(|| self.eye());
        self.caches.par_iter().map(|cache| gather(cache, &self.vals, eye, weight)).collect()
    }

    /// Both lobes by unshadowed light paths of one bounce, and their noise.
    fn light_paths(&self) -> ([Vec<[f32; 3]>; 2], f64) {
        let settings = path_trace::PathTraceSettings::unshadowed(self.settings.size);
        let mut trace = PathTrace::new(self.scene, self.camera, &settings);
        for _ in 0..SAMPLES / PASS_SAMPLES {
            trace.pass();
        }
        let covered = trace.covered();
        let seen = |image: Vec<[f32; 3]>| image.into_iter().zip(&covered).filter(|p| *p.1).map(|p| p.0).collect();
        ([seen(trace.diffuse()), seen(trace.glossy())], trace.noise())
    }
}

fn lobe(is_glossy: bool) -> fn(&Gathered) -> &Lobe {
    if is_glossy { |gathered| &gathered.glossy } else { |gathered| &gathered.diffuse }
}
