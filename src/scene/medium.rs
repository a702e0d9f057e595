//! Media that scatter light below a surface: coefficients, measured presets, and their parameters in the dipole model.
//! METHOD 7; Jensen, Marschner, Levoy and Hanrahan 2001, "A Practical Model for Subsurface Light Transport".

use std::f64::consts::PI;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// Smallest and largest reduced extinction [1/m] used in calculations: mean free paths of a thousand kilometres and of
/// a nanometre. Values derived from either fit single precision.
const EXTINCTION: [f64; 2] = [1e-6, 1e9];

/// Medium that fills a body, from `extras.lightskin.subsurface`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Subsurface {
    /// Scattering coefficient [1/m].
    pub sigma_s: Vec3,
    /// Absorption coefficient [1/m].
    pub sigma_a: Vec3,
    /// Mean cosine of scattering, in (-1, 1).
    pub g: f32,
    /// Index of refraction, at least 1.
    pub ior: f32,
    /// Factor on all mean free paths: 10 makes the body look a tenth of its size.
    pub scale: f32,
}

/// Name, reduced scattering and absorption [1/mm], index of refraction.
type Measured = (&'static str, [f32; 3], [f32; 3], f32);

/// Measurements of Jensen et al. 2001, figure 5. The scattering coefficients are reduced, as for isotropic scattering.
const MEASURED: [Measured; 12] = [
    ("apple", [2.29, 2.39, 1.97], [0.0030, 0.0034, 0.046], 1.3),
    ("chicken1", [0.15, 0.21, 0.38], [0.015, 0.077, 0.19], 1.3),
    ("chicken2", [0.19, 0.25, 0.32], [0.018, 0.088, 0.20], 1.3),
    ("cream", [7.38, 5.47, 3.15], [0.0002, 0.0028, 0.0163], 1.3),
    ("ketchup", [0.18, 0.07, 0.03], [0.061, 0.97, 1.45], 1.3),
    ("marble", [2.19, 2.62, 3.00], [0.0021, 0.0041, 0.0071], 1.5),
    ("potato", [0.68, 0.70, 0.55], [0.0024, 0.0090, 0.12], 1.3),
    ("skimmilk", [0.70, 1.22, 1.90], [0.0014, 0.0025, 0.0142], 1.3),
    ("skin1", [0.74, 0.88, 1.01], [0.032, 0.17, 0.48], 1.3),
    ("skin2", [1.09, 1.59, 1.79], [0.013, 0.070, 0.145], 1.3),
    ("spectralon", [11.6, 20.4, 14.9], [0.00, 0.00, 0.00], 1.3),
    ("wholemilk", [2.55, 3.21, 3.77], [0.0011, 0.0024, 0.014], 1.3),
];

/// Presets chosen by eye, not measured: name, diffuse colour, mean free path [mm], index of refraction.
const CHOSEN: [(&str, [f32; 3], [f32; 3], f32); 2] =
    [("wax", [0.92, 0.80, 0.55], [2.0, 1.6, 1.2], 1.45), ("jade", [0.30, 0.62, 0.36], [1.2, 1.6, 1.3], 1.6)];

/// Short names for common presets.
const ALIASES: [(&str, &str); 3] = [("skin", "skin2"), ("milk", "wholemilk"), ("chicken", "chicken1")];

impl Subsurface {
    /// A medium by name.
    pub fn preset(name: &str) -> Option<Self> {
        let name = ALIASES.iter().find(|(alias, _)| *alias == name).map_or(name, |(_, meant)| meant);
        let measured = MEASURED.iter().find(|(own, ..)| *own == name).map(|&(_, scattered, absorbed, ior)| Self {
            sigma_s: 1e3 * Vec3::from(scattered),
            sigma_a: 1e3 * Vec3::from(absorbed),
            g: 0.0,
            ior,
            scale: 1.0,
        });
        let chosen = || CHOSEN.iter().find(|(own, ..)| *own == name);
        measured.or_else(|| {
            chosen().map(|&(_, color, path, ior)| Self::of_color(color.into(), 1e-3 * Vec3::from(path), ior))
        })
    }

    /// Names of all presets.
    pub fn presets() -> impl Iterator<Item = &'static str> {
        let measured = MEASURED.iter().map(|(name, ..)| *name);
        measured.chain(CHOSEN.iter().map(|(name, ..)| *name)).chain(ALIASES.iter().map(|(alias, _)| *alias))
    }

    /// Name of the preset that has these coefficients, at any scale.
    pub fn name(&self) -> Option<&'static str> {
        let is_this = |name: &&str| Self::preset(name).is_some_and(|own| Self { scale: self.scale, ..own } == *self);
        Self::presets().find(is_this)
    }

    /// The medium for which a thick, flat body returns this share of the light that enters it, with mean free paths of
    /// `radius` \[m\].
    pub fn of_color(color: Vec3, radius: Vec3, ior: f32) -> Self {
        let boundary = boundary(ior.into());
        let albedo = color.to_array().map(|color| albedo_of(f64::from(color).clamp(0.0, 1.0), boundary) as f32);
        let extinction = radius.recip();
        let sigma_s = Vec3::from(albedo) * extinction;
        Self { sigma_s, sigma_a: (extinction - sigma_s).max(Vec3::ZERO), g: 0.0, ior, scale: 1.0 }
    }

    /// Parameters of the medium in the dipole model.
    pub fn medium(&self) -> Medium {
        Medium::new(self)
    }
}

/// A medium in the dipole model, by channel. METHOD 7.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Medium {
    /// Reduced extinction `sigma_t'` [1/m]. Its reciprocal is the mean free path and the depth `z_r` of the real
    /// source.
    pub extinction: DVec3,
    /// Reduced albedo `alpha'`.
    pub albedo: DVec3,
    /// Effective extinction `sigma_tr` [1/m].
    pub sigma_tr: DVec3,
    /// Depth of the real source \[m\].
    pub z_r: DVec3,
    /// Height of the virtual source \[m\].
    pub z_v: DVec3,
    /// Index of refraction.
    pub ior: f64,
    /// Share of uniform light from outside that enters.
    pub entering: f64,
    /// Factor on `R_d` for a body that is not a half space; see [`Medium::in_body`].
    pub share: DVec3,
}

impl Medium {
    fn new(of: &Subsurface) -> Self {
        let path = f64::from(of.scale);
        let reduced = f64::from(1.0 - of.g) * of.sigma_s.as_dvec3() / path;
        let absorption = of.sigma_a.as_dvec3() / path;
        let clamped = |x: f64| x.clamp(EXTINCTION[0], EXTINCTION[1]);
        let extinction = DVec3::from((reduced + absorption).to_array().map(clamped));
        // The albedo is not affected by the limits of the extinction.
        let albedo =
            (reduced / (reduced + absorption).max(DVec3::splat(f64::MIN_POSITIVE))).clamp(DVec3::ZERO, DVec3::ONE);
        let ior = f64::from(of.ior);
        let z_r = extinction.recip();
        Self {
            extinction,
            albedo,
            sigma_tr: DVec3::from((3.0 * (1.0 - albedo)).to_array().map(f64::sqrt)) * extinction,
            z_r,
            z_v: z_r * (1.0 + 4.0 / 3.0 * boundary(ior)),
            ior,
            entering: 1.0 - mean_fresnel(ior),
            share: DVec3::ONE,
        }
    }

    /// Share of the light entering a thick, flat body that leaves it again: the integral of `R_d` over the plane.
    pub fn diffuse_albedo(&self) -> DVec3 {
        DVec3::from(self.albedo.to_array().map(|albedo| diffuse_albedo(albedo, boundary(self.ior))))
    }
}

impl Medium {
    /// The same medium, corrected for a body. `points` \[m\] are evenly spread over the body's surface; `area` [m^2] is
    /// the area of each. `R_d` holds for a half space: a thin body would return more light than it receives, and a
    /// small one would lose the light that leaves beyond its end. A body returns no less than a half space, since no
    /// light stays in it longer, and no more than all of it.
    pub fn in_body(self, points: &[DVec3], area: f64) -> Self {
        if points.is_empty() {
            return self;
        }
        let wide = widest(area);
        let sum_at =
            |x: &DVec3| -> DVec3 { points.iter().map(|y| diffuse_reflectance(&self, x.distance(*y), wide)).sum() };
        // A sample of a thousand points gives the mean over all.
        let some: Vec<&DVec3> = points.iter().step_by(points.len().div_ceil(1000)).collect();
        let sums: Vec<DVec3> = some.par_iter().map(|x| sum_at(x)).collect();
        let sent = sums.iter().sum::<DVec3>() * (area / sums.len() as f64);
        let bounded = sent.clamp(self.diffuse_albedo(), DVec3::ONE);
        let share = bounded / sent.max(DVec3::splat(f64::MIN_POSITIVE));
        Self { share: DVec3::select(sent.cmpgt(DVec3::ZERO), share.min(DVec3::splat(MOST_SHARE)), DVec3::ONE), ..self }
    }
}

/// Largest factor on `R_d`, for bodies far smaller than a mean free path.
const MOST_SHARE: f64 = 1e3;

/// One source of a dipole, `z` \[m\] below or above the surface: its share of `R_d` [1/m^2] at lateral distance `r`,
/// without the albedo. Sources nearer to the surface than `widest` \[m\] are moved away from it, and their decay is
/// limited accordingly, with the same integral over the plane. Texels larger than the mean free path then do not show.
pub fn source(r: f64, z: f64, sigma_tr: f64, widest: f64) -> f64 {
    let deep = z.max(widest);
    let decay = sigma_tr.min((sigma_tr * z).max(1.0) / deep);
    let d = r.hypot(deep);
    deep * (1.0 + decay * d) * (-decay * (d - deep) - sigma_tr * z).exp() / (4.0 * PI * d.powi(3))
}

/// `R_d` [1/m^2] by channel: share of the entered light that leaves at distance `r` \[m\] (5.83, without its first
/// `1/sigma_t'`). Sources are at least `widest` \[m\] from the surface; the result includes the body's share.
pub fn diffuse_reflectance(medium: &Medium, r: f64, widest: f64) -> DVec3 {
    let of = |i: usize| {
        let at = |z: f64| source(r, z, medium.sigma_tr[i], widest);
        medium.share[i] * medium.albedo[i] * (at(medium.z_r[i]) + at(medium.z_v[i]))
    };
    DVec3::new(of(0), of(1), of(2))
}

/// Least distance \[m\] of dipole sources from the surface, for texels of this area.
pub fn widest(area: f64) -> f64 {
    area.sqrt()
}

/// `A` of the boundary condition, from the internal diffuse reflectance (5.77).
pub fn boundary(ior: f64) -> f64 {
    let inside = (-1.44 / (ior * ior) + 0.71 / ior + 0.668 + 0.0636 * ior).clamp(0.0, 0.999);
    (1.0 + inside) / (1.0 - inside)
}

/// The integral of `R_d` over the plane, for a reduced albedo.
fn diffuse_albedo(albedo: f64, boundary: f64) -> f64 {
    let root = (3.0 * (1.0 - albedo)).max(0.0).sqrt();
    0.5 * albedo * (1.0 + (-4.0 / 3.0 * boundary * root).exp()) * (-root).exp()
}

/// The reduced albedo for a diffuse albedo: inverse of `diffuse_albedo`, unique because both increase together.
fn albedo_of(color: f64, boundary: f64) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if diffuse_albedo(middle, boundary) < color { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Fresnel reflectance of a smooth boundary for unpolarised light, at this cosine. `ior` is the relative index of the
/// medium beyond the boundary.
pub fn fresnel(cosine: f64, ior: f64) -> f64 {
    let c = cosine.abs().min(1.0);
    let below = 1.0 - (1.0 - c * c) / (ior * ior);
    if below <= 0.0 {
        return 1.0;
    }
    let t = below.sqrt();
    let square = |a: f64, b: f64| if a + b > 0.0 { ((a - b) / (a + b)).powi(2) } else { 1.0 };
    0.5 * (square(c, ior * t) + square(ior * c, t))
}

/// Fresnel reflectance for uniform light: the cosine-weighted mean over the hemisphere.
pub fn mean_fresnel(ior: f64) -> f64 {
    // The midpoint rule in the squared cosine. The square root at grazing angles leaves an error of 1e-5.
    const STEPS: usize = 4096;
    (0..STEPS).map(|i| fresnel(((i as f64 + 0.5) / STEPS as f64).sqrt(), ior)).sum::<f64>() / STEPS as f64
}
