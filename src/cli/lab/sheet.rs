//! `lightskin lab sheet`: compares every scene of a folder with the path tracer. Each picture is rendered by the
//! command `render` in a process of its own, so that a crash on one file affects only its own line.

use crate::cli::{progress_bar, render, wrong_usage};
use anyhow::{Context, Result, anyhow, bail};
use lightskin::files::{self, check_writable};
use lightskin::image::read_picture;
use lightskin::lab::sheet::{Entry, Sheet};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

#[derive(clap::Args)]
pub(super) struct SheetArgs {
    /// Folder to search for .gltf and .glb files, subfolders included.
    folder: PathBuf,
    /// HTML page to write, with embedded pictures. Updated after each scene.
    #[arg(short, long, value_name = "FILE.html", default_value = "sheet.html")]
    out: PathBuf,
    /// Picture size [pixels].
    #[arg(long, value_name = "WxH", value_parser = render::size, default_value = "240x135")]
    size: [u32; 2],
    /// Samples per pixel of the path tracer, half of them with another seed, to tell noise from errors. They are
    /// stored; a later run with a larger N uses them again.
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    spp: u32,
    /// Flags of `render` for both pictures, like --sky probe.hdr or --bounces 4.
    #[arg(last = true, value_name = "FLAGS")]
    flags: Vec<String>,
}

/// Draws all scenes. Fails if there is no scene, or if none could be drawn.
pub(super) fn run(args: &SheetArgs) -> Result<()> {
    if args.flags.iter().any(|flag| flag == "--seed" || flag.starts_with("--seed=")) {
        wrong_usage("--seed: the two halves of the path tracer's samples have seeds of their own; leave it out");
    }
    check_writable(&args.out)?;
    let mut scenes = Vec::new();
    find(&args.folder, &mut scenes)?;
    if scenes.is_empty() {
        bail!("{}: neither the folder nor its subfolders contain a .gltf or .glb file", args.folder.display());
    }
    let [w, h] = args.size;
    let mut about = format!("{w} x {h} pixels, at least {} samples per pixel of all light.", args.spp);
    if !args.flags.is_empty() {
        about += &format!(" Flags of both: {}.", args.flags.join(" "));
    }
    let pictures = Pictures::make()?;
    let mut sheet = Sheet::default();
    let bar = progress_bar("[{bar:40}] {percent:>3} %  {elapsed}, {eta} left  {wide_msg}");
    for (index, scene) in scenes.iter().enumerate() {
        let name = scene.strip_prefix(&args.folder).unwrap_or(scene).display().to_string();
        bar.set_message(name.clone());
        bar.set_position(1000 * index as u64 / scenes.len() as u64);
        let entry = pictures.compare(scene, &name, args);
        bar.suspend(|| match &entry {
            Ok(entry) => say!(
                "FLIP {:.4}, noise {:.4}, bias {:+7.2} %  {name}",
                entry.flip,
                entry.flip_of_noise,
                100.0 * entry.bias
            ),
            Err(reason) => log::warn!("{name}: {reason}"),
        });
        sheet.add(&name, entry);
        sheet.write(&args.out, &about)?;
    }
    bar.finish_and_clear();
    let [drawn, failed] = sheet.counts();
    let Some([flip, noise, bias]) = sheet.medians() else { bail!("none of {failed} scenes could be drawn") };
    say!("scenes    {drawn}, {failed} could not be drawn");
    say!("median    FLIP {flip:.4}, noise {noise:.4}, absolute bias {:.2} %", 100.0 * bias);
    say!("sheet     {}", args.out.display());
    Ok(())
}

/// Finds the glTF files of a folder and its subfolders, sorted. Links to folders are not followed.
fn find(folder: &Path, scenes: &mut Vec<PathBuf>) -> Result<()> {
    let paths = files::list(folder).map_err(|reason| anyhow!("{}: {reason}", folder.display()))?;
    for path in paths {
        let is = |name: &str| path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(name));
        if path.is_dir() && !path.is_symlink() {
            if let Err(error) = find(&path, scenes) {
                log::warn!("{error:#}");
            }
        } else if is("gltf") || is("glb") {
            scenes.push(path);
        }
    }
    Ok(())
}

/// A temporary folder for the pictures of a scene. Dropping it deletes the folder.
struct Pictures {
    folder: PathBuf,
}

impl Drop for Pictures {
    fn drop(&mut self) {
        // If this fails, the files stay in the system's folder for temporary files.
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

impl Pictures {
    fn make() -> Result<Self> {
        let folder = std::env::temp_dir().join(format!("lightskin-sheet-{}", std::process::id()));
        std::fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
        Ok(Self { folder })
    }

    fn compare(&self, scene: &Path, name: &str, args: &SheetArgs) -> Result<Entry, String> {
        let [drawn, half, other] = ["drawn", "half", "other"].map(|name| self.folder.join(name).with_extension("exr"));
        let spp = args.spp.div_ceil(2).to_string();
        let mut notes = rendered(scene, &drawn, args, &[])?;
        for (seed, traced) in [("0", &half), ("1", &other)] {
            let told = rendered(scene, traced, args, &["--gi", "path-trace", "--spp", &spp, "--seed", seed])?;
            notes.extend(told.into_iter().filter(|line| !notes.contains(line)).collect::<Vec<_>>());
        }
        let read = |path: &Path, layer| read_picture(path, layer).map_err(|error| error.to_string());
        let covered: Vec<bool> = read(&half, Some("Z"))?.rgb.iter().map(|z| z[0].is_finite()).collect();
        Entry::new(name, &read(&drawn, None)?, &[read(&half, None)?, read(&other, None)?], &covered, &notes)
    }
}

/// Runs `render`. Returns the lines of its standard error. If it fails, the last of these is the error.
fn rendered(scene: &Path, out: &Path, args: &SheetArgs, flags: &[&str]) -> Result<Vec<String>, String> {
    let program = std::env::current_exe().map_err(|error| format!("this program's own file: {error}"))?;
    let [w, h] = args.size;
    let run = Command::new(program)
        .args([OsStr::new("render"), scene.as_os_str(), OsStr::new("-o"), out.as_os_str()])
        .args(["--size", &format!("{w}x{h}")])
        .args(flags)
        .args(&args.flags)
        .stdin(Stdio::null())
        .output()
        .map_err(|error| format!("this program could not be started again: {error}"))?;
    let told = String::from_utf8_lossy(&run.stderr);
    // The page already shows the name of the file.
    let (program, file) = ("lightskin: ", format!("{}: ", scene.display()));
    let own = |line: &str| line.trim_start_matches(program).trim_start_matches(&file).to_owned();
    let lines: Vec<String> = told.lines().map(own).collect();
    if !run.status.success() {
        return Err(lines.last().cloned().unwrap_or_else(|| run.status.to_string()));
    }
    Ok(lines)
}
