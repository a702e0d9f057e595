//! Light clustering: builds a pyramid of nodes over the VALs of each RSM view; a cache gathers from a cut through it.
//! METHOD 9, thesis listing 6.6. `cut.rs` has the cuts.
//!
//! Nodes are stored depth first: after a node that is used comes its `skip`, after any other its first child, which is
//! the next node. Views follow each other, so that one traversal from 0 to the end covers all. The finest nodes hold up
//! to 2 x 2 VALs, which are not nodes themselves: they need no test and are not copied.

mod cut;

pub use cut::{Cut, GROUP, Rule};

use glam::DVec3;

use super::gather::{ProxyWeight, luminance};
use super::rsm::Val;

/// The VALs of a square block of texels, merged.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Node {
    /// Weighted mean of the VALs' positions \[m\].
    pub position: DVec3,
    /// `d_val` \[m\]: radius of a sphere about the position that holds the children's spheres, and thus every VAL.
    pub radius: f64,
    /// Weighted mean of the VALs' normals, unit.
    pub normal: DVec3,
    /// Largest distance of a VAL \[m\] from the plane through the position perpendicular to the normal.
    pub thickness: f64,
    /// Sum of the fluxes \[lm\].
    pub flux: DVec3,
    /// Weighted mean of the VALs' areas [m^2]: the merged light falls off as each VAL's does.
    pub area: f64,
    /// Sum of the weights for a proxy's position; 0 if no VAL is lit.
    pub weight: f64,
    /// Largest distance of a VAL's normal from the node's, on the unit sphere.
    pub spread: f64,
    /// Index of the node after all descendants.
    pub skip: usize,
    /// First VAL of a finest node's 2 x 2 texels.
    pub first: usize,
    /// Offset from `first` to the VAL in the next row.
    pub row: usize,
    /// Bit mask of the four VALs that are lit, row by row; 0 except in finest nodes.
    pub alive: u32,
}

/// Part of a node: a VAL, or a node of the next finer level.
#[derive(Clone, Copy)]
struct Part {
    position: DVec3,
    radius: f64,
    normal: DVec3,
    thickness: f64,
    flux: DVec3,
    area: f64,
    weight: f64,
    spread: f64,
}

/// The VALs of all views and the nodes over them.
pub struct Pyramid<'a> {
    /// Depth first, view by view.
    pub nodes: Vec<Node>,
    /// All VALs in the views' order; VALs without weight are ignored.
    pub vals: &'a [Val],
    weight: ProxyWeight,
}

/// Number of levels above the VALs for a view of `n` x `n` texels: at least one; the last is a single node.
pub fn levels(n: usize) -> u32 {
    n.next_power_of_two().ilog2().max(1)
}

impl<'a> Pyramid<'a> {
    /// Builds the pyramid over views of these sizes; their VALs follow each other row by row.
    pub fn new(vals: &'a [Val], sizes: &[usize], weight: ProxyWeight) -> Self {
        let mut pyramid = Self { nodes: Vec::new(), vals, weight };
        let mut first = 0;
        for &n in sizes {
            pyramid.build(first, n, levels(n), [0, 0]);
            first += n * n;
        }
        assert_eq!(first, vals.len(), "the views have all VALs");
        pyramid
    }

    /// Weight of a VAL for a proxy's position; 0 for an unlit one.
    pub fn weight(&self, val: &Val) -> f64 {
        self.weight.of(val)
    }

    /// Adds the node over `2^level` x `2^level` texels from `corner` on, and its descendants; returns its index.
    fn build(&mut self, first: usize, n: usize, level: u32, corner: [usize; 2]) -> usize {
        let index = self.nodes.len();
        let half = 1 << (level - 1);
        let cells = [[0, 0], [half, 0], [0, half], [half, half]].map(|[x, y]| [corner[0] + x, corner[1] + y]);
        let inside = |[x, y]: [usize; 2]| x < n && y < n;
        self.nodes.push(merge(&[]));
        let mut parts = Vec::new();
        let (mut start, mut row, mut alive) = (0, 0, 0);
        if level == 1 {
            (start, row) = (first + corner[1] * n + corner[0], n);
            for (i, cell) in cells.into_iter().enumerate().filter(|(_, cell)| inside(*cell)) {
                let val = &self.vals[first + cell[1] * n + cell[0]];
                let part = Part::of_val(val, self.weight(val));
                if part.weight > 0.0 {
                    alive |= 1 << i;
                    parts.push(part);
                }
            }
        } else {
            for cell in cells.into_iter().filter(|cell| inside(*cell)) {
                let child = self.build(first, n, level - 1, cell);
                if self.nodes[child].weight > 0.0 {
                    parts.push(Part::of_node(&self.nodes[child]));
                }
            }
        }
        self.nodes[index] = Node { skip: self.nodes.len(), first: start, row, alive, ..merge(&parts) };
        index
    }

    /// Indices of a node's children; none for a finest node.
    pub fn children(&self, index: usize) -> impl Iterator<Item = usize> + '_ {
        let end = self.nodes[index].skip;
        let step = move |child: usize| (child < end).then_some(child);
        std::iter::successors(step(index + 1), move |child| step(self.nodes[*child].skip))
    }

    /// The lit VALs of a finest node.
    pub fn vals_of(&self, node: &Node) -> impl Iterator<Item = &'a Val> + use<'a> {
        let (vals, node) = (self.vals, *node);
        let alive = (0..4).filter(move |i| node.alive >> i & 1 == 1);
        alive.map(move |i| &vals[node.first + (i >> 1) * node.row + (i & 1)])
    }
}

impl Part {
    fn of_val(val: &Val, weight: f64) -> Self {
        let Val { position, area, normal, flux } = *val;
        Self { position, radius: 0.0, normal, thickness: 0.0, flux, area, weight, spread: 0.0 }
    }

    fn of_node(node: &Node) -> Self {
        let Node { position, radius, normal, thickness, flux, area, weight, spread, .. } = *node;
        Self { position, radius, normal, thickness, flux, area, weight, spread }
    }
}

/// Merges parts that have weight into one node.
fn merge(parts: &[Part]) -> Node {
    let mut node = Node {
        position: DVec3::ZERO,
        radius: 0.0,
        normal: DVec3::ZERO,
        thickness: 0.0,
        flux: DVec3::ZERO,
        area: 0.0,
        weight: 0.0,
        spread: 0.0,
        skip: 0,
        first: 0,
        row: 0,
        alive: 0,
    };
    let Some(one) = parts.first() else { return node };
    // Relative to the first, so that precision does not depend on the block's position.
    for part in parts {
        node.weight += part.weight;
        node.flux += part.flux;
        node.area += part.weight * part.area;
        node.normal += part.weight * part.normal;
        node.position += part.weight * (part.position - one.position);
    }
    node.area /= node.weight;
    node.position = one.position + node.position / node.weight;
    node.normal = node.normal.normalize_or(one.normal);
    for part in parts {
        let offset = part.position - node.position;
        node.radius = node.radius.max(offset.length() + part.radius);
        node.spread = node.spread.max(part.normal.distance(node.normal) + part.spread);
        node.thickness = node.thickness.max(offset.dot(node.normal).abs() + part.reach(node.normal));
    }
    node
}

impl Part {
    /// Largest extent of the VALs from the position along a unit direction \[m\].
    fn reach(&self, direction: DVec3) -> f64 {
        reach(self.normal, self.thickness, self.radius, direction)
    }
}

/// Extent of a cylinder about the origin along a unit direction.
fn reach(axis: DVec3, thickness: f64, radius: f64, direction: DVec3) -> f64 {
    // The cross product keeps small angles, which 1 - cos^2 would lose.
    thickness * axis.dot(direction).abs() + radius * axis.cross(direction).length()
}

impl Node {
    /// A VAL that represents all VALs of the node.
    pub fn val(&self) -> Val {
        Val { position: self.position, area: self.area, normal: self.normal, flux: self.flux }
    }

    /// Whether no VAL lights a point with this unit normal: all lie below its horizon, or all face away. Within 1e-5 of
    /// the horizon counts as on it: VALs and caches on one wall do not see each other.
    pub fn is_dark(&self, point: DVec3, normal: DVec3) -> bool {
        let offset = self.position - point;
        let distance = offset.length();
        let rim = 1e-5 * distance;
        normal.dot(offset) + reach(self.normal, self.thickness, self.radius, normal) <= rim
            || -self.normal.dot(offset) + self.thickness + self.spread * (distance + self.radius) <= rim
    }

    /// Upper bound of the irradiance's luminance \[lx\] at a point, for any arrangement of the VALs.
    fn brightest(&self, point: DVec3, normal: DVec3) -> f64 {
        let offset = self.position - point;
        let (distance, nearest) = (offset.length(), offset.length() - self.radius);
        if nearest <= 0.0 {
            return f64::INFINITY;
        }
        let bound = |along: f64| (along / nearest).clamp(0.0, 1.0);
        let here = bound(normal.dot(offset) + reach(self.normal, self.thickness, self.radius, normal));
        let there = bound(-self.normal.dot(offset) + self.thickness + self.spread * (distance + self.radius));
        luminance(self.flux) * here * there / (std::f64::consts::PI * nearest * nearest)
    }
}
