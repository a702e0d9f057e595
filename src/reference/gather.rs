//! Stage 6, gather: computes a cache's proxy lights from the VALs. METHOD 3-4, thesis 5.3.4.
//!
//! The eps of the printed weights is taken to its limit 0: a lobe that no VAL reaches is unlit, instead of having its
//! proxy at the mean of all VALs. Positions are summed relative to the cache, so that precision does not depend on the
//! scene's position.

use std::f64::consts::PI;

use glam::DVec3;

use super::form_factor;
use super::phong::{cos_power, mirrored_view};
use super::rsm::Val;

/// A point at which light is gathered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cache {
    /// World position \[m\].
    pub position: DVec3,
    /// Unit normal.
    pub normal: DVec3,
    /// Phong exponent `k`.
    pub exponent: f64,
}

/// A VAL's weight in the mean position of a proxy.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ProxyWeight {
    /// The VAL's irradiance at the cache: `w_j = luminance(phi_j) G_j`; dark VALs count less.
    #[default]
    Irradiance,
    /// The VAL's form factor as in 5.42: `w_j = F_j = A_j G_j`; black and white VALs count equally.
    FormFactor,
}

impl ProxyWeight {
    /// A VAL's weight before the geometry factor.
    pub fn of(self, val: &Val) -> f64 {
        match self {
            Self::Irradiance => luminance(val.flux),
            Self::FormFactor => val.area,
        }
    }
}

/// One lobe's proxy light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lobe {
    /// World position `x_p` \[m\]; of an unlit lobe the cache's position plus its normal: finite, but without meaning.
    pub position: DVec3,
    /// `I = E / (N.w_p)` \[lx\]: irradiance at the cache on a plane that faces the proxy, `phi_p / (4 pi |x_p - c|^2)`.
    pub facing_irradiance: DVec3,
    /// Whether any VAL has weight in this lobe, with a mean position above the horizon by more than rounding errors.
    pub lit: bool,
    /// Mean squared distance [m^2] of the VALs from the cache, with the weights of the position; 0 if unlit.
    pub distance2: f64,
}

/// Light gathered at a cache.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gathered {
    /// Proxy of the diffuse lobe.
    pub diffuse: Lobe,
    /// Proxy of the glossy lobe; unlit if gathered without an eye.
    pub glossy: Lobe,
    /// `R(c)`: the cache's mirrored view direction; zero if gathered without an eye.
    pub mirrored_view: DVec3,
}

/// A lobe is unlit if the cosine between the normal and the direction to its proxy is at most this. Proxies lie above
/// the horizon because all their VALs do. Smaller cosines are rounding errors of VALs in the cache's own plane, which
/// give no light.
pub const LEAST_COSINE: f64 = 1e-4;

/// Lower bound of the squared distance to a VAL, in units of its area. For a cache on a VAL the cosines are 0/0; the
/// bound makes them 0.
pub const LEAST_DISTANCE2: f64 = 1e-12;

/// Luminance of a linear Rec.709 colour.
pub fn luminance(color: DVec3) -> f64 {
    color.dot(DVec3::new(0.2126, 0.7152, 0.0722))
}

/// `G = cos+_l cos+_x / max(A, pi d^2)` [1/m^2] of a VAL at a point with unit normal, and the unit direction to the VAL.
pub fn val_geometry(point: DVec3, normal: DVec3, val: &Val) -> (f64, DVec3) {
    let offset = val.position - point;
    // The smallest positive number is the bound for a VAL without area: again 0/0 becomes 0.
    let d2 = offset.length_squared().max(LEAST_DISTANCE2 * val.area).max(f64::MIN_POSITIVE);
    let direction = offset / d2.sqrt();
    (form_factor::val_geometry(val.area, -val.normal.dot(direction), normal.dot(direction), d2), direction)
}

/// Sums over VALs for one lobe.
#[derive(Clone, Copy, Default)]
struct Sums {
    weight: f64,
    position: DVec3,
    distance2: f64,
    irradiance: DVec3,
}

impl Sums {
    fn add(&mut self, weight: f64, offset: DVec3, irradiance: DVec3) {
        self.weight += weight;
        self.position += weight * offset;
        self.distance2 += weight * offset.length_squared();
        self.irradiance += irradiance;
    }

    /// Position of the proxy relative to the cache \[m\]; `None` for an unlit lobe.
    fn mean(&self) -> Option<DVec3> {
        (self.weight > 0.0).then(|| self.position / self.weight)
    }
}

/// Contribution of one VAL at a cache.
#[derive(Clone, Copy, Debug)]
pub struct Received {
    /// Position of the VAL relative to the cache \[m\].
    pub offset: DVec3,
    /// Irradiance \[lx\].
    pub irradiance: DVec3,
    /// Weight in the diffuse proxy's position.
    pub pull: f64,
    /// `cos^k` of the angle to the mirrored view; 0 without an eye.
    pub lobe: f64,
}

/// Gathers `vals` at a cache: the diffuse lobe by eq. 5.39-5.43; with an `eye` \[m\] also the glossy lobe, eq. 5.44.
pub fn gather(cache: &Cache, vals: &[Val], eye: Option<DVec3>, weight: ProxyWeight) -> Gathered {
    let mirrored = eye.map(|eye| mirrored_view(cache.position, cache.normal, eye));
    let received = vals.iter().map(|val| receive(cache, mirrored, val, weight.of(val)));
    gather_received(cache, mirrored.unwrap_or_default(), received)
}

/// Contribution of a VAL of this weight at a cache, for the glossy lobe with this mirrored view.
pub fn receive(cache: &Cache, mirrored: Option<DVec3>, val: &Val, weight: f64) -> Received {
    let (geometry, direction) = val_geometry(cache.position, cache.normal, val);
    let lobe = mirrored.map_or(0.0, |mirrored| cos_power(cache.exponent, mirrored.dot(direction)));
    let offset = val.position - cache.position;
    Received { offset, irradiance: val.flux * geometry, pull: geometry * weight, lobe }
}

/// The proxies of a cache with this mirrored view, from the contributions of its VALs.
pub fn gather_received(cache: &Cache, mirrored: DVec3, received: impl Iterator<Item = Received>) -> Gathered {
    let (mut diffuse, mut glossy) = (Sums::default(), Sums::default());
    for Received { offset, irradiance, pull, lobe } in received {
        diffuse.add(pull, offset, irradiance);
        glossy.add(pull * lobe, offset, irradiance * lobe);
    }
    Gathered {
        diffuse: proxy(cache, &diffuse, |_| diffuse.irradiance),
        glossy: proxy(cache, &glossy, |direction| {
            // Dark or far VALs can pull the proxy away from bright ones. Then cos^k towards the proxy is far below
            // theirs and the quotient explodes; it is limited to all light that arrives.
            let lobe = cos_power(cache.exponent, mirrored.dot(direction));
            let quotient = if lobe > 0.0 { glossy.irradiance / lobe } else { diffuse.irradiance };
            quotient.min(diffuse.irradiance)
        }),
        mirrored_view: mirrored,
    }
}

/// The proxy of a lobe; `irradiance` returns its irradiance at the cache \[lx\], given its direction.
fn proxy(cache: &Cache, sums: &Sums, irradiance: impl Fn(DVec3) -> DVec3) -> Lobe {
    let unlit =
        Lobe { position: cache.position + cache.normal, facing_irradiance: DVec3::ZERO, lit: false, distance2: 0.0 };
    let Some(offset) = sums.mean() else { return unlit };
    let direction = offset.normalize_or_zero();
    let cosine = cache.normal.dot(direction);
    if cosine <= LEAST_COSINE {
        return unlit;
    }
    Lobe {
        position: cache.position + offset,
        facing_irradiance: irradiance(direction) / cosine,
        lit: true,
        distance2: sums.distance2 / sums.weight,
    }
}

impl Lobe {
    /// Flux of the proxy \[lm\], `phi_p = 4 pi |x_p - c|^2 I`, eq. 5.39.
    pub fn flux(&self, cache: &Cache) -> DVec3 {
        4.0 * PI * self.position.distance_squared(cache.position) * self.facing_irradiance
    }
}
