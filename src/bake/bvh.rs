//! Builds a bounding volume hierarchy over boxes with the surface area heuristic.
//!
//! obvhs builds by merging neighbours along a curve. With similar triangles, such as those of subdivided walls, rays
//! then visit four to six times as many nodes as with top-down splitting. This module therefore splits top-down, and
//! obvhs converts the result to eight-wide nodes.

use glam::Vec3A;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::bvh2_to_cwbvh::bvh2_to_cwbvh;

/// Candidate split positions of a node, along each axis.
const BINS: usize = 16;

/// From this number of boxes on, the two parts of a node are built in parallel.
const SIDE_BY_SIDE: usize = 4096;

/// Most boxes in a leaf.
const LEAF: u32 = 3;

/// Share of the nodes that reinsertion tries to improve afterwards.
const REINSERTED: f32 = 0.3;

/// Depth above which the result of reinsertion is discarded; several times the depth of usual scenes.
const DEEPEST: usize = 96;

/// A box and its index.
#[derive(Clone, Copy)]
struct Item {
    bounds: Aabb,
    number: u32,
}

/// A hierarchy of compressed nodes with eight children over the boxes; empty without boxes. Uses all cores.
pub fn hierarchy(boxes: &[Aabb]) -> CwBvh {
    if boxes.is_empty() {
        return CwBvh::default();
    }
    let mut tree = divided(boxes, divide);
    let before = tree.clone();
    ReinsertionOptimizer::default().run(&mut tree, REINSERTED, None);
    // Reinsertion turns concentric boxes into a chain, for which rays would need an equally deep stack.
    if binary_depth(&tree) > DEEPEST {
        tree = before;
    }
    bvh2_to_cwbvh(&tree, LEAF, true, false)
}

/// A hierarchy that is faster to build and no deeper than `most_depth`, for a few boxes that change in every frame.
pub fn shallow(boxes: &[Aabb]) -> CwBvh {
    if boxes.is_empty() {
        return CwBvh::default();
    }
    let tree = bvh2_to_cwbvh(&divided(boxes, divide), LEAF, true, false);
    if depth(&tree) <= most_depth(boxes.len()) {
        return tree;
    }
    bvh2_to_cwbvh(&divided(boxes, |items| items.len() / 2), LEAF, true, false)
}

/// Upper limit of the depth of a `shallow` hierarchy over this many boxes, in nodes.
pub fn most_depth(boxes: usize) -> u32 {
    boxes.max(1).next_power_of_two().ilog2() + 1
}

/// Depth of a hierarchy, in nodes; 1 if it is empty.
pub fn depth(tree: &CwBvh) -> u32 {
    depths(tree).into_iter().max().unwrap_or(1)
}

/// Depth of each node, including the node itself.
pub fn depths(tree: &CwBvh) -> Vec<u32> {
    let mut depths = vec![1_u32; tree.nodes.len()];
    // Children are stored after their parents.
    for (at, node) in tree.nodes.iter().enumerate() {
        for child in 0..node.imask.count_ones() {
            depths[(node.child_base_idx + child) as usize] = depths[at] + 1;
        }
    }
    depths
}

/// A binary hierarchy, split top-down by `divide`.
fn divided(boxes: &[Aabb], divide: impl Fn(&mut [Item]) -> usize + Copy + Send + Sync) -> Bvh2 {
    let mut items: Vec<Item> =
        boxes.iter().enumerate().map(|(i, bounds)| Item { bounds: *bounds, number: i as u32 }).collect();
    let mut nodes = vec![Bvh2Node::new(Aabb::empty(), 0, 0); 2 * boxes.len() - 1];
    let (root, rest) = nodes.split_at_mut(1);
    split(&mut root[0], rest, 1, &mut items, 0, divide);
    Bvh2 {
        nodes,
        primitive_indices: items.iter().map(|item| item.number).collect(),
        children_are_ordered_after_parents: true,
        ..Bvh2::default()
    }
}

/// Depth of a binary hierarchy, in nodes.
fn binary_depth(tree: &Bvh2) -> usize {
    let mut deepest = 0;
    let mut open = vec![(0, 1)];
    while let Some((at, depth)) = open.pop() {
        let node = &tree.nodes[at];
        deepest = deepest.max(depth);
        if !node.is_leaf() {
            open.extend([0, 1].map(|child| (node.first_index as usize + child, depth + 1)));
        }
    }
    deepest
}

/// Fills in a node over `items` and all nodes below it. `first` is the index of the first item among all items. `below`
/// holds the nodes below, two less than twice the number of items; `at` is the index of its first node among all nodes.
fn split(
    node: &mut Bvh2Node,
    below: &mut [Bvh2Node],
    at: usize,
    items: &mut [Item],
    first: usize,
    divide: impl Fn(&mut [Item]) -> usize + Copy + Send + Sync,
) {
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
    let mut first_part = || split(&mut left_node[0], left_rest, left_at, left, first, divide);
    let mut second_part = || split(&mut right_node[0], right_rest, right_at, right, first + middle, divide);
    if side_by_side {
        rayon::join(first_part, second_part);
    } else {
        first_part();
        second_part();
    }
}

/// Partitions two or more items and returns the start of the second part.
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
    // If all items are in one place, any half will do.
    if middle == 0 || middle == items.len() { items.len() / 2 } else { middle }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DVec3, Vec3};
    use obvhs::cwbvh::node::CwBvhNode;

    /// State of a walk through a tree.
    struct Walk<'a> {
        tree: &'a CwBvh,
        boxes: &'a [Aabb],
        /// Number of visits of each box.
        met: Vec<u32>,
        nodes: usize,
    }

    impl Walk<'_> {
        /// Exact bounds of a node's boxes, and the node's depth; fails if a child's box does not contain its own boxes.
        fn node(&mut self, at: usize) -> ([DVec3; 2], usize) {
            let node: CwBvhNode = self.tree.nodes[at];
            self.nodes += 1;
            let step = DVec3::from_array(node.e.map(|e| f64::from(f32::from_bits(u32::from(e) << 23))));
            let corner = node.p.as_dvec3();
            let (mut all, mut depth, mut inner) = ([DVec3::INFINITY, DVec3::NEG_INFINITY], 1, 0);
            for child in 0..8 {
                let meta = node.child_meta[child];
                if meta == 0 {
                    continue;
                }
                let own = if node.imask >> child & 1 == 1 {
                    inner += 1;
                    let (own, below) = self.node((node.child_base_idx + inner - 1) as usize);
                    depth = depth.max(below + 1);
                    own
                } else {
                    let first = node.primitive_base_idx + u32::from(meta & 0x1f);
                    let mut own = [DVec3::INFINITY, DVec3::NEG_INFINITY];
                    for slot in first..first + (meta >> 5).count_ones() {
                        let number = self.tree.primitive_indices[slot as usize] as usize;
                        self.met[number] += 1;
                        own[0] = own[0].min(Vec3::from(self.boxes[number].min).as_dvec3());
                        own[1] = own[1].max(Vec3::from(self.boxes[number].max).as_dvec3());
                    }
                    own
                };
                let of = |x: [u8; 8], y: [u8; 8], z: [u8; 8]| {
                    corner + step * DVec3::from([x, y, z].map(|plane| f64::from(plane[child])))
                };
                let low = of(node.child_min_x, node.child_min_y, node.child_min_z);
                let high = of(node.child_max_x, node.child_max_y, node.child_max_z);
                // Half of the margin that a ray adds to each side.
                let slack = 1.2e-7 * (corner.abs() + 255.0 * step);
                assert!(
                    (low - slack).cmple(own[0]).all() && (high + slack).cmpge(own[1]).all(),
                    "{low} {high} {own:?}"
                );
                all = [all[0].min(own[0]), all[1].max(own[1])];
            }
            (all, depth)
        }
    }

    /// Walks the hierarchy over some boxes and returns its depth.
    fn walked(boxes: &[Aabb]) -> usize {
        walked_by(hierarchy, boxes)
    }

    /// The same with a hierarchy built by `make`.
    fn walked_by(make: fn(&[Aabb]) -> CwBvh, boxes: &[Aabb]) -> usize {
        let tree = make(boxes);
        let mut walk = Walk { tree: &tree, boxes, met: vec![0; boxes.len()], nodes: 0 };
        let (all, depth) = walk.node(0);
        assert!(walk.met.iter().all(|met| *met == 1), "{:?}", walk.met.iter().position(|met| *met != 1));
        assert_eq!((walk.nodes, tree.primitive_indices.len()), (tree.nodes.len(), boxes.len()));
        let whole = boxes.iter().fold(Aabb::empty(), |all, b| all.union(b));
        assert_eq!(all, [whole.min, whole.max].map(|p| Vec3::from(p).as_dvec3()));
        assert_eq!(super::depth(&tree) as usize, depth);
        depth
    }

    /// Random boxes in a cube, most of them small.
    fn random(count: usize, size: f32) -> Vec<Aabb> {
        let mut state = 1_u32;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32
        };
        let one = |_| {
            let low = Vec3A::new(next(), next(), next());
            let extent = 0.1 * next().powi(4) * Vec3A::new(next(), next(), next());
            Aabb::new(low * size, (low + extent) * size)
        };
        (0..count).map(one).collect()
    }

    #[test]
    fn every_box_is_there_once_and_inside_its_parents() {
        assert!(hierarchy(&[]).nodes.is_empty());
        for count in [1, 2, 3, 4, 5, 8, 9, 25, 100, 3000, 20_000] {
            let depth = walked(&random(count, 1.0));
            assert!(depth <= 2 + count.ilog2() as usize / 2, "{count} boxes: {depth} deep");
        }
        for size in [1e-6, 1e9] {
            walked(&random(1000, size));
        }
        // In a plane, on a line, and in a point.
        for flat in [Vec3A::new(1.0, 1.0, 0.0), Vec3A::X, Vec3A::ZERO] {
            let boxes: Vec<Aabb> = random(1000, 1.0).iter().map(|b| Aabb::new(b.min * flat, b.max * flat)).collect();
            walked(&boxes);
        }
    }

    #[test]
    fn boxes_in_one_place_are_not_deep() {
        let one = Aabb::new(Vec3A::ZERO, Vec3A::ONE);
        let same = walked(&vec![one; 20_000]);
        // Concentric, each larger than the one before.
        let nested: Vec<Aabb> = (0..20_000).map(|i| Aabb::new(-Vec3A::ONE * i as f32, Vec3A::ONE * i as f32)).collect();
        let nested = walked(&nested);
        // With a common corner, each half as large as the one before.
        let shrinking: Vec<Aabb> =
            (0..100).map(|i| 0.5_f32.powi(i)).map(|s| Aabb::new(Vec3A::ZERO, Vec3A::splat(s))).collect();
        let shrinking = walked(&shrinking);
        assert!(same <= 8 && nested <= 8 && shrinking <= 24, "{same}, {nested}, {shrinking}");
    }

    #[test]
    fn a_top_level_is_never_deep() {
        assert!(shallow(&[]).nodes.is_empty());
        for count in [1, 2, 3, 4, 5, 8, 9, 25, 100, 299, 3000] {
            let one = vec![Aabb::new(Vec3A::ZERO, Vec3A::ONE); count];
            let nested = (0..count).map(|i| Aabb::new(-Vec3A::ONE * i as f32, Vec3A::ONE * i as f32)).collect();
            let far = (0..count).map(|i| 0.5_f32.powi(i as i32)).map(|s| Aabb::new(Vec3A::ZERO, Vec3A::splat(s)));
            for boxes in [random(count, 1.0), one, nested, far.collect()] {
                let depth = walked_by(shallow, &boxes);
                assert!(depth <= most_depth(count) as usize, "{count} boxes: {depth} deep");
                assert!(shallow(&boxes).nodes.len() <= count, "{count} boxes");
            }
        }
    }
}
