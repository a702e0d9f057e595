//! Which stages a frame runs: all of them, or with `Settings::reuse` those whose inputs are not what they last ran with. What
//! a stage has written stays in its targets, and a stage gives the same bits for the same inputs: so do frames that leave
//! stages out. Nothing of one moment is ever shown at another.

use super::moving::Revisions;
use super::{Plan, SceneBuffers, View};

/// What the targets hold.
#[derive(Default)]
pub(super) struct Done {
    revisions: Revisions,
    view: Option<View>,
    /// Revision of the surfaces that emit.
    emitters: u64,
}

/// Which stages a frame runs.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Due {
    /// Stages 1 and 2: the camera's picture before indirect light.
    pub(super) direct: bool,
    /// Stage 3.
    pub(super) atlas: bool,
    /// Stage 4, light by light.
    pub(super) lights: Vec<bool>,
    /// Stage 4's list of VALs, and what stands on it.
    pub(super) rsm: bool,
    /// Stage 5: what the camera sees.
    pub(super) visible: bool,
    /// Stage 5: which caches that needs.
    pub(super) cull: bool,
    /// Stage 6: what live caches see of each other.
    pub(super) depth_images: bool,
    /// Stages 6 and 7.
    pub(super) gather: bool,
    /// Stage 8.
    pub(super) interpolate: bool,
    /// Stage 11.
    pub(super) composite: bool,
}

impl Due {
    /// What a frame runs if the targets hold what is `done`, and the scene and the view are as given. Without `reuse`, all.
    pub(super) fn find(&mut self, reuse: bool, plan: &Plan, done: &Done, now: &Revisions, view: &View) {
        let surfaces = !reuse || done.revisions.surfaces != now.surfaces;
        let seen = surfaces || done.view.as_ref() != Some(view);
        let moved = done.view.is_none_or(|last| last.eye != view.eye);
        self.lights.clear();
        self.lights
            .extend((0..now.lights.len()).map(|i| surfaces || done.revisions.lights.get(i) != now.lights.get(i)));
        let lit = surfaces || self.lights.contains(&true);
        self.direct = seen || lit;
        self.atlas = surfaces;
        self.rsm = lit;
        self.visible = seen;
        self.cull = seen || lit;
        // They go by the list of live caches: by its order alone, whatever the light.
        self.depth_images = surfaces || (seen && plan.cull);
        self.gather = lit || (seen && plan.cull) || (moved && plan.glossy);
        self.interpolate = seen || self.gather;
        self.composite = seen || lit;
    }

    /// Names of the stages of a plan that are left out.
    pub(super) fn skipped(&self, plan: &Plan) -> Vec<&'static str> {
        let all = [
            ("gbuffer", self.direct, true),
            ("direct", self.direct, plan.direct),
            ("atlas", self.atlas, plan.lightskin),
            ("rsm", self.rsm, plan.indirect()),
            ("visible", self.visible, plan.lightskin),
            ("cull", self.cull, plan.cull),
            ("depth images", self.depth_images, plan.depth_images),
            ("gather", self.gather, plan.lightskin),
            ("occlude", self.gather, plan.occlude),
            ("interpolate", self.interpolate, plan.indirect()),
            ("composite", self.composite, true),
        ];
        all.iter().filter(|(_, runs, planned)| *planned && !runs).map(|(name, ..)| *name).collect()
    }
}

impl Done {
    /// Nothing, but VALs of the surfaces that emit.
    pub(super) fn new(scene: &SceneBuffers) -> Self {
        Self { emitters: scene.revisions.surfaces, ..Self::default() }
    }

    /// Whether they hold anything.
    pub(super) fn is_some(&self) -> bool {
        self.view.is_some()
    }

    /// Whether the surfaces that emit are not those the VALs are of; from now on they are.
    pub(super) fn new_emitters(&mut self, scene: &SceneBuffers) -> bool {
        let now = scene.revisions.surfaces;
        std::mem::replace(&mut self.emitters, now) != now && !scene.emitters.is_empty()
    }

    /// After a frame of this.
    pub(super) fn set(&mut self, revisions: &Revisions, view: &View) {
        self.revisions.surfaces = revisions.surfaces;
        self.revisions.lights.clone_from(&revisions.lights);
        self.view = Some(*view);
    }
}
