//! One frame, top to bottom: what is due, and its stages in order.

use super::gather::{Gather, Lit};
use super::interpolate::Shaded;
use super::light::{IndirectLight, Light};
use super::picture::Picture;
use super::plan::{self, STAGES};
use super::settings::Look;
use super::view::View;
use super::world::World;
use crate::gpu::{Cmd, Use};

/// Records one frame of some views, top to bottom; the numbers are METHOD's. A stage the scene does not need is `None`, one
/// whose inputs are as they were is not due. Light is made once for all views: each costs its own surfaces, shading and
/// share of the glossy lobe. Where no view has pixels nothing is recorded.
///
/// # Panics
/// Where light or pictures were not fitted after a change of world, settings or number of views.
pub fn record(cmd: &Cmd<'_>, world: &World, light: &mut Light, views: &mut [(View, &mut Picture)], look: &Look) {
    assert!(light.fits(world) && views.len() <= light.eyes(), "the light does not fit: call Light::fit");
    assert!(views.iter().all(|(_, p)| p.fits(world, light)), "a picture does not fit the light: call Picture::fit");
    if views.iter().all(|(_, picture)| picture.is_empty()) {
        light.ran = 0;
        return;
    }
    find_due(world, light, views, look);
    let mut ran = 0;
    let mut enter = |stage: usize| {
        ran |= 1 << stage;
        cmd.zone(STAGES[stage].name)
    };
    let shown = || views.iter().map(|(view, picture)| (view, &**picture)).filter(|(_, picture)| !picture.is_empty());
    let surfaces = || shown().filter(|(_, p)| p.due.surface).map(|(view, p)| (view, &p.surface));
    let some_surface = surfaces().next().is_some();
    let due = &light.due;

    if let (true, Some(poses)) = (world.record_changes(cmd), &light.poses) {
        poses.record(cmd, world); // what bends, before all stages
        cmd.barrier(Use::ComputeWrite, Use::VertexInput | Use::ComputeRead);
    }
    if some_surface {
        let _zone = enter(plan::GBUFFER); // 1
        for (view, picture) in shown().filter(|(_, p)| p.due.surface) {
            picture.gbuffer.record(cmd, world, view, &picture.surface);
        }
    }
    if let (true, Some(direct)) = (some_surface, &light.direct) {
        let _zone = enter(plan::DIRECT); // 2
        direct.record(cmd, world, surfaces());
    }
    if let (true, Some(sky), Some((_, picture))) = (some_surface, &world.sky, shown().next())
        && let Some(background) = &picture.background
    {
        let _zone = enter(plan::SKY); // 2
        background.record(cmd, sky, surfaces());
    }
    if let (true, IndirectLight::Caches(caches)) = (due.atlas, &light.indirect) {
        let _zone = enter(plan::ATLAS); // 3
        caches.atlas.record(cmd, world);
    }
    if let (true, Some(rsm)) = (due.vals, &light.rsm) {
        let live = light.caches().and_then(|caches| caches.gather.live());
        {
            let _zone = enter(plan::RSM); // 4
            rsm.record(cmd, world, |i| due.lights[i], due.emitters, live);
        }
        if let Some(Gather::Clusters(by)) = light.caches().map(|caches| &caches.gather) {
            let _zone = enter(plan::PYRAMID); // 4, its end
            by.pyramid.record(cmd, &rsm.vals);
        }
    }
    if let (IndirectLight::Caches(caches), Some(rsm)) = (&light.indirect, &light.rsm) {
        let lists = || shown().filter_map(|(view, p)| Some((view, p, p.visible.as_ref()?)));
        let seen = || lists().filter(|(_, p, _)| p.due.visible);
        if seen().next().is_some() {
            let _zone = enter(plan::VISIBLE); // 5
            caches.visible.record(
                cmd,
                world,
                seen().filter_map(|(v, p, list)| Some((v, p.surface.element.as_ref()?, list))),
            );
        }
        if let (true, Some(cull)) = (due.cull, &caches.cull) {
            let _zone = enter(plan::CULL); // 5
            if seen().next().is_some() {
                cmd.barrier(Use::ComputeWrite, Use::IndirectRead | Use::ComputeRead); // visible vertices -> here
            }
            cull.record(cmd, world, lists().map(|(.., list)| list), &rsm.vals, &caches.gather);
        }
        if some_surface || due.atlas || due.vals || due.cull {
            cmd.barrier(
                Use::ComputeWrite | Use::DepthWrite,
                Use::ComputeRead | Use::IndirectRead | Use::VertexRead | Use::FragmentRead | Use::DepthRead,
            ); //   VALs, atlas, live caches -> 6
        }
        if let (true, Some(images), Some(live)) = (due.depth_images, caches.gather.depth_images(), caches.gather.live())
        {
            let _zone = enter(plan::DEPTH_IMAGES); // 6
            images.record(cmd, &caches.atlas, live);
            cmd.barrier(Use::ComputeWrite, Use::ComputeRead);
        }
        if due.proxies {
            let eyes: Vec<_> = views.iter().map(|(view, _)| view.eye).collect();
            let (atlas, proxies) = (&caches.atlas, &caches.proxies);
            {
                let _zone = enter(plan::GATHER); // 6
                let albedos = world.cache_albedos();
                caches.gather.record(cmd, &Lit { vals: &rsm.vals, atlas, proxies, eyes: &eyes, albedos });
            }
            if let Some(occlude) = &caches.occlude {
                let _zone = enter(plan::OCCLUDE); // 7
                occlude.record(cmd, atlas, caches.gather.live(), proxies, eyes.len());
            }
        }
        let shaded = || {
            views.iter().enumerate().filter(|(_, (_, p))| p.due.indirect && !p.is_empty()).filter_map(
                |(eye, (view, p))| {
                    let (visible, out) = (p.visible.as_ref()?, p.indirect.as_ref()?);
                    let first_proxy = caches.proxies.first(eye as u32);
                    Some(Shaded { view, surface: &p.surface, visible, out, first_proxy })
                },
            )
        };
        if shaded().next().is_some() {
            let _zone = enter(plan::INTERPOLATE); // 8
            caches.interpolate.record(cmd, world, &caches.atlas, &caches.proxies, shaded());
        }
    }
    if let (IndirectLight::BruteForce(brute_force), Some(rsm)) = (&light.indirect, &light.rsm)
        && shown().any(|(_, p)| p.due.indirect)
    {
        cmd.barrier(Use::ComputeWrite | Use::ColorWrite | Use::DepthWrite, Use::FragmentRead); //   VALs, G-buffer -> 8
        let _zone = enter(plan::BRUTE_FORCE); // 8
        for (view, picture) in shown().filter(|(_, p)| p.due.indirect) {
            if let Some(out) = &picture.indirect {
                brute_force.record(cmd, &rsm.vals, view, &picture.surface, out);
            }
        }
    }
    let composed = || shown().filter(|(_, p)| p.due.output).map(|(_, p)| p);
    if let Some(first) = composed().next() {
        let _zone = enter(plan::COMPOSITE); // 11
        // Where the look alone has changed, radiance is that of an earlier frame.
        let lit = shown().any(|(_, p)| p.due.surface || p.due.indirect);
        first.composite.record(cmd, look, lit, composed().map(Picture::composed));
    }
    light.ran = ran;
}

/// Finds what is newer than what was made of it, or all without `Settings::reuse`.
fn find_due(world: &World, light: &mut Light, views: &mut [(View, &mut Picture)], look: &Look) {
    let anew = !light.settings().reuse;
    let (surfaces, lights) = (world.revisions.surfaces, &world.revisions.lights);
    for (view, picture) in views.iter_mut().filter(|(_, picture)| !picture.is_empty()) {
        let (made, due) = (&mut picture.made, &mut picture.due);
        made.surface.renew([surfaces, made.view.revision_of(*view)]);
        let surface = made.surface.revision();
        due.surface = made.radiance.renew(lights.iter().copied().chain([surface])) || anew;
        due.visible = made.visible.renew([surface]) || anew;
        made.eye.revision_of(view.eye);
    }
    let shown = || views.iter().map(|(_, picture)| picture).filter(|picture| !picture.is_empty());

    let (made, due) = (&mut light.made, &mut light.due);
    made.lights.resize_with(lights.len(), Default::default);
    due.lights.clear();
    due.lights.extend(made.lights.iter_mut().zip(lights).map(|(made, light)| made.renew([surfaces, *light]) || anew));
    due.vals = made.vals.renew(lights.iter().copied().chain([surfaces])) || anew;
    due.emitters = std::mem::replace(&mut made.emitters, surfaces) != surfaces && !world.emitters.is_empty();
    let vals = made.vals.revision();
    let mut indirect = vals;
    if let IndirectLight::Caches(caches) = &mut light.indirect {
        let (plan, made) = (&light.plan, &mut caches.made);
        due.atlas = made.atlas.renew([surfaces]) || anew;
        // What views show decides which caches are live, in which order; how many lights there are, only the dispatch.
        made.order.renew(shown().filter(|_| plan.cull).map(|picture| picture.made.visible.revision()));
        let order = made.order.revision();
        due.cull = made.live.renew([order, vals]) || anew;
        due.depth_images = made.depth_images.renew([made.atlas.revision(), order]) || anew;
        let eyes = views.iter().filter(|_| plan.glossy).map(|(_, picture)| picture.made.eye.revision());
        due.proxies = made.proxies.renew(eyes.chain([vals, made.atlas.revision(), order])) || anew;
        indirect = made.proxies.revision();
    }
    for (_, picture) in views.iter_mut().filter(|(_, picture)| !picture.is_empty()) {
        let (made, due) = (&mut picture.made, &mut picture.due);
        due.indirect = made.indirect.renew([made.surface.revision(), indirect]) || anew;
        let look = made.look.revision_of(*look);
        due.output = made.output.renew([made.radiance.revision(), made.indirect.revision(), look]) || anew;
    }
}
