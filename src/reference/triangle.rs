//! Diffuse triangles and the nearest hit of a ray, by testing all of them: fast enough for references.

use glam::DVec3;

/// A triangle that reflects diffusely on both sides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Triangle {
    /// World positions of the corners \[m\].
    pub positions: [DVec3; 3],
    /// Unit shading normals at the corners.
    pub normals: [DVec3; 3],
    /// Diffuse albedo `rho_d`.
    pub diffuse: DVec3,
}

/// A ray's hit on a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance along the ray \[m\].
    pub distance: f64,
    /// World position \[m\].
    pub position: DVec3,
    /// Unit shading normal on the triangle's side that the ray came from.
    pub normal: DVec3,
    /// Unit normal of the triangle on that side.
    pub geometric: DVec3,
    /// Diffuse albedo `rho_d`.
    pub diffuse: DVec3,
}

impl Triangle {
    /// A flat triangle; counter-clockwise seen from the side that its normal points to.
    pub fn flat(positions: [DVec3; 3], diffuse: DVec3) -> Self {
        let [a, b, c] = positions;
        Self { positions, normals: [(b - a).cross(c - a).normalize(); 3], diffuse }
    }

    /// The flat parallelogram at `corner` spanned by two edges; its normal is `u x v`.
    pub fn parallelogram(corner: DVec3, u: DVec3, v: DVec3, diffuse: DVec3) -> [Self; 2] {
        [
            Self::flat([corner, corner + u, corner + u + v], diffuse),
            Self::flat([corner, corner + u + v, corner + v], diffuse),
        ]
    }

    /// Distance and barycentric weights of the second and third corner at a ray's hit (Moeller-Trumbore).
    fn intersect(&self, origin: DVec3, direction: DVec3) -> Option<(f64, f64, f64)> {
        // A ray through a shared edge must hit one of the two triangles: edges overlap by this share of a triangle.
        const OVERLAP: f64 = 1e-12;
        let [a, b, c] = self.positions;
        let (u, v) = (b - a, c - a);
        let p = direction.cross(v);
        let determinant = u.dot(p);
        if determinant == 0.0 {
            return None;
        }
        let offset = origin - a;
        let q = offset.cross(u);
        let (second, third) = (offset.dot(p) / determinant, direction.dot(q) / determinant);
        let distance = v.dot(q) / determinant;
        let inside = second >= -OVERLAP && third >= -OVERLAP && second + third <= 1.0 + OVERLAP;
        (inside && distance > 0.0).then_some((distance, second, third))
    }
}

/// The nearest hit of the ray from `origin` in the unit `direction`.
pub fn nearest(triangles: &[Triangle], origin: DVec3, direction: DVec3) -> Option<Hit> {
    let (triangle, (distance, second, third)) = triangles
        .iter()
        .filter_map(|triangle| Some((triangle, triangle.intersect(origin, direction)?)))
        .min_by(|(_, a), (_, b)| a.0.total_cmp(&b.0))?;
    let [a, b, c] = triangle.normals;
    let normal = (a * (1.0 - second - third) + b * second + c * third).normalize();
    let [p, q, r] = triangle.positions;
    let geometric = (q - p).cross(r - p).normalize();
    let geometric = if geometric.dot(direction) > 0.0 { -geometric } else { geometric };
    Some(Hit {
        distance,
        position: origin + distance * direction,
        normal: if normal.dot(geometric) < 0.0 { -normal } else { normal },
        geometric,
        diffuse: triangle.diffuse,
    })
}
