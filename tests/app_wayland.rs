//! The window on Wayland. The compositor is Weston. Its own window is on a private X display, where tests press keys and
//! read pixels.

use crate::cli::folder;
use crate::common::window::{App, Display, PATIENCE, SMALL, cornell, png};
use std::fs::{self, Permissions};
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

const SOCKET: &str = "lightskin-test";

/// A running compositor. Its shell gives each window the whole screen, without a frame: Weston 10 sometimes crashes when
/// a frame grows.
struct Weston {
    server: Child,
    /// Folder of its socket.
    runtime: PathBuf,
}

impl Weston {
    /// Starts a compositor with a screen of this size [pixels], two for each logical pixel. If it is missing, prints a
    /// message and returns `None`.
    fn start(display: &Display, folder: &Path, [width, height]: [u16; 2]) -> Option<Self> {
        let runtime = folder.join("runtime");
        fs::create_dir_all(&runtime).expect("a folder");
        fs::set_permissions(&runtime, Permissions::from_mode(0o700)).expect("a private folder");
        let size = [format!("--width={}", width / 2), format!("--height={}", height / 2)];
        let started = Command::new("weston")
            .args([
                "--backend=x11-backend.so",
                "--use-pixman",
                "--shell=kiosk-shell.so",
                "--scale=2",
                "--no-config",
                "--idle-time=0",
            ])
            .args(size)
            .arg(format!("--socket={SOCKET}"))
            .arg(format!("--log={}", folder.join("weston.log").display()))
            .env("DISPLAY", display.name())
            .env("XDG_RUNTIME_DIR", &runtime)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn();
        let Ok(server) = started else {
            println!("skipped: no Weston here; scripts/setup installs it");
            return None;
        };
        let mut weston = Self { server, runtime };
        let start = Instant::now();
        while !weston.runtime.join(SOCKET).exists() {
            let ended = weston.server.try_wait().expect("a process");
            assert!(ended.is_none() && start.elapsed() < PATIENCE, "Weston does not start: {ended:?}");
            std::thread::sleep(Duration::from_millis(20));
        }
        Some(weston)
    }
}

impl Drop for Weston {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

/// Waits until keys reach the window. Those that come before the compositor has given it the focus are lost. The key that
/// is pressed here stores the camera, which may be done twice.
fn wait_for_focus(app: &App) {
    let start = Instant::now();
    while app.told("stored as camera 1").is_empty() {
        assert!(start.elapsed() < PATIENCE, "no key reaches the window");
        app.press_with("Control", "1");
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// Asks for command lines until one contains `wanted`, since the compositor answers when it likes.
fn becomes(app: &mut App, wanted: &str) {
    let start = Instant::now();
    let mut command = app.command();
    while !command.contains(wanted) {
        assert!(start.elapsed() < PATIENCE, "'{wanted}' is not in: {command}");
        command = app.command();
    }
}

/// The window fills the screen that the compositor gives it, on a display with two pixels for each logical pixel: its
/// panels are twice as large. It takes keys and clicks, shows its picture, and ends without messages.
#[test]
fn a_window_on_wayland_has_the_displays_size_and_scale() {
    let Some(display) = Display::open() else { return };
    let folder = folder("app_wayland");
    let screen @ [width, height] = [960, 500];
    let Some(weston) = Weston::start(&display, &folder, screen) else { return };
    let scene = cornell();
    let words = ["view", scene.to_str().expect("a path"), "--size", "160x120", "--reduced-motion"];
    let runtime = weston.runtime.to_str().expect("a path");
    let variables = [("WAYLAND_DISPLAY", SOCKET), ("XDG_RUNTIME_DIR", runtime), ("DISPLAY", "")];
    let mut app = App::start_with(&display, &folder, &variables, &[&words[..], &SMALL].concat());
    assert_eq!(app.size(), screen, "the compositor's window");
    app.line("scene");
    wait_for_focus(&app);
    becomes(&mut app, "--size 320x500");
    // The slider of bounces.
    app.tap([320 + 224, 440], "--bounces ");
    // The handle of the light covers a part of the picture.
    app.press("L");
    let (size, picture) = png(&folder.join(app.picture()));
    assert_eq!(size, [320, height]);
    let at = |i: usize| (i % usize::from(width), i / usize::from(width));
    let wanted = |i| if at(i).0 < 320 { picture[at(i).1 * 320 + at(i).0] } else { [0; 3] };
    let wanted: Vec<[u8; 3]> = (0..usize::from(width) * usize::from(height)).map(wanted).collect();
    app.shows_at(screen, &wanted, |i| at(i).0 < 320, "the picture");
    app.quit();
}
