//! The sheet: all scenes of a folder on one page, the worst first, and a line for each file that cannot be drawn.

use std::fs;
use std::path::Path;

use crate::cli::{fails, folder, left, works};

#[test]
fn a_sheet_has_every_scene_and_a_word_on_every_broken_one() {
    let at = folder("sheet");
    let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets");
    fs::create_dir_all(at.join("scenes/in it")).expect("made");
    fs::copy(assets.join("cornell_diffuse.glb"), at.join("scenes/in it/a & b.glb")).expect("copied");
    fs::copy(assets.join("cornell_glossy.glb"), at.join("scenes/glossy.GLB")).expect("copied");
    fs::write(at.join("scenes/broken.gltf"), "{").expect("written");
    fs::write(at.join("scenes/notes.txt"), "no scene").expect("written");
    let small = ["--size", "48x32", "--spp", "32"];
    let args = [&["lab", "sheet", "scenes", "-o", "sheet.html"], &small[..], &["--", "--caches", "100"]].concat();
    let said = works(&at, &args);
    println!("{said}");
    assert!(said.contains("2, 1 could not be drawn"), "{said}");
    assert_eq!(left(&at), ["scenes", "sheet.html"]);

    let page = fs::read_to_string(at.join("sheet.html")).expect("a page");
    assert_eq!(page.matches("data:image/png;base64,").count(), 6);
    assert!(!page.contains("src=\"http") && page.contains("Flags of both: --caches 100"));
    let broken = page.lines().find(|line| line.contains("broken.gltf")).expect("told");
    assert!(broken.contains("JSON"), "{broken}");
    assert!(!page.contains("notes.txt"));
    // The worst scene is first, with the figures of the output.
    let figures = |line: &str| -> Option<(f64, f64, String)> {
        let (flip, rest) = line.strip_prefix("FLIP ")?.split_once(", noise ")?;
        let (noise, rest) = rest.split_once(", bias ")?;
        Some((flip.parse().ok()?, noise.parse().ok()?, rest.split_once("%  ")?.1.to_owned()))
    };
    let mut lines: Vec<(f64, f64, String)> = said.lines().filter_map(figures).collect();
    lines.sort_by(|a, b| b.0.total_cmp(&a.0));
    assert_eq!(lines.len(), 2, "{said}");
    let heads: Vec<&str> = page.lines().filter(|line| line.contains("<h2")).collect();
    for ((flip, noise, scene), (index, head)) in lines.iter().zip(heads.iter().enumerate()) {
        assert!(*noise > 0.0 && noise < flip && head.contains(&format!("scene-{index}")), "{head}");
        assert!(head.contains(&scene.replace('&', "&amp;")), "{head} does not name {scene}");
        assert!(
            page.contains(&format!("<b>{flip:.4}</b>")) && page.contains(&format!("{noise:.4}")),
            "{flip}, {noise}"
        );
    }
}

#[test]
fn sheets_without_a_scene_fail() {
    let at = folder("sheet none");
    fs::create_dir_all(at.join("empty")).expect("made");
    fails(&at, &["lab", "sheet", "empty"], 1, &["no", ".gltf"]);
    fails(&at, &["lab", "sheet", "missing"], 1, &["missing"]);
    fs::write(at.join("empty/broken.glb"), "x").expect("written");
    fails(&at, &["lab", "sheet", "empty"], 1, &["none of 1"]);
}
