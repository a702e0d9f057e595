//! Stage 1, G-buffer: draws depth, normal, reflectances, emitted radiance and element of visible surfaces. METHOD 1.

use super::arrivals::Arrivals;
use super::plan::Plan;
use super::settings::Antialiasing;
use super::view::View;
use super::world::{ByKind, VERTEX, VERTEX_PLACE, Which, World};
use crate::error::Result;
use crate::gpu::{
    Attach, Attachments, Blend, Cmd, Cull, Depth, Device, Extent, Format, Image, ImageDesc, Pipeline, Raster, Shape,
};

const FLOAT: Format = Format::R32G32B32A32_SFLOAT;
const HALF: Format = Format::R16G16B16A16_SFLOAT;
const COAT: Format = Format::R32G32B32A32_UINT;

/// G-buffer of a view, and the direct light of its surfaces.
pub struct Surface {
    /// Picture size \[pixels\].
    pub size: [u32; 2],
    /// Reversed depth: 1 at the near plane, 0 without a surface. For second surfaces, negative in pixels that have
    /// none.
    pub depth: Image,
    /// Shading normal and Phong exponent.
    pub normal: Image,
    /// `rho_d`, and x of the octahedral geometric normal.
    pub albedo: Image,
    /// `rho_g`, and y of the octahedral geometric normal.
    pub specular: Image,
    /// Triangle in a pixel: draw number, from 1, and index within the draw. Only where caches are interpolated or light
    /// travels through translucent bodies.
    pub element: Option<Image>,
    /// Layers over both lobes: a clear coat with its normal, and sheen (`lib/coat.glsl`). Only if some material has
    /// either.
    pub coat: Option<Image>,
    /// Emitted radiance. Stage 2 adds directly reflected radiance and the sky.
    pub radiance: Image,
    /// Whether these are second surfaces, which are visible away from the pixel's centre.
    pub is_second: bool,
    /// Light of one source at a time that reaches the surfaces; only with ray-traced shadows.
    pub arrivals: Option<Arrivals>,
}

impl Surface {
    /// Creates the images, and the buffers of rays to lights.
    ///
    /// # Errors
    /// Fails if the device runs out of memory or the driver rejects the shaders.
    pub fn new(gpu: &Device, plan: &Plan, size: [u32; 2]) -> Result<Self> {
        let arrivals = plan.light_rays.then(|| Arrivals::new(gpu, "direct", size)).transpose()?;
        Ok(Self { arrivals, ..Self::unlit(gpu, plan, size)? })
    }

    /// Creates the images alone.
    ///
    /// # Errors
    /// As `new`.
    pub(super) fn unlit(gpu: &Device, plan: &Plan, size: [u32; 2]) -> Result<Self> {
        let [w, h] = size;
        // Further points of a pixel write into the images.
        let storage = plan.antialiasing.shaded_points() > 0;
        let image = |name, format| gpu.image(&ImageDesc { name, format, size, extent: Extent::Plane, storage });
        Ok(Self {
            size,
            depth: gpu.target("gbuffer.depth", Format::D32_SFLOAT, w, h)?,
            normal: gpu.target("gbuffer.normal", FLOAT, w, h)?,
            albedo: image("gbuffer.albedo", HALF)?,
            specular: image("gbuffer.specular", HALF)?,
            element: plan.elements().then(|| gpu.target("gbuffer.element", Format::R32G32_UINT, w, h)).transpose()?,
            coat: plan.coated.then(|| gpu.target("gbuffer.coat", COAT, w, h)).transpose()?,
            radiance: image("direct.radiance", FLOAT)?,
            is_second: false,
            arrivals: None,
        })
    }

    /// Creates images that shaders write, for second surfaces of pixels.
    ///
    /// # Errors
    /// As `new`.
    pub(super) fn written(gpu: &Device, plan: &Plan, size: [u32; 2]) -> Result<Self> {
        let image = |name, format| gpu.image(&ImageDesc { name, format, size, extent: Extent::Plane, storage: true });
        Ok(Self {
            size,
            depth: image("edges.depth", Format::R32_SFLOAT)?,
            normal: image("edges.normal", FLOAT)?,
            albedo: image("edges.albedo", HALF)?,
            specular: image("edges.specular", HALF)?,
            element: plan.elements().then(|| image("edges.element", Format::R32G32_UINT)).transpose()?,
            coat: plan.coated.then(|| image("edges.coat", COAT)).transpose()?,
            radiance: image("edges.radiance", FLOAT)?,
            is_second: true,
            arrivals: plan.light_rays.then(|| Arrivals::new(gpu, "edges", size)).transpose()?,
        })
    }

    /// Creates a pipeline that covers all pixels and adds to their radiance.
    ///
    /// # Errors
    /// Fails if the driver rejects the shaders.
    pub(super) fn adding(gpu: &Device, fragment: &'static str, constants: &[u32]) -> Result<Pipeline> {
        Self::adding_over(gpu, "screen.vert", fragment, constants)
    }

    /// Creates a pipeline that adds to the radiance of the pixels that this vertex shader covers.
    ///
    /// # Errors
    /// As `adding`.
    pub(super) fn adding_over(
        gpu: &Device,
        vertex: &'static str,
        fragment: &'static str,
        constants: &[u32],
    ) -> Result<Pipeline> {
        gpu.raster(&Raster {
            vertex,
            fragment: Some(fragment),
            shape: Shape::Triangles,
            streams: &[],
            colors: &[FLOAT],
            blend: Blend::Add,
            depth: Depth::None,
            cull: Cull::None,
            multisampled: false,
            constants,
        })
    }

    /// The images that a surface draw fills, in the order of the shader's outputs. `of_layer` is the additional image
    /// of layers.
    pub(super) fn targets<'a>(&'a self, of_layer: Option<&'a Image>) -> impl Iterator<Item = &'a Image> {
        let images = [&self.normal, &self.albedo, &self.specular, &self.radiance];
        images.into_iter().chain(&self.element).chain(of_layer).chain(&self.coat)
    }

    /// The whole picture: corner and size \[pixels\].
    pub fn area(&self) -> [u32; 4] {
        [0, 0, self.size[0], self.size[1]]
    }
}

/// The formats of `Surface::targets`.
fn targets(plan: &Plan, of_layer: Option<Format>) -> Vec<Format> {
    let element = plan.elements().then_some(Format::R32G32_UINT);
    let coat = plan.coated.then_some(COAT);
    [FLOAT, HALF, HALF, FLOAT].into_iter().chain(element).chain(of_layer).chain(coat).collect()
}

/// Whether the vertex shader passes triangle numbers to pixels.
fn pulls(gpu: &Device, plan: &Plan) -> bool {
    plan.elements() && !gpu.numbers_triangles()
}

/// Creates pipelines that draw the nearest surfaces.
fn surfaces(
    (gpu, world): (&Device, &World),
    plan: &Plan,
    (points, averaged): (u32, bool),
    fragment: &'static str,
    colors: &[Format],
) -> Result<ByKind> {
    let (vertex, streams): (_, &[_]) =
        if pulls(gpu, plan) { ("mesh_pulled.vert", &[]) } else { ("mesh.vert", &[VERTEX]) };
    let damped = u32::from(plan.antialiasing.points() > 0);
    let inside = if plan.inside { 1 + u32::from(plan.brute_force) } else { 0 };
    world.by_kind(|kind| {
        gpu.raster(&Raster {
            vertex,
            fragment: Some(fragment),
            shape: Shape::Triangles,
            streams,
            colors,
            blend: Blend::Replace,
            depth: Depth::Nearest,
            cull: Cull::Back,
            multisampled: false,
            constants: &[kind, points, damped, inside, averaged.into()],
        })
    })
}

/// Draws every opaque surface once. Double-sided surfaces have separate triangles for both sides.
pub struct GBuffer {
    /// Draws the depth of surfaces without holes first, so that hidden surfaces are not shaded. Only where this is
    /// likely to be faster. It changes no bit.
    depth: Option<ByKind>,
    draw: ByKind,
}

impl GBuffer {
    /// Creates the pipelines for pictures of this size.
    ///
    /// # Errors
    /// Fails if the device runs out of memory or the driver rejects the shaders.
    pub fn new(gpu: &Device, world: &World, plan: &Plan, [width, height]: [u32; 2]) -> Result<Self> {
        let name = match (plan.elements(), pulls(gpu, plan), plan.coated) {
            (false, _, false) => "gbuffer.frag",
            (false, _, true) => "gbuffer_coat.frag",
            (true, false, false) => "gbuffer_elements.frag",
            (true, false, true) => "gbuffer_elements_coat.frag",
            (true, true, false) => "gbuffer_pulled.frag",
            (true, true, true) => "gbuffer_pulled_coat.frag",
        };
        // Where triangles outnumber pixels, or have no textures, drawing them twice costs more than shading hidden ones.
        let few = world.triangle_count() <= u64::from(width) * u64::from(height);
        let depth = (few && world.has_textures()).then(|| {
            world.by_kind(|_| {
                gpu.raster(&Raster {
                    vertex: "mesh_depth.vert",
                    fragment: None,
                    shape: Shape::Triangles,
                    streams: &[VERTEX_PLACE],
                    colors: &targets(plan, None),
                    blend: Blend::Replace,
                    depth: Depth::Farther,
                    cull: Cull::Back,
                    multisampled: false,
                    constants: &[],
                })
            })
        });
        let textures = (plan.antialiasing.textured_points(), plan.antialiasing == Antialiasing::Fast);
        Ok(Self {
            depth: depth.transpose()?,
            draw: surfaces((gpu, world), plan, textures, name, &targets(plan, None))?,
        })
    }

    /// Creates the pipelines for transparent layers.
    pub(super) fn of_layers(gpu: &Device, world: &World, plan: &Plan) -> Result<ByKind> {
        let name = match (plan.elements(), pulls(gpu, plan), plan.coated) {
            (false, _, false) => "layers.frag",
            (false, _, true) => "layers_coat.frag",
            (true, false, false) => "layers_elements.frag",
            (true, false, true) => "layers_elements_coat.frag",
            (true, true, false) => "layers_pulled.frag",
            (true, true, true) => "layers_pulled_coat.frag",
        };
        // Layers have one point in each picture.
        let points = if plan.antialiasing.points() == 0 { plan.antialiasing.textured_points() } else { 0 };
        surfaces((gpu, world), plan, (points, false), name, &targets(plan, Some(HALF)))
    }

    /// Records the stage for a view.
    pub fn record(&self, cmd: &Cmd<'_>, world: &World, view: &View, surface: &Surface) {
        let colors: Vec<_> = surface.targets(None).map(Attach::clear).collect();
        let attachments =
            Attachments { colors: &colors, depth: Some(Attach::clear(&surface.depth)), area: surface.area() };
        cmd.render(&attachments, |draw| {
            if let Some(depth) = &self.depth {
                world.draw(draw, depth, Which::Whole, view.clip_from_world, view.eye);
            }
            world.draw(draw, &self.draw, Which::Solid, view.clip_from_world, view.eye);
        });
    }
}
