//! Tracks which triangle of a deforming mesh each vertex follows while triangles are subdivided.
//!
//! A vertex is a weighted mean of at most three vertices of `Deform::bind`. A vertex on an original edge is a mean of
//! the edge's two vertices, from either adjacent triangle, so no crack opens in any pose.

use crate::scene::Mesh;
use crate::scene::deform::{Deform, Follower};

/// Weights of `bind` vertices in a mesh vertex, by increasing index; they sum to 1. Unused places have weight 0.
type Shares = [(u32, f32); 3];

/// Weights of all vertices of a mesh.
pub(super) struct Carried {
    shares: Vec<Shares>,
    flat: Vec<bool>,
}

impl Carried {
    pub(super) fn new(deform: &Deform) -> Self {
        let own = |vertex: u32| [(vertex, 1.0), (u32::MAX, 0.0), (u32::MAX, 0.0)];
        let mut shares: Vec<Shares> = (0..deform.bind.len() as u32).map(own).collect();
        let mut flat = vec![false; shares.len()];
        for follower in &deform.followers {
            let vertex = follower.vertex as usize;
            if shares.len() <= vertex {
                shares.resize(vertex + 1, own(0));
                flat.resize(vertex + 1, false);
            }
            let [second, third] = follower.weights;
            let [a, b, c] = follower.corners;
            shares[vertex] = sorted([(a, 1.0 - second - third), (b, second), (c, third)]);
            flat[vertex] = follower.flat == 1;
        }
        Self { shares, flat }
    }

    /// The follower `vertex` halfway along an edge of a triangle.
    pub(super) fn middle(&self, vertex: u32, edge: [u32; 2], triangle: &[u32]) -> Follower {
        let corners = self.source(triangle);
        let share = |corner: u32| -> f32 {
            let of = |end: &u32| {
                let found = self.shares[*end as usize].iter().find(|(index, _)| *index == corner);
                found.map_or(0.0, |(_, share)| *share)
            };
            0.5 * edge.iter().map(of).sum::<f32>()
        };
        // The first corner gets the remainder. Repeated halves are exact, so on an edge the remainder is exactly 0.
        let weights = [share(corners[1]), share(corners[2])];
        let flat = edge.iter().all(|&end| self.flat[end as usize]);
        Follower { vertex, corners, weights, flat: u32::from(flat) }
    }

    /// The triangle of `bind` that contains a triangle of the mesh, with the same winding.
    fn source(&self, triangle: &[u32]) -> [u32; 3] {
        let shares = [0, 1, 2].map(|corner| self.shares[triangle[corner] as usize]);
        let mut corners: Vec<u32> =
            shares.iter().flatten().filter(|(_, share)| *share > 0.0).map(|(index, _)| *index).collect();
        corners.sort_unstable();
        corners.dedup();
        let [a, b, c] = corners[..] else { unreachable!("a part of a triangle has its three corners") };
        // Rows are vertices, columns corners. The determinant is negative if the winding is reversed.
        let row = |shares: &Shares| {
            [a, b, c].map(|corner| shares.iter().find(|(index, _)| *index == corner).map_or(0.0, |(_, share)| *share))
        };
        let [x, y, z] = [row(&shares[0]), row(&shares[1]), row(&shares[2])].map(glam::Vec3::from);
        if x.cross(y).dot(z) < 0.0 { [a, c, b] } else { [a, b, c] }
    }
}

/// Moves all followers to where the vertices of `bind` carry them at rest.
pub(super) fn settle(mesh: &mut Mesh) {
    let Some(deform) = &mesh.deform else { return };
    let mut vertices = mesh.vertices.clone();
    for follower in &deform.followers {
        mesh.settle(follower, &mut vertices);
    }
    mesh.vertices = vertices;
}

fn sorted(mut shares: Shares) -> Shares {
    shares.iter_mut().filter(|(_, share)| *share <= 0.0).for_each(|share| *share = (u32::MAX, 0.0));
    shares.sort_by_key(|(index, _)| *index);
    shares
}
