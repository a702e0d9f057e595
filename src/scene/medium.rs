//! Media that scatter light below a surface: coefficients, measured presets, and their parameters in the dipole model.
//! METHOD 7; Jensen, Marschner, Levoy and Hanrahan 2001, "A Practical Model for Subsurface Light Transport".

use std::collections::BTreeMap;
use std::f64::consts::PI;

use glam::{DVec3, Vec3};

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
        let albedo = color.to_array().map(|color| albedo_of(f64::from(color).clamp(0.0, 1.0), ior.into()) as f32);
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
    /// Reduced extinction `sigma_t'` [1/m]. Its reciprocal is the mean free path.
    pub extinction: DVec3,
    /// Reduced albedo `alpha'`.
    pub albedo: DVec3,
    /// Effective extinction `sigma_tr` [1/m]; smaller in a small body, see [`Medium::in_body`].
    pub sigma_tr: DVec3,
    /// Distances of the two sources from the surface \[m\]: of light that scatters little, and of diffuse light.
    pub depths: [DVec3; 2],
    /// Index of refraction.
    pub ior: f64,
    /// Share of uniform light from outside that enters.
    pub entering: f64,
    /// Strength of both sources together, so that `R_d` has the right integral.
    pub strength: DVec3,
    /// Share of the entering light that leaves again: the integral of `R_d` over the body.
    pub returned: DVec3,
    /// Share of the returned light that pixels reflect themselves, because caches cannot resolve where it leaves.
    pub close_by: DVec3,
    /// Squared radius [m^2] of the surface around a pixel whose light it reflects itself.
    pub around: f64,
}

/// Least squared radius [m^2] around a pixel; far below that of any cache's surface.
const LEAST_AROUND: f64 = 1e-30;

/// Share of each source in the light that leaves. Like the depths, these were fitted to random walks with albedos of .9
/// and more and indices of refraction from 1 to 1.5, under uniform light.
pub const SOURCES: [f64; 2] = [0.2, 0.8];

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
        let inside = inner_reflectance(ior);
        let path = extinction.recip();
        // By Grosjean's diffusion coefficient, which holds for lower albedos, too.
        let sigma_tr = DVec3::from((3.0 * (1.0 - albedo) / (2.0 - albedo)).to_array().map(f64::sqrt)) * extinction;
        let depths = [0.3 * path, path * (1.0 + 0.6 * (1.0 + inside) / (1.0 - inside))];
        let integral = SOURCES[0] * (-sigma_tr * depths[0]).exp() + SOURCES[1] * (-sigma_tr * depths[1]).exp();
        let returned = DVec3::from(albedo.to_array().map(|albedo| diffuse_albedo(albedo, ior)));
        let strength = returned / integral.max(DVec3::splat(f64::MIN_POSITIVE));
        let (entering, close_by, around) = (1.0 - mean_fresnel(ior), DVec3::ZERO, LEAST_AROUND);
        Self { extinction, albedo, sigma_tr, depths, ior, entering, strength, returned, close_by, around }
    }

    /// Share of the light entering a thick, flat body that leaves it again: the integral of `R_d` over the plane.
    pub fn diffuse_albedo(&self) -> DVec3 {
        DVec3::from(self.albedo.to_array().map(|albedo| diffuse_albedo(albedo, self.ior)))
    }

    /// Share of the light entering a closed body of this depth, `3 V / S` \[m\], that leaves it again. For a ball that
    /// is the radius.
    pub fn returned_at(&self, depth: f64) -> DVec3 {
        let (flat, inside) = (self.diffuse_albedo(), inner_reflectance(self.ior));
        let of = |i: usize| {
            let x = self.sigma_tr[i] * depth;
            // Flow through the surface of a ball with a diffuse inside, over that of a half space.
            let flow = if x > 1e-3 { 1.0 / x.tanh() - 1.0 / x } else { x / 3.0 };
            let boundary = 0.5 * (1.0 + inside);
            let resistance = boundary + (1.0 / (1.0 - flat[i]) - boundary) / flow;
            if flat[i] < 1.0 { 1.0 - 1.0 / resistance } else { 1.0 }
        };
        DVec3::new(of(0), of(1), of(2))
    }
}

/// The shape of a body, for the light that it returns.
#[derive(Clone, Debug, Default)]
pub struct Shape {
    /// Points evenly spread over the surface \[m\], and unit normals.
    pub points: Vec<[DVec3; 2]>,
    /// Surface of each point [m^2].
    pub area: f64,
    /// Volume [m^3]. `None` if the surface is open.
    pub volume: Option<f64>,
}

impl Medium {
    /// The same medium in a body. `R_d` is that of a half space: a thin body would return more light than it receives,
    /// and a small one would lose the light that leaves beyond its end. Moreover light leaves a small body sooner, so
    /// less of it is absorbed. So `sigma_tr` is reduced until all points together return as much as the body does. Open
    /// surfaces return no less than a half space and no more than all light.
    pub fn in_body(self, shape: &Shape) -> Self {
        if shape.points.is_empty() {
            return self;
        }
        let distances = Distances::of(shape);
        let surface = shape.area * shape.points.len() as f64;
        let target = shape.volume.map(|volume| self.returned_at(3.0 * volume / surface));
        let mut made = self;
        for i in 0..3 {
            let sent = |sigma_tr: f64| distances.sum(&self.of_channel(i, sigma_tr));
            let most = sent(self.sigma_tr[i]);
            let target = target.map_or(most.clamp(self.diffuse_albedo()[i], 1.0), |all| all[i]);
            let [mut low, mut high] = [0.0, self.sigma_tr[i]];
            if most < target && shape.volume.is_some() {
                for _ in 0..40 {
                    let middle = 0.5 * (low + high);
                    if sent(middle) > target { low = middle } else { high = middle }
                }
                made.sigma_tr[i] = high;
            }
            let sent = sent(made.sigma_tr[i]);
            if sent > 0.0 {
                let stronger = (target / sent).min(MOST_STRONGER);
                made.strength[i] *= stronger;
                made.returned[i] = sent * stronger;
            }
        }
        made
    }

    /// Part of the light leaving a half space that leaves within a radius \[m\] of where it entered.
    pub fn within(&self, radius: f64) -> DVec3 {
        let of = |i: usize| {
            let channel = Channel { strength: 1.0, ..self.of_channel(i, self.sigma_tr[i]) };
            channel.within(radius, 0.0) / channel.within(f64::MAX, 0.0).max(f64::MIN_POSITIVE)
        };
        DVec3::new(of(0), of(1), of(2))
    }

    /// One channel with another `sigma_tr` [1/m].
    fn of_channel(&self, i: usize, sigma_tr: f64) -> Channel {
        Channel { sigma_tr, depths: self.depths.map(|z| z[i]), strength: self.strength[i] }
    }
}

/// One channel of a medium.
struct Channel {
    sigma_tr: f64,
    depths: [f64; 2],
    strength: f64,
}

impl Channel {
    /// `R_d` [1/m^2] at distance `r` \[m\].
    fn reflectance(&self, r: f64, widest: f64) -> f64 {
        let at = |i: usize| SOURCES[i] * source(r, self.depths[i], self.sigma_tr, widest);
        self.strength * (at(0) + at(1))
    }

    /// The integral of `R_d` over a flat disc of this radius \[m\], whose centre lies `away` \[m\] across the surface.
    fn within(&self, radius: f64, away: f64) -> f64 {
        let of = |i: usize| {
            let z = self.depths[i];
            let part = |d: f64| z / d * (-self.sigma_tr * d).exp();
            SOURCES[i] * (part(z.hypot(away)) - part(z.hypot(away).hypot(radius)))
        };
        self.strength * (of(0) + of(1))
    }
}

/// How far the points of a body's surface are from a mean point.
struct Distances {
    /// Radii \[m\] of flat discs around the point, which stand for the points in them. The mean over all radii counts.
    discs: [f64; 8],
    /// Beyond the discs: distance \[m\] and surface at about this distance [m^2].
    beyond: Vec<(f64, f64)>,
    /// Opposite the point, within the widest disc: distance of the other side \[m\], and its part of such a disc. The
    /// points of a thin body may be farther apart than its sides.
    opposite: Vec<(f64, f64)>,
}

impl Distances {
    fn of(shape: &Shape) -> Self {
        // Classes of distances differ by 2 %.
        const PER_DOUBLING: f64 = 35.0;
        let discs: [f64; 8] = std::array::from_fn(|i| (1.5 + 0.3 * i as f64) * (shape.area / PI).sqrt());
        let widest = discs[discs.len() - 1];
        let mut classes = [const { BTreeMap::<i32, (f64, f64)>::new() }; 2];
        for [x, x_normal] in &shape.points {
            for [y, y_normal] in &shape.points {
                let r = x.distance(*y);
                let through = x_normal.dot(*y_normal) < 0.0;
                let thickness = x_normal.dot(*y - *x).abs();
                let is_opposite = through && r * r - thickness * thickness < widest * widest;
                let length = if is_opposite { thickness } else { r };
                let beyond = discs.iter().filter(|disc| through || r > **disc).count() as f64 / discs.len() as f64;
                if beyond > 0.0 {
                    let class = (PER_DOUBLING * length.max(1e-30).log2()).floor() as i32;
                    let sum = classes[usize::from(is_opposite)].entry(class).or_default();
                    *sum = (sum.0 + beyond * length, sum.1 + beyond);
                }
            }
        }
        let each = shape.area / shape.points.len() as f64;
        let of_disc = each / (PI * widest * widest);
        let [beyond, opposite] = classes;
        let means = |of: BTreeMap<i32, (f64, f64)>, share: f64| {
            of.into_values().map(|(sum, count)| (sum / count, share * count)).collect()
        };
        Self { discs, beyond: means(beyond, each), opposite: means(opposite, of_disc) }
    }

    /// Share of the light that enters at a mean point and leaves anywhere.
    fn sum(&self, channel: &Channel) -> f64 {
        let near = self.discs.iter().map(|disc| channel.within(*disc, 0.0)).sum::<f64>() / self.discs.len() as f64;
        let beyond: f64 = self.beyond.iter().map(|(r, area)| area * channel.reflectance(*r, 0.0)).sum();
        let widest = self.discs[self.discs.len() - 1];
        near + beyond + self.opposite.iter().map(|(away, share)| share * channel.within(widest, *away)).sum::<f64>()
    }
}

/// Largest factor on `R_d`, for bodies far smaller than a mean free path.
const MOST_STRONGER: f64 = 1e3;

/// One source of a dipole, `z` \[m\] below the surface: its part of `R_d` [1/m^2] at lateral distance `r`, of strength one.
/// Its integral over the plane is `e^(-sigma_tr z)`. Sources nearer to the surface than `widest` \[m\] are moved away from
/// it, and their decay is limited accordingly, with the same integral. Texels larger than the mean free path then do not
/// show.
pub fn source(r: f64, z: f64, sigma_tr: f64, widest: f64) -> f64 {
    let deep = z.max(widest);
    let decay = sigma_tr.min((sigma_tr * z).max(1.0) / deep);
    let d = r.hypot(deep);
    deep * (1.0 + decay * d) * (-decay * (d - deep) - sigma_tr * z).exp() / (2.0 * PI * d.powi(3))
}

/// `R_d` [1/m^2] by channel: share of the entered light that leaves at distance `r` \[m\]. Sources are at least `widest`
/// \[m\] from the surface. The form of (5.83), with constants of its own.
pub fn diffuse_reflectance(medium: &Medium, r: f64, widest: f64) -> DVec3 {
    let of = |i: usize| medium.of_channel(i, medium.sigma_tr[i]).reflectance(r, widest);
    DVec3::new(of(0), of(1), of(2))
}

/// Least distance \[m\] of dipole sources from the surface, for texels of this area.
pub fn widest(area: f64) -> f64 {
    area.sqrt()
}

/// Share of uniform light inside that a smooth boundary reflects back (5.77).
pub fn inner_reflectance(ior: f64) -> f64 {
    (-1.44 / (ior * ior) + 0.71 / ior + 0.668 + 0.0636 * ior).clamp(0.0, 0.999)
}

/// Share of uniform light, of what enters a half space with this reduced albedo, that leaves again. Hapke's function for
/// light that enters within the cone of refraction, and for light that the boundary reflects back; and a correction
/// fitted to random walks: where much is absorbed, light leaves at flatter angles. Errors: METHOD 7.
fn diffuse_albedo(albedo: f64, ior: f64) -> f64 {
    let inside = inner_reflectance(ior);
    let s = (1.0 - albedo).max(0.0).sqrt();
    let back = |cosine: f64| (1.0 - s) / (1.0 + 2.0 * cosine * s);
    let edge = (1.0 - 1.0 / (ior * ior)).max(0.0).sqrt(); // cosine of the cone
    let cosine = 2.0 / 3.0 * (1.0 + edge + edge * edge) / (1.0 + edge); // mean in the cone
    let whole = back(cosine) * (1.0 - inside) / (1.0 - inside * back(2.0 / 3.0));
    whole / (1.0 + inside * s * (1.3 * s - 0.25))
}

/// The reduced albedo for a diffuse albedo: inverse of `diffuse_albedo`, unique because both increase together.
fn albedo_of(color: f64, ior: f64) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if diffuse_albedo(middle, ior) < color { low = middle } else { high = middle }
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
