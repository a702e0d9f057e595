//! The image of the window: an exact copy of the picture, with marks and the panels over it.

use super::compare::Over;
use super::inset::Inset;
use super::marks::{Marker, Marks};
use super::textures::Textures;
use egui::TextureId;
use egui::epaint::{ClippedPrimitive, Primitive, Vertex};
use glam::{Vec2, Vec4};
use lightskin::Result;
use lightskin::frame::{Light, Look, Picture, View};
use lightskin::gpu::{
    Attach, Attachments, Bind, Blend, Buffer, Cmd, Cull, Depth, Draw, Format, Gpu, Image, Pipeline, Raster,
    SamplerKind, Shape, Stream, Use,
};
use lightskin::shared::{
    LAYER_BROKEN, LAYER_DEPTH, LAYER_DIRECTION, LAYER_LUMINANCE, LAYER_RADIANCE, LAYER_REFLECTANCE, LayerPush, UiPush,
};

/// The layer of a picture that the window shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Shown {
    /// The picture itself.
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
    /// Distances from the camera plane, in false colours.
    Depth,
    /// Luminance, in false colours.
    Luminance,
    /// Pixels where a layer has negative or non-finite radiance.
    Broken,
}

impl Shown {
    /// All layers, with their names in the panel.
    pub(super) const ALL: [(Self, &'static str); 9] = [
        (Self::Picture, "picture"),
        (Self::Direct, "direct light"),
        (Self::Diffuse, "indirect, diffuse"),
        (Self::Glossy, "indirect, glossy"),
        (Self::Albedo, "albedo"),
        (Self::Normals, "normals"),
        (Self::Depth, "depth"),
        (Self::Luminance, "luminance"),
        (Self::Broken, "broken values"),
    ];

    /// The images whose sum is shown, and how to show it: a `LAYER_*`. `None` for the picture itself, and if the
    /// picture lacks the layer.
    fn layers(self, picture: &Picture) -> Option<(Vec<&Image>, u32)> {
        let (surface, indirect) = (&picture.surface, picture.indirect.as_ref());
        let [diffuse, glossy] = [indirect.map(|i| &i.diffuse), indirect.and_then(|i| i.glossy.as_ref())];
        let all = || [&surface.radiance].into_iter().chain(diffuse).chain(glossy).collect();
        Some(match self {
            Self::Picture => return None,
            Self::Direct => (vec![&surface.radiance], LAYER_RADIANCE),
            Self::Diffuse => (vec![diffuse?], LAYER_RADIANCE),
            Self::Glossy => (vec![glossy?], LAYER_RADIANCE),
            Self::Albedo => (vec![&surface.albedo], LAYER_REFLECTANCE),
            Self::Normals => (vec![&surface.normal], LAYER_DIRECTION),
            Self::Depth => (vec![&surface.depth], LAYER_DEPTH),
            Self::Luminance => (all(), LAYER_LUMINANCE),
            Self::Broken => (all(), LAYER_BROKEN),
        })
    }

    /// The unit of the false-colour scale. `None` for layers without false colours.
    pub(super) fn unit(self) -> Option<&'static str> {
        match self {
            Self::Depth => Some("m"),
            Self::Luminance => Some("cd/m\u{b2}"),
            _ => None,
        }
    }
}

/// A picture and how the window shows it.
pub(super) struct Scenery<'a> {
    pub(super) picture: &'a Picture,
    pub(super) view: View,
    /// Corner in the window [pixels].
    pub(super) corner: [u32; 2],
    pub(super) shown: Shown,
    pub(super) look: &'a Look,
    /// Ends of the false-colour scale.
    pub(super) scale: [f32; 2],
    pub(super) over: Vec<Over<'a>>,
    pub(super) insets: Vec<Inset<'a>>,
    pub(super) marks: Marks,
    /// The light of the last frame, whose caches and VALs are marked.
    pub(super) light: Option<&'a Light>,
}

/// Triangles of the panels in two buffers.
struct Panels {
    vertices: Buffer,
    indices: Buffer,
    /// Clip rectangle [pixels], texture and range of indices of each draw.
    runs: Vec<([u32; 4], TextureId, std::ops::Range<u32>)>,
}

/// The image that is presented in the window.
pub(super) struct Canvas {
    pub(super) image: Image,
    ui: Pipeline,
    layer: Pipeline,
    marker: Marker,
    /// Textures of the panels.
    pub(super) textures: Textures,
    panels: Option<Panels>,
    scale: Vec2,
}

const FORMAT: Format = Format::R8G8B8A8_UNORM;

impl Canvas {
    /// `textures` are those of the panels so far.
    pub(super) fn new(gpu: &Gpu, size: [u32; 2], textures: Textures) -> Result<Self> {
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
            multisampled: false,
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
            marker: Marker::new(gpu, FORMAT)?,
            textures,
            panels: None,
            scale: Vec2::ONE,
        })
    }

    fn image(gpu: &Gpu, size: [u32; 2]) -> Result<Image> {
        let [width, height] = size.map(|side| side.max(1));
        gpu.target("window.canvas", FORMAT, width, height)
    }

    /// Recreates the image if the size of the window has changed.
    pub(super) fn fit(&mut self, gpu: &Gpu, size: [u32; 2]) -> Result<()> {
        if [self.image.width, self.image.height] != size.map(|side| side.max(1)) {
            self.image = Self::image(gpu, size)?;
        }
        Ok(())
    }

    /// Width and height [pixels].
    pub(super) fn size(&self) -> [u32; 2] {
        [self.image.width, self.image.height]
    }

    /// Uploads the current triangles and textures of the panels.
    pub(super) fn take(&mut self, gpu: &Gpu, primitives: &[ClippedPrimitive], pixels_per_point: f32) -> Result<()> {
        self.textures.upload(gpu)?;
        let size = self.size();
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
            runs.push(([left, top, right - left, bottom - top], mesh.texture_id, first..indices.len() as u32));
        }
        self.panels = None;
        if !runs.is_empty() {
            // New buffers, because the previous frame may still read the old ones.
            let mut of_vertices = gpu.host_buffer("window.vertices", size_of_val(&vertices[..]) as u64)?;
            let mut of_indices = gpu.host_buffer("window.indices", size_of_val(&indices[..]) as u64)?;
            of_vertices.write(0, &vertices);
            of_indices.write(0, &indices);
            self.panels = Some(Panels { vertices: of_vertices, indices: of_indices, runs });
        }
        Ok(())
    }

    /// Records the picture or a layer of it, if there is one, the marks and images over it, and the panels over all.
    pub(super) fn record(&self, cmd: &Cmd<'_>, scenery: Option<&Scenery<'_>>) {
        let _zone = cmd.zone("window");
        let area = [0, 0, self.image.width, self.image.height];
        let render = |canvas, draw: &dyn Fn(&Draw<'_, '_>)| {
            cmd.render(&Attachments { colors: &[canvas], depth: None, area }, |scope| draw(scope));
        };
        let layer = |draw: &Draw<'_, '_>| {
            // Layers need no barrier: the composite also reads them in fragment shaders, or they come from an earlier
            // frame.
            if let Some(scenery) = scenery
                && let Some((layers, how)) = scenery.shown.layers(scenery.picture)
            {
                self.draw_layer(draw, scenery, (&layers, how), [0.0, 1.0]);
            }
        };
        let over = |draw: &Draw<'_, '_>| {
            if let Some(scenery) = scenery {
                self.draw_marks(draw, scenery);
                for over in &scenery.over {
                    self.draw_layer(draw, scenery, (&[over.image], over.how), over.part);
                }
                scenery.insets.iter().for_each(|inset| self.draw_inset(draw, scenery, inset));
            }
            self.draw_panels(draw);
        };
        match scenery {
            Some(Scenery { picture, corner, shown: Shown::Picture, .. }) => {
                render(Attach::clear(&self.image), &|_| {});
                cmd.barrier(Use::ColorWrite, Use::CopyRead | Use::CopyWrite);
                cmd.copy_image(&picture.output.picture, &self.image, *corner);
                cmd.barrier(Use::CopyWrite | Use::ComputeWrite, Use::ColorWrite | Use::VertexRead); // picture, caches, VALs
                render(Attach::keep(&self.image), &over);
            }
            Some(scenery) if scenery.marks.any() => {
                render(Attach::clear(&self.image), &layer);
                cmd.barrier(Use::ColorWrite | Use::ComputeWrite, Use::ColorWrite | Use::VertexRead); // layer, caches, VALs
                render(Attach::keep(&self.image), &over);
            }
            _ => render(Attach::clear(&self.image), &|draw| {
                layer(draw);
                over(draw);
            }),
        }
    }

    /// Draws the sum of layers in the part of the picture's width between two shares from 0 to 1.
    fn draw_layer(&self, draw: &Draw<'_, '_>, scenery: &Scenery<'_>, (layers, how): (&[&Image], u32), part: [f32; 2]) {
        let ([width, height], [left, top]) = (scenery.picture.size(), scenery.corner);
        let [from, to] = part.map(|share| (share.clamp(0.0, 1.0) * width as f32).round() as u32);
        if from >= to {
            return;
        }
        let part = |i: usize| Bind::from(layers[i.min(layers.len() - 1)]);
        draw.bind(&self.layer, &[part(0), (&scenery.picture.output.exposure).into(), part(1), part(2)]);
        let ([low, high], tonemap) = (scenery.scale, scenery.look.tonemap as u32);
        let parts = layers.len() as u32;
        let depth = distance_by_depth(&scenery.view);
        draw.push(&LayerPush {
            how,
            tonemap,
            left,
            top,
            first_column: 0,
            first_row: 0,
            texels: 1.0,
            parts,
            low,
            high,
            depth,
        });
        draw.area([left, top, width, height]);
        draw.clip([left + from, top, to - from, height]);
        draw.draw(3);
        draw.area([0, 0, self.image.width, self.image.height]);
    }

    /// Draws a part of an image with texels as squares.
    fn draw_inset(&self, draw: &Draw<'_, '_>, scenery: &Scenery<'_>, inset: &Inset<'_>) {
        let [left, top, side] = inset.place;
        let image = Bind::from(inset.image);
        draw.bind(&self.layer, &[image, (&scenery.picture.output.exposure).into(), image, image]);
        let ([low, high], [first_column, first_row]) = (inset.scale, inset.first);
        draw.push(&LayerPush {
            how: inset.how,
            tonemap: scenery.look.tonemap as u32,
            left,
            top,
            first_column,
            first_row,
            texels: inset.side as f32 / side as f32,
            parts: 1,
            low,
            high,
            depth: inset.depth,
        });
        draw.area([left, top, side, side]);
        draw.draw(3);
        draw.area([0, 0, self.image.width, self.image.height]);
    }

    fn draw_marks(&self, draw: &Draw<'_, '_>, scenery: &Scenery<'_>) {
        let ([width, height], [left, top]) = (scenery.picture.size(), scenery.corner);
        draw.area([left, top, width, height]);
        self.marker.draw(draw, scenery);
        draw.area([0, 0, self.image.width, self.image.height]);
    }

    fn draw_panels(&self, draw: &Draw<'_, '_>) {
        let Some(panels) = &self.panels else { return };
        let mut bound = None;
        for (clip, id, run) in &panels.runs {
            let Some(texture) = self.textures.get(*id) else { continue };
            if bound.replace(*id) != Some(*id) {
                draw.bind(&self.ui, &[Bind::Texture(texture, SamplerKind::CLAMPED)]);
                draw.push(&UiPush { scale: self.scale });
                draw.vertices(&[(&panels.vertices, 0)]);
                draw.indices(&panels.indices, 0);
            }
            draw.clip(*clip);
            draw.draw_indexed(run.end - run.start, run.start);
        }
    }
}

/// The value of `LayerPush::depth` for a view.
fn distance_by_depth(view: &View) -> Vec4 {
    // Computed for points at the centre of the picture. Other points of the same depth have the same distance.
    let [of_depth, of_one] = [view.world_from_clip.z_axis, view.world_from_clip.w_axis];
    Vec4::new(view.plane.dot(of_one), view.plane.dot(of_depth), of_one.w, of_depth.w)
}
