//! Comparison of two pictures side by side: lightskin's picture, references of the current view, or files. The error is
//! shown as numbers and as a map.

use super::background::{Rest, Thread};
use super::side::{Reference, Side, Source};
use crate::cli::view::print;
use anyhow::Result;
use glam::{DVec3, Vec3};
use lightskin::frame::{Engine, Look, Picture, Tonemap, View};
use lightskin::gpu::{Format, Gpu, Image};
use lightskin::image::is_exr;
use lightskin::metrics::display::Values;
use lightskin::metrics::flip::{PIXELS_PER_DEGREE, flip};
use lightskin::metrics::heat::{self, Scale};
use lightskin::metrics::{metrics, relative_squares};
use lightskin::reference::tonemap;
use lightskin::scene::Camera;
use lightskin::shared::LAYER_COLOR;
use std::borrow::Cow;
use std::path::Path;
use std::sync::Arc;
use std::thread::JoinHandle;

/// Content to the right of the wipe.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Map {
    /// The right picture itself.
    Reference,
    /// FLIP of each pixel.
    Flip,
    /// Relative squared error of each pixel.
    Relmse,
}

/// A picture that covers a part of lightskin's picture.
pub(super) struct Over<'a> {
    pub(super) image: &'a Image,
    /// How to show the image: a `LAYER_*`.
    pub(super) how: u32,
    /// Left and right end as shares of the width.
    pub(super) part: [f32; 2],
}

/// Errors of the left picture against the right one.
pub(super) struct Errors {
    pub(super) flip: f64,
    pub(super) relmse: f64,
    pub(super) bias: f64,
    /// The scale of the map.
    pub(super) scale: Option<Scale>,
}

/// The current state of the window.
pub(super) struct Now<'a> {
    pub(super) engine: &'a Engine,
    pub(super) picture: &'a Picture,
    pub(super) view: View,
    pub(super) camera: Camera,
    pub(super) look: Look,
    /// Number of changes of the scene so far.
    pub(super) changes: u64,
    /// Whether a job runs, a video is written, an animation plays or the camera flies.
    pub(super) busy: bool,
}

/// Identifies a measurement: the numbers of lightskin's picture and of both references, and the map.
pub(super) type Measured = (u64, [u64; 2], Map);

/// Both sides, and their size.
type Sides = ([Pixels; 2], [u32; 2]);

/// The thread of a measurement.
enum Measuring {
    /// Reads lightskin's picture back.
    Reads(Thread<Sides>),
    /// Returns the errors, and the map as RGBA.
    Compares(JoinHandle<(Errors, Vec<u8>)>),
}

impl Measuring {
    fn is_finished(&self) -> bool {
        match self {
            Self::Reads(thread) => thread.is_finished(),
            Self::Compares(thread) => thread.is_finished(),
        }
    }
}

/// The comparison.
pub(super) struct Compare {
    /// The pictures left and right of the wipe.
    pub(super) sides: [Side; 2],
    /// Whether the comparison is shown instead of lightskin's picture alone.
    pub(super) shown: bool,
    /// Share of the width for the left picture.
    pub(super) wipe: f32,
    pub(super) map: Map,
    pub(super) errors: Option<Errors>,
    pub(super) rest: Rest,
    measuring: Option<(Measured, Measuring)>,
    /// Number of lightskin's pictures so far.
    pictures: u64,
    measured: Option<Measured>,
    image: Option<Image>,
    /// Problems that the barrier check has reported for frames of the comparison.
    pub(super) problems: Vec<String>,
}

impl Compare {
    /// Compares lightskin with the path tracer, which stops at `most` samples per pixel.
    pub(super) fn new(most: u32) -> Self {
        Self {
            sides: [Source::Lightskin, Source::PathTrace].map(|source| Side::new(source, most)),
            shown: false,
            wipe: 0.0,
            map: Map::Reference,
            errors: None,
            rest: Rest::new(),
            measuring: None,
            pictures: 0,
            measured: None,
            image: None,
            problems: Vec::new(),
        }
    }

    /// Reads a picture in the background and shows it: on the left if that side waits for a file, else on the right.
    pub(super) fn open(&mut self, path: &Path) {
        let [left, right] = &mut self.sides;
        if left.waits_for_file() {
            left.open(path)
        } else {
            right.open(path)
        }
        self.shown = true;
    }

    /// Whether the ending of a file's name is that of a picture which can only be compared with.
    pub(super) fn is_picture(path: &Path) -> bool {
        let ending = path.extension().and_then(|e| e.to_str()).map(str::to_lowercase);
        ending.is_some_and(|ending| ["png", "jpg", "jpeg"].contains(&ending.as_str()))
    }

    /// Whether a dropped file is to be compared with. An EXR is one only while the comparison is shown; otherwise it is
    /// a sky.
    pub(super) fn takes(&self, path: &Path) -> bool {
        Self::is_picture(path) || (self.shown && is_exr(path))
    }

    /// Size of the file, if a side shows one. The picture needs the same size.
    pub(super) fn file_size(&self) -> Option<[u32; 2]> {
        self.sides.iter().rev().find_map(Side::file_size)
    }

    /// The images to draw over lightskin's picture.
    pub(super) fn over(&self) -> Vec<Over<'_>> {
        if !self.shown {
            return Vec::new();
        }
        let [left, right] = &self.sides;
        let map = self.image.as_ref().filter(|_| self.map != Map::Reference).map(|map| (map, LAYER_COLOR));
        let parts = [(left.image(), [0.0, self.wipe]), (map.or(right.image()), [self.wipe, 1.0])];
        parts.into_iter().filter_map(|(seen, part)| seen.map(|(image, how)| Over { image, how, part })).collect()
    }

    /// A value that changes whenever there is something new to show.
    pub(super) fn version(&self) -> ([u64; 2], Option<Measured>, [bool; 2]) {
        (self.numbers(), self.measured, self.sides.each_ref().map(|side| side.reference().is_some()))
    }

    fn numbers(&self) -> [u64; 2] {
        self.sides.each_ref().map(|side| side.made)
    }

    /// Whether there is work to do without input.
    pub(super) fn works(&self) -> bool {
        let waits = self.sides.iter().any(|side| side.works() || (self.shown && side.waits()));
        self.measuring.is_some() || waits || self.is_unmeasured()
    }

    /// Whether the next step should follow at once.
    pub(super) fn hurries(&self) -> bool {
        self.shown && self.rest.is_over() && self.sides.iter().any(Side::hurries)
    }

    fn wanted(&self) -> Measured {
        (self.pictures, self.numbers(), self.map)
    }

    /// Whether the two sides can have different pictures.
    fn differ(&self) -> bool {
        self.sides[0].source != self.sides[1].source || self.sides[0].source == Source::File
    }

    fn is_unmeasured(&self) -> bool {
        self.shown && self.differ() && self.sides.iter().all(Side::is_whole) && self.measured != Some(self.wanted())
    }

    /// A line that describes both sides and their progress.
    pub(super) fn state(&self) -> String {
        let [left, right] = &self.sides;
        if left.source == Source::Lightskin { right.state() } else { format!("{} | {}", left.state(), right.state()) }
    }

    /// Switches the comparison off.
    pub(super) fn stop(&mut self) {
        self.shown = false;
        self.sides.iter_mut().for_each(Side::forget);
    }

    /// Drops everything on the device. The next steps make it again on another.
    pub(super) fn leave_device(&mut self) {
        (self.image, self.measured, self.measuring) = (None, None, None);
        self.sides.iter_mut().for_each(Side::leave_device);
    }

    /// Advances by one step after each frame: takes over new results and starts missing work. Waits for nothing but the
    /// device. `drew` means that the picture has changed. Returns the size that the picture needs for a newly loaded
    /// file.
    pub(super) fn step(&mut self, gpu: &Gpu, now: &Now<'_>, drew: bool) -> Result<Option<[u32; 2]>> {
        self.pictures += u64::from(drew);
        let rests = self.rest.is_over() && !now.busy;
        let mut size = None;
        for side in &mut self.sides {
            size = side.step(gpu, now, (self.shown && rests, &self.rest), &mut self.problems)?.or(size);
        }
        self.shown |= size.is_some();
        if !self.differ() || !self.sides.iter().all(Side::is_there) {
            (self.errors, self.measured, self.image) = (None, None, None);
        }
        self.measure(gpu, now, rests)?;
        Ok(size)
    }

    fn measure(&mut self, gpu: &Gpu, now: &Now<'_>, rests: bool) -> Result<()> {
        match self.measuring.take_if(|(_, measuring)| measuring.is_finished()) {
            Some((of, Measuring::Reads(thread))) if of.1 == self.numbers() => {
                let ([image, reference], size) = thread.join()?;
                let (values, rest) = (self.values(), self.rest.clone());
                let compare = move || errors(&image.values(), &reference.values(), values, size, of.2);
                let compares = std::thread::spawn(move || rest.first(compare));
                self.measuring = Some((of, Measuring::Compares(compares)));
            }
            Some((of, Measuring::Compares(thread))) if of.1 == self.numbers() => {
                if let Ok((errors, map)) = thread.join() {
                    self.take(gpu, now.picture.size(), of, (errors, map))?;
                }
            }
            _ => {}
        }
        if rests && self.measuring.is_none() && self.is_unmeasured() {
            let read = self.read(gpu, now)?;
            self.measuring = Some((self.wanted(), Measuring::Reads(Thread::start(read))));
        }
        Ok(())
    }

    /// If either side has display values, both sides are compared as a display shows them.
    fn values(&self) -> Values {
        let shows = |side: &Side| side.reference().is_some_and(|reference| reference.values == Values::Display);
        if self.sides.iter().any(shows) { Values::Display } else { Values::Radiance }
    }

    /// Begins to read both sides. The result waits for the device.
    fn read(&self, gpu: &Gpu, now: &Now<'_>) -> Result<impl FnOnce() -> Result<Sides> + Send + use<>> {
        let (values, curve, size) = (self.values(), now.look.tonemap, now.picture.size());
        let references = self.sides.each_ref().map(|side| side.reference());
        let ours = references.iter().any(Option::is_none).then(|| read(gpu, now.picture, values)).transpose()?;
        let ev = gpu.begin("readback", |cmd| cmd.read_buffer::<f32>(&now.picture.output.exposure))?;
        Ok(move || {
            let look = (curve, ev.take()?[0]);
            let mut ours = ours.map(|wait| wait()).transpose()?.unwrap_or_default();
            let pixels = references.map(|reference| match reference {
                Some(reference) => {
                    let look = (reference.values != values).then_some(look);
                    Pixels::Of(reference, look)
                }
                None => Pixels::Read(std::mem::take(&mut ours)),
            });
            Ok((pixels, size))
        })
    }

    /// Takes over a measurement.
    fn take(&mut self, gpu: &Gpu, size: [u32; 2], of: Measured, (errors, map): (Errors, Vec<u8>)) -> Result<()> {
        let [width, height] = size;
        let fits = map.len() == 4 * width as usize * height as usize;
        self.image = (of.2 != Map::Reference && fits)
            .then(|| gpu.texture("window.map", Format::R8G8B8A8_UNORM, width, height, &[map]))
            .transpose()?;
        self.measured = Some(of);
        // Print the errors once the references are final.
        if !self.sides.iter().any(Side::works) && of == self.wanted() {
            let Errors { flip, relmse, bias, .. } = errors;
            print(&format!("errors    flip {flip:.6}, relmse {relmse:.6}, bias {bias:.6}: {}", self.state()));
        }
        self.errors = Some(errors);
        Ok(())
    }
}

/// Pixels of a side.
enum Pixels {
    /// Pixels of lightskin's picture.
    Read(Vec<[f32; 3]>),
    /// A reference. With a tone curve and an exposure value, it is converted to display values.
    Of(Arc<Reference>, Option<(Tonemap, f32)>),
}

impl Pixels {
    fn values(&self) -> Cow<'_, [[f32; 3]]> {
        match self {
            Self::Read(pixels) => pixels.into(),
            Self::Of(reference, None) => (&reference.rgb).into(),
            Self::Of(reference, Some((curve, ev))) => {
                let scale = f64::from(-ev).exp2() / 1.2;
                let shown = |rgb: &[f32; 3]| {
                    let exposed = Vec3::from(*rgb).as_dvec3().max(DVec3::ZERO) * scale;
                    let mapped = match curve {
                        Tonemap::PbrNeutral => tonemap::pbr_neutral(exposed),
                        Tonemap::Agx => tonemap::agx(exposed),
                        Tonemap::Aces => tonemap::aces(exposed),
                        Tonemap::Linear => tonemap::linear(exposed),
                    };
                    mapped.clamp(DVec3::ZERO, DVec3::ONE).as_vec3().to_array()
                };
                reference.rgb.iter().map(shown).collect::<Vec<_>>().into()
            }
        }
    }
}

/// Computes the errors, and the map as RGBA.
fn errors(image: &[[f32; 3]], reference: &[[f32; 3]], values: Values, size: [u32; 2], map: Map) -> (Errors, Vec<u8>) {
    let flips = flip(image, reference, size, values, PIXELS_PER_DEGREE);
    let found = metrics(image, reference);
    let mean = flips.iter().sum::<f64>() / flips.len() as f64;
    let (errors, scale) = match map {
        Map::Reference => (Vec::new(), None),
        Map::Flip => (flips, Some(Scale::Linear(1.0))),
        Map::Relmse => (relative_squares(image, reference), Some(Scale::Log(1e-6, 1.0))),
    };
    let colors = scale.map_or_else(Vec::new, |scale| heat::colors(&errors, scale));
    (Errors { flip: mean, relmse: found.relmse, bias: found.bias, scale }, colors)
}

/// Begins to read a picture: its total radiance [cd/m^2], or as a display shows it, converted to linear. The result
/// waits for the device, on any thread.
pub(super) fn read(
    gpu: &Gpu,
    picture: &Picture,
    values: Values,
) -> Result<impl FnOnce() -> Result<Vec<[f32; 3]>> + Send + use<>> {
    let indirect = picture.indirect.as_ref();
    let layers =
        [Some(&picture.surface.radiance), indirect.map(|i| &i.diffuse), indirect.and_then(|i| i.glossy.as_ref())];
    let (radiance, shown) = gpu.begin("readback", |cmd| {
        let image = &picture.output.picture;
        Ok(match values {
            Values::Display => (Vec::new(), Some(cmd.read_image::<[u8; 4]>(image)?)),
            Values::Radiance => {
                let layers = layers.into_iter().flatten().map(|image| cmd.read_image::<[f32; 4]>(image));
                (layers.collect::<lightskin::Result<_>>()?, None)
            }
        })
    })?;
    let [width, height] = picture.size().map(|side| side as usize);
    Ok(move || {
        if let Some(shown) = shown {
            let linear: Vec<f32> = (0..=255).map(lightskin::image::linear_from_srgb).collect();
            return Ok(shown.take()?.iter().map(|t| [0, 1, 2].map(|c| linear[usize::from(t[c])])).collect());
        }
        let mut all = vec![[0.0; 3]; width * height];
        for layer in radiance {
            all.iter_mut().zip(layer.take()?).for_each(|(all, one)| (0..3).for_each(|c| all[c] += one[c]));
        }
        Ok(all)
    })
}
