//! A second reader of animated files, in f64. Its methods differ from the engine's: it writes out matrices and searches
//! keys linearly.

use base64::Engine;
use glam::{DMat3, DMat4, DVec3, DVec4};
use serde_json::Value;
use std::path::Path;

/// JSON and buffers of a file.
pub(super) struct File {
    json: Value,
    buffers: Vec<Vec<u8>>,
}

/// A drawn triangle: world-space corners, and their unit normals if the file has normals.
pub(super) type Triangle = ([DVec3; 3], Option<[DVec3; 3]>);

struct Node {
    translation: DVec3,
    rotation: [f64; 4],
    scale: DVec3,
    matrix: Option<DMat4>,
    weights: Vec<f64>,
}

impl File {
    pub(super) fn open(path: &Path) -> Self {
        let bytes = std::fs::read(path).expect("is there");
        let (json, chunk) = if bytes.starts_with(b"glTF") {
            let length = u32::from_le_bytes(bytes[12..16].try_into().expect("four")) as usize;
            (bytes[20..20 + length].to_vec(), Some(bytes[28 + length..].to_vec()))
        } else {
            (bytes, None)
        };
        let json: Value = serde_json::from_slice(&json).expect("is JSON");
        let fetch = |buffer: &Value| match buffer["uri"].as_str() {
            None => chunk.clone().expect("is a GLB"),
            Some(uri) => match uri.split_once("base64,") {
                Some((_, data)) => base64::engine::general_purpose::STANDARD.decode(data).expect("is base64"),
                None => std::fs::read(path.parent().expect("has a folder").join(uri)).expect("is there"),
            },
        };
        let buffers = json["buffers"].as_array().expect("has buffers").iter().map(fetch).collect();
        Self { json, buffers }
    }

    fn list(&self, name: &str) -> &[Value] {
        self.json[name].as_array().map_or(&[], Vec::as_slice)
    }

    pub(super) fn animations(&self) -> usize {
        self.list("animations").len()
    }

    /// Reads all elements of an accessor.
    fn read(&self, index: u64) -> Vec<Vec<f64>> {
        let accessor = &self.json["accessors"][index as usize];
        let width = match accessor["type"].as_str().expect("has a type") {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            _ => 16,
        };
        let code = accessor["componentType"].as_u64().expect("has one");
        let count = number(&accessor["count"]);
        let mut all = match accessor["bufferView"].as_u64() {
            None => vec![vec![0.0; width]; count],
            Some(view) => self.view(view, number(&accessor["byteOffset"]), count, width, code),
        };
        if let Some(sparse) = accessor.get("sparse") {
            let part = |key: &str, width: usize, code: u64| {
                let part = &sparse[key];
                let view = part["bufferView"].as_u64().expect("has one");
                self.view(view, number(&part["byteOffset"]), number(&sparse["count"]), width, code)
            };
            let places = part("indices", 1, sparse["indices"]["componentType"].as_u64().expect("has one"));
            for (place, value) in places.iter().zip(part("values", width, code)) {
                all[place[0] as usize] = value;
            }
        }
        if accessor["normalized"] == true {
            let most = [(5120, 127.0), (5121, 255.0), (5122, 32767.0), (5123, 65535.0)];
            let most = most.iter().find(|(c, _)| *c == code).expect("an integer").1;
            all.iter_mut().flatten().for_each(|x| *x = (*x / most).max(-1.0));
        }
        all
    }

    fn view(&self, view: u64, offset: usize, count: usize, width: usize, code: u64) -> Vec<Vec<f64>> {
        let view = &self.json["bufferViews"][view as usize];
        let size = match code {
            5120 | 5121 => 1,
            5122 | 5123 => 2,
            _ => 4,
        };
        let stride = view["byteStride"].as_u64().map_or(size * width, |s| s as usize);
        let bytes = &self.buffers[number(&view["buffer"])][number(&view["byteOffset"]) + offset..];
        let component = |at: usize| match code {
            5120 => f64::from(bytes[at] as i8),
            5121 => f64::from(bytes[at]),
            5122 => f64::from(i16::from_le_bytes([bytes[at], bytes[at + 1]])),
            5123 => f64::from(u16::from_le_bytes([bytes[at], bytes[at + 1]])),
            5125 => f64::from(u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four"))),
            _ => f64::from(f32::from_le_bytes(bytes[at..at + 4].try_into().expect("four"))),
        };
        (0..count).map(|i| (0..width).map(|c| component(i * stride + c * size)).collect()).collect()
    }

    /// First and last key time of an animation.
    pub(super) fn span(&self, animation: usize) -> (f64, f64) {
        let samplers = self.json["animations"][animation]["samplers"].as_array().expect("has samplers");
        let times = samplers.iter().flat_map(|s| self.read(s["input"].as_u64().expect("has one"))).flatten();
        times.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), t| (low.min(t), high.max(t)))
    }

    fn nodes(&self) -> Vec<Node> {
        let node = |node: &Value| Node {
            translation: vector(&node["translation"], DVec3::ZERO),
            rotation: floats(&node["rotation"]).try_into().unwrap_or([0.0, 0.0, 0.0, 1.0]),
            scale: vector(&node["scale"], DVec3::ONE),
            matrix: node.get("matrix").map(|m| DMat4::from_cols_slice(&floats(m))),
            weights: match (node.get("weights"), node["mesh"].as_u64()) {
                (Some(own), _) => floats(own),
                (None, Some(mesh)) => floats(&self.json["meshes"][mesh as usize]["weights"]),
                (None, None) => Vec::new(),
            },
        };
        self.list("nodes").iter().map(node).collect()
    }

    /// All drawn triangles at a time, grouped by the node that draws them. Without an animation, the rest pose.
    pub(super) fn drawn(&self, played: Option<(usize, f64)>) -> Vec<Vec<Triangle>> {
        let mut nodes = self.nodes();
        if let Some((animation, time)) = played {
            let animation = &self.json["animations"][animation];
            for channel in animation["channels"].as_array().expect("has channels") {
                let sampler = &animation["samplers"][number(&channel["sampler"])];
                let Some(node) = channel["target"]["node"].as_u64() else { continue };
                let node = &mut nodes[node as usize];
                let path = channel["target"]["path"].as_str().expect("has a path");
                let value = self.sampled(sampler, time, path == "rotation");
                match path {
                    "translation" => node.translation = DVec3::from_slice(&value),
                    "rotation" => node.rotation = value.try_into().expect("four"),
                    "scale" => node.scale = DVec3::from_slice(&value),
                    _ => node.weights = value,
                }
            }
        }
        let locals: Vec<DMat4> = nodes.iter().map(local).collect();
        let mut parents = vec![None; nodes.len()];
        for (index, node) in self.list("nodes").iter().enumerate() {
            for child in indices(&node["children"]) {
                parents[child] = Some(index);
            }
        }
        let worlds: Vec<DMat4> = (0..nodes.len())
            .map(|node| {
                let mut world = locals[node];
                let mut above = parents[node];
                while let Some(parent) = above {
                    world = locals[parent] * world;
                    above = parents[parent];
                }
                world
            })
            .collect();
        let mut drawn = Vec::new();
        let mut stack: Vec<usize> = indices(&self.json["scenes"][number(&self.json["scene"])]["nodes"]);
        stack.reverse();
        while let Some(node) = stack.pop() {
            let mut children = indices(&self.list("nodes")[node]["children"]);
            children.reverse();
            stack.extend(children);
            if let Some(mesh) = self.list("nodes")[node]["mesh"].as_u64() {
                let skin = self.list("nodes")[node]["skin"].as_u64();
                drawn.push(self.mesh(mesh as usize, &nodes[node].weights, worlds[node], skin, &worlds));
            }
        }
        drawn
    }

    fn mesh(&self, mesh: usize, weights: &[f64], world: DMat4, skin: Option<u64>, worlds: &[DMat4]) -> Vec<Triangle> {
        let mut triangles = Vec::new();
        for primitive in self.json["meshes"][mesh]["primitives"].as_array().expect("has primitives") {
            assert!(primitive["mode"].as_u64().is_none_or(|mode| mode == 4), "a list of triangles");
            let attributes = &primitive["attributes"];
            let attribute = |name: &str| attributes[name].as_u64().map(|index| self.read(index));
            let points = |list: Vec<Vec<f64>>| -> Vec<DVec3> { list.iter().map(|v| DVec3::from_slice(v)).collect() };
            let mut positions = points(attribute("POSITION").expect("has positions"));
            let mut normals = attribute("NORMAL").map(points);
            for (target, weight) in primitive["targets"].as_array().into_iter().flatten().zip(weights) {
                let add = |name: &str, to: &mut Vec<DVec3>| {
                    if let Some(index) = target[name].as_u64() {
                        to.iter_mut().zip(points(self.read(index))).for_each(|(to, d)| *to += d * *weight);
                    }
                };
                add("POSITION", &mut positions);
                normals.iter_mut().for_each(|normals| add("NORMAL", normals));
            }
            let count = positions.len();
            let mut places = vec![world; count];
            if let Some(skin) = skin {
                let skin = &self.json["skins"][skin as usize];
                let joints = indices(&skin["joints"]);
                let binds = skin["inverseBindMatrices"].as_u64().map(|index| self.read(index));
                let bind = |j: usize| binds.as_ref().map_or(DMat4::IDENTITY, |b| DMat4::from_cols_slice(&b[j]));
                let matrices: Vec<DMat4> = joints.iter().enumerate().map(|(j, &node)| worlds[node] * bind(j)).collect();
                places = vec![DMat4::ZERO; count];
                for set in 0.. {
                    let Some(which) = attribute(&format!("JOINTS_{set}")) else { break };
                    let shares = attribute(&format!("WEIGHTS_{set}")).expect("goes with the joints");
                    for (place, (which, shares)) in places.iter_mut().zip(which.iter().zip(&shares)) {
                        for (joint, share) in which.iter().zip(shares) {
                            *place += matrices[*joint as usize] * *share;
                        }
                    }
                }
                // The stored weights of a vertex sum to 1 only approximately. The matrix's last row holds their sum.
                places.iter_mut().for_each(|place| *place *= 1.0 / place.w_axis.w);
            }
            let placed: Vec<DVec3> =
                positions.iter().zip(&places).map(|(p, m)| (*m * DVec4::from((*p, 1.0))).truncate()).collect();
            let turned: Option<Vec<DVec3>> = normals.map(|normals| {
                let turn = |(n, m): (&DVec3, &DMat4)| {
                    let m = DMat3::from_mat4(*m);
                    (m.inverse().transpose() * *n).normalize()
                };
                normals.iter().zip(&places).map(turn).collect()
            });
            let corners: Vec<usize> = match primitive["indices"].as_u64() {
                Some(index) => self.read(index).iter().map(|i| i[0] as usize).collect(),
                None => (0..count).collect(),
            };
            let front: Vec<Triangle> = corners
                .chunks_exact(3)
                .filter(|c| c[0] != c[1] && c[1] != c[2] && c[2] != c[0])
                .map(|c| {
                    let of = |list: &Vec<DVec3>| [list[c[0]], list[c[1]], list[c[2]]];
                    (of(&placed), turned.as_ref().map(of))
                })
                .collect();
            let material = primitive["material"].as_u64().map(|m| &self.json["materials"][m as usize]);
            let back = |((p, n), _): (Triangle, ())| ([p[0], p[2], p[1]], n.map(|n| [-n[0], -n[2], -n[1]]));
            let double_sided = material.is_some_and(|m| m["doubleSided"] == true);
            let backs: Vec<Triangle> = front.iter().map(|t| back((*t, ()))).collect();
            for (front, back) in front.into_iter().zip(backs) {
                triangles.push(front);
                triangles.extend(double_sided.then_some(back));
            }
        }
        triangles
    }

    fn sampled(&self, sampler: &Value, time: f64, is_rotation: bool) -> Vec<f64> {
        let times: Vec<f64> = self.read(sampler["input"].as_u64().expect("has one")).into_iter().flatten().collect();
        let flat: Vec<f64> = self.read(sampler["output"].as_u64().expect("has one")).into_iter().flatten().collect();
        let way = sampler["interpolation"].as_str().unwrap_or("LINEAR");
        let parts = if way == "CUBICSPLINE" { 3 } else { 1 };
        let width = flat.len() / times.len() / parts;
        let part = |key: usize, part: usize| &flat[(key * parts + part) * width..][..width];
        let value = |key: usize| part(key, parts / 3);
        let last = times.len() - 1;
        if time <= times[0] || time >= times[last] {
            return value(if time <= times[0] { 0 } else { last }).to_vec();
        }
        let mut key = 0;
        while times[key + 1] <= time {
            key += 1;
        }
        let span = times[key + 1] - times[key];
        let t = (time - times[key]) / span;
        let (from, to) = (value(key), value(key + 1));
        match way {
            "STEP" => from.to_vec(),
            "LINEAR" if is_rotation => {
                let unit = |q: &[f64]| -> Vec<f64> {
                    let length = q.iter().map(|x| x * x).sum::<f64>().sqrt();
                    q.iter().map(|x| x / length).collect()
                };
                let (from, to) = (unit(from), unit(to));
                let dot: f64 = from.iter().zip(&to).map(|(a, b)| a * b).sum();
                let angle = dot.abs().min(1.0).acos();
                let (a, b) = if angle < 1e-6 {
                    (1.0 - t, t)
                } else {
                    (((1.0 - t) * angle).sin() / angle.sin(), (t * angle).sin() / angle.sin())
                };
                from.iter().zip(&to).map(|(x, y)| a * x + b * y * dot.signum()).collect()
            }
            "LINEAR" => from.iter().zip(to).map(|(a, b)| a + (b - a) * t).collect(),
            _ => {
                // The cubic polynomial by its four coefficients.
                let (m, n) = (part(key, 2), part(key + 1, 0));
                let hermite = |i: usize| {
                    let (p, q, m, n) = (from[i], to[i], m[i] * span, n[i] * span);
                    p + t * (m + t * ((3.0 * (q - p) - 2.0 * m - n) + t * (2.0 * (p - q) + m + n)))
                };
                (0..width).map(hermite).collect()
            }
        }
    }
}

fn local(node: &Node) -> DMat4 {
    if let Some(matrix) = node.matrix {
        return matrix;
    }
    let length = node.rotation.iter().map(|x| x * x).sum::<f64>().sqrt();
    let [x, y, z, w] = node.rotation.map(|c| c / length);
    let rotation = DMat3::from_cols_array(&[
        1.0 - 2.0 * (y * y + z * z),
        2.0 * (x * y + z * w),
        2.0 * (x * z - y * w),
        2.0 * (x * y - z * w),
        1.0 - 2.0 * (x * x + z * z),
        2.0 * (y * z + x * w),
        2.0 * (x * z + y * w),
        2.0 * (y * z - x * w),
        1.0 - 2.0 * (x * x + y * y),
    ]);
    let stretched = rotation * DMat3::from_diagonal(node.scale);
    let column = |c: usize| stretched.col(c).extend(0.0);
    DMat4::from_cols(column(0), column(1), column(2), node.translation.extend(1.0))
}

fn number(value: &Value) -> usize {
    value.as_u64().unwrap_or(0) as usize
}

fn indices(value: &Value) -> Vec<usize> {
    value.as_array().into_iter().flatten().map(number).collect()
}

fn floats(value: &Value) -> Vec<f64> {
    value.as_array().into_iter().flatten().filter_map(Value::as_f64).collect()
}

fn vector(value: &Value, absent: DVec3) -> DVec3 {
    if value.is_null() { absent } else { DVec3::from_slice(&floats(value)) }
}
