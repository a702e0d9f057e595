//! `lightskin view`: the initial state of the window, and loading of a scene in the same way as `render`.

use super::camera::camera;
use super::drawing::DrawingArgs;
use super::picture::{Read, TonemapArg, Writing};
use super::sky::SkyArgs;
use super::words::{AntialiasingArg, GiArg, NearArg, ShadowsArg, light_shadows_word};
use super::{CacheArgs, Command, DeviceArgs, QualityArg, called, divide_for, load_under, word, wrong_usage};
use anyhow::{Context, Result, anyhow, bail};
use clap::ValueEnum;
use lightskin::frame::View as FrameView;
use lightskin::frame::engine::Loaded;
use lightskin::frame::settings::Ways;
use lightskin::frame::{
    Antialiasing, ClusterRule, Exposure, Interpolation, Look, Picture, Quality, Settings, Shadows, Tonemap,
};
use lightskin::gpu::{Gpu, Present};
use lightskin::scene::defaults::Ground;
use std::ffi::OsString;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use winit::raw_window_handle::RawDisplayHandle;

#[derive(clap::Args, Clone)]
pub(crate) struct View {
    /// glTF or GLB file, a folder that contains one, or a saved session [default: the built-in showpiece].
    ///
    /// The window saves a session with Ctrl+S. Other files can be dropped on the window.
    pub(crate) scene: Option<PathBuf>,
    /// Size of the picture without the panels [pixels].
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = super::render::size)]
    pub(crate) size: [u32; 2],
    /// Initial camera of the scene by name or index, or "eye;target;up;fov" [default: the first camera].
    ///
    /// eye, target and up are x,y,z [m]; fov is the vertical field of view [degrees].
    #[arg(long, value_name = "CAMERA", allow_hyphen_values = true, value_parser = super::camera::readable)]
    pub(crate) camera: Option<String>,
    /// Exposure value at ISO 100 [default: metered from the surfaces in view].
    ///
    /// A luminance of 1.2 * 2^EV cd/m^2 becomes white.
    #[arg(long, value_name = "EV", allow_hyphen_values = true, value_parser = super::render::exposure)]
    ev: Option<f32>,
    /// Tone curve from radiance to display colours.
    #[arg(long, value_enum, default_value_t)]
    tonemap: TonemapArg,
    /// Picture of the same size to compare with, PNG or OpenEXR. The Space key shows or hides it.
    #[arg(long, value_name = "FILE")]
    pub(crate) against: Option<PathBuf>,
    /// Samples per pixel at which the path-traced reference stops. The Space key shows the reference.
    #[arg(long, value_name = "N", default_value_t = 4096, value_parser = clap::value_parser!(u32).range(1..=16_777_216))]
    pub(crate) reference_spp: u32,
    /// Reload the scene when its files change. The camera stays.
    #[arg(long)]
    pub(crate) watch: bool,
    /// Compile shaders again when their files change, for developers of lightskin.
    ///
    /// The default folder is the one from which this program was built. Another one must hold the same shaders at the
    /// start. Errors appear over the picture, which keeps the last shaders that compiled and that the device took. Other
    /// bindings, push constants and structs of shared*.glsl need a new build.
    #[cfg(feature = "glsl")]
    #[arg(long, hide_short_help = true, value_name = "FOLDER", num_args = 0..=1, require_equals = true, default_missing_value = concat!(env!("CARGO_MANIFEST_DIR"), "/glsl"))]
    pub(crate) dev: Option<PathBuf>,
    /// Target frame rate [frames/s]. The timings panel draws a line at the time that a frame may take.
    #[arg(long, value_name = "HZ", value_parser = super::positive)]
    pub(crate) target_hz: Option<f64>,
    /// Start with hidden panels. The Tab key shows them.
    #[arg(long)]
    pub(crate) no_panels: bool,
    /// Size of the panels' text, relative to the display's own scale, from 0.5 to 4.
    ///
    /// Ctrl+Plus and Ctrl+Minus change it in the window, Ctrl+0 restores it.
    #[arg(long, value_name = "F", default_value_t = 1.0, value_parser = ui_scale)]
    pub(crate) ui_scale: f32,
    /// Largest number of frames per second, at least 1 [default: no limit].
    ///
    /// It saves power while an animation plays or the camera flies.
    #[arg(long, value_name = "F", value_parser = max_fps)]
    pub(crate) max_fps: Option<f64>,
    /// Panels change at once, without animated transitions.
    ///
    /// Animations of a scene never start by themselves, with or without this flag.
    #[arg(long)]
    pub(crate) reduced_motion: bool,
    /// Presentation mode. A mode that the device does not support falls back to fifo.
    #[arg(long, value_enum, default_value_t)]
    present: PresentArg,
    #[command(flatten)]
    drawing: DrawingArgs,
    #[command(flatten)]
    caches: CacheArgs,
    #[command(flatten)]
    pub(crate) sky: SkyArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

/// Range of `--ui-scale`.
pub(crate) const UI_SCALES: RangeInclusive<f32> = 0.5..=4.0;

fn ui_scale(text: &str) -> std::result::Result<f32, String> {
    let scale = text.parse::<f32>().ok().filter(|scale| UI_SCALES.contains(scale));
    scale.ok_or_else(|| format!("needs a number from {} to {}", UI_SCALES.start(), UI_SCALES.end()))
}

fn max_fps(text: &str) -> std::result::Result<f64, String> {
    text.parse::<f64>()
        .ok()
        .filter(|fps| (1.0..=1e6).contains(fps))
        .ok_or_else(|| "needs a number of at least 1".into())
}

#[derive(Clone, Copy, Default, ValueEnum)]
enum PresentArg {
    /// At the next refresh of the display, in order. No tearing; every device supports it.
    #[default]
    Fifo,
    /// At the next refresh, the newest finished picture. No tearing.
    Mailbox,
    /// Immediately. Pictures may tear.
    Immediate,
}

/// The state of the window that its command line describes.
pub(crate) struct Now<'a> {
    pub(crate) settings: &'a Settings,
    pub(crate) look: &'a Look,
    /// Number of caches in the whole scene.
    pub(crate) caches: usize,
    pub(crate) size: [u32; 2],
    /// Value of `--camera`.
    pub(crate) camera: String,
    /// Index of the animation and its time [s]. `None` for a scene at rest.
    pub(crate) moment: Option<(usize, f64)>,
}

impl View {
    /// Loads the scene, and bakes its caches or reads the stored bake, as `render` does.
    pub(crate) fn load(&self, progress: &(dyn Fn(f32, &str) + Sync)) -> Result<Loaded> {
        progress(0.0, "load");
        let mut scene = load_under(self.scene.as_deref(), self.sky.sky()?, self.caches.ground)?;
        self.sky.put_behind(&mut scene)?;
        self.sky.size_lights(&mut scene);
        // Fail if the camera named on the command line is missing from the scene.
        if let Some(wanted) = &self.camera {
            camera(&scene, Some(wanted))?;
        }
        let at_vertices = divide_for(&mut scene, &self.caches, false);
        let name = called(&scene, self.scene.as_deref());
        Loaded::with_caches(scene, &self.caches.settings(), at_vertices, progress).context(name)
    }

    /// These arguments with another scene.
    pub(crate) fn with_file(&self, file: &Path) -> Self {
        Self { camera: None, scene: Some(file.to_owned()), ..self.clone() }
    }

    /// These arguments with this environment map as the sky.
    pub(crate) fn with_sky(&self, file: &Path) -> Self {
        let mut view = self.clone();
        view.sky.replace(file);
        view
    }

    pub(crate) fn quality(&self) -> Quality {
        self.caches.quality()
    }

    /// Sets the level with all its settings. The flags of the command line no longer override them.
    pub(crate) fn set_quality(&mut self, quality: Quality) {
        self.caches.quality = QualityArg::of(quality);
        self.drawing = DrawingArgs::default();
        self.set_caches(None);
    }

    /// Requested number of caches. The bake meets it approximately. `None` if their spacing is requested instead.
    pub(crate) fn cache_count(&self) -> Option<usize> {
        self.caches.spacing.is_none().then(|| self.caches.count())
    }

    /// Requested distance of caches \[m\], if it replaces their number.
    pub(crate) fn spacing(&self) -> Option<f64> {
        self.caches.spacing
    }

    /// Requests caches at this distance \[m\] instead of a number.
    pub(crate) fn set_spacing(&mut self, spacing: f64) {
        (self.caches.caches, self.caches.spacing) = (None, Some(spacing));
    }

    /// Requests this number of caches, or that of the quality level for `None`.
    pub(crate) fn set_caches(&mut self, count: Option<u32>) {
        (self.caches.caches, self.caches.spacing) = (count, None);
    }

    /// Largest angle between a surface normal and the normal of its cache [degrees].
    pub(crate) fn angle(&self) -> f64 {
        self.caches.angle
    }

    pub(crate) fn set_angle(&mut self, degrees: f64) {
        self.caches.angle = degrees;
    }

    /// The requested ground.
    pub(crate) fn ground(&self) -> Ground {
        self.caches.ground
    }

    pub(crate) fn set_ground(&mut self, ground: Ground) {
        self.caches.ground = ground;
    }

    /// Number of caches interpolated at each vertex.
    pub(crate) fn references(&self) -> usize {
        self.caches.settings().references
    }

    /// Requests 8 or 16 interpolated caches.
    pub(crate) fn set_references(&mut self, count: usize) {
        let usual = self.quality().references();
        self.caches.refs = (count != usual).then(|| count.to_string());
    }

    /// The initial settings with this number of caches. Stages with unchanged inputs are skipped.
    pub(crate) fn settings(&self, caches: usize, ways: Ways) -> Settings {
        Settings { reuse: true, ..self.drawing.settings(self.quality(), caches, ways) }
    }

    /// Ends the process if the flags cannot be combined, or if they request what a window does not show.
    pub(crate) fn check(&self) {
        if self.drawing.gi == GiArg::PathTrace {
            wrong_usage(
                "--gi path-trace: a window shows the path tracer's picture as the reference. Press Space in it",
            );
        }
        self.drawing.check(self.quality());
        if self.drawing.antialiasing(self.quality()) == Antialiasing::Supersampled {
            wrong_usage("--aa 64 takes 64 pictures, which is too slow for a window: use --aa 8, or lightskin render");
        }
    }

    /// Initial tone curve, exposure and background.
    pub(crate) fn look(&self) -> Look {
        Look {
            tonemap: self.tonemap.curve(),
            exposure: self.ev.map_or(Exposure::Automatic, Exposure::Ev),
            behind: self.sky.behind(),
        }
    }

    /// Opens a device that can present to this display.
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

    /// The `lightskin render` command that writes the same picture.
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

    /// Settings as flags of `render`, where they differ from those of the quality level with `caches` caches.
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
                    flag("--near", word(NearArg::of(near)));
                    if let Some([per_pixel, every]) = near.rays() {
                        flag("--near-rays", per_pixel.to_string());
                        let usual = usual.near().rays().or(Quality::High.near().rays());
                        if usual.is_none_or(|[_, usual]| every != usual) {
                            flag("--near-every", every.to_string());
                        }
                    }
                }
                if shadows != self.quality().shadows(caches, near) {
                    flag("--shadows", shadow_word(shadows));
                }
            }
            (Indirect::Caches(Caches { gather: Gather::Draws { dim, .. }, .. }), _) => {
                flag("--gather", "fragment".into());
                flag("--shadows", shadow_word(if dim { Shadows::Proxy } else { Shadows::Off }));
            }
            (Indirect::Caches(Caches { gather: Gather::Clusters { rule, dim }, .. }), _) => {
                match rule {
                    ClusterRule::Distance(radii) => flag("--cluster", radii.to_string()),
                    ClusterRule::Error(share) => flag("--cluster-error", share.to_string()),
                }
                flag("--shadows", shadow_word(if dim { Shadows::Proxy } else { Shadows::Off }));
            }
            _ => {}
        }
        if matches!(settings.indirect, Indirect::Caches(Caches { interpolation: Interpolation::Printed, .. })) {
            flag("--interpolation", "printed".into());
        }
        if settings.rsm != level.rsm {
            flag("--rsm", settings.rsm.to_string());
        }
        if settings.light_shadows != level.light_shadows {
            flag("--shadow-map", light_shadows_word(settings.light_shadows));
        }
        // `render` supersamples at the highest level; a window does not.
        if settings.antialiasing != level.antialiasing || self.quality() == Quality::Reference {
            flag("--aa", word(AntialiasingArg::of(settings.antialiasing)));
        }
        if settings.layers != level.layers {
            flag("--layers", settings.layers.to_string());
        }
        words
    }

    /// The arguments to store in a session: those that load the scene, then those that draw it.
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

    /// Reads the words of a session. Size, panels, device and other properties of the window stay those of `self`.
    pub(crate) fn of_session(&self, words: &[String]) -> Result<Self> {
        // Quality and similar flags may appear in both lists.
        let grammar = super::grammar().mut_subcommand("view", |view| view.args_override_self(true));
        let all = ["lightskin", "view"].into_iter().chain(words.iter().map(String::as_str)).map(OsString::from);
        let cli = super::parse(grammar, all.collect()).map_err(|error| {
            let said = error.to_string();
            anyhow!("{}", said.lines().next().unwrap_or_default().trim_start_matches("error: ").to_owned())
        })?;
        let Command::View(view) = cli.command else { bail!("needs flags of `lightskin view`") };
        if view.drawing.antialiasing(view.quality()) == Antialiasing::Supersampled {
            bail!("--aa 64 takes 64 pictures, which is too slow for a window: use --aa 8");
        }
        Ok(Self {
            size: self.size,
            no_panels: self.no_panels,
            present: self.present,
            device: self.device.clone(),
            against: None,
            reference_spp: self.reference_spp,
            watch: self.watch,
            #[cfg(feature = "glsl")]
            dev: self.dev.clone(),
            target_hz: self.target_hz,
            ui_scale: self.ui_scale,
            max_fps: self.max_fps,
            reduced_motion: self.reduced_motion,
            ..*view
        })
    }
}

/// Whether the ending of a file's name is that of an environment map.
pub(crate) fn is_sky(file: &Path) -> bool {
    file.extension().is_some_and(|e| e.eq_ignore_ascii_case("hdr") || e.eq_ignore_ascii_case("exr"))
}

fn shadow_word(shadows: Shadows) -> String {
    ShadowsArg::of(shadows)
}

/// A picture that is being read back from the device, to be written as OpenEXR with all layers or as PNG.
pub(crate) struct Taken {
    writing: Writing,
    read: Box<dyn FnOnce() -> Result<Read> + Send>,
}

impl Taken {
    /// Begins to read back the picture of the last frame. The ending of `path` decides which layers are read.
    pub(crate) fn begin(gpu: &Gpu, picture: &Picture, view: &FrameView, look: &Look, path: &Path) -> Result<Self> {
        let writing = Writing { layer: None, tonemap: TonemapArg::of(look.tonemap), behind: look.behind };
        Ok(Self { writing, read: Box::new(Read::begin(gpu, picture, view, writing.needs_all(path))?) })
    }

    /// Waits for the picture and writes it. `about` is the description stored in an EXR file.
    pub(crate) fn write(self, about: &str, path: &Path) -> Result<()> {
        match self.writing.write_read((self.read)()?, about, path)? {
            0 => Ok(()),
            broken => bail!("{broken} values of the picture are negative or not finite; this is a bug of lightskin"),
        }
    }
}

/// Prints a result line on standard output.
pub(crate) fn print(line: &str) {
    say!("{line}");
}

/// Quotes a word for a shell, if necessary.
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
