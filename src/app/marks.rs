//! Marks over the picture: caches and virtual lights as discs, proxy lights as lines.

use super::canvas::Scenery;
use lightskin::Result;
use lightskin::frame::View;
use lightskin::frame::caches::CacheLight;
use lightskin::frame::vals::Vals;
use lightskin::gpu::{Blend, Cull, Depth, Draw, Format, Gpu, Pipeline, Raster, Shape};
use lightskin::shared::{MARK_DARK, MARK_HUE, MARK_LIGHT, MARK_RIMMED, MarkPush};

/// Radius of a disc, in radii of the area that it stands for.
const DISC: f32 = 0.4;

/// Length of a line, in radii of its cache's area.
const LINE: f32 = 1.5;

/// How caches are shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Discs {
    /// Not at all.
    #[default]
    Off,
    /// In arbitrary colours.
    Hues,
    /// Live ones by their diffuse light.
    Light,
    /// Live ones in arbitrary colours, others dark.
    Live,
}

/// The marks that are shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Marks {
    /// Caches as discs.
    pub(super) caches: Discs,
    /// Diffuse proxy lights as lines.
    pub(super) proxies: bool,
    /// Virtual lights as discs.
    pub(super) vals: bool,
}

impl Marks {
    /// Whether anything is shown.
    pub(super) fn any(self) -> bool {
        self != Self::default()
    }
}

/// Draws marks.
pub(super) struct Marker {
    discs: Pipeline,
    val_discs: Pipeline,
    lines: Pipeline,
}

impl Marker {
    /// Creates pipelines for an image of this format.
    pub(super) fn new(gpu: &Gpu, format: Format) -> Result<Self> {
        let pass = |vertex, shape| {
            gpu.raster(&Raster {
                vertex,
                fragment: Some("marks.frag"),
                shape,
                streams: &[],
                colors: &[format],
                blend: Blend::Replace,
                depth: Depth::None,
                cull: Cull::None,
                multisampled: false,
                constants: &[],
            })
        };
        Ok(Self {
            discs: pass("discs.vert", Shape::Triangles)?,
            val_discs: pass("val_discs.vert", Shape::Triangles)?,
            lines: pass("lines.vert", Shape::Lines)?,
        })
    }

    /// Draws the marks of the last frame's light. The drawn area must be the picture's.
    pub(super) fn draw(&self, draw: &Draw<'_, '_>, scenery: &Scenery<'_>) {
        let (marks, Some(light)) = (scenery.marks, scenery.light) else { return };
        if let Some(caches) = light.caches() {
            let discs: &[_] = match marks.caches {
                Discs::Off => &[],
                Discs::Hues => &[(MARK_HUE, false)],
                Discs::Light => &[(MARK_LIGHT, true)],
                Discs::Live => &[(MARK_DARK, false), (MARK_HUE, true)],
            };
            for (how, live) in discs {
                self.draw_caches(draw, scenery, caches, (&self.discs, 3), &push(scenery, DISC, *how, *live));
            }
            if marks.proxies {
                self.draw_caches(draw, scenery, caches, (&self.lines, 2), &push(scenery, LINE, MARK_RIMMED, true));
            }
        }
        if let (true, Some(vals)) = (marks.vals, light.vals()) {
            self.draw_vals(draw, scenery, vals);
        }
    }

    fn draw_caches(
        &self,
        draw: &Draw<'_, '_>,
        scenery: &Scenery<'_>,
        CacheLight { atlas, gather, proxies, .. }: &CacheLight,
        (pipeline, vertices): (&Pipeline, u32),
        push: &MarkPush,
    ) {
        let Some(live) = gather.live().filter(|_| atlas.count > 0) else { return };
        let (depth, exposure) = (&scenery.picture.surface.depth, &scenery.picture.output.exposure);
        let (list, args) = (&live.list, &live.args);
        let of_lights = [list, args, &proxies.buffer].map(Into::into);
        draw.bind(pipeline, &[&[(&atlas.caches).into(), depth.into(), exposure.into()], &of_lights[..]].concat());
        draw.push(push);
        draw.draw(vertices * atlas.count);
    }

    fn draw_vals(&self, draw: &Draw<'_, '_>, scenery: &Scenery<'_>, vals: &Vals) {
        let (depth, exposure) = (&scenery.picture.surface.depth, &scenery.picture.output.exposure);
        draw.bind(&self.val_discs, &[(&vals.live).into(), depth.into(), exposure.into(), (&vals.live_count).into()]);
        draw.push(&push(scenery, DISC, MARK_RIMMED, true));
        draw.draw(3 * vals.count);
    }
}

fn push(scenery: &Scenery<'_>, size: f32, how: u32, live: bool) -> MarkPush {
    let (View { clip_from_world, eye, .. }, [left, top]) = (scenery.view, scenery.corner);
    let pixel = 2.0 / (clip_from_world.row(1).truncate().length() * scenery.picture.size()[1] as f32);
    let (live, tonemap) = (live.into(), scenery.look.tonemap as u32);
    MarkPush { clip_from_world, eye, size, pixel, how, live, tonemap, left, top }
}
