//! A hash of a scene's content.

use super::Scene;

impl Scene {
    /// Hash of everything that affects a picture of the scene; excludes its name and notes.
    pub fn fingerprint(&self) -> blake3::Hash {
        let mut hasher = blake3::Hasher::new();
        let mut add = |bytes: &[u8]| {
            hasher.update(&(bytes.len() as u64).to_le_bytes());
            hasher.update(bytes);
        };
        for mesh in &self.meshes {
            add(bytemuck::cast_slice(&mesh.vertices));
            add(bytemuck::cast_slice(&mesh.indices));
            add(format!("{:?}", mesh.primitives).as_bytes());
            if let Some(deform) = &mesh.deform {
                add(bytemuck::cast_slice(&deform.bind));
                add(bytemuck::cast_slice(&deform.influences));
                deform.targets.iter().for_each(|target| add(bytemuck::cast_slice(target)));
                add(bytemuck::cast_slice(&deform.followers));
            }
        }
        for image in &self.images {
            add(format!("{}x{}", image.width, image.height).as_bytes());
            add(&image.rgba);
        }
        // Numbers are printed so that they parse back exactly: the text loses nothing.
        for text in [
            format!("{:?}", self.materials),
            format!("{:?}", self.instances),
            format!("{:?}", self.lights),
            format!("{:?}", self.cameras),
        ] {
            add(text.as_bytes());
        }
        if let Some(sky) = &self.sky {
            add(format!("{}x{} {} {:?}", sky.width, sky.height, sky.turn, sky.lights).as_bytes());
            [Some(&sky.texels), sky.shown.as_ref()]
                .into_iter()
                .flatten()
                .for_each(|grid| add(bytemuck::cast_slice(grid)));
        }
        hasher.finalize()
    }
}
