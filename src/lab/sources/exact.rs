//! One VAL at one point, with any of its approximations replaced by the exact integral. METHOD 2-3.

use glam::DVec3;

use super::vals::Texel;
use crate::reference::disc::{disc_form_factor, lobe_mean, polygon_form_factor, regular_polygon};
use crate::reference::gather::val_geometry;
use crate::reference::phong::cos_power;
use crate::reference::rsm::Val;

/// Approximations of a VAL to replace.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Exact {
    /// Form factor: the integral instead of `A cos cos / max(A, pi d^2)`.
    pub form_factor: bool,
    /// Glossy lobe: its mean over the patch instead of its value towards the centre.
    pub lobe: bool,
    /// Patch: the texel's footprint on the surface instead of a disc with the area perpendicular to the axis. Without
    /// `form_factor` only its area counts.
    pub footprint: bool,
}

/// A point that receives light.
#[derive(Clone, Copy, Debug)]
pub struct Receiver {
    /// World position \[m\].
    pub position: DVec3,
    /// Unit normal.
    pub normal: DVec3,
    /// Unit mirrored view direction and exponent; `None` without a glossy lobe.
    pub lobe: Option<(DVec3, f64)>,
}

/// Squared distance, in units of the patch's area, beyond which the formula replaces the integral: its error is about
/// the inverse of this.
const FAR: f64 = 1e4;

/// Corners of the polygon that replaces a disc under the glossy lobe.
const DISC_CORNERS: usize = 8;

/// `G` [1/m^2] of a VAL at a point, the unit direction to its centre, and `cos^k` of the lobe.
pub fn receive(texel: &Texel, at: &Receiver, exact: Exact) -> (f64, DVec3, f64) {
    let val = if exact.footprint { Val { area: texel.footprint(), ..texel.val } } else { texel.val };
    let (mut geometry, direction) = val_geometry(at.position, at.normal, &val);
    if exact.form_factor {
        let offset = val.position - at.position;
        let is_behind = val.normal.dot(offset) >= 0.0;
        if is_behind {
            geometry = 0.0;
        } else if offset.length_squared() < FAR * val.area {
            geometry = if exact.footprint {
                polygon_form_factor(&texel.corners(), at.position, at.normal)
            } else {
                disc_form_factor(val.area, val.position, val.normal, at.position, at.normal)
            } / val.area;
        }
    }
    let Some((mirrored, k)) = at.lobe.filter(|_| geometry > 0.0) else { return (geometry, direction, 0.0) };
    let mean = |corners: &[DVec3]| lobe_mean(corners, val.area, at.position, at.normal, mirrored, k);
    let lobe = match exact {
        Exact { lobe: false, .. } => cos_power(k, mirrored.dot(direction)),
        Exact { footprint: true, .. } => mean(&texel.corners()),
        _ => mean(&regular_polygon::<DISC_CORNERS>(val.area, val.position, val.normal)),
    };
    (geometry, direction, lobe)
}
