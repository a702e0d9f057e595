//! Records one frame: finds the outdated parts, then runs the stages in order.

use super::brute_force::{BruteForce, blocks};
use super::gather::{Gather, Lit, SeenSky};
use super::interpolate::Shaded;
use super::light::{IndirectLight, Light};
use super::picture::Picture;
use super::plan::{self, STAGES};
use super::rsm::Rsm;
use super::settings::Look;
use super::view::View;
use super::world::World;
use crate::gpu::{Cmd, Use};
use std::ops::Range;

/// How much of a frame to record for a submission.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Part {
    /// The whole frame.
    Whole,
    /// All stages before brute force.
    Before,
    /// Brute force in these blocks of pixels; see `brute_force::blocks`. The last block includes all stages after it.
    Blocks(Range<u32>),
}

/// Records one frame of all given views. The numbers in the code are METHOD's stages. A stage that the scene does not
/// need is `None`; a stage whose inputs have not changed is not outdated. Light is computed once for all views; each
/// view adds only the cost of its own surfaces, its shading and its share of the glossy lobe. If no view has pixels,
/// nothing is recorded.
///
/// # Panics
/// Panics if light or pictures were not fitted after a change of the world, the settings or the number of views.
pub fn record(cmd: &Cmd<'_>, world: &World, light: &mut Light, views: &mut [(View, &mut Picture)], look: &Look) {
    record_part(cmd, world, light, views, look, &Part::Whole);
}

/// Records a part of a frame, so that input can be handled between the parts of a slow one. `Before` and then all
/// blocks together give the bits of `Whole`. The inputs of the pictures must not change between the parts. Light of
/// caches belongs to `Before`.
///
/// # Panics
/// As `record`.
pub fn record_part(
    cmd: &Cmd<'_>,
    world: &World,
    light: &mut Light,
    views: &mut [(View, &mut Picture)],
    look: &Look,
    part: &Part,
) {
    assert!(
        light.fits(world) && views.len() <= light.eyes(),
        "the light does not fit the world or the views: call Light::fit"
    );
    assert!(views.iter().all(|(_, p)| p.fits(world, light)), "a picture does not fit the light: call Picture::fit");
    if views.iter().all(|(_, picture)| picture.is_empty()) {
        light.ran = 0;
        return;
    }
    let whole = *part == Part::Whole;
    let all = views.iter().map(|(_, picture)| blocks(picture.size())).max().unwrap_or(0);
    light.ran = 0;
    if !matches!(part, Part::Blocks(_)) {
        find_outdated(world, light, views, look);
        light.ran |= record_start(cmd, world, light, views);
    }
    let lit = match part {
        Part::Before => return,
        Part::Whole => 0..all,
        Part::Blocks(blocks) => blocks.clone(),
    };
    light.ran |= record_brute_force(cmd, light, views, (&lit, whole));
    if lit.end >= all {
        light.ran |= record_end(cmd, world, light, views, look, whole);
    }
}

/// Records all stages before brute force. Returns which ran, by their bits.
fn record_start(cmd: &Cmd<'_>, world: &World, light: &Light, views: &[(View, &mut Picture)]) -> u32 {
    let mut ran = 0;
    let mut enter = |stage: usize| {
        ran |= 1 << stage;
        cmd.zone(STAGES[stage].name)
    };
    let shown = || views.iter().map(|(view, picture)| (view, &**picture)).filter(|(_, picture)| !picture.is_empty());
    let drawn = || shown().filter(|(_, p)| p.outdated.surface);
    let surfaces = || drawn().flat_map(|(view, p)| p.surfaces().map(move |surface| (view, surface)));
    let some_surface = surfaces().next().is_some();
    let outdated = &light.outdated;

    if let (true, Some(poses), Some(refit)) = (world.record_changes(cmd), &light.poses, &light.refit) {
        poses.record(cmd, world); // deformed meshes, before all stages
        cmd.barrier(Use::ComputeWrite, Use::VertexInput | Use::VertexRead | Use::ComputeRead);
        refit.record(cmd, world);
    }
    if some_surface {
        let _zone = enter(plan::GBUFFER); // 1
        for (view, picture) in drawn() {
            picture.gbuffer.record(cmd, world, view, &picture.surface);
        }
    }
    if drawn().any(|(_, p)| p.edges.is_some()) {
        let _zone = enter(plan::EDGES); // 1
        for (view, picture) in drawn() {
            if let Some(edges) = &picture.edges {
                edges.record(cmd, world, view, (&picture.gbuffer, &picture.surface));
            }
        }
    }
    if drawn().any(|(_, p)| p.layers.is_some()) {
        let _zone = enter(plan::LAYERS); // 1
        for (view, picture) in drawn() {
            if let Some(layers) = &picture.layers {
                layers.record(cmd, world, view, &picture.surface);
            }
        }
    }
    let lit = || drawn().flat_map(|(view, p)| p.lit().map(move |surface| (view, surface)));
    if let (true, Some(direct)) = (some_surface, &light.direct) {
        let _zone = enter(plan::DIRECT); // 2
        direct.record(cmd, world, |i| outdated.lights[i], lit());
    }
    if let (true, Some(sky), Some((_, picture))) = (some_surface, &world.sky, shown().next())
        && let Some(background) = &picture.background
    {
        let _zone = enter(plan::SKY); // 2
        background.record(cmd, sky, surfaces());
    }
    if let (true, IndirectLight::Caches(caches)) = (outdated.atlas, &light.indirect) {
        let _zone = enter(plan::ATLAS); // 3
        caches.atlas.record(cmd, world);
        if let Some(hidden) = &caches.hidden {
            hidden.record(cmd, world, &caches.atlas);
        }
    }
    if let (true, Some(rsm)) = (outdated.vals, &light.rsm) {
        let live = light.caches().and_then(|caches| caches.gather.live());
        {
            let _zone = enter(plan::RSM); // 4
            rsm.record(cmd, world, |i| outdated.lights[i], outdated.emitters, live);
        }
        if let Some(Gather::Clusters(by)) = light.caches().map(|caches| &caches.gather) {
            let _zone = enter(plan::PYRAMID); // 4, its end
            by.pyramid.record(cmd, &rsm.vals);
        }
    }
    if let (IndirectLight::Caches(caches), Some(rsm)) = (&light.indirect, &light.rsm) {
        let seen = || {
            let outdated = shown().filter(|(_, p)| p.outdated.visible);
            outdated.flat_map(|(view, p)| p.lists().map(move |(surface, list)| (view, surface, list)))
        };
        if seen().next().is_some() {
            let _zone = enter(plan::VISIBLE); // 5
            let listed = seen().filter_map(|(view, surface, list)| Some((view, surface.element.as_ref()?, list)));
            caches.visible.record(cmd, world, listed);
        }
        if let (true, Some(cull)) = (outdated.cull, &caches.cull) {
            let _zone = enter(plan::CULL); // 5
            if seen().next().is_some() {
                cmd.barrier(Use::ComputeWrite, Use::IndirectRead | Use::ComputeRead); // visible vertices -> here
            }
            let lists = shown().flat_map(|(_, p)| p.lists()).map(|(_, list)| list);
            cull.record(cmd, world, lists, &rsm.vals, &caches.gather);
        }
        if some_surface || outdated.atlas || outdated.vals || outdated.cull {
            cmd.barrier(
                Use::ComputeWrite | Use::DepthWrite,
                Use::ComputeRead | Use::IndirectRead | Use::VertexRead | Use::FragmentRead | Use::DepthRead,
            ); //   VALs, atlas, live caches -> 6
        }
        if let (true, Some(images), Some(live)) =
            (outdated.depth_images, caches.gather.depth_images(), caches.gather.live())
        {
            let _zone = enter(plan::DEPTH_IMAGES); // 6
            images.record(cmd, world, &caches.atlas, live);
            cmd.barrier(Use::ComputeWrite, Use::ComputeRead);
        }
        if let (true, Some((caches_sky, _)), Some(sky)) = (outdated.sky, &caches.sky, &world.sky_light) {
            let _zone = enter(plan::SKY_SEEN); // 6
            caches_sky.record(cmd, (world, sky), &caches.atlas, caches.gather.sent_on());
        }
        if outdated.proxies {
            let eyes: Vec<_> = views.iter().map(|(view, _)| view.eye).collect();
            let (atlas, proxies) = (&caches.atlas, &caches.proxies);
            {
                let _zone = enter(plan::GATHER); // 6
                let albedos = world.cache_albedos();
                let sky = caches.sky.as_ref().zip(world.sky_light.as_ref()).map(|((of_caches, _), sky)| {
                    let (seen, open) = (&of_caches.seen, &of_caches.open);
                    SeenSky { seen, open, texels: &sky.texels, levels: &sky.levels }
                });
                caches.gather.record(cmd, &Lit { vals: &rsm.vals, atlas, proxies, eyes: &eyes, albedos, sky });
            }
            if let Some(occlude) = &caches.occlude {
                let _zone = enter(plan::OCCLUDE); // 7
                occlude.record(cmd, atlas, caches.gather.live(), proxies, eyes.len());
            }
        }
        if let (true, Some(near)) = (some_surface || outdated.proxies, &caches.near) {
            let _zone = enter(plan::NEAR); // 8
            let seen = shown().flat_map(|(view, p)| p.near().map(move |(surface, near)| (view, surface, near)));
            if let Some(far) = caches.gather.radiances().zip(caches.gather.guides()) {
                // The barriers for listed elements or drawn RSMs already waited for all images, and the occlusion stage
                // waited for the light that it dims. With cells, no stage reads proxies before the pixels do, unless
                // light enters translucent bodies.
                let listed = shown().any(|(_, p)| p.outdated.visible);
                let drawn = outdated.vals && rsm.lights(world).any(|(i, _)| outdated.lights[i]);
                let read = world.cells.is_none() || caches.occlude.is_none() || caches.inside.is_some();
                let lit = outdated.proxies && read;
                let waits = !(listed || drawn) || lit;
                let of_caches = (
                    caches.gather.cache_vals(),
                    caches.sky.as_ref().map(|(of_caches, _)| [&of_caches.seen, &of_caches.open]),
                );
                near.record(cmd, world, (&caches.atlas.caches, far.into()), of_caches, waits, seen);
            }
        }
        let shaded = || {
            let outdated = views.iter().enumerate().filter(|(_, (_, p))| p.outdated.indirect && !p.is_empty());
            outdated.flat_map(|(eye, (view, p))| {
                let first_proxy = caches.proxies.first(eye as u32);
                let lists = p.lists().zip(p.shaded());
                lists.map(move |((surface, visible), (_, out, near))| Shaded {
                    view,
                    surface,
                    visible,
                    near,
                    out,
                    first_proxy,
                })
            })
        };
        if shaded().next().is_some() {
            let _zone = enter(plan::INTERPOLATE); // 8
            let seen = caches.sky.as_ref().map(|(seen, _)| &seen.seen);
            let near = caches.near.is_some();
            // Stage 6 already waited for the visible vertices. If short rays ran, they waited for everything else.
            let waits = !near && (outdated.proxies || (outdated.sky && caches.sky.is_some()));
            caches.interpolate.record(cmd, world, &caches.atlas, &caches.proxies, (waits, near, seen), shaded());
        }
        // Radiance that is reused from an earlier frame already contains this light.
        let anew = || shaded().filter(|shaded| lit().any(|(_, surface)| std::ptr::eq(surface, shaded.surface)));
        if let (true, Some((seen, shading)), Some(sky)) = (some_surface, &caches.sky, &world.sky_light) {
            let _zone = enter(plan::SKY_LIGHT); // 8
            shading.record(cmd, (world, sky), &caches.atlas, &seen.seen, anew());
        }
        if let (Some(dipoles), Some(inside)) = (&caches.inside, &rsm.inside) {
            if outdated.proxies {
                let _zone = enter(plan::DIPOLES); // 9
                if world.cells.is_some() && caches.near.is_none() {
                    cmd.barrier(Use::ComputeWrite, Use::ComputeRead); //   proxies -> here
                }
                dipoles.record(cmd, world, &inside.vals, &caches.atlas, &caches.proxies);
            }
            if some_surface {
                let _zone = enter(plan::SCATTER); // 10
                dipoles.record_pixels(cmd, world, &caches.atlas, anew());
            }
        }
    }
    ran
}

/// Records brute force in these blocks. Returns the stage's bit if it ran. With `waits`, the stages before it are
/// recorded for the same submission.
fn record_brute_force(
    cmd: &Cmd<'_>,
    light: &Light,
    views: &[(View, &mut Picture)],
    (blocks, waits): (&Range<u32>, bool),
) -> u32 {
    let shown = || views.iter().filter(|(_, p)| !p.is_empty() && p.outdated.indirect);
    let (IndirectLight::BruteForce(brute_force), Some(rsm), true) =
        (&light.indirect, &light.rsm, shown().next().is_some())
    else {
        return 0;
    };
    if waits {
        cmd.barrier(Use::ComputeWrite | Use::ColorWrite | Use::DepthWrite, Use::FragmentRead); //   VALs, G-buffer -> 8
    }
    let _zone = cmd.zone(STAGES[plan::BRUTE_FORCE].name); // 8
    for (view, picture) in shown() {
        for (surface, out, _) in picture.shaded() {
            brute_force.record(cmd, &rsm.vals, view, surface, (out, blocks));
        }
    }
    1 << plan::BRUTE_FORCE
}

/// Records the stages after all indirect light. Returns which ran, by their bits. With `waits`, earlier stages are
/// recorded for the same submission.
fn record_end(
    cmd: &Cmd<'_>,
    world: &World,
    light: &Light,
    views: &[(View, &mut Picture)],
    look: &Look,
    waits: bool,
) -> u32 {
    let mut ran = 0;
    let mut enter = |stage: usize| {
        ran |= 1 << stage;
        cmd.zone(STAGES[stage].name)
    };
    let shown = || views.iter().map(|(view, picture)| (view, &**picture)).filter(|(_, picture)| !picture.is_empty());
    let drawn = || shown().filter(|(_, p)| p.outdated.surface);
    let some_surface = drawn().next().is_some();
    if let (
        true,
        IndirectLight::BruteForce(BruteForce { inside: Some(scatter), .. }),
        Some(Rsm { inside: Some(inside), .. }),
    ) = (some_surface, &light.indirect, &light.rsm)
    {
        let _zone = enter(plan::SCATTER); // 10
        if waits {
            cmd.barrier(Use::ColorWrite, Use::ColorWrite); // direct light -> here
        }
        for (view, surface) in drawn().flat_map(|(view, p)| p.lit().map(move |surface| (view, surface))) {
            scatter.record(cmd, world, &inside.vals, view, surface);
        }
    }
    let mixed = || shown().filter(|(_, p)| p.outdated.surface || p.outdated.indirect).map(|(_, p)| p);
    if mixed().any(|p| p.edges.is_some()) {
        let direct = light.direct.is_some() || mixed().any(|p| p.background.is_some());
        let indirect = light.rsm.is_some() && shown().any(|(_, p)| p.outdated.indirect && p.indirect.is_some());
        if (some_surface && direct) || indirect {
            cmd.barrier(Use::ColorWrite, Use::FragmentRead | Use::ColorWrite); //   radiance -> here
        }
        let _zone = enter(plan::MIX); // 8
        for picture in mixed() {
            if let Some(edges) = &picture.edges {
                let which = (picture.outdated.surface, picture.outdated.indirect);
                edges.record_mix(cmd, (&picture.surface, picture.indirect.as_ref()), which);
            }
        }
    }
    if mixed().any(|p| p.layers.is_some()) {
        let waits = Use::ColorWrite | Use::DepthWrite;
        let waits = if light.plan.refracts { waits | Use::ComputeWrite } else { waits };
        cmd.barrier(waits, Use::FragmentRead | Use::ColorWrite); //   radiance, layers, light of caches -> here
        let _zone = enter(plan::MIX_LAYERS); // 8
        for (view, picture) in shown() {
            let which = (picture.outdated.surface, picture.outdated.indirect);
            if let (Some(layers), (true, _) | (_, true)) = (&picture.layers, which) {
                layers.record_mix(cmd, (world, light), view, (&picture.surface, picture.indirect.as_ref()), which);
            }
        }
    }
    let composed = || shown().filter(|(_, p)| p.outdated.output).map(|(_, p)| p);
    if let Some(first) = composed().next() {
        let _zone = enter(plan::COMPOSITE); // 11
        // If only the look has changed, the radiance comes from an earlier frame.
        let lit = shown().any(|(_, p)| p.outdated.surface || p.outdated.indirect);
        first.composite.record(cmd, look, lit, composed().map(Picture::composed));
    }
    ran
}

/// Marks results that are older than their inputs as outdated; marks everything without `Settings::reuse`.
fn find_outdated(world: &World, light: &mut Light, views: &mut [(View, &mut Picture)], look: &Look) {
    let anew = !light.settings().reuse;
    let (surfaces, lights) = (world.revisions.surfaces, &world.revisions.lights);
    for (view, picture) in views.iter_mut().filter(|(_, picture)| !picture.is_empty()) {
        let (made, outdated) = (&mut picture.made, &mut picture.outdated);
        made.surface.renew([surfaces, made.view.revision_of(*view)]);
        let surface = made.surface.revision();
        outdated.surface = made.radiance.renew(lights.iter().copied().chain([surface])) || anew;
        outdated.visible = made.visible.renew([surface]) || anew;
        made.eye.revision_of(view.eye);
    }
    let shown = || views.iter().map(|(_, picture)| picture).filter(|picture| !picture.is_empty());

    let (made, outdated) = (&mut light.made, &mut light.outdated);
    made.lights.resize_with(lights.len(), Default::default);
    outdated.lights.clear();
    outdated
        .lights
        .extend(made.lights.iter_mut().zip(lights).map(|(made, light)| made.renew([surfaces, *light]) || anew));
    outdated.vals = made.vals.renew(lights.iter().copied().chain([surfaces])) || anew;
    outdated.emitters = std::mem::replace(&mut made.emitters, surfaces) != surfaces && !world.emitters.is_empty();
    let vals = made.vals.revision();
    let mut indirect = vals;
    if let IndirectLight::Caches(caches) = &mut light.indirect {
        let (plan, made) = (&light.plan, &mut caches.made);
        outdated.atlas = made.atlas.renew([surfaces]) || anew;
        // The visible surfaces of the views determine which caches are live, and their order. The number of VALs
        // affects only the dispatch.
        made.order.renew(shown().filter(|_| plan.cull).map(|picture| picture.made.visible.revision()));
        let order = made.order.revision();
        outdated.cull = made.live.renew([order, vals]) || anew;
        outdated.sky = made.sky.renew([made.atlas.revision(), world.revisions.sky]) || anew;
        outdated.depth_images = made.depth_images.renew([made.atlas.revision(), order]) || anew;
        let eyes = views.iter().filter(|_| plan.lobes).map(|(_, picture)| picture.made.eye.revision());
        let sky = plan.sky_light.then(|| made.sky.revision());
        outdated.proxies = made.proxies.renew(eyes.chain([vals, made.atlas.revision(), order]).chain(sky)) || anew;
        indirect = made.proxies.revision();
    }
    for (_, picture) in views.iter_mut().filter(|(_, picture)| !picture.is_empty()) {
        let (made, outdated) = (&mut picture.made, &mut picture.outdated);
        outdated.indirect = made.indirect.renew([made.surface.revision(), indirect]) || anew;
        if light.plan.refracts {
            // What is seen through glass mixes both.
            outdated.surface |= outdated.indirect;
            outdated.indirect |= outdated.surface;
        }
        let look = made.look.revision_of(*look);
        outdated.output = made.output.renew([made.radiance.revision(), made.indirect.revision(), look]) || anew;
    }
}
