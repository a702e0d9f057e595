//! Runs the tool on mutants of all kinds, each in its own process.

use super::seeds::{self, BOX, Kind, Seed};
use super::{Random, mutant};
use crate::cli::{folder, keeping, text};
use crate::common::window::Display;
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{BufRead, BufReader};
use std::ops::Range;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Limits of each run: processor time [s] and address space [KiB].
const MOST_SECONDS: u32 = 10;
const MOST_KIB: u32 = 2 << 20;

/// Time limit of each run on a busy machine.
const PATIENCE: Duration = Duration::from_secs(100);

/// Arguments that make kept bakes and samples.
pub(super) const CACHES: [&str; 2] = ["--caches", "40"];
pub(super) const PATH_TRACE: [&str; 9] =
    ["render", BOX, "-o", "a.png", "--gi", "path-trace", "--size", "4x4", "--spp=16"];
const DRAW: [&str; 8] = ["-o", "a.png", "--size", "16x16", "--rsm", "8", "--quality", "low"];

/// Phrases that tell the user what to do. An error line must contain one of them.
const REMEDIES: [&str; 23] = [
    "export",
    "write or download",
    "give a",
    "convert",
    "simplify",
    "split",
    "merge",
    "lower ",
    "raise ",
    "put the file",
    "move the file",
    "rename the file",
    "keep buffers",
    "check the path",
    "ask for",
    "save ",
    "allows it",
    "is needed",
    "are needed",
    "needs ",
    "must be",
    "use ",
    "leaves it out",
];

/// The numbers of mutants from `LIGHTSKIN_FUZZ`.
fn wanted() -> Option<Range<u64>> {
    let text = std::env::var("LIGHTSKIN_FUZZ").ok()?;
    let number = |text: &str| text.parse().expect("LIGHTSKIN_FUZZ is a number of mutants, or FIRST..END");
    Some(match text.split_once("..") {
        Some((first, end)) => number(first)..number(end),
        None => 0..number(&text),
    })
}

/// A random seed, according to the weights of the kinds, and its index over all kinds.
fn chosen<'a>(seeds: &'a [(usize, Vec<Seed>)], random: &mut Random) -> (usize, &'a Seed) {
    let mut at = random.below(seeds.iter().map(|(weight, _)| weight).sum());
    let mut before = 0;
    for (weight, of_kind) in seeds {
        if at < *weight {
            let index = random.below(of_kind.len());
            return (before + index, &of_kind[index]);
        }
        at -= weight;
        before += of_kind.len();
    }
    unreachable!("is below the sum")
}

/// Folder for mutants of a seed, with the files that the seed refers to.
fn place(at: &Path, index: usize, seed: &Seed) -> PathBuf {
    fn copy(from: &Path, to: &Path, depth: usize) {
        fs::create_dir_all(to).expect("the target folder is writable");
        for entry in fs::read_dir(from).expect("test data is readable").flatten() {
            let (path, to) = (entry.path(), to.join(entry.file_name()));
            if path.is_dir() && depth > 0 {
                copy(&path, &to, depth - 1);
            } else if path.is_file() && path.extension().is_none_or(|e| e != "gltf" && e != "glb") {
                // Unlike `fs::copy`, this does not copy a read-only permission.
                fs::write(to, fs::read(path).expect("test data is readable")).expect("the target folder is writable");
            }
        }
    }
    let Some(beside) = &seed.beside else { return at.to_owned() };
    let folder = at.join(format!("seed_{index}"));
    if !folder.exists() {
        copy(beside, &folder, 1);
    }
    folder
}

/// The tool's arguments for a mutant.
fn arguments(seed: &Seed, random: &mut Random) -> Vec<String> {
    fn path_trace(scene: &str) -> Vec<&str> {
        [&["render", scene], &PATH_TRACE[2..]].concat()
    }
    let name = seed.name.as_str();
    let words = match (seed.kind, random.below(60)) {
        (Kind::Scene, 0) => [&["render", name][..], &DRAW, &CACHES].concat(),
        (Kind::Scene, 1..=7) => path_trace(name),
        (Kind::Scene, _) => [&["bake", name][..], &CACHES].concat(),
        (Kind::Sky, _) => [&path_trace(BOX)[..], &["--sky", name]].concat(),
        (Kind::Picture, _) => vec!["compare", name, name],
        (Kind::Bake, 0..=5) => [&["render", BOX][..], &DRAW, &CACHES].concat(),
        (Kind::Bake, _) => [&["bake", BOX][..], &CACHES].concat(),
        (Kind::Samples, _) => PATH_TRACE.to_vec(),
        (Kind::Session, _) => vec!["view", name, "--size", "16x16"],
    };
    words.into_iter().map(str::to_owned).collect()
}

/// How a run of the tool ended.
struct Ended {
    status: ExitStatus,
    /// Stopped by the test, because time ran out or the window shows its scene.
    stopped: bool,
    time: Duration,
    said: String,
}

impl Ended {
    /// Whether the limit of processor time has ended the process.
    fn is_out_of_time(&self) -> bool {
        const SIGXCPU: i32 = 24;
        matches!(self.status.signal(), Some(SIGXCPU | 9)) && !self.stopped
    }
}

/// Runs the tool with the limits.
fn run(folder: &Path, display: Option<&Display>, words: &[String], seconds: u32) -> Ended {
    let err = folder.join("stderr.txt");
    let mut command = Command::new("sh");
    let limit = format!("ulimit -v {MOST_KIB}; ulimit -t {seconds}; exec \"$0\" \"$@\"");
    keeping(command.args(["-c", &limit, env!("CARGO_BIN_EXE_lightskin")]).args(words), folder)
        .env("RAYON_NUM_THREADS", "1")
        .stdout(Stdio::piped())
        .stderr(File::create(&err).expect("the target folder is writable"));
    if let Some(display) = display {
        command.env("DISPLAY", display.name()).env("XDG_STATE_HOME", folder).env("XDG_CONFIG_HOME", folder);
        command.env_remove("WAYLAND_DISPLAY").env_remove("WAYLAND_SOCKET");
    }
    let start = Instant::now();
    let mut process = command.spawn().expect("the tool runs");
    let is_shown = lines(&mut process);
    let (mut stopped, mut status) = (false, None);
    while status.is_none() {
        let shown = display.is_some() && is_shown.load(Ordering::Relaxed) == 1;
        if shown || start.elapsed() > PATIENCE {
            stopped = true;
            let _ = process.kill();
            status = Some(process.wait().expect("a process"));
        } else {
            std::thread::sleep(Duration::from_millis(3));
            status = process.try_wait().expect("a process");
        }
    }
    let time = start.elapsed();
    let said = text(&fs::read(err).expect("its messages"));
    Ended { status: status.expect("has ended"), stopped, time, said }
}

/// Reads the tool's standard output. The result becomes 1 once a window shows its scene.
fn lines(process: &mut Child) -> std::sync::Arc<AtomicU64> {
    let shown = std::sync::Arc::new(AtomicU64::new(0));
    let (out, told) = (BufReader::new(process.stdout.take().expect("its output")), shown.clone());
    std::thread::spawn(move || {
        for line in out.lines().map_while(Result::ok) {
            if line.starts_with("scene ") {
                told.store(1, Ordering::Relaxed);
            }
        }
    });
    shown
}

/// An error describes what is wrong with a run. Otherwise the result is the tool's error line, if the mutant was
/// refused.
fn judged(ended: &Ended, kind: Kind) -> Result<Option<String>, String> {
    let last = ended.said.lines().last().unwrap_or_default();
    let broken = ["panicked", "bug of lightskin", "memory allocation", "not a number"];
    if broken.iter().any(|word| ended.said.contains(word)) {
        return Err(ended.said.clone());
    }
    if ended.time > PATIENCE {
        return Err(format!("took more than {:.1} s", ended.time.as_secs_f64()));
    }
    if let Some(line) = ended.said.lines().find(|line| !line.starts_with("lightskin: ")) {
        return Err(format!("a line that the tool did not write: {line}"));
    }
    if ended.is_out_of_time() {
        return Err(format!("took more than {MOST_SECONDS} s"));
    }
    match ended.status.code() {
        Some(0) => Ok(None),
        _ if ended.stopped && kind == Kind::Session => Ok(None),
        Some(1) if remedy(last) => Ok(Some(last.to_owned())),
        Some(1) => Err(format!("no file, place or remedy: {last}")),
        _ => Err(format!("{}: {last}", ended.status)),
    }
}

/// Whether a line names file, place and remedy.
fn remedy(line: &str) -> bool {
    let mut parts = line.split(": ");
    let named = parts.next() == Some("lightskin") && parts.next().is_some_and(|file| !file.is_empty());
    let rest: Vec<&str> = parts.collect();
    named && rest.len() > 1 && REMEDIES.iter().any(|word| rest[1..].iter().any(|part| part.contains(word)))
}

/// A line without its numbers and names.
fn shape(line: &str) -> String {
    let mut shape = String::new();
    let mut quote = None;
    for letter in line.chars() {
        match quote {
            Some(end) => {
                if letter == end {
                    quote = None;
                    shape.push(letter);
                }
            }
            None if letter == '"' || (letter == '\'' && !shape.ends_with(char::is_alphabetic)) => {
                quote = Some(letter);
                shape.push(letter);
            }
            None if letter.is_ascii_digit() => {
                if !shape.ends_with('#') {
                    shape.push('#');
                }
            }
            None => shape.push(letter),
        }
    }
    shape
}

#[derive(Default)]
struct Found {
    accepted: usize,
    refused: usize,
    slowest: Duration,
    /// For each shape of error lines: how often it occurred, and one such line.
    lines: BTreeMap<String, (usize, String)>,
    faults: Vec<String>,
}

#[test]
fn mutants_end_in_a_result_or_one_line_with_a_remedy() {
    let Some(range) = wanted() else {
        println!("skipped: LIGHTSKIN_FUZZ=10000 runs the tool on that many broken files; see scripts/test");
        return;
    };
    let seeds = seeds::all();
    let display = Display::open();
    folder("fuzz/found");
    let next = AtomicU64::new(range.start);
    let found = Mutex::new(Found::default());
    let work = |worker: usize| {
        let at = folder(&format!("fuzz/worker_{worker}"));
        seeds::write_box(&at);
        // The first run measures the fastest gather, and the driver compiles the shaders.
        let words = [&["render", BOX][..], &DRAW, &CACHES].concat().into_iter().map(str::to_owned).collect::<Vec<_>>();
        let first = run(&at, None, &words, 300);
        assert!(first.status.success(), "{}", first.said);
        loop {
            let number = next.fetch_add(1, Ordering::Relaxed);
            if number >= range.end {
                break;
            }
            let mut random = Random::new(number);
            let (index, seed) = chosen(&seeds, &mut random);
            let kept = matches!(seed.kind, Kind::Bake | Kind::Samples);
            let at = if kept { at.join("cache/lightskin") } else { place(&at, index, seed) };
            let bytes = mutant(seed, &mut random);
            fs::write(at.join(&seed.name), &bytes).expect("the target folder is writable");
            let display = display.as_ref().filter(|_| seed.kind == Kind::Session);
            if seed.kind == Kind::Session && display.is_none() {
                continue;
            }
            let words = arguments(seed, &mut random);
            let from = if kept { at.join("../..") } else { at };
            let mut ended = run(&from, display, &words, MOST_SECONDS);
            if ended.is_out_of_time() && words.iter().any(|word| word == "--rsm") {
                // The driver may have compiled shaders for a new kind of scene. The second run finds them in its cache.
                ended = run(&from, display, &words, MOST_SECONDS);
            }
            let mut found = found.lock().expect("no thread panics while it holds the lock");
            found.slowest = found.slowest.max(ended.time);
            match judged(&ended, seed.kind) {
                Ok(None) => found.accepted += 1,
                Ok(Some(line)) => {
                    found.refused += 1;
                    found.lines.entry(shape(&line)).or_insert((0, line)).0 += 1;
                }
                Err(fault) => {
                    let place = format!("fuzz/found/{number}");
                    fs::write(folder(&place).join(&seed.name), bytes).expect("the target folder is writable");
                    println!("{number} {:?}: lightskin {}: {fault}", seed.kind, words.join(" "));
                    found.faults.push(fault);
                }
            }
        }
    };
    std::thread::scope(|scope| {
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let work = &work;
        (0..threads).for_each(|worker| drop(scope.spawn(move || work(worker))));
    });
    let Found { accepted, refused, slowest, lines, faults } =
        found.into_inner().expect("no thread panics while it holds the lock");
    let told: String = lines.values().map(|(count, line)| format!("{count:>6}  {line}\n")).collect();
    fs::write(folder("fuzz/told").join("errors.txt"), told).expect("the target folder is writable");
    println!(
        "{accepted} accepted, {refused} refused with {} kinds of error lines, {} faults, slowest {:.2} s",
        lines.len(),
        faults.len(),
        slowest.as_secs_f64()
    );
    assert!(faults.is_empty(), "{} faults", faults.len());
}
