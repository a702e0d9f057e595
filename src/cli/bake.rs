//! `lightskin bake`: places caches, stores them, and prints the measured proof that every surface point has a cache.

use super::{CacheArgs, bake_scene, load_scene, thousands};
use anyhow::Result;
use std::path::PathBuf;

#[derive(clap::Args)]
pub(super) struct Bake {
    /// glTF or GLB file, or a folder that contains one [default: the built-in showpiece].
    scene: Option<PathBuf>,
    #[command(flatten)]
    caches: CacheArgs,
    /// Bake again, even if a matching bake is stored.
    #[arg(long)]
    again: bool,
}

pub(super) fn run(args: &Bake) -> Result<()> {
    let scene = load_scene(args.scene.as_deref(), &args.caches)?;
    let settings = args.caches.settings();
    let baked = bake_scene(&scene, args.scene.as_deref(), &settings, args.again)?;
    let set = &baked.caches;
    let coverage =
        set.models.iter().fold((0.0_f64, 0.0_f64), |(d, a), m| (d.max(m.coverage.distance), a.max(m.coverage.angle)));
    let references: usize = set.models.iter().map(|m| m.references.len()).sum();
    say!("scene       {} ({} triangles)", scene.name, thousands(scene.triangle_count()));
    say!("caches      {} in {} models", thousands(baked.count), set.models.len());
    say!("references  {} ({} per vertex)", thousands(references), settings.references);
    say!("spacing     {:.4} m, angle {:.1} degrees", set.spacing, settings.angle.to_degrees());
    say!(
        "coverage    every surface point has a cache within {:.4} m ({:.1} % of the spacing) and {:.1} degrees",
        coverage.0,
        100.0 * coverage.0 / set.spacing,
        coverage.1.to_degrees()
    );
    say!(
        "time        {:.2} s{}",
        baked.time.as_secs_f64(),
        if baked.kept { " (read from the stored bake)" } else { "" }
    );
    Ok(())
}
