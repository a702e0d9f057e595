//! Textures of the panels: the glyphs and shapes of all text and widgets, and the gradients of colour pickers.

use egui::{Color32, ColorImage, ImageData, TextureId, TexturesDelta};
use lightskin::Result;
use lightskin::gpu::{Format, Gpu, Image};
use std::collections::HashMap;

/// A texture and its texels, to which changes are applied.
struct Texture {
    texels: ColorImage,
    /// `None` if it differs from `texels`.
    image: Option<Image>,
}

/// All textures, by their identities in egui.
#[derive(Default)]
pub(super) struct Textures {
    all: HashMap<TextureId, Texture>,
    /// Textures that the last frame was the last to draw.
    freed: Vec<TextureId>,
}

impl Textures {
    /// Takes over the changes of a frame. They are frequent in the first frames and rare later.
    pub(super) fn change(&mut self, mut delta: TexturesDelta) {
        for id in self.freed.drain(..) {
            self.all.remove(&id);
        }
        for (id, changes) in delta.set.drain() {
            for change in changes {
                let ImageData::Color(part) = change.image;
                match (change.pos, self.all.get_mut(&id)) {
                    (Some([x, y]), Some(texture)) => {
                        let ([width, height], row) = (part.size, texture.texels.size[0]);
                        for (i, from) in part.pixels.chunks(width).enumerate().take(height) {
                            texture.texels.pixels[(y + i) * row + x..][..width].copy_from_slice(from);
                        }
                        texture.image = None;
                    }
                    _ => drop(self.all.insert(id, Texture { texels: (*part).clone(), image: None })),
                }
            }
        }
        self.freed.extend(delta.free.drain());
    }

    /// Uploads what has changed.
    pub(super) fn upload(&mut self, gpu: &Gpu) -> Result<()> {
        for Texture { texels, image } in self.all.values_mut().filter(|texture| texture.image.is_none()) {
            let [width, height] = texels.size.map(|side| side as u32);
            let bytes = texels.pixels.iter().flat_map(Color32::to_array).collect();
            *image = Some(gpu.texture("window.texture", Format::R8G8B8A8_UNORM, width, height, &[bytes])?);
        }
        Ok(())
    }

    /// The texture of this identity.
    pub(super) fn get(&self, id: TextureId) -> Option<&Image> {
        self.all.get(&id)?.image.as_ref()
    }

    /// Drops everything on the device. The next upload is to another one.
    pub(super) fn leave_device(mut self) -> Self {
        self.all.values_mut().for_each(|texture| texture.image = None);
        self
    }
}
