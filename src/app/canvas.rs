//! What the window shows, as an image: the picture, bit by bit, and the panels over it.

use egui::epaint::{ClippedPrimitive, Primitive, Vertex};
use egui::{ImageData, TextureId, TexturesDelta};
use glam::Vec2;
use lightskin::Result;
use lightskin::frame::{Look, Picture};
use lightskin::gpu::{
    Attach, Attachments, Bind, Blend, Buffer, Cmd, Cull, Depth, Draw, Format, Gpu, Image, Pipeline, Raster,
    SamplerKind, Shape, Stream, Use,
};
use lightskin::shared::{LAYER_DIRECTION, LAYER_RADIANCE, LAYER_REFLECTANCE, LayerPush, UiPush};

/// What of a picture the window shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Shown {
    /// The picture.
    #[default]
    Picture,
    /// Emitted and directly reflected radiance.
    Direct,
    /// Diffuse indirect radiance.
    Diffuse,
    /// Glossy indirect radiance.
    Glossy,
    /// Diffuse albedo.
    Albedo,
    /// Shading normals.
    Normals,
}

impl Shown {
    /// All, with their names for people.
    pub(super) const ALL: [(Self, &'static str); 6] = [
        (Self::Picture, "picture"),
        (Self::Direct, "direct light"),
        (Self::Diffuse, "indirect, diffuse"),
        (Self::Glossy, "indirect, glossy"),
        (Self::Albedo, "albedo"),
        (Self::Normals, "normals"),
    ];

    /// The layer of a picture, and how it is shown; none where the picture has no such layer.
    fn layer(self, picture: &Picture) -> Option<(&Image, u32)> {
        let indirect = picture.indirect.as_ref();
        match self {
            Self::Picture => None,
            Self::Direct => Some((&picture.surface.radiance, LAYER_RADIANCE)),
            Self::Diffuse => indirect.map(|i| (&i.diffuse, LAYER_RADIANCE)),
            Self::Glossy => indirect.and_then(|i| i.glossy.as_ref()).map(|image| (image, LAYER_RADIANCE)),
            Self::Albedo => Some((&picture.surface.albedo, LAYER_REFLECTANCE)),
            Self::Normals => Some((&picture.surface.normal, LAYER_DIRECTION)),
        }
    }
}

/// Triangles of the panels, all in two buffers.
struct Panels {
    vertices: Buffer,
    indices: Buffer,
    /// Where they may draw [pixels], and which of the indices.
    runs: Vec<([u32; 4], std::ops::Range<u32>)>,
}

/// The image that goes to the window.
pub(super) struct Canvas {
    pub(super) image: Image,
    ui: Pipeline,
    layer: Pipeline,
    /// Glyphs and shapes of the panels, on both sides: changes are put together on the CPU.
    glyphs: Option<Image>,
    texels: egui::ColorImage,
    panels: Option<Panels>,
    scale: Vec2,
}

const FORMAT: Format = Format::R8G8B8A8_UNORM;

impl Canvas {
    pub(super) fn new(gpu: &Gpu, size: [u32; 2]) -> Result<Self> {
        let raster = Raster {
            vertex: "ui.vert",
            fragment: Some("ui.frag"),
            shape: Shape::Triangles,
            streams: &[Stream {
                stride: size_of::<Vertex>() as u32,
                attributes: &[(0, Format::R32G32_SFLOAT, 0), (1, Format::R32G32_SFLOAT, 8), (2, FORMAT, 16)],
            }],
            colors: &[FORMAT],
            blend: Blend::Over,
            depth: Depth::None,
            cull: Cull::None,
            constants: &[],
        };
        let layer = Raster {
            vertex: "screen.vert",
            fragment: Some("layer.frag"),
            streams: &[],
            blend: Blend::Replace,
            ..raster
        };
        Ok(Self {
            image: Self::image(gpu, size)?,
            ui: gpu.raster(&raster)?,
            layer: gpu.raster(&layer)?,
            glyphs: None,
            texels: egui::ColorImage::default(),
            panels: None,
            scale: Vec2::ONE,
        })
    }

    fn image(gpu: &Gpu, size: [u32; 2]) -> Result<Image> {
        let [width, height] = size.map(|side| side.max(1));
        gpu.target("window.canvas", FORMAT, width, height)
    }

    /// Makes the image anew for a window of another size.
    pub(super) fn fit(&mut self, gpu: &Gpu, size: [u32; 2]) -> Result<()> {
        if [self.image.width, self.image.height] != size.map(|side| side.max(1)) {
            self.image = Self::image(gpu, size)?;
        }
        Ok(())
    }

    /// Takes over what the panels look like now.
    pub(super) fn take(
        &mut self,
        gpu: &Gpu,
        primitives: &[ClippedPrimitive],
        textures: TexturesDelta,
        pixels_per_point: f32,
    ) -> Result<()> {
        self.take_glyphs(gpu, textures)?;
        let size = [self.image.width, self.image.height];
        self.scale = Vec2::new(2.0 / size[0] as f32, 2.0 / size[1] as f32) * pixels_per_point;
        let (mut vertices, mut indices, mut runs) = (Vec::<Vertex>::new(), Vec::<u32>::new(), Vec::new());
        for ClippedPrimitive { clip_rect, primitive } in primitives {
            let Primitive::Mesh(mesh) = primitive else { continue };
            let pixel = |at: f32, most: u32| (at * pixels_per_point).round().clamp(0.0, most as f32) as u32;
            let (left, top) = (pixel(clip_rect.min.x, size[0]), pixel(clip_rect.min.y, size[1]));
            let (right, bottom) = (pixel(clip_rect.max.x, size[0]), pixel(clip_rect.max.y, size[1]));
            if right <= left || bottom <= top || mesh.indices.is_empty() {
                continue;
            }
            let (first, base) = (indices.len() as u32, vertices.len() as u32);
            vertices.extend_from_slice(&mesh.vertices);
            indices.extend(mesh.indices.iter().map(|index| base + index));
            runs.push(([left, top, right - left, bottom - top], first..indices.len() as u32));
        }
        self.panels = None;
        if !runs.is_empty() {
            // The frame before may still read its own.
            let mut of_vertices = gpu.host_buffer("window.vertices", size_of_val(&vertices[..]) as u64)?;
            let mut of_indices = gpu.host_buffer("window.indices", size_of_val(&indices[..]) as u64)?;
            of_vertices.write(0, &vertices);
            of_indices.write(0, &indices);
            self.panels = Some(Panels { vertices: of_vertices, indices: of_indices, runs });
        }
        Ok(())
    }

    /// New glyphs. There are some in the first frames, then seldom.
    fn take_glyphs(&mut self, gpu: &Gpu, mut textures: TexturesDelta) -> Result<()> {
        let deltas = textures.set.remove(&TextureId::default()).unwrap_or_default();
        let changed = !deltas.is_empty();
        for delta in deltas {
            let ImageData::Color(image) = delta.image;
            match delta.pos {
                None => self.texels = (*image).clone(),
                Some([x, y]) => {
                    let ([width, height], row) = (image.size, self.texels.size[0]);
                    for (i, from) in image.pixels.chunks(width).enumerate().take(height) {
                        self.texels.pixels[(y + i) * row + x..][..width].copy_from_slice(from);
                    }
                }
            }
        }
        if changed {
            let [width, height] = self.texels.size.map(|side| side as u32);
            let bytes = self.texels.pixels.iter().flat_map(egui::Color32::to_array).collect();
            self.glyphs = Some(gpu.texture("window.glyphs", FORMAT, width, height, &[bytes])?);
        }
        Ok(())
    }

    /// Records the picture, if there is one, with its top left corner, and the panels over it.
    pub(super) fn record(&self, cmd: &Cmd<'_>, picture: Option<(&Picture, [u32; 2])>, shown: Shown, look: &Look) {
        let _zone = cmd.zone("window");
        let area = [0, 0, self.image.width, self.image.height];
        let layer = picture.and_then(|(picture, _)| shown.layer(picture));
        let mut canvas = Attach::clear(&self.image);
        if let (Some((picture, corner)), Shown::Picture) = (picture, shown) {
            cmd.render(&Attachments { colors: &[canvas], depth: None, area }, |_| {});
            cmd.barrier(Use::ColorWrite, Use::CopyRead | Use::CopyWrite);
            cmd.copy_image(&picture.output.picture, &self.image, corner);
            cmd.barrier(Use::CopyWrite, Use::ColorWrite);
            canvas = Attach::keep(&self.image);
        }
        // Layers need no barrier: the composite reads them in fragment shaders, too, or they are of an earlier frame.
        cmd.render(&Attachments { colors: &[canvas], depth: None, area }, |draw| {
            if let (Some((picture, corner)), Some(layer)) = (picture, layer) {
                self.draw_layer(draw, picture, corner, layer, look);
            }
            self.draw_panels(draw);
        });
    }

    fn draw_layer(
        &self,
        draw: &Draw<'_, '_>,
        picture: &Picture,
        [left, top]: [u32; 2],
        (layer, how): (&Image, u32),
        look: &Look,
    ) {
        let [width, height] = picture.size();
        draw.bind(&self.layer, &[layer.into(), (&picture.output.exposure).into()]);
        draw.push(&LayerPush { how, tonemap: look.tonemap as u32, left, top });
        draw.area([left, top, width, height]);
        draw.draw(3);
        draw.area([0, 0, self.image.width, self.image.height]);
    }

    fn draw_panels(&self, draw: &Draw<'_, '_>) {
        let (Some(panels), Some(glyphs)) = (&self.panels, &self.glyphs) else { return };
        draw.bind(&self.ui, &[Bind::Texture(glyphs, SamplerKind::CLAMPED)]);
        draw.push(&UiPush { scale: self.scale });
        draw.vertices(&[(&panels.vertices, 0)]);
        draw.indices(&panels.indices, 0);
        for (clip, run) in &panels.runs {
            draw.clip(*clip);
            draw.draw_indexed(run.end - run.start, run.start);
        }
    }
}
