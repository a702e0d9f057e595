//! Runs the window from a user's view: real key and button events on a private display.

use crate::cli::{folder, keeping};
use lightskin::scene::build::{CornellSurface, cornell as boxed};
use lightskin::scene::write::write_glb;
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::os::fd::AsRawFd;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, LazyLock, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use x11rb::connection::Connection;
use x11rb::protocol::Event;
use x11rb::protocol::xproto::{
    BUTTON_PRESS_EVENT, BUTTON_RELEASE_EVENT, ClientMessageEvent, ConfigureWindowAux, ConnectionExt as _,
    CreateWindowAux, EventMask, ImageFormat, InputFocus, KEY_PRESS_EVENT, KEY_RELEASE_EVENT, MOTION_NOTIFY_EVENT,
    MapState, PropMode, SELECTION_NOTIFY_EVENT, SelectionNotifyEvent, Window, WindowClass,
};
use x11rb::protocol::xtest::ConnectionExt as _;
use x11rb::rust_connection::RustConnection;
use x11rb::wrapper::ConnectionExt as _;

/// Time limit for each wait. It is long because the machine may be busy.
pub(crate) const PATIENCE: Duration = Duration::from_secs(120);

/// A virtual display without a screen (Xvfb). The server chooses the number.
pub(crate) struct Display {
    server: Child,
    name: String,
}

impl Display {
    /// Starts the server. If Xvfb is missing, or the driver cannot show windows, prints a message and returns `None`.
    pub(crate) fn open() -> Option<Self> {
        if std::env::var("VK_DRIVER_FILES").is_ok_and(|files| files.contains("swiftshader")) {
            println!("skipped: SwiftShader shows no windows");
            return None;
        }
        // The server writes its number to standard output. Without `-noreset` it rejects clients that connect while the
        // last one leaves.
        let arguments = ["-displayfd", "1", "-screen", "0", "1280x1800x24", "-nolisten", "tcp", "-noreset"];
        let started = Command::new("Xvfb").args(arguments).stdout(Stdio::piped()).stderr(Stdio::null()).spawn();
        let Ok(mut server) = started else {
            println!("skipped: no Xvfb here; scripts/setup installs it");
            return None;
        };
        let mut number = String::new();
        let out = server.stdout.as_mut().expect("its number");
        assert!(out.as_raw_fd() > 0);
        BufReader::new(out).read_line(&mut number).expect("its number");
        Some(Self { server, name: format!(":{}", number.trim()) })
    }

    /// The value of `DISPLAY` for this display.
    pub(crate) fn name(&self) -> &str {
        &self.name
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

/// The running program and its window.
pub(crate) struct App {
    process: Child,
    folder: PathBuf,
    lines: Receiver<String>,
    /// Lines that the program has written to standard error.
    said: Arc<Mutex<Vec<String>>>,
    errors: Option<JoinHandle<()>>,
    x: RustConnection,
    root: Window,
    window: Window,
}

/// Key codes of X, which are evdev's codes plus 8.
pub(crate) const KEYS: [(&str, u8); 25] = [
    ("Escape", 9),
    ("1", 10),
    ("2", 11),
    ("0", 19),
    ("Minus", 20),
    ("Plus", 21),
    ("Tab", 23),
    ("Q", 24),
    ("W", 25),
    ("E", 26),
    ("Return", 36),
    ("O", 32),
    ("P", 33),
    ("Control", 37),
    ("A", 38),
    ("S", 39),
    ("H", 43),
    ("L", 46),
    ("Shift", 50),
    ("Z", 52),
    ("C", 54),
    ("Space", 65),
    ("F1", 67),
    ("F12", 96),
    ("Delete", 119),
];

impl App {
    /// Starts the program in a folder and waits for its window.
    pub(crate) fn start(display: &Display, folder: &Path, arguments: &[&str]) -> Self {
        Self::start_with(display, folder, &[], arguments)
    }

    /// Like `start`, with environment variables.
    pub(crate) fn start_with(display: &Display, folder: &Path, variables: &[(&str, &str)], arguments: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lightskin"));
        let mut process = keeping(&mut command, folder)
            .args(arguments)
            // All tests share one cache, so the fastest gather is measured only once.
            .env("XDG_CACHE_HOME", folder.with_file_name("app_cache"))
            .env("XDG_CONFIG_HOME", folder.join("config"))
            .env("XDG_STATE_HOME", folder.join("state"))
            .env("DISPLAY", &display.name)
            .env_remove("WAYLAND_DISPLAY")
            .env_remove("WAYLAND_SOCKET")
            .envs(variables.iter().copied())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the tool runs");
        let (send, lines) = channel();
        let out = BufReader::new(process.stdout.take().expect("its output"));
        std::thread::spawn(move || out.lines().map_while(Result::ok).try_for_each(|line| send.send(line)));
        let said: Arc<Mutex<Vec<String>>> = Arc::default();
        let (err, of_thread) = (BufReader::new(process.stderr.take().expect("its messages")), said.clone());
        let errors = std::thread::spawn(move || {
            err.lines().map_while(Result::ok).for_each(|line| of_thread.lock().expect("messages").push(line));
        });
        let (x, screen) = x11rb::connect(Some(&display.name)).expect("the display");
        let root = x.setup().roots[screen].root;
        let start = Instant::now();
        let window = loop {
            let all = x.query_tree(root).expect("windows").reply().expect("windows").children;
            let shown = |window: &Window| {
                let attributes = x.get_window_attributes(*window).ok().and_then(|a| a.reply().ok());
                attributes.is_some_and(|a| a.map_state == MapState::VIEWABLE)
            };
            if let Some(window) = all.into_iter().find(shown) {
                break window;
            }
            if let Some(status) = process.try_wait().expect("a process") {
                let _ = errors.join();
                panic!("no window: {status}: {}", said.lock().expect("messages").join("\n"));
            }
            assert!(start.elapsed() < PATIENCE, "no window");
            std::thread::sleep(Duration::from_millis(20));
        };
        let app = Self { process, folder: folder.to_owned(), lines, said, errors: Some(errors), x, root, window };
        // There is no window manager to set the focus.
        app.x.set_input_focus(InputFocus::PARENT, app.window, 0_u32).expect("focus");
        app.sync();
        app
    }

    fn sync(&self) {
        self.x.get_input_focus().expect("a request").reply().expect("an answer");
    }

    fn fake(&self, kind: u8, detail: u8, [x, y]: [i16; 2]) {
        self.x.xtest_fake_input(kind, detail, 0, self.root, x, y, 0).expect("an event").check().expect("an event");
    }

    fn code(key: &str) -> u8 {
        KEYS.iter().find(|(name, _)| *name == key).map(|(_, code)| *code).expect("a key")
    }

    pub(crate) fn hold(&self, key: &str, down: bool) {
        self.fake(if down { KEY_PRESS_EVENT } else { KEY_RELEASE_EVENT }, Self::code(key), [0, 0]);
    }

    pub(crate) fn press(&self, key: &str) {
        self.hold(key, true);
        self.hold(key, false);
    }

    pub(crate) fn press_with(&self, other: &str, key: &str) {
        self.hold(other, true);
        self.press(key);
        self.hold(other, false);
    }

    pub(crate) fn move_to(&self, at: [i16; 2]) {
        self.fake(MOTION_NOTIFY_EVENT, 0, at);
    }

    pub(crate) fn click(&self, button: u8, at: [i16; 2]) {
        self.move_to(at);
        self.fake(BUTTON_PRESS_EVENT, button, [0, 0]);
        self.fake(BUTTON_RELEASE_EVENT, button, [0, 0]);
    }

    pub(crate) fn drag(&self, button: u8, from: [i16; 2], to: [i16; 2]) {
        self.move_to(from);
        self.fake(BUTTON_PRESS_EVENT, button, [0, 0]);
        for i in 1..=4 {
            self.move_to([0, 1].map(|k| from[k] + (to[k] - from[k]) * i / 4));
        }
        self.fake(BUTTON_RELEASE_EVENT, button, [0, 0]);
    }

    /// Waits until changes in the panels have taken effect, which may need more than one frame, and checks the command
    /// line.
    pub(crate) fn settle(&mut self, wanted: &str) {
        self.command();
        let command = self.command();
        assert!(command.contains(wanted), "'{wanted}' is not in: {command}");
    }

    /// Waits until a frame has processed all earlier input. This uses no modifier key such as Shift, which would change
    /// a drag.
    pub(crate) fn frame(&mut self) {
        let written = self.picture();
        std::fs::remove_file(self.folder.join(written)).expect("a picture");
    }

    /// Presses and releases a button in different frames, as a person does.
    pub(crate) fn tap(&mut self, at: [i16; 2], wanted: &str) {
        self.move_to(at);
        self.fake(BUTTON_PRESS_EVENT, 1, [0, 0]);
        self.frame();
        self.fake(BUTTON_RELEASE_EVENT, 1, [0, 0]);
        self.settle(wanted);
    }

    /// Chooses an entry from a list. Entries are 25 pixels high.
    pub(crate) fn choose(&mut self, [x, y]: [i16; 2], entry: i16, wanted: &str) {
        self.tap([x, y], "");
        self.tap([x, y + 2 + 25 * entry], wanted);
    }

    pub(crate) fn slide(&mut self, [x, y]: [i16; 2], by: i16, wanted: &str) {
        self.move_to([x, y]);
        self.fake(BUTTON_PRESS_EVENT, 1, [0, 0]);
        self.frame();
        self.move_to([x + by, y]);
        self.frame();
        self.fake(BUTTON_RELEASE_EVENT, 1, [0, 0]);
        self.settle(wanted);
    }

    pub(crate) fn resize(&self, width: u32, height: u32) {
        let size = ConfigureWindowAux::new().width(width).height(height);
        self.x.configure_window(self.window, &size).expect("a size").check().expect("a size");
    }

    /// Hides the window for a moment, like minimising.
    pub(crate) fn minimise(&self) {
        self.x.unmap_window(self.window).expect("a request").check().expect("a window");
        std::thread::sleep(Duration::from_millis(200));
        self.x.map_window(self.window).expect("a request").check().expect("a window");
        self.x.set_input_focus(InputFocus::PARENT, self.window, 0_u32).expect("focus");
        self.sync();
    }

    /// Delays of input so far beyond the frames themselves [ms], and the lines that report them. Needs `-vv`.
    pub(crate) fn held(&self) -> Vec<(f64, String)> {
        let one = |line: String| {
            let (_, times) = line.split_once(" held input for ")?;
            let beyond = times.split_once("ms, ")?.1.split_whitespace().next()?.parse().ok()?;
            Some((beyond, line.clone()))
        };
        self.told(" held input for ").into_iter().filter_map(one).collect()
    }

    /// Draws `frames` more frames by flying back and forth. Returns the device's counters by name, before and after.
    /// The first map also has the memory of the process [MiB]. Needs `-vv`.
    pub(crate) fn fly(&self, frames: u64) -> [BTreeMap<String, u64>; 2] {
        // Frames while the scene was loading count as well. The first fifty after them create all objects, so the line
        // that may lie among these is left out.
        let lines = || self.told(" Counters { ").into_iter();
        let early = lines().count() + 1;
        let counted = || lines().skip(early).last().map_or_else(BTreeMap::new, |line| counters(&line));
        let begin = |count: &BTreeMap<String, u64>| count.get("frames").copied().unwrap_or(0);
        let (start, mut before) = (Instant::now(), None);
        for key in ["W", "S"].into_iter().cycle() {
            self.hold(key, true);
            std::thread::sleep(Duration::from_millis(300));
            self.hold(key, false);
            let now = counted();
            if before.is_none() && begin(&now) > 0 {
                before = Some(now.into_iter().chain([("memory".to_owned(), self.memory())]).collect());
            } else if let Some(before) = before.clone().filter(|before| begin(&now) >= begin(before) + frames) {
                return [before, now];
            }
            assert!(start.elapsed() < PATIENCE * 5, "{frames} frames take too long");
        }
        unreachable!("keys go round for ever")
    }

    /// The next line of standard output that starts with `begin`.
    pub(crate) fn line(&mut self, begin: &str) -> String {
        let start = Instant::now();
        loop {
            match self.lines.recv_timeout(PATIENCE.saturating_sub(start.elapsed())) {
                Ok(line) if line.starts_with(begin) => return line,
                Ok(_) => {}
                Err(_) => {
                    let ended = self.process.try_wait().expect("a process").map(|status| format!("it ended: {status}"));
                    let seen = ended.unwrap_or_else(|| self.keep_picture());
                    let _ = self.process.kill();
                    let said = self.messages();
                    panic!("no line '{begin}'; {seen}: {}", said.join("\n"));
                }
            }
        }
    }

    /// All lines on standard error, after the program has ended.
    fn messages(&mut self) -> Vec<String> {
        let _ = self.errors.take().map(JoinHandle::join);
        std::mem::take(&mut self.said.lock().expect("messages"))
    }

    /// Lines on standard error so far that contain `part`.
    pub(crate) fn told(&self, part: &str) -> Vec<String> {
        self.said.lock().expect("messages").iter().filter(|line| line.contains(part)).cloned().collect()
    }

    /// Resident memory of the process [MiB].
    pub(crate) fn memory(&self) -> u64 {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.process.id())).expect("Linux");
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).expect("a size");
        line.trim().trim_end_matches(" kB").parse::<u64>().expect("a number") / 1024
    }

    /// Saves the window's content to a file, to help find out why a test failed. Says where it is.
    fn keep_picture(&self) -> String {
        let size = self.size();
        let pixels = self.pixels([0, 0], size);
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("window.png");
        let bytes: Vec<u8> = pixels.concat();
        let [width, height] = size.map(u32::from);
        image::save_buffer(&path, &bytes, width, height, image::ColorType::Rgb8).expect("a picture");
        format!("{} shows the window", path.display())
    }

    /// The command line of the current picture. The answer comes after all earlier requests have been processed.
    pub(crate) fn command(&mut self) -> String {
        self.hold("Shift", true);
        self.press_with("Control", "C");
        self.hold("Shift", false);
        self.line("lightskin render")
    }

    /// Presses F12 and returns the name of the picture file.
    pub(crate) fn picture(&mut self) -> String {
        self.press("F12");
        self.line("picture").split_whitespace().last().expect("a name").to_owned()
    }

    /// RGB of a part of the window.
    pub(crate) fn pixels(&self, [x, y]: [i16; 2], [width, height]: [u16; 2]) -> Vec<[u8; 3]> {
        let image = self.x.get_image(ImageFormat::Z_PIXMAP, self.window, x, y, width, height, !0);
        let image = image.expect("a request").reply().expect("pixels");
        image.data.chunks_exact(4).map(|p| [p[2], p[1], p[0]]).collect()
    }

    /// Waits until the window's top left part shows the pixels `wanted`.
    pub(crate) fn shows(&self, size: [u16; 2], wanted: &[[u8; 3]], what: &str) {
        self.shows_at(size, wanted, |_| true, what);
    }

    /// Like `shows`, but compares only some of the pixels.
    pub(crate) fn shows_at(&self, size: [u16; 2], wanted: &[[u8; 3]], some: impl Fn(usize) -> bool, what: &str) {
        let start = Instant::now();
        loop {
            let seen = self.pixels([0, 0], size);
            let differ = seen.iter().zip(wanted).enumerate().filter(|(i, (a, b))| some(*i) && a != b).count();
            if differ == 0 && seen.len() == wanted.len() {
                return;
            }
            assert!(start.elapsed() < PATIENCE, "{what}: {differ} of {} pixels differ", wanted.len());
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Waits until the window's top left part differs from the pixels `before`. Returns it.
    pub(crate) fn changes(&self, size: [u16; 2], before: &[[u8; 3]], what: &str) -> Vec<[u8; 3]> {
        let start = Instant::now();
        loop {
            let seen = self.pixels([0, 0], size);
            if seen != before {
                return seen;
            }
            assert!(start.elapsed() < PATIENCE, "{what}: no pixel changes");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Quits. Fails on any error, message of the validation layer, or missing or idle barrier.
    pub(crate) fn quit(self) {
        self.quit_after(&[]);
    }

    /// Like `quit`, but requires errors that contain these, in this order.
    pub(crate) fn quit_after(mut self, failed: &[&str]) {
        self.press_with("Control", "Q");
        let said = self.messages();
        let status = self.process.wait().expect("a process");
        assert!(status.success(), "{status}: {}", said.join("\n"));
        let errors: Vec<&String> =
            said.iter().filter(|l| l.contains("lightskin: error") || l.contains("panicked")).collect();
        let expected = errors.iter().zip(failed).all(|(error, failed)| error.contains(failed));
        assert!(errors.len() == failed.len() && expected, "{}", said.join("\n"));
    }

    /// Requires that the program has failed, with exit code 1. Returns its last message.
    pub(crate) fn failure(mut self) -> String {
        let said = self.messages();
        let status = self.process.wait().expect("a process");
        assert_eq!(status.code(), Some(1), "{}", said.join("\n"));
        let broken = |line: &&String| line.contains("validation") || line.contains("panicked");
        assert_eq!(said.iter().find(broken), None, "{}", said.join("\n"));
        said.last().expect("a message").clone()
    }

    /// Waits for a line on standard error that contains `part`.
    pub(crate) fn tells(&self, part: &str) {
        let start = Instant::now();
        while self.told(part).is_empty() {
            assert!(start.elapsed() < PATIENCE, "no '{part}' in: {}", self.told("").join("\n"));
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// Whether the program has ended.
    pub(crate) fn has_ended(&mut self) -> bool {
        self.process.try_wait().expect("a process").is_some()
    }

    /// Width and height of the window [pixels].
    pub(crate) fn size(&self) -> [u16; 2] {
        let size = self.x.get_geometry(self.window).expect("a request").reply().expect("a size");
        [size.width, size.height]
    }

    /// Drops a file on the window, as a file manager does.
    pub(crate) fn drop_file(&self, file: &Path) {
        let atom =
            |name: &str| self.x.intern_atom(false, name.as_bytes()).expect("a name").reply().expect("a name").atom;
        let [enter, position, drop, finished] = ["XdndEnter", "XdndPosition", "XdndDrop", "XdndFinished"].map(atom);
        let [selection, copy, list] = ["XdndSelection", "XdndActionCopy", "text/uri-list"].map(atom);
        let source = self.x.generate_id().expect("a window");
        let only_events = CreateWindowAux::new();
        let made = self.x.create_window(0, source, self.root, 0, 0, 1, 1, 0, WindowClass::INPUT_ONLY, 0, &only_events);
        made.expect("a window").check().expect("a window");
        self.x.set_selection_owner(source, selection, 0_u32).expect("a selection");
        let send = |kind, data: [u32; 5]| {
            let event = ClientMessageEvent::new(32, self.window, kind, data);
            self.x.send_event(false, self.window, EventMask::NO_EVENT, event).expect("an event");
        };
        send(enter, [source, 5 << 24, list, 0, 0]);
        send(position, [source, 0, 8 << 16 | 8, 0, copy]);
        self.x.flush().expect("events");
        let start = Instant::now();
        loop {
            match self.x.poll_for_event().expect("events") {
                Some(Event::SelectionRequest(asked)) => {
                    let uri = format!("file://{}\r\n", file.display());
                    let (to, at) = (asked.requestor, asked.property);
                    self.x
                        .change_property8(PropMode::REPLACE, to, at, asked.target, uri.as_bytes())
                        .expect("a property");
                    let answer = SelectionNotifyEvent {
                        response_type: SELECTION_NOTIFY_EVENT,
                        sequence: 0,
                        time: asked.time,
                        requestor: to,
                        selection: asked.selection,
                        target: asked.target,
                        property: at,
                    };
                    self.x.send_event(false, to, EventMask::NO_EVENT, answer).expect("an answer");
                    // The window now knows the file, so it can be dropped.
                    send(drop, [source, 0, 0, 0, 0]);
                    self.x.flush().expect("an answer");
                }
                Some(Event::ClientMessage(message)) if message.type_ == finished => return,
                _ => std::thread::sleep(Duration::from_millis(5)),
            }
            assert!(start.elapsed() < PATIENCE, "the file is not taken");
        }
    }
}

impl Drop for App {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Counters and number of frames from a line of the log.
fn counters(line: &str) -> BTreeMap<String, u64> {
    let (frames, held) = line.split_once(" Counters { ").expect("counters");
    let frames = frames.split_whitespace().rev().nth(1).expect("a number").parse().expect("a number");
    let pairs = held.trim_end_matches([' ', '}']).split(", ").filter_map(|pair| pair.split_once(": "));
    let counted = pairs.map(|(name, count)| (name.to_owned(), count.parse().expect("a number")));
    counted.chain([("frames".to_owned(), frames)]).collect()
}

/// Size and RGB of a PNG file.
pub(crate) fn png(path: &Path) -> ([u16; 2], Vec<[u8; 3]>) {
    let image = image::open(path).unwrap_or_else(|error| panic!("{}: {error}", path.display())).into_rgb8();
    ([image.width() as u16, image.height() as u16], image.pixels().map(|p| p.0).collect())
}

/// The Cornell box as a file, with the diffuse one beside it. It has few triangles: on software devices, those of the
/// distributed boxes are most of a small frame.
pub(crate) fn cornell() -> PathBuf {
    static ROOMS: LazyLock<PathBuf> = LazyLock::new(|| {
        let rooms = folder("app_rooms");
        for (surface, name) in [(CornellSurface::Diffuse, "diffuse"), (CornellSurface::Glossy, "glossy")] {
            write_glb(&boxed(surface, 0.5), &rooms.join(format!("cornell_{name}.glb"))).expect("a room");
        }
        rooms.join("cornell_glossy.glb")
    });
    ROOMS.clone()
}

/// Few caches and a quality that software devices can draw fast, with validation.
pub(crate) const SMALL: [&str; 6] = ["--caches", "150", "--quality", "medium", "--validation", "sync"];

/// Splits a command line that the tool has written into words, like a shell.
pub(crate) fn words(line: &str) -> Vec<String> {
    let parts = line.split('\'').enumerate();
    let quoted = |(i, part): (usize, &str)| {
        if i % 2 == 1 { vec![part.to_owned()] } else { part.split_whitespace().map(str::to_owned).collect() }
    };
    parts.flat_map(quoted).collect()
}
