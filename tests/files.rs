//! Files and streams that end early: full disks, closed pipes, signals, named pipes, and headers that claim too much
//! data.

use crate::cli::{ATRIUM, fails, folder, keeping, left, text, works};
use crate::common::{Builder, PNG, glb};
use lightskin::image::{Layer, write_exr, write_png};
use serde_json::json;
use std::fs;
use std::io::Write;
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

const TOOL: &str = env!("CARGO_BIN_EXE_lightskin");

const SMALL: [&str; 8] = ["--gi", "off", "--size", "64x36", "--shadow-map", "64", "--ev", "9"];

/// The tool with arguments, to be run in a folder.
fn tool(folder: &Path, args: &[&str]) -> Command {
    shell(folder, "", args)
}

/// The tool, started by a shell after the commands in `before`.
fn shell(folder: &Path, before: &str, args: &[&str]) -> Command {
    let mut command = Command::new("sh");
    command.args(["-c", &format!("{before}\nexec \"$0\" \"$@\""), TOOL]).args(args);
    keeping(&mut command, folder).env_remove("RUST_BACKTRACE");
    command
}

/// Waits until a process has ended, and fails after `seconds`.
fn ends(mut child: Child, seconds: u64) -> Output {
    let start = Instant::now();
    while child.try_wait().expect("a child").is_none() {
        if start.elapsed() > Duration::from_secs(seconds) {
            child.kill().expect("killed");
            panic!("still runs after {seconds} s");
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    child.wait_with_output().expect("has ended")
}

fn signal(child: &Child, name: &str) {
    let sent = Command::new("kill").args([name, &child.id().to_string()]).status();
    assert!(sent.expect("kill runs").success());
}

#[test]
fn what_fails_to_be_written_leaves_the_old_file() {
    let at = folder("files-failed");
    let file = at.join("picture.png");
    fs::write(&file, b"old").expect("file");
    let error = lightskin::files::replace_file(&file, |file| {
        file.write_all(b"half")?;
        Err(std::io::Error::from(std::io::ErrorKind::StorageFull))
    });
    let message = error.expect_err("the disk is full").to_string();
    assert!(message.contains("picture.png") && message.contains("free some space"), "{message}");
    assert_eq!(fs::read(&file).expect("file"), b"old");
    assert_eq!(left(&at), ["picture.png"]);
}

#[test]
fn no_picture_is_lost_where_nothing_more_can_be_written() {
    let at = folder("files-full");
    fs::write(at.join("old.png"), b"old").expect("file");
    write_png(&at.join("a.png"), 16, 16, &[128; 1024]).expect("a PNG");
    let before = left(&at);
    for args in [
        &[&["render", ATRIUM, "-o", "old.png"][..], &SMALL].concat(),
        &[&["render", ATRIUM, "-o", "new.png"][..], &SMALL].concat(),
        &[&["render", ATRIUM, "-o", "new.exr"][..], &SMALL].concat(),
        &["compare", "a.png", "a.png", "--diff", "new.png"][..],
        &["compare", "a.png", "a.png", "--diff", "old.png"],
    ] {
        // No byte can be written to any file, as on a full disk.
        let out = shell(&at, "trap '' XFSZ; ulimit -f 0", args).output().expect("the tool runs");
        let message = text(&out.stderr);
        assert_eq!(out.status.code(), Some(1), "{args:?}: {message}");
        assert!(message.contains("cannot write") && message.contains("another disk"), "{args:?}: {message}");
        assert_eq!(left(&at), before, "{args:?}");
        assert_eq!(fs::read(at.join("old.png")).expect("file"), b"old", "{args:?}");
    }
}

/// Headers of pictures that would need tens of GiB.
#[test]
fn headers_that_promise_too_much_are_refused() {
    let at = folder("files-bombs");
    let file = at.join("bomb.exr");
    write_exr(&file, 4, 2, &[Layer::rgb("", &[[1.0; 4]; 8])], "").expect("an EXR");
    let mut bytes = fs::read(&file).expect("an EXR");
    let mut set = |attribute: &[u8], at: usize, value: i32| {
        let found = bytes.windows(attribute.len()).position(|part| part == attribute).expect("the attribute");
        bytes[found + attribute.len() + 4 + at..][..4].copy_from_slice(&value.to_le_bytes());
    };
    // Corner of the picture, and number of its blocks of 16 rows.
    set(b"dataWindow\0box2i\0", 8, 99_999);
    set(b"dataWindow\0box2i\0", 12, 99_999);
    set(b"chunkCount\0int\0", 0, 6250);
    fs::write(&file, bytes).expect("file");
    fs::write(at.join("bomb.hdr"), b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 65535 +X 65535\n").expect("file");
    fails(&at, &["compare", "bomb.exr", "bomb.exr"], 1, &["bomb.exr", "--max-memory"]);
    fails(&at, &["render", "--sky", "bomb.exr"], 1, &["bomb.exr", "--max-memory"]);
    fails(&at, &["render", "--sky", "bomb.hdr"], 1, &["bomb.hdr", "--max-memory"]);
    fails(&at, &["devices", "--max-memory", "2X"], 2, &["512M"]);
    fails(&at, &["devices", "--max-memory", "0"], 2, &["512M"]);
}

#[test]
fn images_of_a_scene_share_the_bound_on_memory() {
    let at = folder("files-images");
    write_png(&at.join("wall.png"), 512, 512, &[200, 200, 200, 255].repeat(1 << 18)).expect("a PNG");
    let wall = fs::read(at.join("wall.png")).expect("a PNG");
    let mut b = Builder::triangle();
    b.attribute("TEXCOORD_0", "VEC2", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    b.primitive()["material"] = json!(0);
    let [wall, small] = [&wall[..], PNG].map(|bytes| b.view(bytes));
    b.json["images"] = json!([{"bufferView": wall}, {"uri": "wall.png"}, {"bufferView": wall}, {"bufferView": small}]);
    b.json["textures"] = json!([{"source": 0}, {"source": 1}, {"source": 2}, {"source": 3}]);
    b.json["materials"] = json!([{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0},
        "metallicRoughnessTexture": {"index": 1}}, "normalTexture": {"index": 2}, "emissiveTexture": {"index": 3}}]);
    fs::write(at.join("walls.glb"), glb(&b.json, &b.binary)).expect("file");

    // Three images of 1 MiB each stay in memory. Decoding one of them takes at least another 3/4 MiB at a time.
    let info = |most| ["info", "walls.glb", "--caches", "10", "--max-memory", most];
    fails(&at, &info("3M"), 1, &["walls.glb: images", "4 MiB", "--max-memory 4M"]);
    assert!(works(&at, &info("4M")).contains(" 4 images"));
    fails(&at, &["compare", "wall.png", "wall.png", "--max-memory", "1M"], 1, &["wall.png", "--max-memory"]);
    works(&at, &["compare", "wall.png", "wall.png", "--max-memory", "16M"]);
}

#[test]
fn closed_pipes_and_full_disks_hide_no_verdict() {
    let at = folder("files-streams");
    write_png(&at.join("a.png"), 16, 16, &[128; 1024]).expect("a PNG");
    write_png(&at.join("b.png"), 16, 16, &[64; 1024]).expect("a PNG");
    let judge = ["compare", "a.png", "b.png", "--fail-above", "mae=0"];
    let same = ["compare", "a.png", "a.png", "--fail-above", "mae=0"];

    // A reader that closes the pipe causes no failure, but a failed comparison still fails.
    for (args, code) in [(&judge[..], 1), (&same, 0), (&["--help"], 0)] {
        let mut child = tool(&at, args).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the tool runs");
        drop(child.stdout.take());
        let out = ends(child, 60);
        let message = text(&out.stderr);
        assert_eq!(out.status.code(), Some(code), "{args:?}: {message}");
        assert_eq!(message.contains("mae"), code == 1, "{args:?}: {message}");
    }
    // A full disk is a failure, and hides no other failure.
    for (args, part) in [(&judge[..], "mae"), (&same, "standard output"), (&["--help"], "standard output")] {
        let out = shell(&at, "exec > /dev/full", args).output().expect("the tool runs");
        let message = text(&out.stderr);
        assert_eq!(out.status.code(), Some(1), "{args:?}: {message}");
        assert!(message.contains(part) && message.lines().count() == 1, "{args:?}: {message}");
    }
    // With a broken standard error nothing can be printed, but the exit code is correct.
    for (args, code) in [(&judge[..], 1), (&["compare", "no.png", "b.png", "-vv"], 1), (&same, 0), (&["lab"], 2)] {
        let out = shell(&at, "exec 2> /dev/full", args).output().expect("the tool runs");
        assert_eq!(out.status.code(), Some(code), "{args:?}");
    }
}

#[test]
fn signals_leave_nothing_half_written() {
    let at = folder("files-signals");
    works(&at, &["assets", "made", "--moving"]);
    let frames = ["render", "made/moving.glb", "-o", "f_{frame}.exr", "--frames", "0..1000", "-q"];
    let args = [&frames[..], &["--gi", "off", "--size", "320x240"]].concat();
    // If these tests run in the background or under nohup, they ignore some signals, and the tool inherits this.
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| u64::from_str_radix(line.strip_prefix("SigIgn:")?.trim(), 16).ok());
    let all = [("-INT", 2), ("-TERM", 15), ("-HUP", 1)];
    let heeded = all.into_iter().filter(|(_, number)| ignored.unwrap_or(0) >> (number - 1) & 1 == 0);
    for (index, (name, number)) in heeded.cycle().take(6).enumerate() {
        let child = tool(&at, &args).spawn().expect("the tool runs");
        let start = Instant::now();
        while !at.join("f_1.exr").exists() {
            assert!(start.elapsed() < Duration::from_secs(60), "no picture");
            std::thread::sleep(Duration::from_millis(5));
        }
        std::thread::sleep(Duration::from_millis(7 * index as u64));
        signal(&child, name);
        let out = ends(child, 10);
        assert_eq!(out.status.signal(), Some(number), "{name} must end the process with its signal");
        for file in left(&at).iter().filter(|file| *file != "made") {
            assert!(!file.starts_with('.') && fs::metadata(at.join(file)).is_ok_and(|f| f.len() > 0), "{name}: {file}");
            fs::remove_file(at.join(file)).expect("removed");
        }
    }
    // The same as under nohup.
    let child = shell(&at, "trap '' HUP", &args).spawn().expect("the tool runs");
    std::thread::sleep(Duration::from_millis(500));
    signal(&child, "-HUP");
    std::thread::sleep(Duration::from_millis(500));
    signal(&child, "-TERM");
    assert_eq!(ends(child, 10).status.signal(), Some(15), "an ignored signal must stay ignored");
}

#[test]
fn a_path_trace_stops_within_its_pass() {
    let at = folder("files-pass");
    // One pass takes minutes.
    let args = ["render", ATRIUM, "--gi", "path-trace", "--bounces", "64", "--size", "2048x2048", "-o", "a.exr"];
    let child = tool(&at, &args).stderr(Stdio::piped()).spawn().expect("the tool runs");
    std::thread::sleep(Duration::from_secs(10));
    signal(&child, "-TERM");
    let out = ends(child, 60);
    let message = text(&out.stderr);
    assert_eq!(out.status.code(), Some(1), "{message}");
    assert!(message.contains("stopped at 0 of 256 samples"), "{message}");
    assert_eq!(left(&at), [""; 0]);
}

#[test]
fn named_pipes_are_refused() {
    let at = folder("files-pipes");
    write_png(&at.join("a.png"), 16, 16, &[128; 1024]).expect("a PNG");
    let pipe = |path: &Path| assert!(Command::new("mkfifo").arg(path).status().expect("mkfifo runs").success());
    ["p.hdr", "p.exr", "p.png", "p.glb"].iter().for_each(|name| pipe(&at.join(name)));
    let fails = |args: &[&str]| {
        let out = ends(tool(&at, args).stderr(Stdio::piped()).spawn().expect("the tool runs"), 20);
        let message = text(&out.stderr);
        assert_eq!(out.status.code(), Some(1), "{args:?}: {message}");
        assert!(message.contains("not a regular file"), "{args:?}: {message}");
    };
    fails(&["render", "--sky", "p.hdr"]);
    fails(&["render", "--sky", "p.exr"]);
    fails(&["render", "p.glb"]);
    fails(&["compare", "p.exr", "a.png"]);
    fails(&["compare", "a.png", "p.png"]);
    fails(&["compare", "a.png", "a.png", "--mask", "p.png"]);
    fails(&["compare", "a.png", "a.png", "--diff", "p.png"]);
    // A kept bake that is not a regular file is made again.
    let bake = ["bake", concat!(env!("CARGO_MANIFEST_DIR"), "/assets/cornell_diffuse.glb"), "--caches", "50"];
    works(&at, &bake);
    let kept = fs::read_dir(at.join("cache/lightskin")).expect("kept").map(|entry| entry.expect("entry").path());
    let bakes: Vec<_> = kept.filter(|file| file.extension().is_some_and(|ending| ending == "caches")).collect();
    let [kept] = &bakes[..] else { panic!("one bake") };
    fs::remove_file(kept).expect("removed");
    pipe(kept);
    let out = ends(tool(&at, &bake).stdout(Stdio::piped()).spawn().expect("the tool runs"), 60);
    assert!(out.status.success() && !text(&out.stdout).contains("stored bake"));
}
