//! Converts primitives to triangles: resolves strips and fans, applies poses, drops degenerate triangles, completes
//! normals, adds second sides.

use glam::{DVec3, Vec2, Vec3, Vec4};

use super::Notes;
use super::pose::{self, Pose};
use crate::Result;
use crate::image::decode;
use crate::scene::Vertex;
use crate::scene::accessor::{Accessor, Accessors, Semantic};
use crate::scene::json::Object;
use crate::scene::material::MOST_UV;

/// Limits on the vertices (4 GiB) and indices (1 GiB) of all meshes together, in addition to the memory limit. Any
/// number of primitives may share accessors, so a small file could request more than there is.
const MAX_VERTICES: usize = 1 << 26;
const MAX_INDICES: usize = 1 << 28;

/// A triangle is degenerate if twice its area is below this share of its longest edge squared.
const FLAT: f64 = 1e-10;

/// Triangles of one primitive; both sides if it is double-sided.
pub(super) struct Surface {
    /// Vertices that triangles refer to.
    pub vertices: Vec<Vertex>,
    /// Three per triangle.
    pub indices: Vec<u32>,
}

/// Reads primitives and counts their vertices and indices towards the limits.
pub(super) struct Geometry<'a> {
    pub accessors: &'a Accessors<'a>,
    pub vertices: usize,
    pub indices: usize,
}

/// A primitive before its normals are final.
pub(super) struct Draft {
    pub vertices: Vec<Vertex>,
    pub triangles: Vec<[u32; 3]>,
    pub has_normals: bool,
}

/// A primitive as the file stores it: its draft, its attributes, the indices of the draft's vertices, and the number of
/// vertices in the file.
pub(super) type Stored<'a> = (Draft, Object<'a>, Vec<u32>, usize);

impl Geometry<'_> {
    /// The triangles of a primitive of `mesh` ("mesh 0 'Wall'") in a pose; `None` if it draws none.
    pub(super) fn surface(
        &mut self,
        primitive: &Object,
        mesh: &str,
        pose: &Pose,
        double_sided: bool,
        notes: &mut Notes,
    ) -> Result<Option<Surface>> {
        let Some((mut draft, attributes, used, count)) = self.draft(primitive, mesh, double_sided, notes)? else {
            return Ok(None);
        };
        let targets = primitive.objects("targets", "morph target")?;
        pose::morph(&mut draft.vertices, &used, count, &targets, pose, self.accessors, mesh)?;
        if let Some(joints) = &pose.joints {
            let mirrored =
                pose::skin(&mut draft.vertices, &used, count, &attributes, joints, self.accessors, mesh, notes)?;
            for triangle in &mut draft.triangles {
                if triangle.iter().all(|&corner| mirrored[corner as usize]) {
                    triangle.swap(1, 2);
                }
            }
        }
        draft.drop_degenerate(notes);
        if draft.triangles.is_empty() {
            return Ok(None);
        }
        let mut surface = if draft.has_normals { draft.with_own_normals(notes) } else { draft.with_flat_normals() };
        if double_sided {
            self.take(surface.vertices.len(), surface.indices.len(), primitive)?;
            surface.add_back();
        }
        Ok(Some(surface))
    }

    /// A primitive as the file stores it; `None` if it draws no triangles.
    pub(super) fn draft<'o>(
        &mut self,
        primitive: &Object<'o>,
        mesh: &str,
        double_sided: bool,
        notes: &mut Notes,
    ) -> Result<Option<Stored<'o>>> {
        let mode = primitive.whole("mode")?.unwrap_or(4);
        if mode > 6 {
            return Err(primitive.error(format!("has the unknown mode {mode}: export the file again")));
        }
        if mode < 4 {
            notes.count("Primitives of points or lines left out", 1);
            return Ok(None);
        }
        let attributes = primitive
            .object("attributes")?
            .ok_or_else(|| primitive.error("has no attributes: export the file again"))?;
        let Some(index) = attributes.index("POSITION")? else {
            notes.count("Primitives without POSITION left out", 1);
            return Ok(None);
        };
        let positions = self.accessors.open(index, &format!("POSITION of {mesh}"), Semantic::Position, &attributes)?;

        let corners = match primitive.index("indices")? {
            Some(index) => {
                let indices =
                    self.accessors.open(index, &format!("indices of {mesh}"), Semantic::Indices, primitive)?;
                self.take(0, indices.count, primitive)?;
                indices.vertex_indices(positions.count)?
            }
            None => {
                self.take(0, positions.count, primitive)?;
                (0..positions.count as u32).collect()
            }
        };
        if mode == 4 && !corners.len().is_multiple_of(3) {
            notes.count("Incomplete last triangles left out", 1);
        }
        // A resolved strip or fan may have three times as many indices.
        self.take(0, if mode == 4 { 0 } else { 2 * corners.len() }, primitive)?;
        let triangles = triangulate(mode, &corners);
        let used = referenced(&corners, positions.count);
        drop(corners);

        let has_normals = attributes.value("NORMAL").is_some();
        self.take(if has_normals { used.len() } else { 3 * triangles.len() }, 0, primitive)?;
        let mut draft = Draft { vertices: Vec::new(), triangles, has_normals };
        if used.len() < positions.count {
            for corner in draft.triangles.iter_mut().flatten() {
                *corner = used.binary_search(corner).unwrap_or(0) as u32;
            }
        }
        draft.vertices = self.vertices(&attributes, mesh, &positions, &used, notes)?;
        if draft.has_normals && draft.is_inside_out(double_sided) {
            draft.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
            notes.count("Primitives turned over (their triangles faced against their normals)", 1);
        }
        Ok(Some((draft, attributes, used, positions.count)))
    }

    /// Counts vertices and indices towards the limits before they are created.
    pub(super) fn take(&mut self, vertices: usize, indices: usize, from: &Object) -> Result<()> {
        self.vertices = self.vertices.saturating_add(vertices);
        self.indices = self.indices.saturating_add(indices);
        if self.vertices > MAX_VERTICES || self.indices > MAX_INDICES {
            return Err(from.error(format!(
                "the scene exceeds {MAX_VERTICES} vertices or {MAX_INDICES} indices at this point; simplify it"
            )));
        }
        let bytes = (self.vertices * size_of::<Vertex>() + self.indices * size_of::<u32>()) as u64;
        let (needed, most) = (bytes.div_ceil(1 << 20), decode::max_memory().div_ceil(1 << 20));
        if needed > most {
            return Err(from.error(format!(
                "the scene's vertices and indices exceed {most} MiB of memory at this point; simplify it, or \
                 allow more with --max-memory"
            )));
        }
        Ok(())
    }

    /// The vertices `used`, as stored in the file.
    fn vertices(
        &self,
        attributes: &Object,
        mesh: &str,
        positions: &Accessor,
        used: &[u32],
        notes: &mut Notes,
    ) -> Result<Vec<Vertex>> {
        let open = |name: &str, semantic| -> Result<Option<Accessor>> {
            let Some(index) = attributes.index(name)? else { return Ok(None) };
            let accessor = self.accessors.open(index, &format!("{name} of {mesh}"), semantic, attributes)?;
            accessor.check_count(positions.count)?;
            Ok(Some(accessor))
        };
        let normals = open("NORMAL", Semantic::Normal)?;
        // glTF: without normals, tangents must be ignored. They are checked anyway.
        let tangents = open("TANGENT", Semantic::Tangent)?.filter(|_| normals.is_some());
        let coordinates = [open("TEXCOORD_0", Semantic::TexCoord)?, open("TEXCOORD_1", Semantic::TexCoord)?];
        let colors = open("COLOR_0", Semantic::Color)?;
        let mut vertices = Vec::with_capacity(used.len());
        for &index in used {
            let at = index as usize;
            let position = Vec3::from(positions.floats::<3>(at));
            if !position.is_finite() {
                return Err(positions.error(format!("element {at} is not finite: export the file again")));
            }
            let uv = coordinates.each_ref().map(|accessor| match accessor {
                Some(accessor) => {
                    let uv = Vec2::from(accessor.floats::<2>(at));
                    let sound = uv.abs().max_element() <= MOST_UV && uv.is_finite();
                    if !sound {
                        notes.count("Texture coordinates that are not finite or beyond a million set to zero", 1);
                    }
                    if sound { uv } else { Vec2::ZERO }
                }
                None => Vec2::ZERO,
            });
            let color = match &colors {
                Some(accessor) => {
                    let [r, g, b, a] = accessor.floats::<4>(at);
                    // The cast saturates and turns NaN into 0.
                    [r, g, b, if accessor.width == 3 { 1.0 } else { a }].map(|c| (c * 255.0 + 0.5) as u8)
                }
                None => [255; 4],
            };
            vertices.push(Vertex {
                position,
                normal: normals.as_ref().map_or(Vec3::ZERO, |a| a.floats::<3>(at).into()),
                tangent: tangents.as_ref().map_or([0.0; 4], |a| a.floats::<4>(at)),
                uv0: uv[0],
                uv1: uv[1],
                color,
            });
        }
        Ok(vertices)
    }
}

/// Vertex indices that occur, in increasing order.
fn referenced(corners: &[u32], vertices: usize) -> Vec<u32> {
    // Many small primitives over one large vertex buffer are common: avoid a pass over all vertices for each of them.
    if vertices / 8 > corners.len() {
        let mut used = corners.to_vec();
        used.sort_unstable();
        used.dedup();
        return used;
    }
    let mut occurs = vec![false; vertices];
    for &corner in corners {
        occurs[corner as usize] = true;
    }
    (0..vertices as u32).filter(|&v| occurs[v as usize]).collect()
}

/// Corners of the triangles of a list (4), strip (5) or fan (6), in glTF's order.
fn triangulate(mode: u64, corners: &[u32]) -> Vec<[u32; 3]> {
    match mode {
        4 => corners.as_chunks::<3>().0.to_vec(),
        5 => corners
            .windows(3)
            .enumerate()
            .map(|(i, c)| if i % 2 == 0 { [c[0], c[1], c[2]] } else { [c[0], c[2], c[1]] })
            .collect(),
        _ => match corners {
            [hub, rim @ ..] => rim.windows(2).map(|c| [c[0], c[1], *hub]).collect(),
            [] => Vec::new(),
        },
    }
}

impl Draft {
    fn corners(&self, triangle: [u32; 3]) -> [DVec3; 3] {
        triangle.map(|corner| self.vertices[corner as usize].position.as_dvec3())
    }

    /// Twice the triangle's area along its geometric normal.
    fn area_vector(&self, triangle: [u32; 3]) -> DVec3 {
        let [a, b, c] = self.corners(triangle);
        (b - a).cross(c - a)
    }

    /// Whether the triangles of a body face inwards although its normals face outwards. Seen as written, such a body
    /// shows the inside of its far side. Flat and open surfaces stay as written. Double-sided surfaces are always
    /// turned over: otherwise each side would be shaded with the normal of the other.
    fn is_inside_out(&self, double_sided: bool) -> bool {
        let finite = |v: DVec3| if v.is_finite() { v } else { DVec3::ZERO };
        let sum: DVec3 = self.vertices.iter().map(|v| finite(v.position.as_dvec3())).sum();
        let middle = sum / self.vertices.len().max(1) as f64;
        let (mut area, mut against, mut outwards, mut most) = (0.0, 0.0, 0.0, 0.0);
        for &triangle in &self.triangles {
            let facing = self.area_vector(triangle);
            if facing.is_finite() {
                let normal: DVec3 = triangle.iter().map(|&c| finite(self.vertices[c as usize].normal.as_dvec3())).sum();
                let from_middle = self.corners(triangle).iter().sum::<DVec3>() / 3.0 - middle;
                area += facing.length();
                against += if facing.dot(normal) < 0.0 { facing.length() } else { 0.0 };
                outwards += facing.dot(from_middle);
                most += facing.length() * from_middle.length();
            }
        }
        against > 0.99 * area && (double_sided || outwards < -0.1 * most)
    }

    fn drop_degenerate(&mut self, notes: &mut Notes) {
        let before = self.triangles.len();
        let triangles = std::mem::take(&mut self.triangles);
        self.triangles = triangles.into_iter().filter(|&triangle| !self.is_degenerate(triangle)).collect();
        notes.count("Degenerate triangles left out (no area or not finite)", before - self.triangles.len());
        // No triangle refers to these vertices any more, but they must not stay non-finite.
        for vertex in &mut self.vertices {
            if !vertex.position.is_finite() {
                vertex.position = Vec3::ZERO;
            }
        }
    }

    fn is_degenerate(&self, triangle: [u32; 3]) -> bool {
        let [a, b, c] = self.corners(triangle);
        let longest = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
        let area = self.area_vector(triangle).length();
        !area.is_finite() || area <= FLAT * longest
    }

    /// Drops triangles with repeated corners, which have no area in any pose.
    pub(super) fn drop_repeated(&mut self, notes: &mut Notes) {
        let before = self.triangles.len();
        self.triangles.retain(|&[a, b, c]| a != b && b != c && c != a);
        notes.count("Degenerate triangles left out (no area or not finite)", before - self.triangles.len());
    }

    /// Gives every triangle its own vertices with flat normals, as glTF requires without normals.
    pub(super) fn with_flat_normals(self) -> Surface {
        let mut vertices = Vec::with_capacity(3 * self.triangles.len());
        for &triangle in &self.triangles {
            let normal = self.area_vector(triangle).try_normalize().unwrap_or(DVec3::Y).as_vec3();
            vertices.extend(triangle.map(|c| Vertex { normal, tangent: [0.0; 4], ..self.vertices[c as usize] }));
        }
        let indices = (0..vertices.len() as u32).collect();
        Surface { vertices, indices }
    }

    /// Normalises normals and tangents, and replaces unusable normals by geometric ones.
    pub(super) fn with_own_normals(mut self, notes: &mut Notes) -> Surface {
        let unit = |v: Vec3| {
            let length = v.as_dvec3().length();
            (length.is_finite() && length > 0.0).then(|| (v.as_dvec3() / length).as_vec3())
        };
        let mut bad = vec![false; self.vertices.len()];
        for (vertex, bad) in self.vertices.iter_mut().zip(&mut bad) {
            *bad = unit(vertex.normal).is_none();
            vertex.normal = unit(vertex.normal).unwrap_or(Vec3::ZERO);
            let [x, y, z, w] = vertex.tangent;
            vertex.tangent = match unit(Vec3::new(x, y, z)) {
                Some(t) if !w.is_nan() => [t.x, t.y, t.z, if w < 0.0 { -1.0 } else { 1.0 }],
                _ => [0.0; 4],
            };
        }
        if bad.contains(&true) {
            let mut sums = vec![(DVec3::ZERO, DVec3::Y); self.vertices.len()];
            for &triangle in &self.triangles {
                let area = self.area_vector(triangle);
                for corner in triangle {
                    let (sum, last) = &mut sums[corner as usize];
                    *sum += area;
                    *last = area;
                }
            }
            for ((vertex, (sum, last)), _) in self.vertices.iter_mut().zip(sums).zip(&bad).filter(|(_, bad)| **bad) {
                // Normals of back-to-back triangles cancel: use that of either.
                vertex.normal = sum.try_normalize().or(last.try_normalize()).unwrap_or(DVec3::Y).as_vec3();
            }
            let replaced = bad.iter().filter(|&&bad| bad).count();
            notes.count("Normals of no length or not finite replaced by geometric ones", replaced);
        }
        let indices = self.triangles.into_iter().flatten().collect();
        Surface { vertices: self.vertices, indices }
    }
}

impl Surface {
    /// Adds the other side, each triangle behind its front. A dent seen from behind is a bump, so the whole tangent
    /// frame is reversed: negating n, t and w also negates the bitangent w * (n x t).
    pub(super) fn add_back(&mut self) {
        let front = self.vertices.len() as u32;
        let back: Vec<Vertex> = self
            .vertices
            .iter()
            .map(|v| Vertex {
                normal: -v.normal,
                tangent: if v.tangent == [0.0; 4] { Vertex::SECOND_SIDE } else { (-Vec4::from(v.tangent)).into() },
                ..*v
            })
            .collect();
        let (triangles, _) = self.indices.as_chunks::<3>();
        let both = |&[a, b, c]: &[u32; 3]| [a, b, c, front + a, front + c, front + b];
        self.indices = triangles.iter().flat_map(both).collect();
        self.vertices.extend(back);
    }
}
