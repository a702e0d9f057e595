//! Morph targets and skins at rest.

use glam::{DAffine3, DMat3, DVec3, Vec3};

use super::Notes;
use crate::Result;
use crate::scene::Vertex;
use crate::scene::accessor::{Accessor, Accessors, Semantic};
use crate::scene::animation::Skin;
use crate::scene::deform::{Displacement, Influence};
use crate::scene::json::{Document, Object, plural};

/// Pose applied to a mesh at load time.
pub(super) struct Pose {
    /// Weight of each morph target; empty for none.
    pub weights: Vec<f64>,
    /// For skinned meshes, each joint's model-to-world matrix, including the inverse bind matrix.
    pub joints: Option<Vec<DAffine3>>,
}

/// A skin: its joints and their inverse bind matrices.
pub(super) fn read_skin(document: &Document, accessors: &Accessors, skin: &Object) -> Result<Skin> {
    let joints = skin.indices("joints")?;
    if joints.is_empty() {
        return Err(skin.error("has no joints: export the file again"));
    }
    let matrices = match skin.index("inverseBindMatrices")? {
        Some(index) => {
            let role = format!("inverseBindMatrices of {}", skin.place);
            let accessor = accessors.open(index, &role, Semantic::Matrices, skin)?;
            if accessor.count < joints.len() {
                let joints = plural(joints.len(), "joint");
                return Err(
                    accessor.error(format!("has {} elements for {joints}: export the file again", accessor.count))
                );
            }
            Some(accessor)
        }
        None => None,
    };
    let mut inverse_bind = Vec::with_capacity(joints.len());
    for (at, &node) in joints.iter().enumerate() {
        document.item("nodes", node, skin)?;
        inverse_bind.push(match &matrices {
            Some(accessor) => {
                let m = accessor.floats::<16>(at).map(f64::from);
                if m.iter().any(|x| !x.is_finite()) {
                    return Err(accessor.error(format!("element {at} is not finite: export the file again")));
                }
                // The fourth row is 0 0 0 1 up to rounding.
                let column = |c: usize| DVec3::new(m[4 * c], m[4 * c + 1], m[4 * c + 2]);
                DAffine3::from_cols(column(0), column(1), column(2), column(3))
            }
            None => DAffine3::IDENTITY,
        });
    }
    Ok(Skin { joints, inverse_bind })
}

/// The joint matrices of a skin, given all nodes' world transforms.
pub(super) fn joints(skin: &Skin, worlds: &[DAffine3]) -> Vec<DAffine3> {
    skin.joints.iter().zip(&skin.inverse_bind).map(|(&node, bind)| worlds[node] * *bind).collect()
}

/// Fails if the number of weights differs from that of a primitive's morph targets.
pub(super) fn check_weights(primitive: &Object, weights: &[f64]) -> Result<()> {
    let targets = primitive.objects("targets", "morph target")?.len();
    if weights.is_empty() || weights.len() == targets {
        return Ok(());
    }
    Err(primitive.error(format!(
        "has {} for {}: export the file again",
        plural(targets, "morph target"),
        plural(weights.len(), "weight")
    )))
}

/// Adds the weighted morph targets to the vertices `used` of `count`.
pub(super) fn morph(
    vertices: &mut [Vertex],
    used: &[u32],
    count: usize,
    targets: &[Object],
    pose: &Pose,
    accessors: &Accessors,
    mesh: &str,
) -> Result<()> {
    for (at, target) in targets.iter().enumerate() {
        let weight = pose.weights.get(at).copied().unwrap_or(0.0) as f32;
        let attributes =
            [("POSITION", Semantic::Position), ("NORMAL", Semantic::Displacement), ("TANGENT", Semantic::Displacement)];
        for (name, semantic) in attributes {
            let Some(index) = target.index(name)? else { continue };
            let accessor = accessors.open(index, &format!("morph target {at} {name} of {mesh}"), semantic, target)?;
            accessor.check_count(count)?;
            if weight == 0.0 {
                continue;
            }
            for (vertex, &index) in vertices.iter_mut().zip(used) {
                let delta = weight * Vec3::from(accessor.floats::<3>(index as usize));
                if !delta.is_finite() {
                    return Err(accessor.error(format!("element {index} is not finite: export the file again")));
                }
                match name {
                    "POSITION" => vertex.position += delta,
                    "NORMAL" => vertex.normal += delta,
                    _ => {
                        let [x, y, z, w] = vertex.tangent;
                        vertex.tangent = (Vec3::new(x, y, z) + delta).extend(w).into();
                    }
                }
            }
        }
    }
    Ok(())
}

/// Displacements of the vertices `used` of `count`, by morph target.
pub(super) fn displacements(
    used: &[u32],
    count: usize,
    targets: &[Object],
    accessors: &Accessors,
    mesh: &str,
) -> Result<Vec<Vec<Displacement>>> {
    let read = |(at, target): (usize, &Object)| -> Result<Vec<Displacement>> {
        let open = |name: &str, semantic| -> Result<Option<Accessor>> {
            let Some(index) = target.index(name)? else { return Ok(None) };
            let accessor = accessors.open(index, &format!("morph target {at} {name} of {mesh}"), semantic, target)?;
            accessor.check_count(count)?;
            Ok(Some(accessor))
        };
        let positions = open("POSITION", Semantic::Position)?;
        let normals = open("NORMAL", Semantic::Displacement)?;
        let tangents = open("TANGENT", Semantic::Displacement)?;
        let element = |accessor: &Option<Accessor>, index: u32| -> Result<Vec3> {
            let Some(accessor) = accessor else { return Ok(Vec3::ZERO) };
            let element = Vec3::from(accessor.floats::<3>(index as usize));
            if !element.is_finite() {
                return Err(accessor.error(format!("element {index} is not finite: export the file again")));
            }
            Ok(element)
        };
        let displacement = |&index: &u32| -> Result<Displacement> {
            Ok(Displacement {
                position: element(&positions, index)?,
                normal: element(&normals, index)?,
                tangent: element(&tangents, index)?,
            })
        };
        used.iter().map(displacement).collect()
    };
    targets.iter().enumerate().map(read).collect()
}

/// Most pairs of JOINTS_n and WEIGHTS_n.
const MOST_SETS: usize = 16;

/// JOINTS_n and WEIGHTS_n of a primitive of `count` vertices.
struct Sets<'a> {
    sets: Vec<(Accessor<'a>, Accessor<'a>)>,
}

impl<'a> Sets<'a> {
    fn open(count: usize, attributes: &Object, accessors: &Accessors<'a>, mesh: &str) -> Result<Self> {
        let open = |name: &str, semantic| -> Result<Option<Accessor<'a>>> {
            let Some(index) = attributes.index(name)? else { return Ok(None) };
            let accessor = accessors.open(index, &format!("{name} of {mesh}"), semantic, attributes)?;
            accessor.check_count(count)?;
            Ok(Some(accessor))
        };
        let mut sets = Vec::new();
        for set in 0.. {
            if set == MOST_SETS {
                return Err(attributes.error(format!("has more than {MOST_SETS} sets of joints; simplify it")));
            }
            let indices = open(&format!("JOINTS_{set}"), Semantic::Joints)?;
            let weights = open(&format!("WEIGHTS_{set}"), Semantic::Weights)?;
            match (indices, weights) {
                (Some(indices), Some(weights)) => sets.push((indices, weights)),
                (None, None) if set > 0 => break,
                _ => {
                    return Err(attributes.error(format!(
                        "belongs to a skinned node but lacks JOINTS_{set} or WEIGHTS_{set}: export the file again"
                    )));
                }
            }
        }
        Ok(Self { sets })
    }

    /// Calls `each` with the joints that move a vertex and their weights, which are above 0. Joints must be below
    /// `joints`.
    fn influences(&self, index: u32, joints: usize, mut each: impl FnMut(u32, f32)) -> Result<()> {
        for (indices, weights) in &self.sets {
            let influences = indices.integers::<4>(index as usize).into_iter().zip(weights.floats::<4>(index as usize));
            for (joint, weight) in influences.filter(|(_, weight)| *weight != 0.0) {
                if !(weight > 0.0 && weight.is_finite()) {
                    return Err(
                        weights.error(format!("element {index} has the weight {weight}: export the file again"))
                    );
                }
                if joint as usize >= joints {
                    let joints = plural(joints, "joint");
                    return Err(indices.error(format!(
                        "element {index} is {joint}, but the skin has {joints}: export the file again"
                    )));
                }
                each(joint, weight);
            }
        }
        Ok(())
    }
}

/// The influences of the vertices `used` of `count`, and by vertex the first influence and their number. The weights of
/// a vertex sum to 1.
pub(super) fn influences(
    used: &[u32],
    count: usize,
    attributes: &Object,
    joints: usize,
    accessors: &Accessors,
    mesh: &str,
    notes: &mut Notes,
) -> Result<(Vec<Influence>, Vec<[u32; 2]>)> {
    let sets = Sets::open(count, attributes, accessors, mesh)?;
    let mut influences: Vec<Influence> = Vec::with_capacity(4 * used.len());
    let mut ranges = Vec::with_capacity(used.len());
    for &index in used {
        let first = influences.len();
        sets.influences(index, joints, |joint, weight| influences.push(Influence { joint, weight }))?;
        let sum: f64 = influences[first..].iter().map(|influence| f64::from(influence.weight)).sum();
        for influence in &mut influences[first..] {
            influence.weight = (f64::from(influence.weight) / sum) as f32;
        }
        if influences.len() == first {
            notes.count(WITHOUT_WEIGHTS, 1);
            influences.push(Influence { joint: 0, weight: 1.0 });
        }
        ranges.push([first as u32, (influences.len() - first) as u32]);
    }
    Ok((influences, ranges))
}

const WITHOUT_WEIGHTS: &str = "Vertices without skin weights moved with the skin's first joint";

/// Moves the vertices `used` of `count` with their joints; returns for each whether it was mirrored.
#[expect(clippy::too_many_arguments, reason = "the primitive's parts, and where to report")]
pub(super) fn skin(
    vertices: &mut [Vertex],
    used: &[u32],
    count: usize,
    attributes: &Object,
    joints: &[DAffine3],
    accessors: &Accessors,
    mesh: &str,
    notes: &mut Notes,
) -> Result<Vec<bool>> {
    let sets = Sets::open(count, attributes, accessors, mesh)?;
    let mut mirrored = Vec::with_capacity(used.len());
    for (vertex, &index) in vertices.iter_mut().zip(used) {
        let (mut linear, mut translation, mut sum) = (DMat3::ZERO, DVec3::ZERO, 0.0);
        sets.influences(index, joints.len(), |joint, weight| {
            let (matrix, weight) = (&joints[joint as usize], f64::from(weight));
            linear += matrix.matrix3 * weight;
            translation += matrix.translation * weight;
            sum += weight;
        })?;
        let blend = if sum > 0.0 {
            DAffine3 { matrix3: linear * (1.0 / sum), translation: translation / sum }
        } else {
            notes.count(WITHOUT_WEIGHTS, 1);
            joints[0]
        };
        let m = blend.matrix3;
        let side = if m.determinant() < 0.0 { -1.0 } else { 1.0 };
        // Cofactors: the inverse transpose without a division, so that a flattened joint needs no special case.
        let cofactors =
            DMat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis)) * side;
        let [x, y, z, w] = vertex.tangent;
        vertex.position = blend.transform_point3(vertex.position.as_dvec3()).as_vec3();
        vertex.normal = direction(cofactors * vertex.normal.as_dvec3());
        let tangent = direction(m * DVec3::new(f64::from(x), f64::from(y), f64::from(z)));
        // For a tangent without length the sign marks the side; mirroring does not change it.
        vertex.tangent = tangent.extend(if tangent == Vec3::ZERO { w } else { w * side as f32 }).into();
        mirrored.push(side < 0.0);
    }
    Ok(mirrored)
}

/// The unit vector in single precision, normalised in f64; zero for a zero vector.
fn direction(v: DVec3) -> Vec3 {
    v.try_normalize().unwrap_or(DVec3::ZERO).as_vec3()
}
