//! Small worlds, whole frames of them, and the device's intermediate results in the form that the references use.

use glam::DVec3;
use lightskin::bake::{CacheSet, NO_CACHE};
use lightskin::frame::depth_images::{DepthImages, SentOn};
use lightskin::frame::gather::{Compute, Gather};
use lightskin::frame::{View, World};
use lightskin::gpu::Gpu;
use lightskin::lab::knobs::{Frame, Knobs};
use lightskin::reference::world::Hit;
use lightskin::scene::Scene;

pub(crate) use lightskin::lab::shot::{PixelSurface, Shot, reflection, seen, sent_on, small, triangles};
pub(crate) use lightskin::lab::worlds::{SPOT, add, camera, corner, lamp, phong, placed};

/// Bakes caches with this spacing [m].
pub(crate) fn baked(scene: &Scene, spacing: f64, references: usize) -> CacheSet {
    lightskin::lab::worlds::baked(scene, spacing, references).expect("bakes")
}

/// Draws one frame from the scene's first camera and reads it back. Fails on any message of the validation layer, the
/// barrier check or the check for invalid values.
#[track_caller]
pub(crate) fn shoot(gpu: &Gpu, scene: &Scene, caches: Option<&CacheSet>, settings: &Knobs) -> Shot {
    let shot = lightskin::lab::shot::shoot(gpu, scene, caches, settings).expect("drawn");
    assert_eq!(shot.complaints, [""; 0]);
    super::assert_clean(gpu);
    shot
}

/// Draws one frame from the scene's first camera and returns it on the device. Fails on any message of the barrier
/// check.
#[track_caller]
pub(crate) fn drawn(gpu: &Gpu, scene: &Scene, caches: &CacheSet, settings: &Knobs) -> Frame {
    let world = World::new(gpu, scene, Some(caches)).expect("upload");
    drawn_of(gpu, scene, &world, settings)
}

/// Like `drawn`, for an uploaded world.
#[track_caller]
pub(crate) fn drawn_of(gpu: &Gpu, scene: &Scene, world: &World, settings: &Knobs) -> Frame {
    drawn_turned(gpu, scene, world, settings, 0.0)
}

/// As `drawn_of`, with the pattern of short rays turned by this angle \[rad\].
pub(crate) fn drawn_turned(gpu: &Gpu, scene: &Scene, world: &World, settings: &Knobs, turn: f32) -> Frame {
    let mut frame = Frame::new(gpu, scene, world, settings).expect("made");
    let view = View { turn, ..View::new(&scene.cameras[0], settings.size, world.origin, world.radius) };
    let drawn = gpu.frame(|cmd| {
        frame.record(cmd, world, &view);
        Ok(())
    });
    assert_eq!(drawn.expect("drawn").problems, [""; 0]);
    frame
}

/// Caches that the corners of a triangle refer to, as indices into those of all instances.
pub(crate) fn references_at(scene: &Scene, caches: &CacheSet, hit: &Hit) -> [Vec<usize>; 3] {
    let of_instance = |instance: usize| &caches.models[caches.instance_model[instance]];
    let first: usize = (0..hit.instance).map(|instance| of_instance(instance).caches.len()).sum();
    let mesh = &scene.meshes[scene.instances[hit.instance].mesh];
    let references = &of_instance(hit.instance).references;
    let each = references.len() / mesh.vertices.len();
    let row = |corner: usize| &references[each * corner..][..each];
    mesh.triangle(hit.triangle)
        .map(|corner| row(corner).iter().filter(|c| **c != NO_CACHE).map(|c| first + usize::from(*c)).collect())
}

/// The gather of a frame whose caches trace rays, and what these rays hit.
#[track_caller]
pub(crate) fn traced(frame: &Frame) -> (&Compute, &SentOn) {
    let Gather::Compute(by) = &frame.light.caches().expect("caches").gather else { panic!("a compute gather") };
    (by, by.depth_images.as_ref().and_then(|images| images.sent_on.as_ref()).expect("rays"))
}

/// Texels of traced depth images: normals of planes, divided by their distance [1/m]; zero without a surface.
pub(crate) fn planes(gpu: &Gpu, images: &DepthImages) -> Vec<DVec3> {
    assert!(images.are_traced());
    let plane = |&[normal, reciprocal]: &[u32; 2]| {
        let [x, y] = [normal as i16, (normal >> 16) as i16].map(|e| (f64::from(e) / 32767.0).clamp(-1.0, 1.0));
        let z = 1.0 - x.abs() - y.abs();
        let folded = |a: f64, b: f64| if z < 0.0 { (1.0 - b.abs()).copysign(a) } else { a };
        DVec3::new(folded(x, y), folded(y, x), z).normalize() * f64::from(f32::from_bits(reciprocal))
    };
    gpu.read::<[u32; 2]>(&images.buffer).expect("read").iter().map(plane).collect()
}

/// Both indirect layers as raw bits.
pub(crate) fn indirect(gpu: &Gpu, frame: &Frame) -> Vec<Vec<[u32; 4]>> {
    let indirect = frame.picture.indirect.as_ref().expect("indirect light");
    let images = [&indirect.diffuse].into_iter().chain(&indirect.glossy);
    images.map(|image| gpu.read_image(image).expect("read")).collect()
}
