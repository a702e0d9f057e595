//! A bounding volume hierarchy over boxes, by the surface area heuristic.
//!
//! obvhs builds by merging neighbours along a curve. Where triangles are alike, as those of divided walls are, rays then visit
//! four to six times as many nodes as by splitting from the top; so this splits, and obvhs makes eight-wide nodes of it.

use glam::Vec3A;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::bvh2_to_cwbvh::bvh2_to_cwbvh;

/// Places where a node may be split, along each axis.
const BINS: usize = 16;

/// Boxes from which on the two parts of a node are built side by side.
const SIDE_BY_SIDE: usize = 4096;

/// Most boxes that a node's child holds without being a node itself.
const LEAF: u32 = 3;

/// Share of the nodes that find better places afterwards.
const REINSERTED: f32 = 0.3;

/// A box and what it is of.
#[derive(Clone, Copy)]
struct Item {
    bounds: Aabb,
    number: u32,
}

/// A hierarchy of compressed nodes with eight children over boxes; empty for none. On all cores.
pub fn hierarchy(boxes: &[Aabb]) -> CwBvh {
    if boxes.is_empty() {
        return CwBvh::default();
    }
    let mut items: Vec<Item> =
        boxes.iter().enumerate().map(|(i, bounds)| Item { bounds: *bounds, number: i as u32 }).collect();
    let mut nodes = vec![Bvh2Node::new(Aabb::empty(), 0, 0); 2 * boxes.len() - 1];
    let (root, rest) = nodes.split_at_mut(1);
    split(&mut root[0], rest, 1, &mut items, 0);
    let mut tree = Bvh2 {
        nodes,
        primitive_indices: items.iter().map(|item| item.number).collect(),
        children_are_ordered_after_parents: true,
        ..Bvh2::default()
    };
    ReinsertionOptimizer::default().run(&mut tree, REINSERTED, None);
    bvh2_to_cwbvh(&tree, LEAF, true, false)
}

/// Fills in a node over `items`, which begin at `first` among all, and all nodes below it: `below` has two less than twice as
/// many nodes as there are items and begins at `at` among all.
fn split(node: &mut Bvh2Node, below: &mut [Bvh2Node], at: usize, items: &mut [Item], first: usize) {
    let bounds = items.iter().fold(Aabb::empty(), |all, item| all.union(&item.bounds));
    if items.len() == 1 {
        *node = Bvh2Node::new(bounds, 1, first as u32);
        return;
    }
    *node = Bvh2Node::new(bounds, 0, at as u32);
    let middle = divide(items);
    let (left, right) = items.split_at_mut(middle);
    let (children, rest) = below.split_at_mut(2);
    let (left_node, right_node) = children.split_at_mut(1);
    let (left_rest, right_rest) = rest.split_at_mut(2 * left.len() - 2);
    let (left_at, right_at) = (at + 2, at + 2 * left.len());
    let side_by_side = left.len() + right.len() >= SIDE_BY_SIDE;
    let mut first_part = || split(&mut left_node[0], left_rest, left_at, left, first);
    let mut second_part = || split(&mut right_node[0], right_rest, right_at, right, first + middle);
    if side_by_side {
        rayon::join(first_part, second_part);
    } else {
        first_part();
        second_part();
    }
}

/// Orders two or more items so that those before the returned place are one part, and the others the other.
fn divide(items: &mut [Item]) -> usize {
    let centre = |item: &Item| item.bounds.min + item.bounds.max;
    let (low, high) = items
        .iter()
        .map(centre)
        .fold((Vec3A::INFINITY, Vec3A::NEG_INFINITY), |(low, high), c| (low.min(c), high.max(c)));
    let scale = (high - low).map(|extent| if extent > 0.0 { BINS as f32 / extent } else { 0.0 });
    let bin = |item: &Item| ((centre(item) - low) * scale).to_array().map(|v| (v as usize).min(BINS - 1));
    let mut bins = [[(Aabb::empty(), 0_usize); BINS]; 3];
    for item in items.iter() {
        for (axis, bin) in bin(item).into_iter().enumerate() {
            let (bounds, count) = &mut bins[axis][bin];
            *bounds = bounds.union(&item.bounds);
            *count += 1;
        }
    }
    let mut best = (f32::INFINITY, 0, 0);
    for (axis, bins) in bins.iter().enumerate().filter(|(axis, _)| scale[*axis] > 0.0) {
        let mut after = [0.0; BINS];
        let mut all = (Aabb::empty(), 0);
        for (place, (bounds, count)) in bins.iter().enumerate().skip(1).rev() {
            all = (all.0.union(bounds), all.1 + count);
            after[place] = if all.1 > 0 { all.0.half_area() * all.1 as f32 } else { f32::INFINITY };
        }
        let mut all = (Aabb::empty(), 0);
        for (place, (bounds, count)) in bins.iter().enumerate().take(BINS - 1) {
            all = (all.0.union(bounds), all.1 + count);
            let cost = all.0.half_area() * all.1 as f32 + after[place + 1];
            if all.1 > 0 && cost < best.0 {
                best = (cost, axis, place + 1);
            }
        }
    }
    let (cost, axis, place) = best;
    let mut middle = 0;
    if cost.is_finite() {
        for i in 0..items.len() {
            if bin(&items[i])[axis] < place {
                items.swap(i, middle);
                middle += 1;
            }
        }
    }
    // All in one place: any half will do.
    if middle == 0 || middle == items.len() { items.len() / 2 } else { middle }
}
