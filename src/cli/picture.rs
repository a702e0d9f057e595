//! Writes the picture of a render and its layers, from the engine or the path tracer, to PNG or EXR.

use anyhow::Result;
use clap::ValueEnum;
use glam::{DVec3, Vec4};
use lightskin::frame::edges::{Edges, Shown};
use lightskin::frame::{Antialiasing, Behind, Picture, Tonemap, View};
use lightskin::gpu::{Cmd, Gpu, Readback};
use lightskin::image::{Layer, broken_values, write_exr, write_png};
use lightskin::reference::tonemap;
use std::path::Path;

#[derive(Clone, Copy, Default, PartialEq, ValueEnum)]
pub(super) enum TonemapArg {
    /// Khronos PBR Neutral.
    #[default]
    PbrNeutral,
    /// AgX.
    Agx,
    /// ACES.
    Aces,
    /// No curve. Bright values clip.
    Linear,
}

impl TonemapArg {
    const ALL: [(Self, Tonemap); 4] = [
        (Self::PbrNeutral, Tonemap::PbrNeutral),
        (Self::Agx, Tonemap::Agx),
        (Self::Aces, Tonemap::Aces),
        (Self::Linear, Tonemap::Linear),
    ];

    pub(super) fn curve(self) -> Tonemap {
        Self::ALL.iter().find(|(arg, _)| *arg == self).map_or(Tonemap::default(), |(_, curve)| *curve)
    }

    #[cfg(feature = "app")]
    pub(super) fn of(curve: Tonemap) -> Self {
        Self::ALL.iter().find(|(_, of)| *of == curve).map_or(Self::default(), |(arg, _)| *arg)
    }
}

/// Layers, named as in an EXR file.
#[derive(Clone, Copy, PartialEq, ValueEnum)]
pub(super) enum LayerArg {
    /// Total radiance.
    Color,
    /// Emitted and directly reflected radiance.
    Direct,
    /// Indirect radiance, diffuse and glossy.
    Indirect,
    /// Diffuse indirect radiance.
    #[value(name = "indirect.diffuse")]
    IndirectDiffuse,
    /// Glossy indirect radiance.
    #[value(name = "indirect.glossy")]
    IndirectGlossy,
    /// Diffuse albedo.
    Albedo,
    /// World-space shading normal.
    Normal,
    /// Distance from the camera plane [m].
    #[value(name = "Z")]
    Z,
}

/// The layers of a picture. Each is RGBA, or XYZ and an unused component, row by row from the top.
pub(super) struct Layers {
    /// Size of the picture [pixels].
    pub(super) size: [u32; 2],
    /// Emitted and directly reflected radiance.
    pub(super) direct: Vec<[f32; 4]>,
    /// Diffuse indirect radiance.
    pub(super) diffuse: Vec<[f32; 4]>,
    /// Glossy indirect radiance.
    pub(super) glossy: Vec<[f32; 4]>,
    /// Diffuse albedo.
    pub(super) albedo: Vec<[f32; 4]>,
    /// World-space shading normal.
    pub(super) normal: Vec<[f32; 4]>,
    /// Distance from the camera plane [m].
    pub(super) depth: Vec<[f32; 4]>,
    /// Fraction of each pixel that surfaces cover.
    pub(super) covered: Vec<f32>,
    /// Radiance of the backdrop that is part of `direct`.
    pub(super) behind: Vec<[f32; 4]>,
}

impl Layers {
    /// Indirect radiance of both lobes.
    pub(super) fn indirect(&self) -> Vec<[f32; 4]> {
        sum(&self.diffuse, &self.glossy)
    }

    /// Total radiance.
    pub(super) fn color(&self) -> Vec<[f32; 4]> {
        sum(&self.direct, &self.indirect())
    }

    /// The exposure value that is metered from the surfaces.
    pub(super) fn automatic_ev(&self) -> f64 {
        let radiance: Vec<DVec3> = self.color().iter().map(|p| Vec4::from(*p).truncate().as_dvec3()).collect();
        let seen: Vec<bool> = self.depth.iter().map(|z| z[0].is_finite()).collect();
        tonemap::automatic_ev(self.size, &radiance, &seen)
    }

    /// The layers of light.
    pub(super) fn light_mut(&mut self) -> [&mut Vec<[f32; 4]>; 4] {
        [&mut self.direct, &mut self.diffuse, &mut self.glossy, &mut self.behind]
    }

    /// The part of this size whose first pixel is `at`.
    pub(super) fn cropped(self, at: [u32; 2], size: [u32; 2]) -> Self {
        fn part<T: Copy>(texels: &[T], width: u32, [x, y]: [u32; 2], [w, h]: [u32; 2]) -> Vec<T> {
            let row = |row: u32| ((y + row) * width + x) as usize;
            (0..h).flat_map(|i| &texels[row(i)..row(i) + w as usize]).copied().collect()
        }
        let of = |layer: Vec<[f32; 4]>| part(&layer, self.size[0], at, size);
        Self {
            size,
            direct: of(self.direct),
            diffuse: of(self.diffuse),
            glossy: of(self.glossy),
            albedo: of(self.albedo),
            normal: of(self.normal),
            depth: of(self.depth),
            covered: part(&self.covered, self.size[0], at, size),
            behind: of(self.behind),
        }
    }

    /// Number of radiance values that are negative or not finite.
    pub(super) fn broken(&self) -> usize {
        [&self.direct, &self.diffuse, &self.glossy].into_iter().map(|layer| broken(layer)).sum()
    }

    fn layer(&self, which: LayerArg) -> Vec<[f32; 4]> {
        match which {
            LayerArg::Color => self.color(),
            LayerArg::Direct => self.direct.clone(),
            LayerArg::Indirect => self.indirect(),
            LayerArg::IndirectDiffuse => self.diffuse.clone(),
            LayerArg::IndirectGlossy => self.glossy.clone(),
            LayerArg::Albedo => self.albedo.clone(),
            LayerArg::Normal => self.normal.clone(),
            LayerArg::Z => self.depth.clone(),
        }
    }

    /// Writes an EXR with all layers, a PNG of the total radiance, or only layer `which` in either format.
    pub(super) fn write(
        &self,
        path: &Path,
        which: Option<LayerArg>,
        curve: TonemapArg,
        ev: f32,
        behind: Behind,
        metadata: &str,
    ) -> Result<()> {
        let [w, h] = self.size;
        if is_exr(path) {
            let mut layers = match which {
                Some(which) => vec![Layer::rgb("", &self.layer(which))],
                None => vec![
                    Layer::rgb("", &self.color()),
                    Layer::rgb("direct", &self.direct),
                    Layer::rgb("indirect.diffuse", &self.diffuse),
                    Layer::rgb("indirect.glossy", &self.glossy),
                    Layer::rgb("albedo", &self.albedo),
                    Layer::of("normal", &["X", "Y", "Z"], &self.normal),
                    Layer::of("", &["Z"], &self.depth),
                ],
            };
            if behind == Behind::Transparent {
                let alpha: Vec<_> = self.covered.iter().map(|covered| [*covered; 4]).collect();
                layers.push(Layer::of("", &["A"], &alpha));
            }
            write_exr(path, w, h, &layers, metadata)?;
        } else {
            let which = which.unwrap_or(LayerArg::Color);
            let lit = matches!(which, LayerArg::Color | LayerArg::Direct);
            let pixel = |(i, p): (usize, &[f32; 4])| {
                let covered = f64::from(self.covered[i]);
                if behind == Behind::Scene {
                    return bytes(display(which, *p, curve, ev), 1.0);
                }
                if covered == 0.0 {
                    return match behind {
                        Behind::Color(color) => bytes(tonemap::srgb_from_linear(color.as_dvec3()), 1.0),
                        _ => [0; 4],
                    };
                }
                // The radiance of the surfaces alone, as if they covered the whole pixel.
                let own = |c: usize| if lit { (p[c] - self.behind[i][c]) / self.covered[i] } else { p[c] };
                let shown = display(which, [own(0), own(1), own(2), 1.0], curve, ev);
                match behind {
                    Behind::Color(color) => {
                        let mixed = color.as_dvec3().lerp(tonemap::linear_from_srgb(shown), covered);
                        bytes(tonemap::srgb_from_linear(mixed), 1.0)
                    }
                    _ => bytes(shown, covered),
                }
            };
            let shown: Vec<u8> = self.layer(which).iter().enumerate().flat_map(pixel).collect();
            write_png(path, w, h, &shown)?;
        }
        Ok(())
    }
}

/// Number of values of a layer that are negative or not finite.
fn broken(layer: &[[f32; 4]]) -> usize {
    layer.iter().map(|p| broken_values(&p[..3])).sum()
}

/// Whether the ending of a file's name is .exr.
pub(super) fn is_exr(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr"))
}

fn sum(a: &[[f32; 4]], b: &[[f32; 4]]) -> Vec<[f32; 4]> {
    a.iter().zip(b).map(|(a, b)| [a[0] + b[0], a[1] + b[1], a[2] + b[2], 1.0]).collect()
}

/// A layer's value as sRGB. Radiance is exposed and tone-mapped; other layers are mapped to a visible range.
fn display(which: LayerArg, p: [f32; 4], curve: TonemapArg, ev: f32) -> DVec3 {
    let v = DVec3::new(p[0].into(), p[1].into(), p[2].into());
    match which {
        LayerArg::Albedo => tonemap::srgb_from_linear(v.clamp(DVec3::ZERO, DVec3::ONE)),
        LayerArg::Normal => v * 0.5 + 0.5,
        LayerArg::Z => DVec3::splat(1.0 / (1.0 + v.x.max(0.0))),
        _ => {
            let exposed = v.max(DVec3::ZERO) * (f64::from(-ev).exp2() / 1.2);
            let mapped = match curve {
                TonemapArg::PbrNeutral => tonemap::pbr_neutral(exposed),
                TonemapArg::Agx => tonemap::agx(exposed),
                TonemapArg::Aces => tonemap::aces(exposed),
                TonemapArg::Linear => tonemap::linear(exposed),
            };
            tonemap::srgb_from_linear(mapped.clamp(DVec3::ZERO, DVec3::ONE))
        }
    }
}

/// A pixel in 8 bits per channel.
fn bytes(srgb: DVec3, alpha: f64) -> [u8; 4] {
    [srgb.x, srgb.y, srgb.z, alpha].map(|c| (c.clamp(0.0, 1.0) * 255.0 + 0.5) as u8)
}

/// The exposure value of the picture of the last frame.
pub(super) fn exposure_value(gpu: &Gpu, picture: &Picture) -> Result<f32> {
    Ok(gpu.read::<f32>(&picture.output.exposure)?[0])
}

/// How a picture is written.
#[derive(Clone, Copy)]
pub(super) struct Writing {
    /// The only layer to write. `None` for the picture.
    pub(super) layer: Option<LayerArg>,
    /// Tone curve from radiance to display colours.
    pub(super) tonemap: TonemapArg,
    /// Background where there is no surface.
    pub(super) behind: Behind,
}

impl Writing {
    /// Writes the picture of the last frame. Returns the number of radiance values that are negative or not finite.
    /// `about` is the description stored in an EXR file.
    pub(super) fn write(&self, gpu: &Gpu, picture: &Picture, view: &View, about: &str, out: &Path) -> Result<usize> {
        self.write_read(Read::begin(gpu, picture, view, self.needs_all(out))?()?, about, out)
    }

    /// Whether this file needs more than the picture and its radiance.
    pub(super) fn needs_all(&self, out: &Path) -> bool {
        self.layer.is_some() || is_exr(out)
    }

    /// Writes a picture that was read back. Needs no device, so it can run on any thread.
    pub(super) fn write_read(&self, read: Read, about: &str, out: &Path) -> Result<usize> {
        let Read { ev, size: [w, h], .. } = read;
        if !self.needs_all(out) {
            write_png(out, w, h, &read.shown)?;
            return Ok([&read.direct, &read.diffuse, &read.glossy].into_iter().map(|layer| broken(layer)).sum());
        }
        self.write_layers(&read.layers(), ev, about, out)
    }

    /// Writes layers, exposed by this exposure value. Returns as `write`.
    pub(super) fn write_layers(&self, layers: &Layers, ev: f32, about: &str, out: &Path) -> Result<usize> {
        layers.write(out, self.layer, self.tonemap, ev, self.behind, &format!("{about}; EV {ev}"))?;
        Ok(layers.broken())
    }
}

/// The parts of a picture that were read back, in the formats of the device.
pub(crate) struct Read {
    size: [u32; 2],
    view: View,
    ev: f32,
    /// The displayed pixels. Empty if all layers were read.
    shown: Vec<u8>,
    direct: Vec<[f32; 4]>,
    diffuse: Vec<[f32; 4]>,
    glossy: Vec<[f32; 4]>,
    rest: Option<Rest>,
}

/// Layers that only files with layers need.
struct Rest {
    albedo: Vec<[u16; 4]>,
    normal: Vec<[f32; 4]>,
    depth: Vec<f32>,
    edges: Option<ReadEdges>,
}

/// What antialiasing found off the centres of pixels.
struct ReadEdges {
    antialiasing: Antialiasing,
    /// Radiance of the first surfaces, before mixing.
    before: Vec<[f32; 4]>,
    /// Radiance and depth of the second surfaces; empty with fast antialiasing.
    second: Vec<[f32; 4]>,
    second_depth: Vec<f32>,
    codes: Vec<u32>,
}

impl Rest {
    /// As `Read::begin`.
    fn begin(
        cmd: &Cmd<'_>,
        picture: &Picture,
    ) -> lightskin::Result<impl FnOnce() -> lightskin::Result<Self> + Send + use<>> {
        let surface = &picture.surface;
        let (albedo, normal, depth) =
            (cmd.read_image(&surface.albedo)?, cmd.read_image(&surface.normal)?, cmd.read_image(&surface.depth)?);
        let edges = match &picture.edges {
            Some(edges) => Some((
                edges.antialiasing,
                cmd.read_image(&edges.before)?,
                picture.second().map(|second| cmd.read_image(&second.surface.radiance)).transpose()?,
                picture.second().map(|second| cmd.read_image(&second.surface.depth)).transpose()?,
                cmd.read_image(&edges.codes)?,
            )),
            None => None,
        };
        Ok(move || {
            let (albedo, normal, depth) = (albedo.take()?, normal.take()?, depth.take()?);
            let edges = match edges {
                Some((antialiasing, before, second, second_depth, codes)) => Some(ReadEdges {
                    antialiasing,
                    before: before.take()?,
                    second: second.map_or(Ok(Vec::new()), Readback::take)?,
                    second_depth: second_depth.map_or(Ok(Vec::new()), Readback::take)?,
                    codes: codes.take()?,
                }),
                None => None,
            };
            Ok(Self { albedo, normal, depth, edges })
        })
    }
}

impl Read {
    /// Begins to read a picture back, with all layers or only with its displayed pixels and radiance. The result waits
    /// for the device, on any thread.
    pub(super) fn begin(
        gpu: &Gpu,
        picture: &Picture,
        view: &View,
        all: bool,
    ) -> Result<impl FnOnce() -> Result<Self> + Send + use<>> {
        let (surface, indirect) = (&picture.surface, picture.indirect.as_ref());
        let (size, view) = (picture.size(), *view);
        Ok(gpu.begin("readback", |cmd| {
            let glossy = indirect.and_then(|i| i.glossy.as_ref());
            let optional = [indirect.map(|i| &i.diffuse), glossy].map(|image| image.map(|i| cmd.read_image(i)));
            let [diffuse, glossy] = optional.map(Option::transpose);
            let (diffuse, glossy) = (diffuse?, glossy?);
            let ev = cmd.read_buffer(&picture.output.exposure)?;
            let shown = if all { None } else { Some(cmd.read_image(&picture.output.picture)?) };
            let direct = cmd.read_image(&surface.radiance)?;
            let rest = if all { Some(Rest::begin(cmd, picture)?) } else { None };
            Ok(move || {
                let or_none = |layer: Option<Readback<[f32; 4]>>| layer.map_or(Ok(Vec::new()), Readback::take);
                Ok(Self {
                    size,
                    view,
                    ev: ev.take()?[0],
                    shown: shown.map_or(Ok(Vec::new()), Readback::take)?,
                    direct: direct.take()?,
                    diffuse: or_none(diffuse)?,
                    glossy: or_none(glossy)?,
                    rest: rest.map(|rest| rest()).transpose()?,
                })
            })
        })?)
    }

    /// Converts to the layers of files. All must have been read.
    pub(super) fn layers(self) -> Layers {
        let Self { size, view, direct, diffuse, glossy, rest, .. } = self;
        let count = direct.len();
        let or_dark = |layer: Vec<[f32; 4]>| if layer.is_empty() { vec![[0.0; 4]; count] } else { layer };
        let Rest { albedo, normal, depth, edges } = rest.expect("all was read");
        let (covered, behind) = backdrop(size[0] as usize, edges.as_ref(), &direct, &depth);
        let half = |texel: [u16; 4]| texel.map(|h| half::f16::from_bits(h).to_f32());
        Layers {
            size,
            covered,
            behind,
            direct,
            diffuse: or_dark(diffuse),
            glossy: or_dark(glossy),
            albedo: albedo.into_iter().map(half).collect(),
            normal,
            depth: view_depth(&depth, &view, size),
        }
    }
}

/// The fraction of each pixel that surfaces cover, and the backdrop's part of its direct radiance.
fn backdrop(width: usize, edges: Option<&ReadEdges>, direct: &[[f32; 4]], depth: &[f32]) -> (Vec<f32>, Vec<[f32; 4]>) {
    let of_one = |(depth, direct): (&f32, &[f32; 4])| if *depth > 0.0 { (1.0, [0.0; 4]) } else { (0.0, *direct) };
    let Some(edges) = edges else { return depth.iter().zip(direct).map(of_one).unzip() };
    let pixel = |i: usize| {
        let (mut points, mut covered, mut behind) = (0.0, 0.0, Vec4::ZERO);
        for shown in Edges::shown(edges.antialiasing, edges.codes[i]) {
            let (share, radiance) = of_one(match shown {
                Shown::Second => (&edges.second_depth[i], &edges.second[i]),
                Shown::First([x, y]) => {
                    let at = (i / width).wrapping_add_signed(y) * width + (i % width).wrapping_add_signed(x);
                    (&depth[at], &edges.before[at])
                }
            });
            points += 1.0;
            covered += share;
            behind += Vec4::from(radiance);
        }
        (covered / points, (behind / points).to_array())
    };
    (0..depth.len()).map(pixel).unzip()
}

/// Distances from the camera plane [m]; infinite where there is no surface.
fn view_depth(depth: &[f32], view: &View, [w, h]: [u32; 2]) -> Vec<[f32; 4]> {
    let middle = |i: usize| {
        let (x, y) = (i as u32 % w, i as u32 / w);
        Vec4::new((x as f32 + 0.5) / w as f32 * 2.0 - 1.0, (y as f32 + 0.5) / h as f32 * 2.0 - 1.0, depth[i], 1.0)
    };
    let distance = |i: usize| {
        if depth[i] == 0.0 {
            return f32::INFINITY;
        }
        let world = view.world_from_clip * middle(i);
        view.plane.dot(world / world.w)
    };
    (0..depth.len()).map(|i| [distance(i); 4]).collect()
}
