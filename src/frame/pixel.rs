//! Debug view: where the light of one pixel comes from. Its direct light by sources, and the caches that it averages.

use super::gbuffer::Surface;
use super::light::Light;
use super::picture::Picture;
use super::settings::{Indirect, Interpolation};
use super::view::View;
use super::world::World;
use crate::error::Result;
use crate::gpu::{Attach, Attachments, Bind, Extent, Format, Gpu, ImageDesc, Use};
use crate::shared::{PixelCache, PixelPush};
use glam::{Mat4, Vec2, Vec3};

/// Rays of pixels within 6 pixels count at soft shadow edges; tiles of rays have 8 x 8.
const TILE: u32 = 8;

/// Width of the image that collects the light of each source \[texels\].
const ROW: u32 = 1024;

/// The light of a pixel, by its sources. Transparent layers in front of it are left out.
pub struct PixelLight {
    /// Radiance [cd/m^2] that the surface reflects of each light's direct light, in the order of `World::lights`.
    pub lights: Vec<Vec3>,
    /// The caches that the pixel averages, heaviest first.
    pub caches: Vec<PixelCache>,
}

impl PixelLight {
    /// Finds the light of a pixel of the last frame's first view, given by column and row. Waits for the device. Finds
    /// nothing if light or picture no longer fit the world.
    ///
    /// # Errors
    /// Fails if the device runs out of memory or is lost.
    ///
    /// # Panics
    /// Panics if the picture has no such pixel.
    pub fn find(
        gpu: &Gpu,
        (world, light): (&World, &Light),
        (view, picture): (&View, &Picture),
        at: [u32; 2],
    ) -> Result<Self> {
        let size = picture.surface.size;
        if !light.fits(world) || !picture.fits(world, light) {
            return Ok(Self { lights: Vec::new(), caches: Vec::new() });
        }
        assert!(at[0] < size[0] && at[1] < size[1], "pixel {at:?} of {size:?}");
        Ok(Self {
            lights: lights(gpu, (world, light), (view, &picture.surface), at)?,
            caches: caches(gpu, (world, light), (view, picture), at)?,
        })
    }
}

/// Draws stage 2 again for each light alone, on the surroundings of the pixel.
fn lights(
    gpu: &Gpu,
    (world, light): (&World, &Light),
    (view, surface): (&View, &Surface),
    at: [u32; 2],
) -> Result<Vec<Vec3>> {
    let count = world.lights().len();
    let Some(direct) = light.direct.as_ref().filter(|_| count > 0) else { return Ok(Vec::new()) };
    let corner = at.map(|i| (i / TILE).saturating_sub(1) * TILE);
    let size = [0, 1].map(|i| (surface.size[i] - corner[i]).min(3 * TILE));
    let around = Surface::new(gpu, &light.plan, size)?;
    let sums = gpu.image(&ImageDesc {
        name: "pixel.lights",
        format: Format::R32G32B32A32_SFLOAT,
        size: [ROW.min(count as u32), (count as u32).div_ceil(ROW)],
        extent: Extent::Plane,
        storage: false,
    })?;
    let within = [0, 1].map(|i| at[i] - corner[i]);
    let part = part(view, surface.size, corner, size);
    gpu.run_once("light of a pixel", |cmd| {
        let fixed = [&surface.depth, &surface.normal, &surface.albedo, &surface.specular];
        let pairs = fixed.into_iter().zip([&around.depth, &around.normal, &around.albedo, &around.specular]);
        for (from, to) in pairs.chain(surface.coat.iter().zip(&around.coat)) {
            cmd.copy_part(from, corner, size, to, [0, 0]);
        }
        for i in 0..count {
            let anew = Attachments { colors: &[Attach::clear(&around.radiance)], depth: None, area: around.area() };
            cmd.render(&anew, |_| ());
            // Copies, and the passes of the last light -> this light's.
            let done = Use::CopyWrite | Use::ColorWrite | Use::FragmentRead | Use::ComputeRead | Use::IndirectRead;
            let next = Use::ColorWrite | Use::FragmentRead | Use::ComputeRead | Use::ComputeWrite | Use::CopyWrite;
            cmd.barrier(done | Use::VertexRead, next | Use::DepthWrite);
            direct.record_light(cmd, world, i, std::iter::once((&part, &around)));
            cmd.barrier(Use::ColorWrite, Use::CopyRead);
            let place = [i as u32 % ROW, i as u32 / ROW];
            cmd.copy_part(&around.radiance, within, [1, 1], &sums, place);
            cmd.barrier(Use::CopyRead, Use::ColorWrite);
        }
    })?;
    let sums: Vec<[f32; 4]> = gpu.read_image(&sums)?;
    Ok(sums.iter().take(count).map(|sum| Vec3::from_slice(sum)).collect())
}

/// The view of a part of a picture, given by its corner and size \[pixels\].
fn part(view: &View, whole: [u32; 2], corner: [u32; 2], size: [u32; 2]) -> View {
    let float = |v: [u32; 2]| Vec2::new(v[0] as f32, v[1] as f32);
    let share = float(size) / float(whole);
    let middle = (2.0 * float(corner) + float(size)) / float(whole) - 1.0;
    let whole_from_part = Mat4::from_translation(middle.extend(0.0)) * Mat4::from_scale(share.extend(1.0));
    View {
        clip_from_world: whole_from_part.inverse() * view.clip_from_world,
        world_from_clip: view.world_from_clip * whole_from_part,
        ..*view
    }
}

/// Lists the caches of a pixel.
fn caches(
    gpu: &Gpu,
    (world, light): (&World, &Light),
    (view, picture): (&View, &Picture),
    at: [u32; 2],
) -> Result<Vec<PixelCache>> {
    let (Some(of_caches), Some(visible), Some(element)) = (light.caches(), &picture.visible, &picture.surface.element)
    else {
        return Ok(Vec::new());
    };
    let printed = match light.settings().indirect {
        Indirect::Caches(settings) => u32::from(settings.interpolation == Interpolation::Printed),
        _ => return Ok(Vec::new()),
    };
    let references = world.references_each as u32;
    let by_cells = world.cells.is_some();
    let name = if by_cells { "pixel_caches_cells.comp" } else { "pixel_caches.comp" };
    let pass = gpu.compute(name, &[])?;
    let most = references as usize * if by_cells { 1 } else { 3 };
    let found = gpu.buffer_from("pixel.caches", &vec![PixelCache::default(); most])?;
    let lists = [&world.draw_records, &world.references, world.indices(), &world.instances, &world.corners];
    let rows = by_cells.then_some(&visible.slots);
    let lit = [&of_caches.atlas.caches, &of_caches.proxies.buffer, &found];
    let mut resources = vec![Bind::from(element)];
    resources.extend(lists.into_iter().chain(rows).chain(lit).map(Bind::from));
    gpu.run_once("caches of a pixel", |cmd| {
        cmd.bind(&pass, &resources);
        let reach = world.cells.as_ref().map_or(0.0, |cells| cells.reach as f32);
        let View { clip_from_world, eye, .. } = *view;
        cmd.push(&PixelPush { clip_from_world, eye, reach, references, printed, column: at[0], row: at[1] });
        cmd.dispatch(1, 1, 1);
    })?;
    let mut merged: Vec<PixelCache> = Vec::new();
    for cache in gpu.read::<PixelCache>(&found)?.into_iter().filter(|cache| cache.number > 0) {
        match merged.iter_mut().find(|other| other.number == cache.number) {
            Some(other) => {
                other.weight += cache.weight;
                other.irradiance += cache.irradiance;
            }
            None => merged.push(cache),
        }
    }
    merged.sort_by(|a, b| b.weight.total_cmp(&a.weight));
    Ok(merged)
}
