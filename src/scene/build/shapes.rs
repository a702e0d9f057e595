//! Basic shapes as vertices and triangles: grids, boxes, lathes. Metres, +Y up, unit normals on the lit side.

use crate::scene::Vertex;
use glam::{Affine3A, Vec2, Vec3};
use std::f32::consts::{PI, TAU};

/// A triangle mesh; triangles are counter-clockwise seen from the side that the normals point to.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surface {
    /// Vertices; triangles with different normals do not share vertices.
    pub vertices: Vec<Vertex>,
    /// Three per triangle.
    pub indices: Vec<u32>,
}

impl Surface {
    /// Joins two surfaces.
    pub fn and(mut self, other: Self) -> Self {
        let base = self.vertices.len() as u32;
        self.vertices.extend(other.vertices);
        self.indices.extend(other.indices.iter().map(|index| base + index));
        self
    }

    /// Transforms the surface rigidly.
    pub fn moved(mut self, transform: Affine3A) -> Self {
        for vertex in &mut self.vertices {
            vertex.position = transform.transform_point3(vertex.position);
            vertex.normal = transform.transform_vector3(vertex.normal).normalize();
        }
        self
    }

    /// Translates the surface \[m\].
    pub fn shifted(self, x: f32, y: f32, z: f32) -> Self {
        self.moved(Affine3A::from_translation(Vec3::new(x, y, z)))
    }

    /// The other side: reversed winding and negated normals.
    pub fn reversed(&self) -> Self {
        let mut back = self.clone();
        back.vertices.iter_mut().for_each(|vertex| vertex.normal = -vertex.normal);
        back.indices.chunks_exact_mut(3).for_each(|triangle| triangle.swap(1, 2));
        back
    }

    /// The surface with a second side, each triangle of which follows its front.
    pub fn two_sided(mut self) -> Self {
        let back = self.reversed();
        let front = self.vertices.len() as u32;
        let (fronts, backs) = (self.indices.as_chunks::<3>().0, back.indices.as_chunks::<3>().0);
        self.indices =
            fronts.iter().zip(backs).flat_map(|(f, b)| [*f, b.map(|i| front + i)].into_iter().flatten()).collect();
        self.vertices.extend(back.vertices);
        self
    }

    fn position(&self, index: u32) -> Vec3 {
        self.vertices[index as usize].position
    }

    /// Adds a triangle, wound so that its front faces along its normals; drops it if it has no area.
    fn triangle(&mut self, [a, b, c]: [u32; 3]) {
        let cross = (self.position(b) - self.position(a)).cross(self.position(c) - self.position(a));
        let extent = (self.position(b) - self.position(a)).length_squared()
            + (self.position(c) - self.position(a)).length_squared();
        if cross.length() <= 1e-5 * extent {
            return;
        }
        let normal: Vec3 = [a, b, c].iter().map(|&index| self.vertices[index as usize].normal).sum();
        self.indices.extend(if cross.dot(normal) > 0.0 { [a, b, c] } else { [a, c, b] });
    }

    /// Adds the quadrilateral with these corners in circular order, split along its shorter diagonal.
    fn quadrilateral(&mut self, [a, b, c, d]: [u32; 4]) {
        let split_ac = self.position(a).distance_squared(self.position(c))
            <= self.position(b).distance_squared(self.position(d)) * 1.0001;
        let halves = if split_ac { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] };
        halves.into_iter().for_each(|half| self.triangle(half));
    }

    /// Removes unused vertices; the others keep their order.
    fn compacted(mut self) -> Self {
        let mut kept = vec![u32::MAX; self.vertices.len()];
        self.indices.iter().for_each(|&index| kept[index as usize] = 0);
        for (count, slot) in kept.iter_mut().filter(|slot| **slot == 0).enumerate() {
            *slot = count as u32;
        }
        let mut old = kept.iter();
        self.vertices.retain(|_| *old.next().expect("one slot per vertex") != u32::MAX);
        self.indices.iter_mut().for_each(|index| *index = kept[*index as usize]);
        self
    }
}

/// A grid of `columns` x `rows` points, each a position and a unit normal. `closed` joins the last column to the first,
/// and the last row to the first.
pub fn patch([columns, rows]: [usize; 2], closed: [bool; 2], point: impl Fn(usize, usize) -> (Vec3, Vec3)) -> Surface {
    let mut surface = Surface::default();
    for row in 0..rows {
        for column in 0..columns {
            let (position, normal) = point(column, row);
            surface.vertices.push(Vertex { position, normal, color: [255; 4], ..Vertex::default() });
        }
    }
    let at = |column: usize, row: usize| ((row % rows) * columns + column % columns) as u32;
    for row in 0..rows - usize::from(!closed[1]) {
        for column in 0..columns - usize::from(!closed[0]) {
            let corners = [at(column, row), at(column + 1, row), at(column + 1, row + 1), at(column, row + 1)];
            surface.quadrilateral(corners);
        }
    }
    surface.compacted()
}

/// The stops and evenly spaced points between them, at most `edge` (metres) apart.
pub fn spans(stops: &[f32], edge: f32) -> Vec<f32> {
    let mut points = vec![stops[0]];
    for pair in stops.windows(2) {
        let count = segments(pair[1] - pair[0], edge);
        points.extend((1..count).map(|k| pair[0] + (pair[1] - pair[0]) * k as f32 / count as f32));
        points.push(pair[1]);
    }
    points
}

/// Number of pieces of at most `edge` that make up `length`, with a tolerance of a thousandth of a piece.
pub(super) fn segments(length: f32, edge: f32) -> usize {
    ((length.abs() / edge - 1e-3).ceil() as usize).max(1)
}

/// A plane with grid lines at `us` along the unit vector `u` and at `vs` along `v`, facing `u x v`. Contains only the
/// cells for whose centre (in u and v) `keep` is true.
pub fn sheet(origin: Vec3, [u, v]: [Vec3; 2], us: &[f32], vs: &[f32], keep: impl Fn(f32, f32) -> bool) -> Surface {
    let normal = u.cross(v).normalize();
    let mut surface = Surface::default();
    for &t in vs {
        for &s in us {
            let position = origin + u * s + v * t;
            surface.vertices.push(Vertex { position, normal, color: [255; 4], ..Vertex::default() });
        }
    }
    let at = |column: usize, row: usize| (row * us.len() + column) as u32;
    for row in 0..vs.len() - 1 {
        for column in 0..us.len() - 1 {
            if keep(0.5 * (us[column] + us[column + 1]), 0.5 * (vs[row] + vs[row + 1])) {
                let corners = [at(column, row), at(column + 1, row), at(column + 1, row + 1), at(column, row + 1)];
                surface.quadrilateral(corners);
            }
        }
    }
    surface.compacted()
}

/// The parallelogram spanned at `origin` by `u` and `v` (metres), facing `u x v`, as a grid of edge length `edge`
/// (metres).
pub fn quad(origin: Vec3, u: Vec3, v: Vec3, edge: f32) -> Surface {
    let (us, vs) = (spans(&[0.0, u.length()], edge), spans(&[0.0, v.length()], edge));
    sheet(origin, [u.normalize(), v.normalize()], &us, &vs, |_, _| true)
}

/// An axis-aligned box with flat faces, each its own grid of edge length `edge` (metres). Contains only the faces for
/// whose outward normal `keep` is true.
pub fn cuboid(low: Vec3, high: Vec3, edge: f32, keep: impl Fn(Vec3) -> bool) -> Surface {
    let size = high - low;
    let (x, y, z) = (Vec3::X * size.x, Vec3::Y * size.y, Vec3::Z * size.z);
    let faces = [
        (Vec3::NEG_X, low, z, y),
        (Vec3::X, low + x, y, z),
        (Vec3::NEG_Y, low, x, z),
        (Vec3::Y, low + y, z, x),
        (Vec3::NEG_Z, low, y, x),
        (Vec3::Z, low + z, x, y),
    ];
    let wanted = faces.into_iter().filter(|face| keep(face.0));
    wanted.fold(Surface::default(), |all, (_, origin, u, v)| all.and(quad(origin, u, v, edge)))
}

/// The surface that a profile of (radius, height) points (metres) sweeps about +Y; the outside is to the right along
/// the profile.
///
/// Normals are smooth where the profile bends by less than 40 degrees, and creased at its corners.
pub fn lathe(profile: &[Vec2], sides: usize) -> Surface {
    let normals: Vec<Vec2> = profile.windows(2).map(|pair| -(pair[1] - pair[0]).perp().normalize()).collect();
    let mut surface = Surface::default();
    let mut start = 0;
    for end in 1..profile.len() {
        let goes_on = end < normals.len() && normals[end - 1].dot(normals[end]) > 40_f32.to_radians().cos();
        if goes_on {
            continue;
        }
        let run = &profile[start..=end];
        let run_normals: Vec<Vec2> = (start..=end)
            .map(|k| {
                let before = if k > start { normals[k - 1] } else { Vec2::ZERO };
                let after = if k < end { normals[k] } else { Vec2::ZERO };
                (before + after).normalize()
            })
            .collect();
        surface = surface.and(patch([sides, run.len()], [true, false], |column, row| {
            let angle = TAU * column as f32 / sides as f32;
            let around = |p: Vec2| Vec3::new(p.x * angle.cos(), p.y, -p.x * angle.sin());
            (around(run[row]), around(run_normals[row]))
        }));
        start = end;
    }
    surface
}

/// Square version of `lathe`: a profile of (half width, height) points (metres) around four flat sides with sharp
/// corners.
pub fn loft_square(profile: &[Vec2], edge: f32) -> Surface {
    let widest = profile.iter().map(|p| p.x).fold(0.0, f32::max);
    let columns = segments(2.0 * widest, edge) + 1;
    let mut surface = Surface::default();
    for pair in profile.windows(2) {
        let rows = segments(pair[0].distance(pair[1]), edge) + 1;
        let outward = -(pair[1] - pair[0]).perp().normalize();
        for side in 0..4 {
            let turn = Affine3A::from_rotation_y(0.5 * PI * side as f32);
            let part = patch([columns, rows], [false; 2], |column, row| {
                let p = pair[0].lerp(pair[1], row as f32 / (rows - 1) as f32);
                let across = 2.0 * column as f32 / (columns - 1) as f32 - 1.0;
                (Vec3::new(p.x * across, p.y, p.x), Vec3::new(0.0, outward.y, outward.x))
            });
            surface = surface.and(part.moved(turn));
        }
    }
    surface
}

/// A sphere around the origin with `rings` rows of faces from pole to pole.
pub fn sphere(radius: f32, rings: usize) -> Surface {
    let at = |k: usize| PI * k as f32 / rings as f32;
    let point = |k: usize| if k == 0 || k == rings { 0.0 } else { radius * at(k).sin() };
    let profile: Vec<Vec2> = (0..=rings).map(|k| Vec2::new(point(k), -radius * at(k).cos())).collect();
    let mut surface = lathe(&profile, 2 * rings);
    surface.vertices.iter_mut().for_each(|vertex| vertex.normal = vertex.position.normalize());
    surface
}
