//! The panel sections for the placement of caches and for variants of the method.

use super::{State, choose, cost, row, rows};
use crate::app::document::Document;
use crate::cli::view::View as Args;
use egui::{DragValue, Slider, Ui};
use lightskin::frame::settings::{Caches, Gather};
use lightskin::frame::{ClusterRule, Indirect, Interpolation, Shadows};

/// Distance of clusters that `--cluster` recommends \[radii\].
const CLUSTER: f32 = 8.0;

impl State {
    /// How caches are placed, and how many of them a vertex has.
    pub(super) fn placement(&mut self, ui: &mut Ui, document: &mut Document) {
        let mut args = document.wanted().clone();
        rows(ui, "placement", |ui| {
            if let Some(spacing) = document.engine.as_ref().and_then(|engine| engine.baked()).map(|set| set.spacing) {
                let mut edited = self.spacing.or(args.spacing()).unwrap_or(spacing);
                let help = "Largest distance from a surface point to its nearest cache. It replaces the number of caches. New \
                            caches are baked in the background.";
                let drag = DragValue::new(&mut edited).range(1e-6..=1e6).speed(0.01 * spacing).suffix(" m");
                let response = row(ui, "Spacing", help, |ui| ui.add(drag.max_decimals(4).update_while_editing(false)));
                self.spacing = response.changed().then_some(edited).or(self.spacing);
                if !response.dragged()
                    && !response.has_focus()
                    && let Some(edited) = self.spacing.take()
                {
                    args.set_spacing(edited);
                }
            }
            let mut angle = self.angle.unwrap_or(args.angle());
            let help = "Largest angle between a surface and its cache. A smaller angle puts more of the caches on curved \
                        surfaces and at edges. New caches are baked in the background.";
            let drag = DragValue::new(&mut angle).range(1.0..=90.0).speed(0.5).suffix("\u{b0}").max_decimals(1);
            let response = row(ui, "Angle", help, |ui| ui.add(drag.update_while_editing(false)));
            self.angle = response.changed().then_some(angle).or(self.angle);
            if !response.dragged() && !response.has_focus() {
                args.set_angle(self.angle.take().unwrap_or(args.angle()));
            }
            let help = "Number of caches that are interpolated at each vertex. 16 is smoother, and slower to interpolate. The \
                        caches are baked again in the background.";
            let mut references = args.references();
            row(ui, "References", help, |ui| choose(ui, "references", &mut references, &[(8, "8"), (16, "16")]));
            args.set_references(references);
        });
        let now = document.wanted();
        let placed = |args: &Args| (args.spacing(), args.angle(), args.references());
        if placed(&args) != placed(now) {
            document.open(args, false);
        }
    }
}

/// How virtual lights light caches, and what is averaged between caches.
pub(super) fn variants(ui: &mut Ui, document: &mut Document) {
    let Indirect::Caches(usual) = document.usual().indirect else { return };
    let mut settings = document.settings;
    let Indirect::Caches(now) = &mut settings.indirect else {
        ui.label("Choose caches as indirect light.");
        return;
    };
    rows(ui, "variants", |ui| variant_rows(ui, document, usual, now));
    document.settings = settings;
}

fn variant_rows(ui: &mut Ui, document: &Document, usual: Caches, now: &mut Caches) {
    let Caches { gather, interpolation, .. } = now;
    let dim = gather.shadows() != Shadows::Off;
    let mut way = match gather {
        Gather::Compute { .. } => 0,
        Gather::Draws { .. } => 1,
        Gather::Clusters { .. } => 2,
    };
    let help = format!(
        "How virtual lights light the caches. Compute is the default, with all bounces and short rays. Draws is the method of \
         the thesis. Clusters lights a cache by a whole group of lights if the group is far away. The last two have one \
         bounce and no short rays.{}",
        cost(document, &["gather"])
    );
    let ways = [(0, "compute"), (1, "draws"), (2, "clusters")];
    if row(ui, "Gather", &help, |ui| choose(ui, "gather", &mut way, &ways)).changed() {
        *gather = match way {
            0 => usual.gather,
            1 => Gather::draws(dim),
            _ => Gather::Clusters { rule: ClusterRule::Distance(CLUSTER), dim },
        };
    }
    if let Gather::Clusters { rule: ClusterRule::Distance(radii), .. } = gather {
        let help = "Distance of a cluster from a cache, in radii of the cluster, beyond which the cluster stands for its \
                    lights. More is more accurate and slower.";
        row(ui, "  beyond", help, |ui| ui.add(Slider::new(radii, 2.0..=32.0).suffix(" radii")));
    }
    let help = format!(
        "What is averaged between caches. Irradiance is bounded and closer to the truth. Flux is the method of the thesis.{}",
        cost(document, &["interpolate"])
    );
    let kinds = [(Interpolation::Facing, "irradiance"), (Interpolation::Printed, "flux")];
    row(ui, "Interpolation", &help, |ui| choose(ui, "interpolation", interpolation, &kinds));
}
