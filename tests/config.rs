//! Origins of the window's settings, shell completions, and manual pages.

use crate::cli::{folder, text, works};
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

/// Runs `lightskin config show` with this settings file, variables and flags.
fn shown(folder: &Path, file: Option<&str>, variables: &[(&str, &str)], flags: &[&str]) -> Output {
    let path = folder.join("config/lightskin/settings.toml");
    let _ = fs::remove_file(&path);
    if let Some(file) = file {
        fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
        fs::write(&path, file).expect("a file");
    }
    let mut command = Command::new(env!("CARGO_BIN_EXE_lightskin"));
    command.args(["config", "show"]).args(flags).env("XDG_CONFIG_HOME", folder.join("config"));
    command.envs(variables.iter().copied()).output().expect("the tool runs")
}

/// Value and origin of a setting.
fn of(out: &Output, name: &str) -> (String, String) {
    let told = text(&out.stdout);
    let line = told.lines().find(|line| line.split(' ').next() == Some(name));
    let line = line.unwrap_or_else(|| panic!("no {name} in {told}{}", text(&out.stderr)));
    let mut words = line.split_whitespace().skip(1);
    let value = words.next().expect("a value").to_owned();
    (value, words.collect::<Vec<_>>().join(" "))
}

#[test]
fn settings_say_where_they_come_from() {
    let folder = folder("config");
    let pair = |value: &str, origin: &str| (value.to_owned(), origin.to_owned());
    let bare = shown(&folder, None, &[], &[]);
    assert_eq!(of(&bare, "quality"), pair("high", "default"));
    assert!(text(&bare.stdout).contains("(does not exist)"));
    let file = "quality = \"low\"\ncaches = 321\nno-panels = true\n\"reference-spp\" = 64\n";
    let out =
        shown(&folder, Some(file), &[("LIGHTSKIN_CACHES", "77"), ("LIGHTSKIN_TONEMAP", "agx")], &["--tonemap", "aces"]);
    assert_eq!(of(&out, "quality"), pair("low", "file"));
    assert_eq!(of(&out, "no-panels"), pair("true", "file"));
    assert_eq!(of(&out, "caches"), pair("77", "LIGHTSKIN_CACHES"));
    assert_eq!(of(&out, "tonemap"), pair("aces", "command line"));
    assert_eq!(of(&out, "size"), pair("1280x720", "default"));
}

#[test]
fn broken_settings_are_named() {
    let folder = folder("config_broken");
    for (file, part) in [
        ("qualty = \"low\"", "qualty: no setting"),
        ("quality = \"best\"", "quality: invalid value 'best'"),
        ("quality = ", "TOML"),
        ("quality = [\"low\"]", "quality: needs a string"),
        ("ev = 3", "ev: no setting"),
        ("ui-scale = 9", "ui-scale: invalid value '9' for '--ui-scale <F>': needs a number from 0.5 to 4"),
        ("max-fps = 0", "max-fps: invalid value '0' for '--max-fps <F>': needs a number of at least 1"),
    ] {
        let out = shown(&folder, Some(file), &[], &[]);
        let said = text(&out.stderr);
        assert_eq!(out.status.code(), Some(1), "{file}: {said}");
        assert!(said.contains("settings.toml") && said.contains(part) && said.lines().count() == 1, "{file}: {said}");
    }
    // Commands without a window have no settings file.
    works(&folder, &["compare", "--help"]);
}

#[test]
fn shells_and_manuals_know_all_subcommands() {
    let folder = folder("manual");
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let told = works(&folder, &["completions", shell]);
        assert!(["view", "render", "reference-spp"].iter().all(|word| told.contains(word)), "{shell}");
    }
    let page = works(&folder, &["man"]);
    assert!(page.contains(".TH lightskin 1") && page.contains("lightskin\\-render(1)"), "{page}");
    assert!(works(&folder, &["man", "view"]).contains("\\-\\-watch"));
}
