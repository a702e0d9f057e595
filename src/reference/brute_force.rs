//! Indirect light from every VAL at a point: the ground truth of caches and interpolation. METHOD 3, thesis
//! 5.3.1-5.3.2.

use glam::DVec3;

use super::gather::val_geometry;
use super::phong::{DIFFUSE_LOBE, Material, phong_lobe};
use super::rsm::Val;

/// Irradiance \[lx\] at a point with unit normal from all VALs, eq. 5.8 summed.
pub fn irradiance(point: DVec3, normal: DVec3, vals: &[Val]) -> DVec3 {
    vals.iter().map(|val| val.flux * val_geometry(point, normal, val).0).sum()
}

/// Radiance [cd/m^2] that leaves a point towards the viewer of `mirrored_view`, diffuse (5.20) and glossy (5.32):
/// `L_d = sum phi_j rho_d/pi G_j`, `L_g = sum phi_j rho_g (k+2)/(2 pi) cos^k(theta_e) G_j`.
pub fn radiance(
    point: DVec3,
    normal: DVec3,
    mirrored_view: DVec3,
    material: &Material,
    vals: &[Val],
) -> (DVec3, DVec3) {
    let mut glossy = DVec3::ZERO;
    for val in vals {
        let (geometry, direction) = val_geometry(point, normal, val);
        glossy += val.flux * geometry * phong_lobe(material.exponent, mirrored_view.dot(direction));
    }
    (material.diffuse * DIFFUSE_LOBE * irradiance(point, normal, vals), material.specular * glossy)
}
