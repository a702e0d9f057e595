//! Moving instances for ray tracing: the bounds of each instance in any pose, and the top level over all instances. The
//! top level is rebuilt in each frame in which something moves.

use super::InstanceLayout;
use super::update::Dynamic;
use crate::bake::bvh;
use crate::scene::{Mesh, Scene};
use crate::shared::{Joint, RAY_STILL};
use glam::{DAffine3, DMat3, DMat4, DVec3, Vec3};
use obvhs::aabb::Aabb;
use obvhs::cwbvh::node::CwBvhNode;
use std::collections::BTreeMap;

/// Static and movable parts of the scene.
pub(super) struct Movers {
    /// Whether each instance may move.
    pub(super) moves: Vec<bool>,
    /// Bounds and root of all static instances, if there are any.
    still: Option<(Aabb, u32)>,
    all: Vec<Mover>,
    /// By mesh.
    reaches: BTreeMap<usize, Reach>,
}

/// An instance that may move.
struct Mover {
    instance: usize,
    mesh: usize,
    /// Root of its BVH, and the centre of the BVH in model space.
    root: u32,
    centre: DVec3,
    /// First of its joints and weights among all.
    first_joint: usize,
    first_weight: usize,
}

/// The top level: nodes over instances, and four words for each instance. Three are rows of the transform from the
/// world to its space; the fourth holds root and index.
#[derive(Default)]
pub(super) struct Top {
    pub(super) nodes: Vec<CwBvhNode>,
    pub(super) instances: Vec<[[f32; 4]; 4]>,
}

/// Bounds of a mesh in any pose: one box for each set of vertices that move together.
struct Reach {
    parts: Vec<Part>,
    /// Factor by which boxes grow to hold vertices outside the triangles they follow.
    stretch: f64,
}

/// Vertices that share a joint.
struct Part {
    /// `None` for meshes without a skin.
    joint: Option<usize>,
    /// In bind space, as [low, high].
    bounds: [DVec3; 2],
    /// Displacement of each morph target at weight 1.
    targets: Vec<[DVec3; 2]>,
}

const EMPTY: [DVec3; 2] = [DVec3::INFINITY, DVec3::NEG_INFINITY];

impl Movers {
    /// Creates movers from instances, the roots of their BVHs, and the bounds of their triangles at rest about a
    /// centre.
    pub(super) fn new(
        scene: &Scene,
        layouts: &[InstanceLayout],
        moves: Vec<bool>,
        still: Option<(Aabb, u32)>,
        mut made: Vec<(usize, u32, (Vec3, Aabb))>,
    ) -> Self {
        made.sort_by_key(|(instance, ..)| *instance);
        let mut reaches = BTreeMap::new();
        let (mut first_joint, mut first_weight, mut counted) = (0, 0, 0);
        let mover = |(instance, root, (centre, bounds)): (usize, u32, (Vec3, Aabb))| {
            let mesh = scene.instances[instance].mesh;
            reaches.entry(mesh).or_insert_with(|| Reach::new(&scene.meshes[mesh], centre, bounds));
            for layout in &layouts[counted..instance] {
                first_joint += layout.pose_sizes.0 as usize;
                first_weight += layout.pose_sizes.1 as usize;
            }
            counted = instance;
            Mover { instance, mesh, root, centre: centre.as_dvec3(), first_joint, first_weight }
        };
        let all = made.into_iter().map(mover).collect();
        Self { moves, still, all, reaches }
    }

    /// The top level over all visible instances.
    pub(super) fn top(&self, now: &Dynamic) -> Top {
        let mut boxes = Vec::with_capacity(self.all.len() + 1);
        let mut words = Vec::with_capacity(self.all.len() + 1);
        if let Some((bounds, root)) = self.still {
            let [x, y, z] = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
            boxes.push(bounds);
            words.push([x, y, z, [f32::from_bits(root), f32::from_bits(RAY_STILL), 0.0, 0.0]]);
        }
        for mover in self.all.iter().filter(|mover| !now.hidden[mover.instance]) {
            let world_from_model = { now.instances[mover.instance].world_from_model };
            let Some(place) = with_volume(DAffine3::from_mat4(world_from_model.as_dmat4())) else { continue };
            let joints = &now.joints[mover.first_joint..];
            let Some(bounds) = self.reaches[&mover.mesh].bounds(&place, joints, &now.weights[mover.first_weight..])
            else {
                continue;
            };
            let own_from_world = (place * DAffine3::from_translation(mover.centre)).inverse();
            let rows = DMat4::from(own_from_world).transpose().as_mat4();
            let what = [f32::from_bits(mover.root), f32::from_bits(mover.instance as u32), 0.0, 0.0];
            boxes.push(bounds);
            words.push([rows.x_axis, rows.y_axis, rows.z_axis, what.into()].map(Into::into));
        }
        let tree = bvh::shallow(&boxes);
        let nodes = if tree.nodes.is_empty() { vec![CwBvhNode::default()] } else { tree.nodes };
        Top { nodes, instances: tree.primitive_indices.iter().map(|&i| words[i as usize]).collect() }
    }
}

impl Reach {
    /// Bounds of a mesh. A rigid mesh has those of its triangles, given about a centre.
    fn new(mesh: &Mesh, centre: Vec3, bounds: Aabb) -> Self {
        let Some(deform) = &mesh.deform else {
            let bounds = [bounds.min, bounds.max].map(|p| Vec3::from(p).as_dvec3() + centre.as_dvec3());
            return Self { parts: vec![Part { joint: None, bounds, targets: Vec::new() }], stretch: 1.0 };
        };
        let mut parts: BTreeMap<Option<u32>, Part> = BTreeMap::new();
        for (at, bind) in deform.bind.iter().enumerate() {
            let mut add = |joint: Option<u32>| {
                let part = parts.entry(joint).or_insert_with(|| Part {
                    joint: joint.map(|joint| joint as usize),
                    bounds: EMPTY,
                    targets: vec![EMPTY; deform.targets.len()],
                });
                grow(&mut part.bounds, bind.position);
                for (bounds, target) in part.targets.iter_mut().zip(&deform.targets) {
                    grow(bounds, target[at].position);
                }
            };
            let first = bind.first_influence as usize;
            let own = &deform.influences[first..first + bind.influence_count as usize];
            own.iter().for_each(|influence| add(Some(influence.joint)));
            if own.is_empty() {
                add(None);
            }
        }
        let outside = |[second, third]: [f32; 2]| (1.0 - second - third).abs() + second.abs() + third.abs();
        let stretch = deform.followers.iter().map(|f| f64::from(outside(f.weights))).fold(1.0, f64::max);
        Self { parts: parts.into_values().collect(), stretch }
    }

    /// A box in the world that holds the whole mesh despite rounding. `None` if it is empty or not finite.
    fn bounds(&self, place: &DAffine3, joints: &[Joint], weights: &[f32]) -> Option<Aabb> {
        let [mut low, mut high] = EMPTY;
        for part in &self.parts {
            let mut own = part.bounds;
            for (target, weight) in part.targets.iter().zip(weights) {
                let [a, b] = target.map(|side| side * f64::from(*weight));
                own = [own[0] + a.min(b), own[1] + a.max(b)];
            }
            let place = part.joint.map_or(*place, |joint| *place * affine(&joints[joint]));
            let (middle, half) = (place.transform_point3(0.5 * (own[0] + own[1])), 0.5 * (own[1] - own[0]));
            let half = DMat3::from_cols(place.x_axis.abs(), place.y_axis.abs(), place.z_axis.abs()) * half;
            low = low.min(middle - half);
            high = high.max(middle + half);
        }
        let (middle, half) = (0.5 * (low + high), 0.5 * self.stretch * (high - low));
        // Positions and rays have single precision, in the world and in model space.
        let far = middle.abs().max((middle - place.translation).abs()).max_element() + half.max_element();
        let half = half + 1e-5 * half.max_element() + 4e-6 * far;
        let bounds = Aabb::new((middle - half).as_vec3().into(), (middle + half).as_vec3().into());
        (bounds.min.is_finite() && bounds.max.is_finite()).then_some(bounds)
    }
}

fn grow(bounds: &mut [DVec3; 2], position: Vec3) {
    *bounds = [bounds[0].min(position.as_dvec3()), bounds[1].max(position.as_dvec3())];
}

/// The matrix of a joint.
fn affine(joint: &Joint) -> DAffine3 {
    let rows = [joint.x, joint.y, joint.z].map(|row| row.as_dvec4());
    DAffine3::from_mat4(DMat4::from_cols(rows[0], rows[1], rows[2], glam::DVec4::W).transpose())
}

/// Makes a transform invertible: a flattened direction gets a millionth of the size as thickness. `None` if nothing is
/// left.
fn with_volume(mut place: DAffine3) -> Option<DAffine3> {
    let m = place.matrix3;
    let cofactors = DMat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis));
    let size = cofactors.to_cols_array().iter().fold(0.0_f64, |most, v| most.max(v.abs())).sqrt();
    let volume = m.determinant();
    if volume.abs() < 1e-6 * size.powi(3) {
        // Cofactors complete the map: they lead from the direction it loses to the one that is missing from its
        // results.
        place.matrix3 += cofactors * (1e-6 * if volume < 0.0 { -1.0 } else { 1.0 } / size);
    }
    (size > 0.0 && place.is_finite() && place.inverse().is_finite()).then_some(place)
}
