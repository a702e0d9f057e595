//! Bounds of all motion, found by sampling many times. The origin and the views of parallel lights are laid out by
//! these bounds, once.

use super::Rig;
use crate::scene::deform::Pose;
use crate::scene::{Instance, Mesh, Scene};
use glam::DVec3;

/// Times sampled in each animation in addition to its keys, and the most keys sampled.
const TIMES: usize = 32;
const MOST_KEYS: usize = 96;

/// Margin around moving objects, as a share of the diagonal of their sampled bounds, for positions between the samples.
const MARGIN: f64 = 0.02;

/// Approximate limit on the box corners transformed in total, and the least number of times per animation.
const MOST_CORNERS: usize = 1 << 26;
const FEWEST_TIMES: usize = 5;

type Bounds = (DVec3, DVec3);

/// The part of a mesh that moves with one joint, or a whole mesh without joints.
struct Part {
    /// Index into `Pose::joints`.
    joint: Option<usize>,
    bounds: Bounds,
    /// For each morph target, smallest and largest displacement \[m\].
    targets: Vec<Bounds>,
}

impl Scene {
    /// Bounds of everything at rest and in any animation; `None` if nothing is drawn. Leaves the scene at rest.
    pub(crate) fn sweep(&mut self) -> Option<Bounds> {
        self.extent = None;
        self.rest();
        let still = self.rig.as_ref().map_or_else(Vec::new, |rig| {
            let of = |(index, instance): (usize, &Instance)| (!rig.moves(index)).then(|| instance.clone());
            self.instances.iter().enumerate().filter_map(of).collect()
        });
        // Static instances are measured only once.
        let mut bounds = still.iter().fold(None, |bounds, instance| self.grown(bounds, instance));
        let mesh_parts: Vec<Vec<Part>> = self.meshes.iter().map(parts).collect();
        let mut swept = self.swept(None, &mesh_parts);
        let corners: usize = self.instances.iter().map(|instance| 8 * mesh_parts[instance.mesh].len()).sum();
        let most = MOST_CORNERS / (corners * self.animations().count()).max(1);
        let times = self.rig.as_ref().map_or_else(Vec::new, |rig| times(rig, most.max(FEWEST_TIMES)));
        for (animation, times) in times.iter().enumerate() {
            for &time in times {
                self.pose(animation, time);
                swept = self.swept(swept, &mesh_parts);
            }
        }
        self.rest();
        if let Some((low, high)) = swept {
            let margin = DVec3::splat(MARGIN * low.distance(high));
            bounds = union(union(bounds, low - margin), high + margin);
        }
        bounds
    }

    fn swept(&self, mut bounds: Option<Bounds>, parts: &[Vec<Part>]) -> Option<Bounds> {
        let Some(rig) = &self.rig else { return bounds };
        let none = Pose::default();
        for (_, instance) in self.instances.iter().enumerate().filter(|(index, _)| rig.moves(*index)) {
            let pose = instance.pose.as_ref().unwrap_or(&none);
            for part in &parts[instance.mesh] {
                let place = match part.joint {
                    Some(joint) => instance.world_from_model * pose.joints.get(joint).copied().unwrap_or_default(),
                    None => instance.world_from_model,
                };
                let (mut low, mut high) = part.bounds;
                for (&weight, target) in pose.weights.iter().zip(&part.targets) {
                    let (a, b) = (target.0 * f64::from(weight), target.1 * f64::from(weight));
                    (low, high) = (low + a.min(b), high + a.max(b));
                }
                for corner in corners(low, high) {
                    bounds = union(bounds, place.transform_point3(corner));
                }
            }
        }
        bounds
    }

    /// The given bounds, extended by an instance in its current pose.
    pub(in crate::scene) fn grown(&self, mut bounds: Option<Bounds>, instance: &Instance) -> Option<Bounds> {
        let mesh = &self.meshes[instance.mesh];
        let posed = instance.pose.as_ref().map(|pose| mesh.posed(pose));
        let vertices = posed.as_ref().unwrap_or(&mesh.vertices);
        for &index in &mesh.indices {
            let position = vertices[index as usize].position.as_dvec3();
            bounds = union(bounds, instance.world_from_model.transform_point3(position));
        }
        bounds
    }
}

/// The parts of a mesh that move independently. Posed vertices are weighted means of their positions under these parts.
fn parts(mesh: &Mesh) -> Vec<Part> {
    let Some(deform) = &mesh.deform else {
        let all = mesh.indices.iter().fold(None, |all, &v| union(all, mesh.vertices[v as usize].position.as_dvec3()));
        return all.map(|bounds| Part { joint: None, bounds, targets: Vec::new() }).into_iter().collect();
    };
    let mut parts: Vec<Option<Part>> = Vec::new();
    for (at, bind) in deform.bind.iter().enumerate() {
        let first = bind.first_influence as usize;
        let influences = &deform.influences[first..first + bind.influence_count as usize];
        let joints = influences.iter().map(|influence| Some(influence.joint as usize));
        let none = influences.is_empty().then_some(None);
        for joint in joints.chain(none) {
            let place = joint.map_or(0, |joint| joint + 1);
            if parts.len() <= place {
                parts.resize_with(place + 1, || None);
            }
            let position = bind.position.as_dvec3();
            let part = parts[place].get_or_insert_with(|| Part {
                joint,
                bounds: (position, position),
                targets: vec![(DVec3::INFINITY, DVec3::NEG_INFINITY); deform.targets.len()],
            });
            part.bounds = (part.bounds.0.min(position), part.bounds.1.max(position));
            for (bounds, target) in part.targets.iter_mut().zip(&deform.targets) {
                let displacement = target[at].position.as_dvec3();
                *bounds = (bounds.0.min(displacement), bounds.1.max(displacement));
            }
        }
    }
    parts.into_iter().flatten().collect()
}

/// Sample times by animation, about `most` or fewer.
fn times(rig: &Rig, most: usize) -> Vec<Vec<f64>> {
    let of = |animation: &super::Animation| {
        let (begin, end) = animation.span();
        let keys = animation.channels.iter().flat_map(|channel| &channel.sampler.times);
        let mut keys: Vec<f64> = keys.map(|&key| f64::from(key)).collect();
        keys.sort_by(f64::total_cmp);
        keys.dedup();
        let step = keys.len().div_ceil(MOST_KEYS.min(most)).max(1);
        let count = TIMES.min(most);
        let even = (0..count).map(|i| begin + (end - begin) * i as f64 / (count - 1) as f64);
        keys.iter().copied().step_by(step).chain(even).collect()
    };
    rig.parts().animations.iter().map(of).collect()
}

fn union(bounds: Option<Bounds>, point: DVec3) -> Option<Bounds> {
    let (low, high) = bounds.unwrap_or((point, point));
    Some((low.min(point), high.max(point)))
}

fn corners(low: DVec3, high: DVec3) -> [DVec3; 8] {
    std::array::from_fn(|i| DVec3::new([low.x, high.x][i & 1], [low.y, high.y][i >> 1 & 1], [low.z, high.z][i >> 2]))
}
