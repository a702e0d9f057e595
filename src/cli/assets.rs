//! `lightskin assets`: the built-in scenes as GLB files. What lies in `assets/` was made so.

use anyhow::{Context, Result};
use lightskin::scene::{build, write};
use std::path::PathBuf;

#[derive(clap::Args)]
pub(super) struct Assets {
    /// Folder to write to; made if missing.
    #[arg(default_value = "assets")]
    folder: PathBuf,
    /// Also the scenes that `choices --shadows` measures.
    #[arg(long)]
    shadowed: bool,
    /// Also the scenes that move: moving.glb, a room, and crowd.glb, 1000 swaying tubes on one mesh.
    #[arg(long)]
    moving: bool,
}

pub(super) fn run(args: &Assets) -> Result<()> {
    std::fs::create_dir_all(&args.folder)
        .with_context(|| format!("{}: cannot make the folder", args.folder.display()))?;
    let mut scenes = vec![
        ("atrium.glb".to_owned(), build::atrium()),
        ("cornell_diffuse.glb".to_owned(), build::cornell(build::CornellSurface::Diffuse, 0.05)),
        ("cornell_glossy.glb".to_owned(), build::cornell(build::CornellSurface::Glossy, 0.05)),
    ];
    if args.shadowed {
        let shadowed = build::Shadowed::ALL.iter();
        scenes.extend(shadowed.map(|which| (format!("shadowed_{}.glb", which.name()), which.scene())));
    }
    if args.moving {
        scenes.push(("moving.glb".to_owned(), build::moving(0.1)));
        scenes.push(("crowd.glb".to_owned(), build::crowd(1000)));
    }
    for (name, scene) in scenes {
        let path = args.folder.join(name);
        write::write_glb(&scene, &path)?;
        say!("{}: {} triangles", path.display(), super::thousands(scene.triangle_count()));
    }
    Ok(())
}
