//! The picture of a render: layers, whoever made them, to PNG or EXR.

use anyhow::Result;
use clap::ValueEnum;
use glam::{DVec3, Vec4};
use lightskin::frame::{Behind, Picture, Tonemap, View};
use lightskin::gpu::Gpu;
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
    /// Clipping alone.
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

/// Layers by the names they have in an EXR file.
#[derive(Clone, Copy, PartialEq, ValueEnum)]
pub(super) enum LayerArg {
    /// All radiance.
    Color,
    /// Emitted and directly reflected radiance.
    Direct,
    /// Both lobes of the indirect radiance.
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
    /// Distance [m] from the camera's plane.
    #[value(name = "Z")]
    Z,
}

/// What a picture consists of; RGBA or XYZ and a spare, row by row from the top.
pub(super) struct Layers {
    /// Picture [pixels].
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
    /// Distance [m] from the camera's plane.
    pub(super) depth: Vec<[f32; 4]>,
}

impl Layers {
    /// Both lobes of the indirect radiance.
    pub(super) fn indirect(&self) -> Vec<[f32; 4]> {
        sum(&self.diffuse, &self.glossy)
    }

    /// All radiance.
    pub(super) fn color(&self) -> Vec<[f32; 4]> {
        sum(&self.direct, &self.indirect())
    }

    /// The exposure value that suits the surfaces.
    pub(super) fn automatic_ev(&self) -> f64 {
        let radiance: Vec<DVec3> = self.color().iter().map(|p| Vec4::from(*p).truncate().as_dvec3()).collect();
        let seen: Vec<bool> = self.depth.iter().map(|z| z[0].is_finite()).collect();
        tonemap::automatic_ev(self.size, &radiance, &seen)
    }

    /// How many values no radiance can have.
    pub(super) fn broken(&self) -> usize {
        [&self.direct, &self.diffuse, &self.glossy].into_iter().flatten().map(|p| broken_values(&p[..3])).sum()
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

    /// Writes an EXR with all layers, or one alone as EXR or PNG; without one a PNG shows all radiance.
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
        let covered = || self.depth.iter().map(|depth| depth[0].is_finite());
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
                let alpha: Vec<_> = covered().map(|covered| [f32::from(u8::from(covered)); 4]).collect();
                layers.push(Layer::of("", &["A"], &alpha));
            }
            write_exr(path, w, h, &layers, metadata)?;
        } else {
            let which = which.unwrap_or(LayerArg::Color);
            let nothing = match behind {
                Behind::Scene => None,
                Behind::Color(color) => Some(bytes(tonemap::srgb_from_linear(color.as_dvec3()))),
                Behind::Transparent => Some([0; 4]),
            };
            let pixel = |(p, covered): (&[f32; 4], bool)| match nothing {
                Some(nothing) if !covered => nothing,
                _ => display(which, *p, curve, ev),
            };
            let shown: Vec<u8> = self.layer(which).iter().zip(covered()).flat_map(pixel).collect();
            write_png(path, w, h, &shown)?;
        }
        Ok(())
    }
}

/// Whether a file's name asks for OpenEXR.
pub(super) fn is_exr(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr"))
}

fn sum(a: &[[f32; 4]], b: &[[f32; 4]]) -> Vec<[f32; 4]> {
    a.iter().zip(b).map(|(a, b)| [a[0] + b[0], a[1] + b[1], a[2] + b[2], 1.0]).collect()
}

/// A layer's value as sRGB bytes: radiance as the picture is shown, others so that they can be looked at.
fn display(which: LayerArg, p: [f32; 4], curve: TonemapArg, ev: f32) -> [u8; 4] {
    let v = DVec3::new(p[0].into(), p[1].into(), p[2].into());
    let srgb = match which {
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
    };
    bytes(srgb)
}

/// An opaque pixel.
fn bytes(srgb: DVec3) -> [u8; 4] {
    let byte = |c: f64| (c.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
    [byte(srgb.x), byte(srgb.y), byte(srgb.z), 255]
}

/// The exposure value that the picture of the last frame is shown with.
pub(super) fn exposure_value(gpu: &Gpu, picture: &Picture) -> Result<f32> {
    Ok(gpu.read::<f32>(&picture.output.exposure)?[0])
}

/// How a picture is written.
pub(super) struct Writing {
    /// This layer alone.
    pub(super) layer: Option<LayerArg>,
    /// Curve from scene to display.
    pub(super) tonemap: TonemapArg,
    /// What shows where no surface is.
    pub(super) behind: Behind,
}

impl Writing {
    /// Writes the picture of the last frame, and says how many of its values no radiance can have; `about` is what an EXR
    /// file says of itself.
    pub(super) fn write(&self, gpu: &Gpu, picture: &Picture, view: &View, about: &str, out: &Path) -> Result<usize> {
        let ev = exposure_value(gpu, picture)?;
        let layers = read_layers(gpu, picture, view)?;
        if self.layer.is_none() && !is_exr(out) {
            let [w, h] = picture.size();
            write_png(out, w, h, &gpu.read_image(&picture.output.picture)?)?;
        } else {
            layers.write(out, self.layer, self.tonemap, ev, self.behind, &format!("{about}; EV {ev}"))?;
        }
        Ok(layers.broken())
    }
}

/// Reads the layers back.
fn read_layers(gpu: &Gpu, picture: &Picture, view: &View) -> Result<Layers> {
    let (surface, indirect, size) = (&picture.surface, picture.indirect.as_ref(), picture.size());
    let dark = || vec![[0.0; 4]; size[0] as usize * size[1] as usize];
    let optional = |image: Option<&lightskin::gpu::Image>| -> Result<Vec<[f32; 4]>> {
        Ok(image.map(|image| gpu.read_image(image)).transpose()?.unwrap_or_else(dark))
    };
    Ok(Layers {
        size,
        direct: gpu.read_image(&surface.radiance)?,
        diffuse: optional(indirect.map(|i| &i.diffuse))?,
        glossy: optional(indirect.and_then(|i| i.glossy.as_ref()))?,
        albedo: read_half(gpu, &surface.albedo)?,
        normal: gpu.read_image(&surface.normal)?,
        depth: view_depth(&gpu.read_image::<f32>(&surface.depth)?, view, size),
    })
}

/// RGBA16F texels as f32.
fn read_half(gpu: &Gpu, image: &lightskin::gpu::Image) -> Result<Vec<[f32; 4]>> {
    let texels: Vec<[u16; 4]> = gpu.read_image(image)?;
    Ok(texels.into_iter().map(|t| t.map(|h| half::f16::from_bits(h).to_f32())).collect())
}

/// Distances [m] from the camera's plane; infinite where nothing is.
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
