//! Animations as glTF defines them, at any time: nodes, skins, morph weights, and targets of KHR_animation_pointer.
//!
//! `Scene::pose` starts from the rest values each time, so a pose depends only on the animation and the time. Times and
//! world transforms are f64.

mod extent;
mod property;
mod sampler;

pub use property::{Property, Quantity};
pub use sampler::{Interpolation, Sampler};

use super::{Instance, Scene};
use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};
use std::ops::Range;

/// The animation data of a scene: [`Parts`] and derived data about which of them move.
#[derive(Clone, Debug, Default)]
pub struct Rig {
    parts: Parts,
    /// Nodes whose world transform an animation changes, parents first.
    moving: Vec<usize>,
    /// By node: whether it is in `moving`.
    moves: Vec<bool>,
    /// Nodes whose visibility an animation changes, parents first.
    fading: Vec<usize>,
    /// By node: whether it is in `fading`.
    fades: Vec<bool>,
    /// By skin: whether any of its joints moves.
    bending: Vec<bool>,
    /// Local transforms, world transforms and visibility of all nodes, as last set.
    locals: Vec<Local>,
    worlds: Vec<DAffine3>,
    shown: Vec<bool>,
    own_shown: Vec<bool>,
    /// Buffer for a sampled value.
    sampled: Vec<f64>,
}

/// The parts that make up a rig.
#[derive(Clone, Debug, Default)]
pub struct Parts {
    /// The node tree.
    pub nodes: Vec<Node>,
    /// Skins that deform meshes.
    pub skins: Vec<Skin>,
    /// For each of the first of `Scene::instances`, the node or skin that places it.
    pub instances: Vec<AnimatedInstance>,
    /// For each of the first of `Scene::lights`, its node.
    pub lights: Vec<usize>,
    /// For each of the first of `Scene::cameras`, its node.
    pub cameras: Vec<usize>,
    /// Animated properties other than node transforms, visibility and weights.
    pub properties: Vec<Property>,
    /// The animations.
    pub animations: Vec<Animation>,
}

/// A node in the rest pose.
#[derive(Clone, Debug, Default)]
pub struct Node {
    /// The parent node.
    pub parent: Option<usize>,
    /// The rest transform.
    pub rest: Local,
    /// KHR_node_visibility: whether the node and its descendants are hidden.
    pub hidden: bool,
}

/// A node's transform relative to its parent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Local {
    /// Scale, then rotate, then translate.
    Parts {
        /// Translation \[m\].
        translation: DVec3,
        /// Unit quaternion.
        rotation: DQuat,
        /// Scale along each axis.
        scale: DVec3,
    },
    /// A matrix, which cannot be animated.
    Matrix(DAffine3),
}

impl Default for Local {
    fn default() -> Self {
        Self::Parts { translation: DVec3::ZERO, rotation: DQuat::IDENTITY, scale: DVec3::ONE }
    }
}

impl Local {
    /// The transform as an affine matrix.
    pub fn affine(&self) -> DAffine3 {
        match *self {
            Self::Parts { translation, rotation, scale } => {
                DAffine3::from_scale_rotation_translation(scale, rotation, translation)
            }
            Self::Matrix(matrix) => matrix,
        }
    }
}

/// Joints that deform meshes.
#[derive(Clone, Debug, Default)]
pub struct Skin {
    /// Joint nodes; at least one.
    pub joints: Vec<usize>,
    /// For each joint, the transform from the mesh's bind space to the joint's space.
    pub inverse_bind: Vec<DAffine3>,
}

/// Attachment of an instance to the node tree.
#[derive(Clone, Debug, Default)]
pub struct AnimatedInstance {
    /// The node that draws the instance.
    pub node: usize,
    /// What places the instance in the world.
    pub hold: Hold,
    /// Rest weights of its morph targets; empty if no animation sets them.
    pub weights: Vec<f32>,
}

/// What places an instance in the world.
#[derive(Clone, Copy, Debug, Default)]
pub enum Hold {
    /// Fixed: vertices of a skin without animation are in world space.
    #[default]
    World,
    /// The instance's node, with the given offset applied first (EXT_mesh_gpu_instancing).
    Node(DAffine3),
    /// The joints of this skin; `world_from_model` is the translation to the first joint.
    Skin(usize),
}

/// A named set of channels that play together.
#[derive(Clone, Debug, Default)]
pub struct Animation {
    /// glTF's name, or a generated one.
    pub name: String,
    /// The animated values.
    pub channels: Vec<Channel>,
}

/// A value over time and its target.
#[derive(Clone, Debug)]
pub struct Channel {
    /// The value over time.
    pub sampler: Sampler,
    /// The target of the value.
    pub target: Target,
}

/// Target of a channel.
#[derive(Clone, Debug, PartialEq)]
pub enum Target {
    /// Translation of a node \[m\].
    Translation(usize),
    /// Rotation of a node.
    Rotation(usize),
    /// Scale of a node.
    Scale(usize),
    /// Morph weights of these instances, starting at weight `first`.
    Weights {
        /// The instances of one node.
        instances: Range<usize>,
        /// Index of the first weight that is set.
        first: usize,
    },
    /// KHR_node_visibility of a node.
    Visible(usize),
    /// A part of one of `Parts::properties`.
    Property {
        /// Index of the property.
        property: usize,
        /// Index of the part.
        part: usize,
    },
}

impl Animation {
    /// Times \[s\] of the first and the last key.
    pub fn span(&self) -> (f64, f64) {
        let begin = self.channels.iter().map(|c| c.sampler.begin()).fold(f64::INFINITY, f64::min);
        let end = self.channels.iter().map(|c| c.sampler.end()).fold(f64::NEG_INFINITY, f64::max);
        if begin <= end { (begin, end) } else { (0.0, 0.0) }
    }

    /// Time within the animation after it has looped for `time` \[s\]. A loop runs from 0 to the last key; at a whole
    /// number of loops the result is the last key.
    pub fn looped(&self, time: f64) -> f64 {
        let (_, end) = self.span();
        let within = if end > 0.0 { time.rem_euclid(end) } else { end };
        if within == 0.0 && time > 0.0 { end } else { within }
    }
}

impl Scene {
    /// Names of the animations, and the times \[s\] of their first and last keys.
    pub fn animations(&self) -> impl Iterator<Item = (&str, f64, f64)> {
        self.rig.iter().flat_map(|rig| &rig.parts.animations).map(|animation| {
            let (begin, end) = animation.span();
            (animation.name.as_str(), begin, end)
        })
    }

    /// Whether an animation sets one of these quantities of a light, camera or material.
    pub fn animates(&self, quantities: &[Quantity], of: usize) -> bool {
        let mut all = self.rig.iter().flat_map(|rig| &rig.parts.properties);
        all.any(|property| quantities.contains(&property.quantity()) && property.of().contains(&of))
    }

    /// Whether an instance may move, deform or vanish: by an animation, by a pose, or because `Instance::moves` is set.
    pub fn may_move(&self, index: usize) -> bool {
        let instance = &self.instances[index];
        let by_rig = |rig: &Rig| {
            let node = rig.parts.instances.get(index).map(|placed| placed.node);
            rig.moves(index) || node.is_some_and(|node| rig.fades[node])
        };
        instance.moves || self.meshes[instance.mesh].deform.is_some() || self.rig.as_ref().is_some_and(by_rig)
    }

    /// See [`Animation::looped`]; without this animation, the time itself.
    pub fn looped(&self, animation: usize, time: f64) -> f64 {
        let played = self.rig.as_ref().and_then(|rig| rig.parts().animations.get(animation));
        played.map_or(time, |animation| animation.looped(time))
    }

    /// Poses the scene as an animation defines it at `time` \[s\]; everything that the animation does not change
    /// returns to rest. Values are held before the first and after the last key. Caches are placed at rest: bake first,
    /// then pose.
    ///
    /// # Panics
    ///
    /// Panics if the animation does not exist.
    pub fn pose(&mut self, animation: usize, time: f64) {
        let count = self.animations().count();
        assert!(animation < count, "pose: animation {animation} of {count}");
        self.set(Some((animation, time)));
    }

    /// Returns everything to rest.
    pub fn rest(&mut self) {
        self.set(None);
    }

    fn set(&mut self, played: Option<(usize, f64)>) {
        // Taken out, because the rig writes to the scene that owns it.
        let Some(mut rig) = self.rig.take() else { return };
        rig.play(played);
        rig.weigh(self, played);
        rig.place(self);
        self.rig = Some(rig);
    }
}

impl Rig {
    /// A rig at rest.
    ///
    /// # Panics
    ///
    /// Panics if the nodes do not form a tree.
    pub fn new(parts: Parts) -> Self {
        let count = parts.nodes.len();
        let mut children = vec![Vec::new(); count];
        let mut order: Vec<usize> = (0..count).filter(|&node| parts.nodes[node].parent.is_none()).collect();
        for (index, node) in parts.nodes.iter().enumerate() {
            node.parent.into_iter().for_each(|parent| children[parent].push(index));
        }
        let mut at = 0;
        while at < order.len() {
            order.extend_from_slice(&children[order[at]]);
            at += 1;
        }
        assert_eq!(order.len(), count, "Rig::new: nodes form a tree");

        let (mut moves, mut fades) = (vec![false; count], vec![false; count]);
        for channel in parts.animations.iter().flat_map(|animation| &animation.channels) {
            match channel.target {
                Target::Translation(node) | Target::Rotation(node) | Target::Scale(node) => moves[node] = true,
                Target::Visible(node) => fades[node] = true,
                Target::Weights { .. } | Target::Property { .. } => {}
            }
        }
        for &node in &order {
            if let Some(parent) = parts.nodes[node].parent {
                moves[node] |= moves[parent];
                fades[node] |= fades[parent];
            }
        }
        let bending = parts.skins.iter().map(|skin| skin.joints.iter().any(|&joint| moves[joint])).collect();
        let widest = parts.animations.iter().flat_map(|a| &a.channels).map(|c| c.sampler.width).max().unwrap_or(0);
        let mut rig = Self {
            moving: order.clone(),
            moves,
            fading: order.clone(),
            fades,
            bending,
            locals: parts.nodes.iter().map(|node| node.rest).collect(),
            worlds: vec![DAffine3::IDENTITY; count],
            shown: vec![true; count],
            own_shown: parts.nodes.iter().map(|node| !node.hidden).collect(),
            sampled: vec![0.0; widest],
            parts,
        };
        // Computes all nodes once; from now on only the animated ones.
        rig.play(None);
        rig.moving.retain(|&node| rig.moves[node]);
        rig.fading.retain(|&node| rig.fades[node]);
        rig
    }

    /// The parts of the rig.
    pub fn parts(&self) -> &Parts {
        &self.parts
    }

    /// World transform of a node, as last set.
    pub(super) fn world(&self, node: usize) -> DAffine3 {
        self.worlds[node]
    }

    /// Whether a node is shown, as last set.
    pub(super) fn is_shown(&self, node: usize) -> bool {
        self.shown[node]
    }

    /// Whether any animation moves a node.
    pub(super) fn moves_node(&self, node: usize) -> bool {
        self.moves[node]
    }

    /// Whether any animation may hide or show a node.
    pub(super) fn fades_node(&self, node: usize) -> bool {
        self.fades[node]
    }

    /// Whether any animation moves or deforms an instance.
    pub fn moves(&self, instance: usize) -> bool {
        let Some(placed) = self.parts.instances.get(instance) else { return false };
        let held = match placed.hold {
            Hold::World => false,
            Hold::Node(_) => self.moves[placed.node],
            Hold::Skin(skin) => self.bending[skin],
        };
        held || !placed.weights.is_empty()
    }

    /// Whether any animation changes anything in the scene.
    pub fn reaches(&self) -> bool {
        let on = |node: &usize| self.moves[*node] || self.fades[*node];
        !self.parts.properties.is_empty()
            || (0..self.parts.instances.len()).any(|instance| self.moves(instance))
            || self.parts.instances.iter().any(|placed| self.fades[placed.node])
            || self.parts.lights.iter().chain(&self.parts.cameras).any(on)
    }

    /// Computes all node transforms, visibilities and properties.
    fn play(&mut self, played: Option<(usize, f64)>) {
        for &node in &self.moving {
            self.locals[node] = self.parts.nodes[node].rest;
        }
        for &node in &self.fading {
            self.own_shown[node] = !self.parts.nodes[node].hidden;
        }
        self.parts.properties.iter_mut().for_each(Property::rest);
        if let Some((animation, time)) = played {
            for channel in &self.parts.animations[animation].channels {
                let sampler = &channel.sampler;
                if let Target::Rotation(node) = channel.target {
                    if let Local::Parts { rotation, .. } = &mut self.locals[node] {
                        *rotation = sampler.rotation(time);
                    }
                    continue;
                }
                let value = &mut self.sampled[..sampler.width];
                sampler.sample(time, value);
                match &channel.target {
                    // `weigh` writes weights directly to the instances.
                    Target::Rotation(_) | Target::Weights { .. } => {}
                    Target::Translation(node) => {
                        if let Local::Parts { translation, .. } = &mut self.locals[*node] {
                            *translation = DVec3::from_slice(value);
                        }
                    }
                    Target::Scale(node) => {
                        if let Local::Parts { scale, .. } = &mut self.locals[*node] {
                            *scale = DVec3::from_slice(value);
                        }
                    }
                    Target::Visible(node) => self.own_shown[*node] = value[0] != 0.0,
                    Target::Property { property, part } => self.parts.properties[*property].set(*part, value),
                }
            }
        }
        for &node in &self.moving {
            let above = self.parts.nodes[node].parent.map(|parent| self.worlds[parent]);
            let local = self.locals[node].affine();
            self.worlds[node] = above.map_or(local, |above| above * local);
        }
        for &node in &self.fading {
            let above = self.parts.nodes[node].parent.is_none_or(|parent| self.shown[parent]);
            self.shown[node] = above && self.own_shown[node];
        }
    }
    /// Sets the weights of morph targets.
    fn weigh(&mut self, scene: &mut Scene, played: Option<(usize, f64)>) {
        for (placed, instance) in self.parts.instances.iter().zip(&mut scene.instances) {
            if let Some(pose) = instance.pose.as_mut().filter(|pose| pose.weights.len() == placed.weights.len()) {
                pose.weights.copy_from_slice(&placed.weights);
            }
        }
        let Some((animation, time)) = played else { return };
        for channel in &self.parts.animations[animation].channels {
            let Target::Weights { instances, first } = &channel.target else { continue };
            let value = &mut self.sampled[..channel.sampler.width];
            channel.sampler.sample(time, value);
            for pose in scene.instances[instances.clone()].iter_mut().filter_map(|instance| instance.pose.as_mut()) {
                for (weight, value) in pose.weights[*first..].iter_mut().zip(&*value) {
                    *weight = *value as f32;
                }
            }
        }
    }

    /// Writes animated transforms, visibilities and properties to the scene.
    fn place(&mut self, scene: &mut Scene) {
        for (placed, instance) in self.parts.instances.iter().zip(&mut scene.instances) {
            self.place_instance(placed, instance);
        }
        for (&node, light) in self.parts.lights.iter().zip(&mut scene.lights).filter(|(node, _)| self.moves[**node]) {
            (light.position, light.direction) = beam(self.worlds[node]);
        }
        for (&node, camera) in self.parts.cameras.iter().zip(&mut scene.cameras).filter(|(node, _)| self.moves[**node])
        {
            camera.world_from_camera = rigid(self.worlds[node]);
        }
        self.parts.properties.iter().for_each(|property| property.apply(scene));
        // Last: a hidden light emits nothing, whatever its animated intensity.
        for (&node, light) in self.parts.lights.iter().zip(&mut scene.lights) {
            if self.fades[node] && !self.shown[node] {
                light.intensity = 0.0;
            }
        }
    }

    fn place_instance(&self, placed: &AnimatedInstance, instance: &mut Instance) {
        if self.fades[placed.node] {
            instance.hidden = !self.shown[placed.node];
        }
        match placed.hold {
            Hold::Node(offset) if self.moves[placed.node] => {
                instance.world_from_model = self.worlds[placed.node] * offset;
            }
            Hold::Skin(skin) if self.bending[skin] => {
                let pose = instance.pose.get_or_insert_default();
                pose.joints.clear();
                let (anchor, joints) = joints(&self.parts.skins[skin], &self.worlds);
                pose.joints.extend(joints);
                instance.world_from_model = anchor;
            }
            Hold::World | Hold::Node(_) | Hold::Skin(_) => {}
        }
    }
}

/// Model transform of a skin, and its joints relative to the model. The model transform is the translation to the first
/// joint, so that vertices stay near 0 however far from the origin the model is.
pub(super) fn joints<'a>(skin: &'a Skin, worlds: &'a [DAffine3]) -> (DAffine3, impl Iterator<Item = DAffine3> + 'a) {
    let anchor = worlds[skin.joints[0]].translation;
    let joint = move |(&node, bind): (&usize, &DAffine3)| {
        let mut joint = worlds[node] * *bind;
        joint.translation -= anchor;
        joint
    };
    (DAffine3::from_translation(anchor), skin.joints.iter().zip(&skin.inverse_bind).map(joint))
}

/// Position and direction of a light at a node.
pub(super) fn beam(world: DAffine3) -> (DVec3, Vec3) {
    let direction = world.transform_vector3(DVec3::NEG_Z).try_normalize().unwrap_or(DVec3::NEG_Z);
    (world.translation, direction.as_vec3())
}

/// Orientation and position of a node without its scale, for cameras.
pub(super) fn rigid(world: DAffine3) -> DAffine3 {
    let back = world.matrix3.z_axis.try_normalize().unwrap_or(DVec3::Z);
    let up = world.matrix3.y_axis.reject_from_normalized(back).try_normalize();
    let up = up.unwrap_or_else(|| back.any_orthonormal_vector());
    DAffine3::from_mat3_translation(DMat3::from_cols(up.cross(back), up, back), world.translation)
}
