//! Data for posing deformed meshes. METHOD 8.

use crate::error::{Error, Result};
use crate::gpu::{Buffer, Device};
use crate::scene::Scene;
use crate::scene::deform::Deform;
use crate::shared::{BindVertex, Body, BodyBlock, DEFORM_ROW, Displacement, Follower, Influence, Joint, VERTEX_WORDS};

/// Vertices, or followers, per workgroup.
const GROUP: u32 = 64;

const _: () = assert!(size_of::<crate::scene::Vertex>() == 4 * VERTEX_WORDS as usize);

/// Data for posing, on the device.
pub struct DeformBuffers {
    /// Joints of all bodies.
    pub(in crate::frame) joints: Buffer,
    /// Morph target weights of all bodies.
    pub(in crate::frame) weights: Buffer,
    pub(in crate::frame) bodies: Buffer,
    pub(in crate::frame) bind: Buffer,
    pub(in crate::frame) influences: Buffer,
    pub(in crate::frame) displacements: Buffer,
    pub(in crate::frame) followers: Buffer,
    pub(in crate::frame) bind_blocks: Blocks,
    pub(in crate::frame) follower_blocks: Blocks,
}

/// Workgroups of a pass.
pub(in crate::frame) struct Blocks {
    pub(in crate::frame) buffer: Buffer,
    pub(in crate::frame) count: u32,
}

impl DeformBuffers {
    /// Uploads the data of all deformed instances. `first_vertices` gives the first posed vertex of each. `None` if no
    /// instance is deformed.
    pub(super) fn new(gpu: &Device, scene: &Scene, first_vertices: &[Option<u32>]) -> Result<Option<Self>> {
        if first_vertices.iter().all(Option::is_none) {
            return Ok(None);
        }
        let (mut bind, mut influences, mut displacements, mut followers) = (vec![], vec![], vec![], vec![]);
        // First bind vertex, displacement and follower of each mesh.
        let firsts: Vec<Option<[u32; 3]>> = scene
            .meshes
            .iter()
            .map(|mesh| {
                let deform = mesh.deform.as_ref()?;
                let firsts = [bind.len() as u32, displacements.len() as u32, followers.len() as u32];
                let first_influence = influences.len() as u32;
                bind.extend(deform.bind.iter().map(|v| BindVertex {
                    position: v.position,
                    normal: v.normal,
                    tangent: v.tangent.into(),
                    first_influence: first_influence + v.first_influence,
                    influence_count: v.influence_count,
                }));
                influences.extend(deform.influences.iter().map(|i| Influence { joint: i.joint, weight: i.weight }));
                displacements.extend(deform.targets.iter().flatten().map(|d| Displacement {
                    position: d.position,
                    normal: d.normal,
                    tangent: d.tangent,
                }));
                followers.extend(deform.followers.iter().map(|f| Follower {
                    vertex: f.vertex,
                    a: f.corners[0],
                    b: f.corners[1],
                    c: f.corners[2],
                    weights: f.weights.into(),
                    is_flat: f.flat,
                }));
                Some(firsts)
            })
            .collect();
        let (mut bodies, mut bind_blocks, mut follower_blocks) = (vec![], vec![], vec![]);
        let (mut joints, mut weights) = (0_u32, 0_u32);
        for (instance, first_vertex) in scene.instances.iter().zip(first_vertices) {
            let Some(first_vertex) = *first_vertex else { continue };
            let deform = scene.meshes[instance.mesh].deform.as_ref().expect("bends");
            let [first_bind, first_displacement, first_follower] = firsts[instance.mesh].expect("bends");
            let body = bodies.len() as u32;
            let (bind_count, follower_count) = (deform.bind.len() as u32, deform.followers.len() as u32);
            bodies.push(Body {
                first_bind,
                bind_count,
                first_vertex,
                first_follower,
                follower_count,
                first_displacement,
                target_count: deform.targets.len() as u32,
                first_joint: joints,
                first_weight: weights,
            });
            let (joint_count, weight_count) = sizes(deform);
            joints += joint_count;
            weights += weight_count;
            let blocks = |count: u32| (0..count).step_by(GROUP as usize).map(move |first| BodyBlock { body, first });
            bind_blocks.extend(blocks(bind_count));
            follower_blocks.extend(blocks(follower_count));
        }
        let blocks = |name: &str, all: &[BodyBlock]| -> Result<Blocks> {
            let count = u32::try_from(all.len()).ok().filter(|n| *n <= DEFORM_ROW * 65_535);
            let count = count.ok_or_else(|| Error::TooLarge("deformed instances have too many vertices".into()))?;
            Ok(Blocks { buffer: gpu.buffer_from(name, all)?, count })
        };
        Ok(Some(Self {
            joints: gpu.buffer("deform.joints", u64::from(joints.max(1)) * size_of::<Joint>() as u64)?,
            weights: gpu.buffer("deform.weights", 4 * u64::from(weights.max(1)))?,
            bodies: gpu.buffer_from("deform.bodies", &bodies)?,
            bind: gpu.buffer_from("deform.bind", &bind)?,
            influences: gpu.buffer_from("deform.influences", &influences)?,
            displacements: gpu.buffer_from("deform.displacements", &displacements)?,
            followers: gpu.buffer_from("deform.followers", &followers)?,
            bind_blocks: blocks("deform.bind_blocks", &bind_blocks)?,
            follower_blocks: blocks("deform.follower_blocks", &follower_blocks)?,
        }))
    }
}

/// Number of joints and weights in a pose of this mesh.
pub(super) fn sizes(deform: &Deform) -> (u32, u32) {
    let joints = deform.influences.iter().map(|i| i.joint + 1).max().unwrap_or(0);
    (joints, deform.targets.len() as u32)
}
