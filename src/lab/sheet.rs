//! Contact sheet of scenes: the engine's picture, the path tracer's, and their difference, as a self-contained page.

use crate::error::{Error, Result};
use crate::files;
use crate::image::{Picture, png};
use crate::lab::plot::escape;
use crate::metrics::display::{Values, clean, encode};
use crate::metrics::flip::{PIXELS_PER_DEGREE, flip};
use crate::metrics::heat::{Scale, colors};
use crate::metrics::metrics;
use crate::reference::tonemap::{automatic_ev, pbr_neutral};
use base64::Engine;
use glam::Vec3;
use std::fmt::Write;
use std::path::Path;

/// Scale of the FLIP maps.
const HEAT: Scale = Scale::Linear(1.0);

const STYLE: &str = include_str!("eval/report.css");

/// Errors of a scene, and its part of the page.
pub struct Entry {
    /// The scene's file name.
    pub scene: String,
    /// HDR-FLIP: mean over all pixels.
    pub flip: f64,
    /// HDR-FLIP: mean over pixels that show a surface.
    pub flip_of_surfaces: f64,
    /// HDR-FLIP that an exact picture would have: that of the path tracer's own noise.
    pub flip_of_noise: f64,
    /// Relative error of the mean radiance over pixels that show a surface.
    pub bias: f64,
    html: String,
}

impl Entry {
    /// Compares a picture with the mean of two of the path tracer that have equally many, independent samples. All
    /// hold linear radiance. The first differs from their mean as much as the mean differs from the truth: its FLIP is
    /// that of the noise. `covered` marks pixels that show a surface. `notes` are printed below.
    ///
    /// # Errors
    /// Fails if the pictures differ in size, show no surface or have non-finite values.
    pub fn new(
        scene: &str,
        drawn: &Picture,
        [half, other]: &[Picture; 2],
        covered: &[bool],
        notes: &[String],
    ) -> std::result::Result<Self, String> {
        let size = [half.width, half.height];
        let sizes = [drawn, half, other].map(|picture| [picture.width, picture.height]);
        if sizes != [size; 3] || covered.len() != half.rgb.len() {
            return Err("the pictures differ in size".into());
        }
        let mean_of = |(a, b): (&[f32; 3], &[f32; 3])| [0, 1, 2].map(|channel| 0.5 * (a[channel] + b[channel]));
        let traced: Vec<[f32; 3]> = half.rgb.iter().zip(&other.rgb).map(mean_of).collect();
        if !covered.contains(&true) {
            return Err("the camera sees no surface".into());
        }
        let map = flip(&drawn.rgb, &traced, size, Values::Radiance, PIXELS_PER_DEGREE);
        let noise = flip(&half.rgb, &traced, size, Values::Radiance, PIXELS_PER_DEGREE);
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        let of_surfaces = |rgb: &[[f32; 3]]| -> Vec<[f32; 3]> {
            rgb.iter().zip(covered).filter(|(_, covered)| **covered).map(|(pixel, _)| *pixel).collect()
        };
        let seen: Vec<f64> =
            map.iter().zip(covered).filter(|(_, covered)| **covered).map(|(error, _)| *error).collect();
        let bias = metrics(&of_surfaces(&drawn.rgb), &of_surfaces(&traced)).bias;
        let (flip, flip_of_surfaces, flip_of_noise) = (mean(&map), mean(&seen), mean(&noise));
        if !(flip.is_finite() && flip_of_noise.is_finite()) {
            return Err("values of the pictures are not finite; this is a bug of lightskin".into());
        }
        let radiance: Vec<_> = traced.iter().map(|rgb| Vec3::from(*rgb).as_dvec3()).collect();
        let exposure = (-automatic_ev(size, &radiance, covered)).exp2() / 1.2;
        let shown = |rgb: &[[f32; 3]]| -> Vec<u8> {
            let bytes = |pixel: &[f32; 3]| {
                let srgb = encode(pbr_neutral(clean(*pixel) * exposure)) * 255.0 + 0.5;
                [srgb.x as u8, srgb.y as u8, srgb.z as u8, 255]
            };
            rgb.iter().flat_map(bytes).collect()
        };
        let mut html = String::new();
        for (what, rgba) in [
            ("the engine", shown(&drawn.rgb)),
            ("the path tracer", shown(&traced)),
            ("FLIP of each pixel", colors(&map, HEAT)),
        ] {
            let data = base64::engine::general_purpose::STANDARD.encode(png(size[0], size[1], &rgba)?);
            // Writing to a string cannot fail.
            let _ = writeln!(
                html,
                "<figure><img alt=\"{what}\" src=\"data:image/png;base64,{data}\"><figcaption>{what}</figcaption></figure>"
            );
        }
        let mut html = format!(
            "<p>FLIP <b>{flip:.4}</b>, {flip_of_surfaces:.4} of surfaces, {flip_of_noise:.4} of the path tracer's noise; \
             bias of surfaces <b>{:+.2} %</b></p>\n\
             <div class=\"strip\">{html}</div>\n",
            100.0 * bias
        );
        for note in notes {
            let _ = writeln!(html, "<p><small>{}</small></p>", escape(note));
        }
        Ok(Self { scene: scene.into(), flip, flip_of_surfaces, flip_of_noise, bias, html })
    }
}

/// All scenes so far.
#[derive(Default)]
pub struct Sheet {
    /// Drawn scenes, the worst first.
    entries: Vec<Entry>,
    /// Scenes that could not be drawn, with reasons.
    failed: Vec<(String, String)>,
}

impl Sheet {
    /// Adds a scene, or the reason why there is no picture of it.
    pub fn add(&mut self, scene: &str, entry: std::result::Result<Entry, String>) {
        match entry {
            Ok(entry) => {
                let worse = self.entries.partition_point(|other| other.flip >= entry.flip);
                self.entries.insert(worse, entry);
            }
            Err(reason) => self.failed.push((scene.into(), reason)),
        }
    }

    /// Numbers of drawn and of failed scenes.
    pub fn counts(&self) -> [usize; 2] {
        [self.entries.len(), self.failed.len()]
    }

    /// Medians over scenes of FLIP, of the noise's FLIP, and of the absolute bias; `None` without scenes.
    pub fn medians(&self) -> Option<[f64; 3]> {
        let median = |of: &dyn Fn(&Entry) -> f64| {
            let mut sorted: Vec<f64> = self.entries.iter().map(of).collect();
            sorted.sort_by(f64::total_cmp);
            let middle = sorted.len() / 2;
            if sorted.len() % 2 == 1 { sorted[middle] } else { 0.5 * (sorted[middle - 1] + sorted[middle]) }
        };
        (!self.entries.is_empty()).then(|| {
            [median(&|entry| entry.flip), median(&|entry| entry.flip_of_noise), median(&|entry| entry.bias.abs())]
        })
    }

    /// Writes the page; `about` says how the pictures were made.
    ///
    /// # Errors
    /// Fails if a file cannot be written.
    pub fn write(&self, path: &Path, about: &str) -> Result<()> {
        if path.is_dir() {
            let reason = "is a folder; name a file".into();
            return Err(Error::Output { file: path.to_owned(), reason });
        }
        files::write(path, self.html(about).as_bytes())
    }

    fn html(&self, about: &str) -> String {
        let title = "lightskin: scenes compared with the path tracer";
        let mut page = format!(
            "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
             <meta name=\"viewport\" content=\"width=device-width\"><title>{title}</title><style>{STYLE}</style></head>\n\
             <body>\n<h1>{title}</h1>\n<p>{}</p>\n",
            escape(about)
        );
        if let Some([flip, noise, bias]) = self.medians() {
            let _ = writeln!(
                page,
                "<p>Median of {} scenes: FLIP <b>{flip:.4}</b>, {noise:.4} of noise, absolute bias of surfaces \
                 <b>{:.2} %</b>. An exact picture would have the noise's FLIP.</p>",
                self.entries.len(),
                100.0 * bias
            );
        }
        let lines: String = (self.failed.iter())
            .map(|(scene, reason)| format!("<li>{}: {}</li>\n", escape(scene), escape(reason)))
            .collect();
        if !lines.is_empty() {
            let _ = writeln!(page, "<div class=\"warn\">Not drawn:<ul>{lines}</ul></div>");
        }
        page.push_str(
            "<table>\n<tr><th>scene</th><th>FLIP</th><th>of surfaces</th><th>of noise</th>\
             <th>bias of surfaces</th></tr>\n",
        );
        for (index, entry) in self.entries.iter().enumerate() {
            let Entry { scene, flip, flip_of_surfaces, flip_of_noise, bias, .. } = entry;
            let _ = writeln!(
                page,
                "<tr><td><a href=\"#scene-{index}\">{}</a></td><td>{flip:.4}</td><td>{flip_of_surfaces:.4}</td>\
                 <td>{flip_of_noise:.4}</td><td>{:+.2} %</td></tr>",
                escape(scene),
                100.0 * bias
            );
        }
        page.push_str("</table>\n");
        for (index, Entry { scene, html, .. }) in self.entries.iter().enumerate() {
            let _ = writeln!(page, "<section><h2 id=\"scene-{index}\">{}</h2>\n{html}</section>", escape(scene));
        }
        page.push_str("</body></html>\n");
        page
    }
}
