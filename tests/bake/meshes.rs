//! Meshes on which the tests place caches.

use glam::DVec3;
use lightskin::scene::{Mesh, Vertex};
use std::f64::consts::{PI, TAU};

/// Pseudorandom numbers in [0, 1), the same in every run (splitmix64).
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut x = self.0;
        x = (x ^ x >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ x >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((x ^ x >> 31) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// A random point in the unit cube.
    pub(crate) fn point(&mut self) -> DVec3 {
        DVec3::new(self.next(), self.next(), self.next())
    }
}

/// Triangles that share no corners, with geometric normals.
pub(super) fn flat_mesh(triangles: &[[DVec3; 3]]) -> Mesh {
    let corners = |[a, b, c]: &[DVec3; 3]| {
        let normal = (*b - *a).cross(*c - *a).normalize_or_zero().as_vec3();
        [*a, *b, *c].map(|p| Vertex { position: p.as_vec3(), normal, ..Default::default() })
    };
    let vertices: Vec<_> = triangles.iter().flat_map(corners).collect();
    Mesh { name: "flat".into(), indices: (0..vertices.len() as u32).collect(), vertices, ..Mesh::default() }
}

/// A grid of quads over the unit square. `map` gives position and normal of each grid point.
pub(super) fn grid_mesh(columns: usize, rows: usize, map: impl Fn(f64, f64) -> (DVec3, DVec3)) -> Mesh {
    let mut mesh = Mesh { name: "grid".into(), ..Default::default() };
    for row in 0..=rows {
        for column in 0..=columns {
            let (position, normal) = map(column as f64 / columns as f64, row as f64 / rows as f64);
            let (position, normal) = (position.as_vec3(), normal.as_vec3());
            mesh.vertices.push(Vertex { position, normal, ..Default::default() });
        }
    }
    let index = |column: usize, row: usize| (row * (columns + 1) + column) as u32;
    for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
        let [a, b, c, d] =
            [index(column, row), index(column + 1, row), index(column + 1, row + 1), index(column, row + 1)];
        mesh.indices.extend([a, b, c, a, c, d]);
    }
    mesh
}

/// A closed box from the origin to `size` with outward normals. Each face is divided into `cuts` x `cuts` quads.
pub(super) fn box_mesh(size: DVec3, cuts: usize) -> Mesh {
    let mut mesh = Mesh { name: "box".into(), ..Default::default() };
    for axis in 0..3 {
        for side in [0.0, 1.0] {
            let mut normal = DVec3::ZERO;
            normal[axis] = 2.0 * side - 1.0;
            let face = grid_mesh(cuts, cuts, |u, v| {
                let (u, v) = if side == 1.0 { (u, v) } else { (v, u) };
                let mut position = DVec3::ZERO;
                position[axis] = side;
                position[(axis + 1) % 3] = u;
                position[(axis + 2) % 3] = v;
                (position * size, normal)
            });
            let first = mesh.vertices.len() as u32;
            mesh.vertices.extend(face.vertices);
            mesh.indices.extend(face.indices.iter().map(|i| first + i));
        }
    }
    mesh
}

pub(crate) fn sphere_mesh(radius: f64, cuts: usize) -> Mesh {
    grid_mesh(2 * cuts, cuts, |u, v| {
        let (theta, phi) = (v * PI, u * TAU);
        let normal = DVec3::new(theta.sin() * phi.sin(), theta.cos(), theta.sin() * phi.cos());
        (normal * radius, normal)
    })
}

pub(super) fn torus_mesh(radius: f64, tube: f64, cuts: usize) -> Mesh {
    grid_mesh(2 * cuts, cuts, |u, v| {
        let out = DVec3::new((u * TAU).cos(), 0.0, (u * TAU).sin());
        let normal = out * (v * TAU).cos() + DVec3::Y * (v * TAU).sin();
        (out * radius + normal * tube, normal)
    })
}

pub(super) fn soup(random: &mut Random, count: usize, size: f64) -> Mesh {
    let triangle = |_| {
        let corner = random.point() * 4.0;
        [corner, corner + (random.point() - 0.5) * size, corner + (random.point() - 0.5) * size]
    };
    flat_mesh(&(0..count).map(triangle).collect::<Vec<_>>())
}
