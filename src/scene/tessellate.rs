//! Subdivides triangles that are large compared to the spacing of caches, since light is interpolated per vertex.
//!
//! Whether an edge is halved depends only on its length, so both adjacent triangles agree and no crack opens.

mod carried;

use super::{Mesh, Primitive, Scene, Vertex};
use carried::Carried;
use glam::{DMat3, Vec4};
use std::collections::HashMap;

/// Rounds of halving; an edge more than a thousand times too long stays too long.
const ROUNDS: usize = 10;

/// Approximate limit on the triangles over all instances after subdivision.
const MOST_TRIANGLES: usize = 2_000_000;

/// Surface area [m^2 in world space] over all instances, as it is while caches are placed.
pub fn area(scene: &Scene) -> f64 {
    let triangle = |mesh: &Mesh, linear: DMat3, t: usize| {
        let [a, b, c] = mesh.triangle(t).map(|i| mesh.placing_at(i).as_dvec3());
        0.5 * (linear * (b - a)).cross(linear * (c - a)).length()
    };
    let instance = |i: &super::Instance| {
        let mesh = &scene.meshes[i.mesh];
        (0..mesh.triangle_count()).map(|t| triangle(mesh, i.stretch(), t)).filter(|a| a.is_finite()).sum::<f64>()
    };
    scene.instances.iter().map(instance).sum()
}

/// Expected distance \[m\] between caches for a given count: the bake needs about five caches per square of their
/// spacing.
pub fn expected_spacing(scene: &Scene, caches: usize) -> f64 {
    (5.0 * area(scene) / caches.max(1) as f64).sqrt()
}

/// Triangles over all instances per cache that subdivision may reach regardless of the original number. An evenly
/// divided surface needs about fifteen.
const TRIANGLES_PER_CACHE: f64 = 64.0;

/// Subdivides for caches `spacing` \[m\] apart. No edge may be longer than a quarter of the spacing or, if given, than
/// `max_edge` \[m\]; 0 leaves the scene unchanged. Stops at about two million triangles over all instances.
pub fn divide(scene: &mut Scene, spacing: f64, max_edge: Option<f64>) {
    if max_edge == Some(0.0) {
        return;
    }
    let longest = longest(scene, max_edge.unwrap_or(0.25 * spacing));
    let most = MOST_TRIANGLES.max(2 * scene.triangle_count());
    if !divide_whole(scene, longest, most) {
        part(scene);
        let added = tessellate(scene, longest, most);
        log::warn!(
            "{}: {added} triangles added by halving edges; some edges stay longer than {longest:.4} m (triangle limit)",
            scene.name
        );
    }
}

/// Subdivides for caches `spacing` \[m\] apart if that is cheap: over all instances the scene then has at most twice
/// its triangles, or few per cache. Otherwise leaves the scene unchanged and returns `false`: light is better
/// interpolated per pixel.
pub fn divide_if_few(scene: &mut Scene, spacing: f64) -> bool {
    let longest = longest(scene, 0.25 * spacing);
    let caches = 5.0 * area(scene) / (spacing * spacing);
    let few = (TRIANGLES_PER_CACHE * caches).min(MOST_TRIANGLES as f64) as usize;
    divide_whole(scene, longest, few.max(2 * scene.triangle_count()))
}

/// The longest edge \[m\] to keep, limited for very fine requests: halving leaves about two triangles per square of the
/// longest edge.
fn longest(scene: &Scene, asked: f64) -> f64 {
    asked.max((2.0 * area(scene) / MOST_TRIANGLES as f64).sqrt())
}

/// Halves all edges longer than `longest` [m in world space]. If the scene would exceed `most` triangles, retries with
/// separate meshes for small and large instances. If that also exceeds the limit, leaves the scene unchanged.
fn divide_whole(scene: &mut Scene, longest: f64, most: usize) -> bool {
    let (meshes, instances) = (scene.meshes.clone(), scene.instances.clone());
    let (mut added, mut whole) = halve_all(scene, longest, most, true);
    if !whole {
        scene.meshes.clone_from(&meshes);
        if part(scene) {
            (added, whole) = halve_all(scene, longest, most, true);
        }
    }
    if whole {
        log::info!("{added} triangles added by halving edges longer than {longest:.4} m");
    } else {
        (scene.meshes, scene.instances) = (meshes, instances);
    }
    whole
}

/// Gives instances whose sizes differ by more than about a factor of two separate meshes, so that small ones are not
/// subdivided for large ones. Returns whether any mesh was copied.
fn part(scene: &mut Scene) -> bool {
    let size = |stretch: DMat3| {
        let longest = [stretch.x_axis, stretch.y_axis, stretch.z_axis].map(|axis| axis.length()).into_iter();
        longest.fold(0.0, f64::max).max(f64::MIN_POSITIVE).log2().round() as i32
    };
    let before = scene.meshes.len();
    let mut own: HashMap<(usize, i32), usize> = HashMap::new();
    let mut taken = vec![false; before];
    for instance in &mut scene.instances {
        let (mesh, size) = (instance.mesh, size(instance.stretch()));
        instance.mesh = *own.entry((mesh, size)).or_insert_with(|| {
            if !std::mem::replace(&mut taken[mesh], true) {
                return mesh;
            }
            scene.meshes.push(scene.meshes[mesh].clone());
            scene.meshes.len() - 1
        });
    }
    scene.meshes.len() > before
}

/// Halves edges longer than `longest` [m in world space] until none is left, or until the scene would exceed `most`
/// triangles over all instances. Returns the number of triangles added to meshes.
pub fn tessellate(scene: &mut Scene, longest: f64, most: usize) -> usize {
    halve_all(scene, longest, most, false).0
}

/// As [`tessellate`]; also returns whether `most` was enough. With `all_or_nothing` it stops as soon as it is not.
fn halve_all(scene: &mut Scene, longest: f64, most: usize, all_or_nothing: bool) -> (usize, bool) {
    // Instances that differ only by rotation have the same metric.
    let mut metrics: Vec<Vec<DMat3>> = vec![Vec::new(); scene.meshes.len()];
    let mut shared = vec![0; scene.meshes.len()];
    for instance in &scene.instances {
        let linear = instance.stretch();
        let metric = linear.transpose() * linear;
        let size = metric.to_cols_array().iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        let metrics = &mut metrics[instance.mesh];
        if !metrics.iter().any(|m| m.abs_diff_eq(metric, 1e-3 * size)) {
            metrics.push(metric);
        }
        shared[instance.mesh] += 1;
    }
    let before: Vec<usize> = scene.meshes.iter().map(Mesh::triangle_count).collect();
    let (mut total, mut whole) = (scene.triangle_count(), true);
    let mut open: Vec<usize> = (0..scene.meshes.len()).collect();
    for _ in 0..ROUNDS {
        open.retain(|&index| {
            let mesh = &mut scene.meshes[index];
            let Some(finer) = halve(mesh, &metrics[index], longest * longest) else {
                return false;
            };
            let more = shared[index] * (finer.triangle_count() - mesh.triangle_count());
            if total + more > most {
                whole = false;
                return false;
            }
            total += more;
            *mesh = finer;
            true
        });
        if all_or_nothing && !whole {
            break;
        }
    }
    let mut added = 0;
    for (mesh, before) in scene.meshes.iter_mut().zip(before).filter(|(mesh, before)| mesh.triangle_count() > *before) {
        carried::settle(mesh);
        added += mesh.triangle_count() - before;
    }
    (added, whole)
}

/// The mesh with every edge whose squared length exceeds `longest2` halved; `None` if there is none.
fn halve(mesh: &Mesh, metrics: &[DMat3], longest2: f64) -> Option<Mesh> {
    let is_long = |a: u32, b: u32| {
        let d = (mesh.placing_at(a as usize) - mesh.placing_at(b as usize)).as_dvec3();
        metrics.iter().any(|m| d.dot(*m * d) > longest2)
    };
    let mut vertices = mesh.vertices.clone();
    let (mut deform, mut placing) = (mesh.deform.clone(), mesh.placing.clone());
    let carried = deform.as_ref().map(Carried::new);
    let mut middles: HashMap<(u32, u32), u32> = HashMap::new();
    let mut middle = |a: u32, b: u32, triangle: &[u32]| {
        is_long(a, b).then(|| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                let new = vertices.len() as u32;
                vertices.push(between(&mesh.vertices[a as usize], &mesh.vertices[b as usize]));
                if let Some(placing) = &mut placing {
                    placing.push((placing[a as usize] + placing[b as usize]) * 0.5);
                }
                if let (Some(deform), Some(carried)) = (&mut deform, &carried) {
                    deform.followers.push(carried.middle(new, [a, b], triangle));
                }
                new
            })
        })
    };
    let mut indices = Vec::with_capacity(2 * mesh.indices.len());
    let mut primitives = Vec::with_capacity(mesh.primitives.len());
    for primitive in &mesh.primitives {
        let first = indices.len();
        let range = primitive.first_index as usize..(primitive.first_index + primitive.index_count) as usize;
        let (triangles, _) = mesh.indices[range].as_chunks::<3>();
        let mut divided = |of: &[u32; 3], [a, b, c]: [u32; 3]| {
            pieces([a, b, c], [middle(a, b, of), middle(b, c, of), middle(c, a, of)])
        };
        let mut at = 0;
        while at < triangles.len() {
            let corners = triangles[at];
            let front = divided(&corners, corners);
            match triangles.get(at + 1).filter(|next| mesh.are_twins(corners, **next)) {
                // Both sides get the same pieces, each behind its own front.
                Some(&[a, c, b]) => {
                    let back = divided(&[a, c, b], [a, b, c]);
                    for (front, [a, b, c]) in front.into_iter().zip(back) {
                        indices.extend(front);
                        indices.extend([a, c, b]);
                    }
                    at += 2;
                }
                None => {
                    indices.extend(front.into_iter().flatten());
                    at += 1;
                }
            }
        }
        let (first_index, index_count) = (first as u32, (indices.len() - first) as u32);
        primitives.push(Primitive { first_index, index_count, ..*primitive });
    }
    (!middles.is_empty()).then(|| Mesh { name: mesh.name.clone(), vertices, indices, primitives, deform, placing })
}

/// The pieces of a triangle whose edges have these middles, if any.
fn pieces([a, b, c]: [u32; 3], middles: [Option<u32>; 3]) -> Vec<[u32; 3]> {
    match middles {
        [None, None, None] => vec![[a, b, c]],
        [Some(m), None, None] => vec![[a, m, c], [m, b, c]],
        [None, Some(m), None] => vec![[b, m, a], [m, c, a]],
        [None, None, Some(m)] => vec![[c, m, b], [m, a, b]],
        [Some(m), Some(n), None] => vec![[m, b, n], [a, m, n], [a, n, c]],
        [None, Some(m), Some(n)] => vec![[m, c, n], [b, m, n], [b, n, a]],
        [Some(n), None, Some(m)] => vec![[m, a, n], [c, m, n], [c, n, b]],
        [Some(m), Some(n), Some(o)] => vec![[a, m, o], [m, b, n], [o, n, c], [m, n, o]],
    }
}

/// The vertex halfway between two others.
fn between(a: &Vertex, b: &Vertex) -> Vertex {
    let tangent = (Vec4::from_array(a.tangent).truncate() + Vec4::from_array(b.tangent).truncate()).normalize_or_zero();
    let color = std::array::from_fn(|i| ((u16::from(a.color[i]) + u16::from(b.color[i])).div_ceil(2)) as u8);
    Vertex {
        position: (a.position + b.position) * 0.5,
        normal: (a.normal + b.normal).try_normalize().unwrap_or(a.normal),
        tangent: tangent.extend(a.tangent[3]).to_array(),
        uv0: (a.uv0 + b.uv0) * 0.5,
        uv1: (a.uv1 + b.uv1) * 0.5,
        color,
    }
}
