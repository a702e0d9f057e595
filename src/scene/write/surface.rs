//! Meshes as glTF JSON: primitives, skin weights and morph targets. Second sides are left out.

use super::{Document, FLOAT, VERTICES};
use crate::scene::deform::{Bind, Deform, Displacement, Influence};
use crate::scene::{Mesh, Primitive, Scene, Vertex};
use glam::{Vec2, Vec3};
use serde_json::{Map, Value, json};
use std::collections::BTreeSet;

/// Most joints per vertex; the loader reads as many.
const MOST_INFLUENCES: usize = 64;

/// A mesh. Fails if glTF cannot represent its deformation.
pub(super) fn mesh(document: &mut Document, scene: &Scene, mesh: &Mesh) -> Result<Value, String> {
    let (flat, mesh) = (flat(mesh)?, &fronts(scene, mesh));
    let mut primitives = Vec::new();
    for run in mesh.primitives.iter().flat_map(|run| alike(mesh, *run, &flat)) {
        primitives.push(primitive(document, mesh, run, &flat)?);
    }
    Ok(json!({ "name": mesh.name, "primitives": primitives }))
}

/// By vertex, whether its normal is that of its triangle in every pose.
fn flat(mesh: &Mesh) -> Result<Vec<bool>, String> {
    let mut flat = vec![false; mesh.vertices.len()];
    let Some(deform) = &mesh.deform else { return Ok(flat) };
    let divided =
        || format!("mesh '{}' deforms and has subdivided triangles; write the scene before subdivision", mesh.name);
    if deform.bind.len() != mesh.vertices.len() {
        return Err(divided());
    }
    for follower in &deform.followers {
        let corner = follower.corners.iter().position(|&corner| corner == follower.vertex);
        let weights = corner.map(|corner| [f32::from(corner == 1), f32::from(corner == 2)]);
        if follower.flat != 1 || weights != Some(follower.weights) {
            return Err(divided());
        }
        flat[follower.vertex as usize] = true;
    }
    Ok(flat)
}

/// The parts of a run that are flat throughout, or nowhere flat.
fn alike(mesh: &Mesh, run: Primitive, flat: &[bool]) -> Vec<Primitive> {
    let indices = &mesh.indices[run.first_index as usize..(run.first_index + run.index_count) as usize];
    let mut parts = Vec::new();
    let mut first_index = run.first_index;
    let is_flat = |triangle: &[u32]| triangle.iter().all(|&corner| flat[corner as usize]);
    let triangles: Vec<&[u32]> = indices.chunks_exact(3).collect();
    for part in triangles.chunk_by(|a, b| is_flat(a) == is_flat(b)) {
        let index_count = 3 * part.len() as u32;
        parts.push(Primitive { first_index, index_count, ..run });
        first_index += index_count;
    }
    parts
}

/// A mesh without the second sides of double-sided materials, each of which follows its front.
fn fronts(scene: &Scene, mesh: &Mesh) -> Mesh {
    let (mut indices, mut primitives) = (Vec::new(), Vec::new());
    for run in &mesh.primitives {
        let range = run.first_index as usize..(run.first_index + run.index_count) as usize;
        let (triangles, _) = mesh.indices[range].as_chunks::<3>();
        let has_backs = scene.materials[run.material].double_sided
            && triangles.chunks(2).all(|pair| pair.len() == 2 && mesh.are_twins(pair[0], pair[1]));
        let first_index = indices.len() as u32;
        indices.extend(triangles.iter().step_by(if has_backs { 2 } else { 1 }).flatten());
        primitives.push(Primitive { first_index, index_count: indices.len() as u32 - first_index, ..*run });
    }
    primitives.retain(|run| run.index_count > 0);
    Mesh { indices, primitives, ..mesh.clone() }
}

/// A primitive with its own vertices: those it uses, in their order. For a deforming mesh they are undeformed.
fn primitive(document: &mut Document, mesh: &Mesh, run: Primitive, flat: &[bool]) -> Result<Value, String> {
    let indices = &mesh.indices[run.first_index as usize..(run.first_index + run.index_count) as usize];
    let used: Vec<u32> = indices.iter().copied().collect::<BTreeSet<_>>().into_iter().collect();
    let vertex = |&index: &u32| {
        let vertex = mesh.vertices[index as usize];
        let bind = mesh.deform.as_ref().map(|deform| deform.bind[index as usize]);
        bind.map_or(vertex, |Bind { position, normal, tangent, .. }| Vertex { position, normal, tangent, ..vertex })
    };
    let vertices: Vec<Vertex> = used.iter().map(vertex).collect();
    let local = |index: &u32| used.binary_search(index).expect("collected above");
    let is_flat = flat[used[0] as usize];

    let count = vertices.len();
    let vec3 = |get: fn(&Vertex) -> Vec3| vertices.iter().map(get).collect::<Vec<_>>();
    let vec2 = |get: fn(&Vertex) -> Vec2| vertices.iter().map(get).collect::<Vec<_>>();
    let mut attributes = Map::new();
    attributes.insert("POSITION".into(), json!(positions(document, &vec3(|v| v.position))));
    let mut float = |document: &mut Document, name: &str, kind, data: &[u8]| {
        attributes.insert(name.into(), json!(document.accessor(data, VERTICES, FLOAT, kind, count)));
    };
    // glTF defines that a primitive without normals has flat triangle normals.
    if !is_flat {
        float(document, "NORMAL", "VEC3", bytemuck::cast_slice(&vec3(|v| v.normal)));
    }
    let has_tangents = !is_flat && vertices.iter().any(|v| v.tangent != [0.0; 4]);
    if has_tangents {
        let tangents: Vec<[f32; 4]> = vertices.iter().map(|v| v.tangent).collect();
        float(document, "TANGENT", "VEC4", bytemuck::cast_slice(&tangents));
    }
    let has_second = vertices.iter().any(|v| v.uv1 != Vec2::ZERO);
    if has_second || vertices.iter().any(|v| v.uv0 != Vec2::ZERO) {
        float(document, "TEXCOORD_0", "VEC2", bytemuck::cast_slice(&vec2(|v| v.uv0)));
    }
    if has_second {
        float(document, "TEXCOORD_1", "VEC2", bytemuck::cast_slice(&vec2(|v| v.uv1)));
    }
    if vertices.iter().any(|v| v.color != [255; 4]) {
        let colors: Vec<[u8; 4]> = vertices.iter().map(|v| v.color).collect();
        let accessor = document.accessor(bytemuck::cast_slice(&colors), VERTICES, 5121, "VEC4", count);
        document.accessors[accessor]["normalized"] = json!(true);
        attributes.insert("COLOR_0".into(), json!(accessor));
    }
    if let Some(deform) = mesh.deform.as_ref().filter(|deform| !deform.influences.is_empty()) {
        joints(document, &mut attributes, mesh, deform, &used)?;
    }

    // 65535 itself is the primitive restart index and not allowed.
    let index_accessor = if vertices.len() <= 65535 {
        let short: Vec<u16> = indices.iter().map(|index| local(index) as u16).collect();
        document.accessor(bytemuck::cast_slice(&short), 34963, 5123, "SCALAR", indices.len())
    } else {
        let long: Vec<u32> = indices.iter().map(|index| local(index) as u32).collect();
        document.accessor(bytemuck::cast_slice(&long), 34963, 5125, "SCALAR", indices.len())
    };
    let mut value = json!({ "attributes": attributes, "indices": index_accessor, "material": run.material });
    let targets: Vec<Value> = mesh
        .deform
        .iter()
        .flat_map(|deform| &deform.targets)
        .map(|target| morph_target(document, target, &used, [!is_flat, has_tangents]))
        .collect();
    if !targets.is_empty() {
        value["targets"] = targets.into();
    }
    Ok(value)
}

/// An accessor of positions, with the bounds that glTF requires.
fn positions(document: &mut Document, positions: &[Vec3]) -> usize {
    let low = positions.iter().fold(Vec3::INFINITY, |low, p| low.min(*p));
    let high = positions.iter().fold(Vec3::NEG_INFINITY, |high, p| high.max(*p));
    let accessor = document.accessor(bytemuck::cast_slice(positions), VERTICES, FLOAT, "VEC3", positions.len());
    document.accessors[accessor]["min"] = json!(low.to_array());
    document.accessors[accessor]["max"] = json!(high.to_array());
    accessor
}

/// JOINTS_n and WEIGHTS_n, as many sets as the vertex with the most joints needs.
fn joints(
    document: &mut Document,
    attributes: &mut Map<String, Value>,
    mesh: &Mesh,
    deform: &Deform,
    used: &[u32],
) -> Result<(), String> {
    let influences = |&index: &u32| -> &[Influence] {
        let Bind { first_influence, influence_count, .. } = deform.bind[index as usize];
        &deform.influences[first_influence as usize..][..influence_count as usize]
    };
    let (mut most, mut highest) = (0, 0);
    for own in used.iter().map(influences) {
        if own.is_empty() {
            return Err(format!("mesh '{}' has vertices that no joint moves; give each a joint", mesh.name));
        }
        most = most.max(own.len());
        highest = own.iter().fold(highest, |highest, influence| highest.max(influence.joint));
    }
    if most > MOST_INFLUENCES || highest > u32::from(u16::MAX) {
        let limit = format!("the loader reads at most {MOST_INFLUENCES} and up to joint {}", u16::MAX);
        return Err(format!("mesh '{}' has {most} joints at a vertex, up to joint {highest}; {limit}", mesh.name));
    }
    for set in 0..most.div_ceil(4) {
        // Unused slots have weight 0 and, as glTF requires, joint 0.
        let at = |index: &u32| [0, 1, 2, 3].map(|k| influences(index).get(4 * set + k).copied().unwrap_or_default());
        let four: Vec<[Influence; 4]> = used.iter().map(at).collect();
        let accessor = if highest <= u32::from(u8::MAX) {
            let joints: Vec<[u8; 4]> = four.iter().map(|four| four.map(|i| i.joint as u8)).collect();
            document.accessor(bytemuck::cast_slice(&joints), VERTICES, 5121, "VEC4", used.len())
        } else {
            let joints: Vec<[u16; 4]> = four.iter().map(|four| four.map(|i| i.joint as u16)).collect();
            document.accessor(bytemuck::cast_slice(&joints), VERTICES, 5123, "VEC4", used.len())
        };
        attributes.insert(format!("JOINTS_{set}"), json!(accessor));
        let weights: Vec<[f32; 4]> = four.iter().map(|four| four.map(|i| i.weight)).collect();
        let accessor = document.accessor(bytemuck::cast_slice(&weights), VERTICES, FLOAT, "VEC4", used.len());
        attributes.insert(format!("WEIGHTS_{set}"), json!(accessor));
    }
    Ok(())
}

/// A morph target. Normals and tangents are written only if the primitive has them and the target changes them.
fn morph_target(
    document: &mut Document,
    target: &[Displacement],
    used: &[u32],
    [normals, tangents]: [bool; 2],
) -> Value {
    let of = |get: fn(&Displacement) -> Vec3| used.iter().map(|&i| get(&target[i as usize])).collect::<Vec<_>>();
    let mut value = json!({ "POSITION": positions(document, &of(|d| d.position)) });
    for (name, is_there, moved) in [("NORMAL", normals, of(|d| d.normal)), ("TANGENT", tangents, of(|d| d.tangent))] {
        if is_there && moved.iter().any(|moved| *moved != Vec3::ZERO) {
            let data = bytemuck::cast_slice(&moved);
            value[name] = json!(document.accessor(data, VERTICES, FLOAT, "VEC3", used.len()));
        }
    }
    value
}
