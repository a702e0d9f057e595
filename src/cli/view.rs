//! `lightskin view`: what the window begins with, and how it loads a scene as `render` does.

use super::camera::camera;
use super::picture::{Read, TonemapArg, Writing};
use super::render::Render;
use super::sky::SkyArgs;
use super::words::{AntialiasingArg, ShadowsArg, light_shadows_word};
use super::{CacheArgs, Command, DeviceArgs, QualityArg, called, divide_for, load_under, word};
use anyhow::{Context, Result, anyhow, bail};
use clap::ValueEnum;
use lightskin::frame::View as FrameView;
use lightskin::frame::engine::Loaded;
use lightskin::frame::{Exposure, Look, Near, Picture, Quality, Settings, Shadows, Tonemap};
use lightskin::gpu::{Gpu, Present};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use winit::raw_window_handle::RawDisplayHandle;

#[derive(clap::Args, Clone)]
pub(crate) struct View {
    /// glTF or GLB file, or a folder with one, or a session that the window has saved; the built-in showpiece without one. Other
    /// files can be dropped on the window.
    pub(crate) scene: Option<PathBuf>,
    /// Size of the picture without panels [pixels].
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = super::render::size)]
    pub(crate) size: [u32; 2],
    /// Camera to begin with, by name or index, or "eye;target;up;fov" with vectors as x,y,z and the vertical field in degrees.
    #[arg(long, value_name = "CAMERA", allow_hyphen_values = true, value_parser = super::camera::readable)]
    pub(crate) camera: Option<String>,
    /// Exposure value at ISO 100 (1.2 * 2^EV cd/m^2 becomes white); without it that of the surfaces in view.
    #[arg(long, value_name = "EV", allow_hyphen_values = true, value_parser = super::render::exposure)]
    ev: Option<f32>,
    /// Curve from scene to display.
    #[arg(long, value_enum, default_value_t)]
    tonemap: TonemapArg,
    /// Picture to compare with, of the same size: PNG or OpenEXR. Space shows it.
    #[arg(long, value_name = "FILE")]
    pub(crate) against: Option<PathBuf>,
    /// Samples per pixel at which the reference that Space shows is done.
    #[arg(long, value_name = "N", default_value_t = 4096, value_parser = clap::value_parser!(u32).range(1..=16_777_216))]
    pub(crate) reference_spp: u32,
    /// Load the scene again when its files change; the view stays.
    #[arg(long)]
    pub(crate) watch: bool,
    /// Frames per second that you aim for: the panel of times draws a line at what a frame may take.
    #[arg(long, value_name = "HZ", value_parser = super::positive)]
    pub(crate) target_hz: Option<f64>,
    /// Begin without panels; Tab shows them.
    #[arg(long)]
    pub(crate) no_panels: bool,
    /// When a picture takes the place of the one before. What the window does not know becomes fifo.
    #[arg(long, value_enum, default_value_t)]
    present: PresentArg,
    #[command(flatten)]
    caches: CacheArgs,
    #[command(flatten)]
    sky: SkyArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

#[derive(Clone, Copy, Default, ValueEnum)]
enum PresentArg {
    /// At the display's next refresh, in order: no tearing, and every device has it.
    #[default]
    Fifo,
    /// At the next refresh, the newest of several pictures.
    Mailbox,
    /// At once: pictures may tear.
    Immediate,
}

/// What a window shows, in words of the command line.
pub(crate) struct Now<'a> {
    pub(crate) settings: &'a Settings,
    pub(crate) look: &'a Look,
    /// Caches of the whole scene.
    pub(crate) caches: usize,
    pub(crate) size: [u32; 2],
    pub(crate) camera: String,
    /// Animation and time [s].
    pub(crate) moment: Option<(usize, f64)>,
}

impl View {
    /// Loads the scene and bakes its caches, or reads the kept bake, just as `render` does.
    pub(crate) fn load(&self, progress: &(dyn Fn(f32, &str) + Sync)) -> Result<Loaded> {
        progress(0.0, "load");
        let mut scene = load_under(self.scene.as_deref(), self.sky.sky()?, self.caches.ground)?;
        self.sky.put_behind(&mut scene)?;
        self.sky.size_lights(&mut scene);
        // A camera that is not there is no reason to look at nothing, but at the start it is a mistake.
        if let Some(wanted) = &self.camera {
            camera(&scene, Some(wanted))?;
        }
        let at_vertices = divide_for(&mut scene, &self.caches, false);
        let name = called(&scene, self.scene.as_deref());
        Loaded::with_caches(scene, &self.caches.settings(), at_vertices, progress).context(name)
    }

    /// The same with another scene, or another sky; whether a file is a sky says its name.
    pub(crate) fn with_file(&self, file: &Path) -> Self {
        let mut view = Self { camera: None, ..self.clone() };
        let sky = file.extension().and_then(|e| e.to_str()).map(str::to_lowercase);
        if sky.is_some_and(|ending| ending == "hdr" || ending == "exr") {
            view.sky.replace(file);
        } else {
            view.scene = Some(file.to_owned());
        }
        view
    }

    pub(crate) fn quality(&self) -> Quality {
        self.caches.quality()
    }

    pub(crate) fn set_quality(&mut self, quality: Quality) {
        self.caches.quality = QualityArg::of(quality);
        self.set_caches(None);
    }

    /// About how many caches the bake is asked for.
    pub(crate) fn cache_count(&self) -> usize {
        self.caches.count()
    }

    /// About so many caches, or those of the level.
    pub(crate) fn set_caches(&mut self, count: Option<u32>) {
        (self.caches.caches, self.caches.spacing) = (count, None);
    }

    /// How the picture is shown at first.
    pub(crate) fn look(&self) -> Look {
        Look {
            tonemap: self.tonemap.curve(),
            exposure: self.ev.map_or(Exposure::Automatic, Exposure::Ev),
            behind: self.sky.behind(),
        }
    }

    /// Opens a device that shows pictures on a display.
    pub(crate) fn open_device(&self, display: RawDisplayHandle) -> Result<Gpu> {
        Ok(Gpu::for_display(&self.device.options(), display)?)
    }

    pub(crate) fn present(&self) -> Present {
        match self.present {
            PresentArg::Fifo => Present::Fifo,
            PresentArg::Mailbox => Present::Mailbox,
            PresentArg::Immediate => Present::Immediate,
        }
    }

    /// The command that writes the same picture.
    pub(crate) fn command(&self, now: &Now<'_>) -> String {
        let Now { settings, look, caches, size, camera, moment } = now;
        let mut words: Vec<String> = vec!["lightskin".into(), "render".into()];
        words.extend(self.scene.as_ref().map(|path| path.display().to_string()));
        let mut flag = |name: &str, value: String| words.extend([name.to_owned(), value]);
        flag("-o", "picture.png".into());
        flag("--size", format!("{}x{}", size[0], size[1]));
        flag("--camera", camera.clone());
        if let Some((animation, time)) = moment {
            flag("--animation", animation.to_string());
            flag("--time", time.to_string());
        }
        if let Exposure::Ev(ev) = look.exposure {
            flag("--ev", ev.to_string());
        }
        if look.tonemap != Tonemap::default() {
            flag("--tonemap", word(TonemapArg::of(look.tonemap)));
        }
        words.extend(self.settings_words(settings, *caches));
        words.extend(self.caches.words());
        words.extend(self.sky.words());
        words.iter().map(|word| quoted(word)).collect::<Vec<_>>().join(" ")
    }

    /// Settings as flags of `render`, where they are not those of the level with so many caches.
    fn settings_words(&self, settings: &Settings, caches: usize) -> Vec<String> {
        use lightskin::frame::Indirect;
        use lightskin::frame::settings::{Caches, Gather};
        let mut words = Vec::new();
        let mut flag = |name: &str, value: String| words.extend([name.to_owned(), value]);
        let level = Settings::at(self.quality(), caches);
        match (settings.indirect, level.indirect) {
            (Indirect::Off, _) => flag("--gi", "off".into()),
            (Indirect::BruteForce, _) => flag("--gi", "brute-force".into()),
            (
                Indirect::Caches(Caches { gather: Gather::Compute { bounces, shadows, near, .. }, .. }),
                Indirect::Caches(Caches { gather: usual, .. }),
            ) => {
                if bounces != usual.bounces() {
                    flag("--bounces", bounces.to_string());
                }
                if near != usual.near() {
                    flag("--near", if near == Near::Off { "off".into() } else { "rays".into() });
                    if let Near::Rays { per_pixel, every } = near {
                        flag("--near-rays", per_pixel.to_string());
                        flag("--near-every", every.to_string());
                    }
                }
                if shadows != self.quality().shadows(caches, near) {
                    flag("--shadows", shadow_word(shadows));
                }
            }
            _ => {}
        }
        if settings.rsm != level.rsm {
            flag("--rsm", settings.rsm.to_string());
        }
        if settings.light_shadows != level.light_shadows {
            flag("--shadow-map", light_shadows_word(settings.light_shadows));
        }
        if settings.antialiasing != level.antialiasing {
            flag("--aa", word(AntialiasingArg::of(settings.antialiasing)));
        }
        if settings.layers != level.layers {
            flag("--layers", settings.layers.to_string());
        }
        words
    }

    /// What `of_session` makes the same of: flags of `view`. `render` takes those of caches and settings, `drawing` reads them.
    pub(crate) fn session_words(&self, look: &Look, settings: &Settings, caches: usize) -> [Vec<String>; 2] {
        let mut view = self.clone();
        view.sky.make_absolute();
        let scene = self.scene.as_ref().map(|path| std::path::absolute(path).unwrap_or_else(|_| path.clone()));
        let mut words: Vec<String> = scene.iter().map(|path| path.display().to_string()).collect();
        if look.tonemap != Tonemap::default() {
            words.extend(["--tonemap".into(), word(TonemapArg::of(look.tonemap))]);
        }
        words.extend(view.caches.words());
        words.extend(view.sky.words());
        let mut drawn = view.caches.words();
        drawn.extend(self.settings_words(settings, caches));
        [words, drawn]
    }

    /// What a session says to open, in a window like this one.
    pub(crate) fn of_session(&self, words: &[String]) -> Result<Self> {
        match parsed("view", words)? {
            Command::View(view) => Ok(Self {
                size: self.size,
                no_panels: self.no_panels,
                present: self.present,
                device: self.device.clone(),
                against: None,
                reference_spp: self.reference_spp,
                watch: self.watch,
                target_hz: self.target_hz,
                ..*view
            }),
            _ => bail!("needs flags of `lightskin view`"),
        }
    }
}

/// Flags of `render` that a session has read.
pub(crate) struct Drawing(Box<Render>);

impl Drawing {
    /// From the words of `View::session_words`.
    pub(crate) fn new(words: &[String]) -> Result<Self> {
        let out = ["-o".to_owned(), "picture.png".to_owned()];
        match parsed("render", &[&out, words].concat())? {
            Command::Render(render) => Ok(Self(render)),
            _ => bail!("needs flags of `lightskin render`"),
        }
    }

    /// The settings, with so many caches.
    pub(crate) fn settings(&self, gpu: &Gpu, caches: usize) -> Result<Settings> {
        self.0.settings(gpu, caches, true)
    }
}

/// What a subcommand makes of these words.
fn parsed(command: &str, words: &[String]) -> Result<Command> {
    let all = ["lightskin", command].into_iter().chain(words.iter().map(String::as_str)).map(OsString::from);
    let cli = super::parse(super::grammar(), all.collect()).map_err(|error| {
        let said = error.to_string();
        anyhow!("{}", said.lines().next().unwrap_or_default().trim_start_matches("error: ").to_owned())
    })?;
    Ok(cli.command)
}

fn shadow_word(shadows: Shadows) -> String {
    ShadowsArg::of(shadows)
}

/// A picture that was read back, and how it is written: OpenEXR with all layers or PNG, by the name.
pub(crate) struct Taken {
    writing: Writing,
    read: Read,
}

impl Taken {
    /// Reads the picture of the last frame back, for such a file.
    pub(crate) fn of(gpu: &Gpu, picture: &Picture, view: &FrameView, look: &Look, path: &Path) -> Result<Self> {
        let writing = Writing { layer: None, tonemap: TonemapArg::of(look.tonemap), behind: look.behind };
        Ok(Self { writing, read: Read::of(gpu, picture, view, writing.needs_all(path))? })
    }

    /// Writes it; `about` is what an EXR says of itself.
    pub(crate) fn write(self, about: &str, path: &Path) -> Result<()> {
        match self.writing.write_read(self.read, about, path)? {
            0 => Ok(()),
            broken => bail!("{broken} values of the picture are negative or not finite; this is a bug of lightskin"),
        }
    }
}

/// Prints a line of the result on standard output.
pub(crate) fn print(line: &str) {
    say!("{line}");
}

/// A word as a shell takes it.
fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./,:=+@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', "'\\''"))
}

pub(super) fn run(args: &View) -> Result<()> {
    crate::app::run(args)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_for_a_shell() {
        assert_eq!(quoted("scenes/a.glb"), "scenes/a.glb");
        assert_eq!(quoted("0,1,4;0,1,0;0,1,0;40"), "'0,1,4;0,1,0;0,1,0;40'");
        assert_eq!(quoted("it's"), "'it'\\''s'");
        assert_eq!(quoted(""), "''");
    }
}
