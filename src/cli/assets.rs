//! `lightskin assets`: writes the built-in scenes as GLB files. It wrote the files in `assets/`.

use anyhow::{Context, Result};
use lightskin::image::{Layer, write_exr};
use lightskin::scene::write::write_glb;
use lightskin::scene::{Scene, build};
use std::path::PathBuf;

#[derive(clap::Args)]
pub(super) struct Assets {
    /// Folder to write to.
    #[arg(default_value = "assets")]
    folder: PathBuf,
    /// Also write the showpiece, the default scene of `render`, as showpiece.glb and showpiece_sky.exr (for --sky).
    #[arg(long)]
    showpiece: bool,
    /// Also write the scenes that `lab shadows` measures.
    #[cfg(feature = "lab")]
    #[arg(long)]
    shadowed: bool,
    /// Also write two animated scenes: moving.glb, a room, and crowd.glb, 1000 swaying tubes.
    #[cfg(feature = "lab")]
    #[arg(long)]
    moving: bool,
    /// Also write the scenes on which indirect light is measured.
    #[cfg(feature = "lab")]
    #[arg(long)]
    measured: bool,
}

pub(super) fn run(args: &Assets) -> Result<()> {
    std::fs::create_dir_all(&args.folder)
        .with_context(|| format!("{}: cannot make the folder", args.folder.display()))?;
    let scenes = [
        ("atrium.glb".to_owned(), build::atrium()),
        ("cornell_diffuse.glb".to_owned(), build::cornell(build::CornellSurface::Diffuse, 0.05)),
        ("cornell_glossy.glb".to_owned(), build::cornell(build::CornellSurface::Glossy, 0.05)),
    ];
    write(args, scenes)?;
    if args.showpiece {
        write_showpiece(args)?;
    }
    #[cfg(feature = "lab")]
    write(args, for_the_lab(args))?;
    Ok(())
}

/// Writes the showpiece, and its sky as a file of its own, because glTF has no skies.
fn write_showpiece(args: &Assets) -> Result<()> {
    let scene = build::showpiece(build::Fineness::default());
    let sky = scene.sky.clone().context("the showpiece has a sky")?;
    write(args, [("showpiece.glb".to_owned(), scene)])?;
    let path = args.folder.join("showpiece_sky.exr");
    let texels: Vec<[f32; 4]> = sky.texels.iter().map(|texel| texel.extend(1.0).to_array()).collect();
    write_exr(&path, sky.width, sky.height, &[Layer::rgb("", &texels)], "radiance of the sky in cd/m^2")?;
    say!("{}: {} x {} texels", path.display(), sky.width, sky.height);
    Ok(())
}

/// The scenes that only measurements need.
#[cfg(feature = "lab")]
fn for_the_lab(args: &Assets) -> Vec<(String, Scene)> {
    use lightskin::lab::scenes;
    let mut made = Vec::new();
    if args.shadowed {
        let shadowed = scenes::Shadowed::ALL.iter();
        made.extend(shadowed.map(|which| (format!("shadowed_{}.glb", which.name()), which.scene())));
    }
    if args.moving {
        made.push(("moving.glb".to_owned(), scenes::moving(0.1)));
        made.push(("crowd.glb".to_owned(), scenes::crowd(1000)));
    }
    if args.measured {
        made.extend(scenes::measured().into_iter().map(|(name, scene)| (format!("{name}.glb"), scene)));
    }
    made
}

fn write(args: &Assets, scenes: impl IntoIterator<Item = (String, Scene)>) -> Result<()> {
    for (name, scene) in scenes {
        let path = args.folder.join(name);
        write_glb(&scene, &path)?;
        say!("{}: {} triangles", path.display(), super::thousands(scene.triangle_count()));
    }
    Ok(())
}
