//! The default scene: its parts, that it is the same every time, and that its file contains it.

use std::collections::HashMap;
use std::path::Path;
use std::sync::LazyLock;

use glam::{DVec3, Vec3};
use lightskin::scene::build::{Fineness, showpiece};
use lightskin::scene::write::write_glb;
use lightskin::scene::{Image, Mesh, Scene, gltf, luminance};

/// The scene of `render` with small pictures and a coarse statue, so that it is made quickly.
const COARSE: Fineness = Fineness { texels: 64, cell: 0.016 };

static SCENE: LazyLock<Scene> = LazyLock::new(|| showpiece(COARSE));

#[test]
fn the_showpiece_holds_what_it_promises() {
    let triangles = SCENE.triangle_count();
    println!("{triangles} triangles with a coarse statue");
    assert!((300_000..1_500_000).contains(&triangles), "{triangles}");
    let names: Vec<&str> = SCENE.cameras.iter().map(|camera| camera.name.as_str()).collect();
    assert_eq!(names, ["Court", "Gallery", "Statue"]);
    let painted: std::collections::BTreeSet<[usize; 3]> = SCENE
        .materials
        .iter()
        .filter_map(|m| {
            Some([m.base_color_texture?.image, m.normal_texture?.image, m.metallic_roughness_texture?.image])
        })
        .collect();
    assert!(painted.len() >= 8, "{} sets of pictures", painted.len());
    assert_eq!(painted.iter().flatten().count(), SCENE.images.len(), "all pictures must be used");
    // The sun comes first, then the lights that stand for the sky. Level ground receives the intended illuminance.
    let sky = SCENE.sky.as_ref().expect("a sky");
    assert_eq!((SCENE.lights[0].name.as_str(), sky.lights.start), ("sun", 1));
    let light = luminance(sky.received(DVec3::Y));
    assert!((light / 17_000.0 - 1.0).abs() < 0.01, "{light} lx");
}

#[test]
fn vertices_of_the_showpiece_are_sound() {
    for mesh in &SCENE.meshes {
        for vertex in &mesh.vertices {
            assert!(vertex.position.is_finite() && vertex.uv0.is_finite(), "{}: {vertex:?}", mesh.name);
            assert!((vertex.normal.length() - 1.0).abs() < 1e-4, "{}: {vertex:?}", mesh.name);
        }
        // Vertex normals must be on the side of the triangle's front.
        let against = |t: &usize| {
            let [a, b, c] = mesh.triangle(*t).map(|k| mesh.vertices[k]);
            let cross = (b.position - a.position).cross(c.position - a.position);
            cross.dot(a.normal + b.normal + c.normal) < 0.0
        };
        let against = (0..mesh.triangle_count()).filter(against).count();
        // The coarse statue has folds in gaps that are narrower than its cells.
        let most = if mesh.name == "statue" { mesh.triangle_count() / 50 } else { 0 };
        assert!(against <= most, "{}: {against} triangles face away from their normals", mesh.name);
    }
}

/// Each edge has as many triangles in one direction as in the other.
#[test]
fn the_statue_is_closed() {
    let statue: &Mesh = SCENE.meshes.iter().find(|mesh| mesh.name == "statue").expect("a statue");
    let mut runs: HashMap<[[u32; 3]; 2], i32> = HashMap::new();
    let place = |p: Vec3| p.to_array().map(f32::to_bits);
    for triangle in 0..statue.triangle_count() {
        let corners = statue.triangle(triangle).map(|k| place(statue.vertices[k].position));
        for k in 0..3 {
            let (from, to) = (corners[k], corners[(k + 1) % 3]);
            let way = if from < to { 1 } else { -1 };
            *runs.entry([from.min(to), from.max(to)]).or_default() += way;
        }
    }
    let open = runs.values().filter(|sum| **sum != 0).count();
    assert!(runs.len() > 10_000 && open == 0, "{open} of {} edges are open", runs.len());
}

/// Texels must not differ more across opposite edges of a picture than inside it.
#[test]
fn pictures_of_the_showpiece_tile() {
    for image in showpiece(Fineness { texels: 256, cell: 0.2 }).images {
        let Image { name, width, height, rgba } = &image;
        let (w, h) = (*width as usize, *height as usize);
        let texel = |x: usize, y: usize| &rgba[4 * ((y % h) * w + x % w)..][..4];
        let step = |a: &[u8], b: &[u8]| (0..4).map(|c| f64::from(a[c].abs_diff(b[c]))).sum::<f64>();
        let across = |x: usize| (0..h).map(|y| step(texel(x, y), texel(x + 1, y))).sum::<f64>() / h as f64;
        let down = |y: usize| (0..w).map(|x| step(texel(x, y), texel(x, y + 1))).sum::<f64>() / w as f64;
        let most = |steps: &dyn Fn(usize) -> f64, count: usize| (0..count - 1).map(steps).fold(0.0, f64::max);
        for (what, seam, within) in
            [("columns", across(w - 1), most(&across, w)), ("rows", down(h - 1), most(&down, h))]
        {
            assert!(
                seam <= 1.25 * within + 1.0,
                "{name}: the last and first {what} differ by {seam}, other neighbours by up to {within}"
            );
        }
    }
}

#[test]
fn the_showpiece_is_the_same_every_time_and_in_its_file() {
    assert_eq!(showpiece(COARSE).fingerprint(), SCENE.fingerprint());
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("showpiece.glb");
    write_glb(&SCENE, &path).expect("written");
    let read = gltf::load(&path).expect("reads");
    assert_eq!(read.notes, [""; 0]);
    assert_eq!(read.triangle_count(), SCENE.triangle_count());
    // The file leaves out the lights that stand for the sky.
    assert_eq!((read.lights.len(), read.cameras.len()), (1, 3));
    // Materials and images are in the order of their first use.
    let image = |scene: &Scene, texture: Option<lightskin::scene::Texture>| {
        texture.map(|t| (scene.images[t.image].rgba.clone(), t.transform, t.uv_set, t.sampler))
    };
    for material in &SCENE.materials {
        let found = read.materials.iter().find(|m| m.name == material.name).expect("the material");
        for (made, read_back) in material.clone().textures_mut().into_iter().zip(found.clone().textures_mut()) {
            assert!(image(&SCENE, *made) == image(&read, *read_back), "textures of {}", material.name);
        }
        let factors = |m: &lightskin::scene::Material| (m.base_color, m.metallic, m.roughness, m.ior, m.specular);
        assert_eq!(factors(material), factors(found), "{}", material.name);
    }
    for (made, found) in SCENE.instances.iter().zip(&read.instances) {
        assert!(made.world_from_model.abs_diff_eq(found.world_from_model, 1e-6), "{}", made.name);
        let (made, found) = (&SCENE.meshes[made.mesh], &read.meshes[found.mesh]);
        let corner = |mesh: &Mesh, k: usize| {
            let vertex = mesh.vertices[mesh.indices[k] as usize];
            (vertex.position, vertex.uv0, vertex.color, vertex.normal)
        };
        for k in (0..made.indices.len()).step_by(97) {
            let (made, found) = (corner(made, k), corner(found, k));
            let same = (made.0, made.1, made.2) == (found.0, found.1, found.2);
            assert!(same && made.3.abs_diff_eq(found.3, 1e-6), "{made:?} is read as {found:?}");
        }
    }
}
