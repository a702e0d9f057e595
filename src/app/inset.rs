//! Insets: small pictures in a corner of the picture, of images from which the light is computed.

use glam::Vec4;
use lightskin::Result;
use lightskin::frame::rsm::RsmCopy;
use lightskin::frame::world::lights::LightInfo;
use lightskin::frame::{Engine, Picture, View, World};
use lightskin::gpu::{Bind, Buffer, Cmd, Extent, Format, Gpu, Image, ImageDesc, Pipeline, Use};
use lightskin::shared::{DEPTH_IMAGE_SIDE, LAYER_DEPTH, LAYER_DIRECTION, LAYER_REFLECTANCE, NearestCache, NearestPush};

/// What is shown of a light's maps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Map {
    /// Nothing.
    #[default]
    Off,
    /// Depth of the shadow map.
    Shadow,
    /// Depth of the reflective shadow map.
    Depth,
    /// Its normals.
    Normal,
    /// Its albedo.
    Albedo,
}

/// Ratio of the distances at the two ends of an inset's false colours.
const RANGE: f32 = 20.0;

/// A square part of an image, and how it is shown.
pub(super) struct Inset<'a> {
    pub(super) image: &'a Image,
    /// First column and row of the part [texels].
    pub(super) first: [u32; 2],
    /// Side of the part [texels].
    pub(super) side: u32,
    /// A `LAYER_*`.
    pub(super) how: u32,
    /// As `LayerPush::depth`.
    pub(super) depth: Vec4,
    /// Distances at the two ends of the false colours [m].
    pub(super) scale: [f32; 2],
    /// Corner and side in the window [pixels].
    pub(super) place: [u32; 3],
}

/// The search for the cache nearest to the pointer.
struct Nearest {
    search: Pipeline,
    found: Buffer,
    /// Copy of the cache's depth image.
    image: Image,
}

/// The insets, and what they show.
pub(super) struct Insets {
    /// Shown map of a light, its index, and the view of the light.
    pub(super) map: Map,
    pub(super) light: usize,
    pub(super) view: u32,
    /// Whether the depth image of the cache nearest to the pointer is shown.
    pub(super) depth_image: bool,
    /// Last position of the pointer over the picture, from 0 at the top left to 1.
    pub(super) pointer: [f32; 2],
    /// The cache that was found in the last frame.
    pub(super) found: Option<NearestCache>,
    /// Corner and side in the window [pixels] of the map and the depth image.
    pub(super) places: [[u32; 3]; 2],
    /// Sides of both [texels] for which they were placed. `None` without the image.
    pub(super) sides: [Option<u32>; 2],
    rsm: Option<RsmCopy>,
    nearest: Option<Nearest>,
}

impl Default for Insets {
    fn default() -> Self {
        Self {
            map: Map::Off,
            light: 0,
            view: 0,
            depth_image: false,
            pointer: [0.5; 2],
            found: None,
            places: [[0; 3]; 2],
            sides: [None; 2],
            rsm: None,
            nearest: None,
        }
    }
}

impl Insets {
    /// The light whose map is shown, with its index and view. `None` if there are no lights.
    pub(super) fn chosen<'a>(&self, world: &'a World) -> Option<(usize, &'a LightInfo, u32)> {
        let light = self.light.min(world.lights().len().checked_sub(1)?);
        let info = &world.lights()[light];
        Some((light, info, self.view.min(info.views - 1)))
    }

    /// Side of the shown map [texels], or why there is none.
    pub(super) fn map_side(&self, engine: &Engine) -> std::result::Result<u32, &'static str> {
        let (world, light) = (engine.world(), engine.light());
        let (index, info, _) = self.chosen(world).ok_or("There is no light.")?;
        if self.map == Map::Shadow {
            let map = light.direct.as_ref().and_then(|direct| direct.shadow_map(world, index));
            let map =
                map.ok_or("This light keeps no shadow map: its shadows are traced, or all lights share one map.")?;
            return Ok(info.shadow_size(map.width));
        }
        let rsm = light.rsm.as_ref().ok_or("There is no indirect light, and so no reflective shadow map.")?;
        if !rsm.draws(world, index) {
            return Err("This light has no reflective shadow map: rays or caches take its place.");
        }
        Ok(info.rsm_size(rsm.depth.width))
    }

    /// Side of the depth image [texels], or why there is none.
    pub(super) fn depth_image_side(engine: &Engine) -> std::result::Result<u32, &'static str> {
        let caches = engine.light().caches().ok_or("No depth image: no caches light the picture.")?;
        let images = caches.gather.depth_images();
        images.map(|_| DEPTH_IMAGE_SIDE).ok_or("No depth image: only GI shadows per virtual light need them.")
    }

    /// Sides of the map and the depth image [texels], as far as they are shown.
    fn sides_now(&self, engine: &Engine) -> [Option<u32>; 2] {
        let map = Some(()).filter(|()| self.map != Map::Off).and_then(|()| self.map_side(engine).ok());
        let depth_image = Some(()).filter(|()| self.depth_image).and_then(|()| Self::depth_image_side(engine).ok());
        [map, depth_image]
    }

    /// Creates what the insets need and drops the rest, for a window of this size [pixels]. Returns whether they must be
    /// placed again, because light or settings have changed since.
    pub(super) fn fit(&mut self, gpu: &Gpu, engine: &Engine, window: [u32; 2]) -> Result<bool> {
        let sides = self.sides_now(engine);
        for (place, side) in self.places.iter_mut().zip(sides) {
            let [left, top, size] = *place;
            if side.is_none() || left + size > window[0] || top + size > window[1] {
                *place = [0; 3];
            }
        }
        let [shows_map, shows_depth_image] = self.places.map(|[.., side]| side > 0);
        let rsm = engine.light().rsm.as_ref().filter(|_| shows_map && self.map != Map::Shadow);
        self.rsm = match (self.rsm.take(), rsm) {
            (Some(copy), Some(rsm)) if copy.fits(rsm) => Some(copy),
            (_, rsm) => rsm.map(|rsm| RsmCopy::new(gpu, rsm)).transpose()?,
        };
        if !shows_depth_image {
            (self.nearest, self.found) = (None, None);
        } else if self.nearest.is_none() {
            self.nearest = Some(Nearest::new(gpu)?);
        }
        Ok(sides != self.sides)
    }

    /// Drops everything on the device.
    pub(super) fn leave_device(&mut self) {
        (self.rsm, self.nearest, self.found) = (None, None, None);
    }

    /// Records the passes that make the images, after the picture's own.
    pub(super) fn record(&mut self, cmd: &Cmd<'_>, engine: &Engine, (view, picture): (&View, &Picture)) {
        if self.rsm.is_none() && self.nearest.is_none() {
            return;
        }
        let _zone = cmd.zone("insets");
        let chosen = self.chosen(engine.world());
        if let (Some(copy), Some(rsm), Some((light, _, view))) = (&mut self.rsm, &engine.light().rsm, chosen)
            && copy.record(cmd, engine.world(), rsm, (light, view))
        {
            cmd.barrier(Use::ColorWrite | Use::DepthWrite, Use::FragmentRead);
        }
        if let Some(nearest) = &self.nearest {
            nearest.record(cmd, engine, (view, picture), self.pointer);
        }
    }

    /// Reads which cache the last frame has found; waits for the device. Returns whether it is another one.
    pub(super) fn read(&mut self, gpu: &Gpu) -> Result<bool> {
        let Some(nearest) = &self.nearest else { return Ok(false) };
        let found = gpu.read::<NearestCache>(&nearest.found)?.into_iter().find(|found| found.number > 0);
        Ok(std::mem::replace(&mut self.found, found) != found)
    }

    /// Distances at the two ends of an inset's false colours, of which `far` is the larger [m].
    pub(super) fn scale(far: f32) -> [f32; 2] {
        [far / RANGE, far]
    }

    /// The insets to draw. Each has a place.
    pub(super) fn drawn<'a>(&'a self, engine: &'a Engine) -> Vec<Inset<'a>> {
        let of_cache = self.nearest.as_ref().map(|nearest| Inset {
            image: &nearest.image,
            first: [0, 0],
            side: DEPTH_IMAGE_SIDE,
            how: LAYER_DEPTH,
            // Its values are reciprocal distances.
            depth: Vec4::new(1.0, 0.0, 0.0, 1.0),
            scale: Self::scale(farthest(engine.world())),
            place: self.places[1],
        });
        self.map(engine).into_iter().chain(of_cache).filter(|inset| inset.place[2] > 0).collect()
    }

    /// The shown map of a light.
    fn map<'a>(&'a self, engine: &'a Engine) -> Option<Inset<'a>> {
        let world = engine.world();
        let (index, info, view) = self.chosen(world)?;
        let side = self.map_side(engine).ok()?;
        let (image, first, how) = match (self.map, &self.rsm) {
            (Map::Shadow, _) => {
                let image = engine.light().direct.as_ref()?.shadow_map(world, index)?;
                (image, info.tile(view).map(|tile| tile * side), LAYER_DEPTH)
            }
            (Map::Depth, Some(rsm)) => (&rsm.depth, [0, 0], LAYER_DEPTH),
            (Map::Normal, Some(rsm)) => (&rsm.normal, [0, 0], LAYER_DIRECTION),
            (Map::Albedo, Some(rsm)) => (&rsm.albedo, [0, 0], LAYER_REFLECTANCE),
            _ => return None,
        };
        let (depth, far) = distance_by_depth(world, info.first_view + view);
        Some(Inset { image, first, side, how, depth, scale: Self::scale(far), place: self.places[0] })
    }
}

/// Distance at the upper end of a depth image's false colours [m].
pub(super) fn farthest(world: &World) -> f32 {
    2.0 * world.radius as f32
}

/// The value of `LayerPush::depth` for a view of a light, and the farthest distance in it [m]. Distances are those from
/// the plane through the light, or for parallel light from where the scene begins.
pub(super) fn distance_by_depth(world: &World, view: u32) -> (Vec4, f32) {
    let clip_from_world = world.clip_from_world(view);
    let (depth, w) = (clip_from_world.row(2), clip_from_world.row(3));
    let slope = depth.truncate().length();
    if slope > 0.0 {
        return (Vec4::new(1.0 / slope, -1.0 / slope, 1.0, 0.0), 1.0 / slope);
    }
    let radius = world.radius as f32;
    (Vec4::new(depth.w, 0.0, 0.0, 1.0), (w.w + radius).max(0.01 * radius))
}

impl Nearest {
    fn new(gpu: &Gpu) -> Result<Self> {
        Ok(Self {
            search: gpu.compute("nearest_cache.comp", &[])?,
            found: gpu.buffer("window.nearest_cache", size_of::<NearestCache>() as u64)?,
            image: gpu.image(&ImageDesc {
                name: "window.depth_image",
                format: Format::R32_SFLOAT,
                size: [DEPTH_IMAGE_SIDE; 2],
                extent: Extent::Plane,
                storage: true,
            })?,
        })
    }

    fn record(&self, cmd: &Cmd<'_>, engine: &Engine, (view, picture): (&View, &Picture), at: [f32; 2]) {
        let Some(caches) = engine.light().caches() else { return };
        let (Some(live), Some(images)) = (caches.gather.live(), caches.gather.depth_images()) else { return };
        let size = picture.size();
        let [column, row] = [0, 1].map(|i| ((at[i] * size[i] as f32) as u32).min(size[i] - 1));
        cmd.clear(&self.found);
        // Also: caches, their list, their images and surfaces -> here.
        let from = Use::CopyWrite | Use::ComputeWrite | Use::ColorWrite | Use::DepthWrite;
        cmd.barrier(from, Use::ComputeRead | Use::ComputeWrite);
        let lists = [&caches.atlas.caches, &live.list, &live.args, &images.buffer].map(Bind::from);
        let pictures = [&picture.surface.depth, &picture.surface.normal, &self.image].map(Bind::from);
        let mut resources = lists.to_vec();
        resources.extend(pictures);
        resources.push((&self.found).into());
        cmd.bind(&self.search, &resources);
        let are_planes = images.are_traced().into();
        cmd.push(&NearestPush { world_from_clip: view.world_from_clip, column, row, are_planes });
        cmd.dispatch(1, 1, 1);
        cmd.barrier(Use::ComputeWrite, Use::FragmentRead);
    }
}
