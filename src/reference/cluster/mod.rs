//! Light clustering: the VALs of each RSM view -> a pyramid of nodes, of which a cache takes a cut. METHOD 9, thesis
//! listing 6.6. `cut.rs` has the cut.
//!
//! Nodes lie depth first: one that is used is followed by its `skip`, one that is not by its first child, which is the
//! next. All views follow one another, so that one walk from 0 to the end takes all of them. The finest nodes hold up to
//! 2 x 2 VALs, which are no nodes themselves: they need no test and are not copied.

mod cut;

pub use cut::{Cut, GROUP, Rule, Share};

use glam::DVec3;

use super::gather::{ProxyWeight, luminance};
use super::rsm::Val;

/// VALs of a square block of texels, together as one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Node {
    /// Mean of the VALs' positions by their weights \[m\].
    pub position: DVec3,
    /// `d_val` \[m\]: a sphere about the position that holds the children's spheres, and so every VAL.
    pub radius: f64,
    /// Mean of the VALs' normals by their weights, unit.
    pub normal: DVec3,
    /// The VALs lie within this distance \[m\] of the plane square to the normal through the position.
    pub thickness: f64,
    /// Sum of the fluxes \[lm\].
    pub flux: DVec3,
    /// Mean of the VALs' areas by their weights [m^2]: their light, together, falls off as that of each.
    pub area: f64,
    /// Sum of the weights on a proxy's position; 0 where no VAL is alive.
    pub weight: f64,
    /// No VAL's normal is farther than this from the node's, as points on the unit sphere.
    pub spread: f64,
    /// The node after all that are below.
    pub skip: usize,
    /// First VAL of the 2 x 2 texels of a finest node.
    pub first: usize,
    /// From it to the VAL of the next row.
    pub row: usize,
    /// Which of the four are alive, in bits, row by row; 0 for all but the finest nodes.
    pub alive: u32,
}

/// Part of a node: a VAL or a node of the next finer level.
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
    /// All VALs, as the views have them; those without weight take no part.
    pub vals: &'a [Val],
    weight: ProxyWeight,
}

/// The levels of a view of `n` x `n` texels above its VALs: at least one, the last a single node.
pub fn levels(n: usize) -> u32 {
    n.next_power_of_two().ilog2().max(1)
}

impl<'a> Pyramid<'a> {
    /// The pyramid over views of these sizes, whose VALs follow one another row by row.
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

    /// A VAL's weight on a proxy's position; 0 for one that is dead.
    pub fn weight(&self, val: &Val) -> f64 {
        self.weight.of(val)
    }

    /// Adds the node over the texels from `corner` on, `2^level` a side, and all below; gives its index.
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

    /// The VALs of a finest node that are alive.
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

/// One node of parts that have weight.
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
    // Relative to the first, so that a block's place does not matter.
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
    /// How far the VALs reach from the position along a unit direction \[m\], at most.
    fn reach(&self, direction: DVec3) -> f64 {
        reach(self.normal, self.thickness, self.radius, direction)
    }
}

/// How far a cylinder about the origin reaches along a unit direction.
fn reach(axis: DVec3, thickness: f64, radius: f64, direction: DVec3) -> f64 {
    // A product of vectors: 1 - cos^2 would lose the small angles.
    thickness * axis.dot(direction).abs() + radius * axis.cross(direction).length()
}

impl Node {
    /// As a VAL that stands for all below.
    pub fn val(&self) -> Val {
        Val { position: self.position, area: self.area, normal: self.normal, flux: self.flux }
    }

    /// Whether none of the VALs lights a point with a unit normal: all lie below its horizon, or all face away. What is
    /// within a hundred thousandth of the horizon counts as on it: VALs and caches of one wall see nothing of each other.
    pub fn is_dark(&self, point: DVec3, normal: DVec3) -> bool {
        let offset = self.position - point;
        let distance = offset.length();
        let rim = 1e-5 * distance;
        normal.dot(offset) + reach(self.normal, self.thickness, self.radius, normal) <= rim
            || -self.normal.dot(offset) + self.thickness + self.spread * (distance + self.radius) <= rim
    }

    /// Luminance of the irradiance \[lx\] that a point receives at most, however the VALs stand.
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
