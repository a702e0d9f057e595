//! Which triangle of a mesh that bends each vertex goes with, while triangles are divided.
//!
//! A vertex is a mean of at most three vertices of `Deform::bind`. One on an edge of the file is a mean of that edge's two,
//! whichever of the triangles beside it is asked: no crack opens in any pose.

use crate::scene::Mesh;
use crate::scene::deform::{Deform, Follower};

/// Shares of vertices of `bind` in a vertex of the mesh, by increasing index; they sum to 1. Unused places have no share.
type Shares = [(u32, f32); 3];

/// Of all vertices of a mesh.
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
        // The first corner's share is what is left. Halves of halves are exact, so that on an edge it is none at all.
        let weights = [share(corners[1]), share(corners[2])];
        let flat = edge.iter().all(|&end| self.flat[end as usize]);
        Follower { vertex, corners, weights, flat: u32::from(flat) }
    }

    /// The triangle of `bind` that a triangle of the mesh is a part of, the same way round.
    fn source(&self, triangle: &[u32]) -> [u32; 3] {
        let shares = [0, 1, 2].map(|corner| self.shares[triangle[corner] as usize]);
        let mut corners: Vec<u32> =
            shares.iter().flatten().filter(|(_, share)| *share > 0.0).map(|(index, _)| *index).collect();
        corners.sort_unstable();
        corners.dedup();
        let [a, b, c] = corners[..] else { unreachable!("a part of a triangle has its three corners") };
        // Rows are vertices, columns corners: turned over, the parts' determinant is negative.
        let row = |shares: &Shares| {
            [a, b, c].map(|corner| shares.iter().find(|(index, _)| *index == corner).map_or(0.0, |(_, share)| *share))
        };
        let [x, y, z] = [row(&shares[0]), row(&shares[1]), row(&shares[2])].map(glam::Vec3::from);
        if x.cross(y).dot(z) < 0.0 { [a, c, b] } else { [a, b, c] }
    }
}

/// Puts all followers where the vertices of `bind` carry them at rest.
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
