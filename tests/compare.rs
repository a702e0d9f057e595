//! `lightskin compare` and its metrics: SSIM and FLIP against closed forms and other implementations.

use crate::cli::{fails, folder, left, works};
use lightskin::image::{Layer, write_exr, write_png};
use lightskin::metrics::display::Values;
use lightskin::metrics::flip::{PIXELS_PER_DEGREE, flip, weighted_quantile};
use lightskin::metrics::ssim::ssim;
use std::path::Path;

const SIZE: [u32; 2] = [96, 64];

/// A picture from a function of x and y.
fn picture(of: impl Fn(u32, u32) -> [f32; 3]) -> Vec<[f32; 3]> {
    (0..SIZE[1]).flat_map(|y| (0..SIZE[0]).map(move |x| [x, y])).map(|[x, y]| of(x, y)).collect()
}

fn flat(value: f32) -> Vec<[f32; 3]> {
    picture(|_, _| [value; 3])
}

/// The central square, the only part where changed pictures differ.
fn is_inside(x: u32, y: u32) -> bool {
    (32..64).contains(&x) && (16..48).contains(&y)
}

/// A patterned display picture in linear values, as if read from a PNG with these codes.
fn display(is_changed: bool) -> Vec<[f32; 3]> {
    let linear = |code: u32| {
        let v = code as f32 / 255.0;
        if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
    };
    picture(|x, y| {
        let codes = [(x * 5 + y * 3) % 256, (x * x + y * 7) % 256, (x * 3 + y * y) % 200];
        codes.map(|c| linear(if is_changed && is_inside(x, y) { c * 3 / 4 + 20 } else { c }))
    })
}

/// A pattern of radiances over nine stops.
fn radiance(is_changed: bool) -> Vec<[f32; 3]> {
    picture(|x, y| {
        let stops = ((x * 7 / 8 + y * 3 / 4) % 9) as f32 - 4.0;
        let base = stops.exp2() * (1.0 + ((x * 13 + y * 29) % 16) as f32 / 16.0);
        let color = [base, base * (1 + y % 4) as f32 / 4.0, base * (1 + x % 3) as f32 / 4.0];
        color.map(|v| if is_changed && is_inside(x, y) { v * 1.5 } else { v })
    })
}

fn mean(map: &[f64]) -> f64 {
    map.iter().sum::<f64>() / map.len() as f64
}

fn near(value: f64, wanted: f64, tolerance: f64) {
    assert!((value - wanted).abs() <= tolerance, "{value} differs from {wanted} by more than {tolerance}");
}

/// FLIP error of each pixel at the papers' viewing distance.
fn flip_of(image: &[[f32; 3]], reference: &[[f32; 3]], values: Values) -> Vec<f64> {
    flip(image, reference, SIZE, values, PIXELS_PER_DEGREE)
}

#[test]
fn equal_images_have_no_error_to_the_eye() {
    for (image, values) in [
        (display(false), Values::Display),
        (radiance(false), Values::Radiance),
        (flat(0.0), Values::Display),
        (flat(0.0), Values::Radiance),
    ] {
        assert!(flip_of(&image, &image, values).iter().all(|e| *e == 0.0));
        assert!(ssim(&image, &image, SIZE, values).iter().all(|s| *s == 1.0));
    }
}

#[test]
fn flip_of_flat_greys_is_its_formula() {
    // Flat pictures have no edges, so FLIP is its colour term alone. Greys have only the lightness of CIELAB. The
    // largest distance of two colours is between green and blue. CIELAB with Hunt's adjustment has them at (87.736,
    // -75.610, 72.981) and (32.298, 25.578, -34.836).
    let largest = (55.438_041 + 101.188_015_f64.hypot(107.817_598)).powf(0.7);
    let formula = |a: f64, b: f64| {
        let lightness = |v: f64| if v > 216.0 / 24389.0 { 116.0 * v.cbrt() - 16.0 } else { 24389.0 / 27.0 * v };
        let power = (lightness(a) - lightness(b)).abs().powf(0.7);
        let knee = 0.4 * largest;
        if power < knee { 0.95 * power / knee } else { 0.95 + 0.05 * (power - knee) / (largest - knee) }
    };
    let linear = |code: f64| ((code / 255.0 + 0.055) / 1.055).powf(2.4);
    let mut last = 1.0;
    for (a, b) in [(0.0, 1.0), (linear(180.0), linear(120.0)), (linear(200.0), linear(190.0))] {
        let map = flip_of(&flat(a as f32), &flat(b as f32), Values::Display);
        // The feature term is a square root. An f32 error of 1e-7 without an edge becomes 3e-4 in the exponent, and e
        // ln(e) is at most 0.37.
        map.iter().for_each(|e| near(*e, formula(a, b), 1.2e-4));
        assert!(map[0] < last, "a smaller difference must give a smaller error");
        last = map[0];
    }
}

#[test]
fn others_measure_the_same_flip() {
    // The expected values come from flip-evaluator 1.7 (the authors' own Python package) for the same pictures. It uses
    // floats. Here values are rounded to 8 bits, by at most half a code of 255, which matters more for small
    // differences.
    let brighter = |factor: f32| -> Vec<[f32; 3]> { radiance(false).iter().map(|c| c.map(|v| v * factor)).collect() };
    let (image, reference) = (radiance(true), radiance(false));
    near(mean(&flip_of(&display(true), &display(false), Values::Display)), 0.073935, 1e-5);
    near(mean(&flip_of(&image, &reference, Values::Radiance)), 0.055844, 2e-5);
    near(mean(&flip_of(&brighter(2.0), &reference, Values::Radiance)), 0.427037, 1e-4);
    near(mean(&flip_of(&brighter(1.1), &reference, Values::Radiance)), 0.106938, 1e-4);
    near(mean(&flip_of(&brighter(1.02), &reference, Values::Radiance)), 0.033704, 2.1e-3);
    near(mean(&flip(&image, &reference, SIZE, Values::Radiance, 30.0)), 0.068429, 2e-5);
    near(mean(&flip(&image, &reference, SIZE, Values::Radiance, 120.0)), 0.051463, 2e-5);
    // A common scale of both radiances does not matter.
    let scaled = |p: &[[f32; 3]]| -> Vec<[f32; 3]> { p.iter().map(|c| c.map(|v| v * 1024.0)).collect() };
    assert!(
        flip_of(&scaled(&image), &scaled(&reference), Values::Radiance)
            == flip_of(&image, &reference, Values::Radiance)
    );
}

#[test]
fn others_measure_the_same_ssim() {
    // scikit-image 0.26 (gaussian_weights, sigma 1.5, no sample covariance, range 1) on the same encoded luminance: the
    // mean without five pixels at each edge, and one pixel. Pixels are f32, hence the bound 1e-7.
    for (image, reference, values, wanted, at, wanted_at) in [
        (display(true), display(false), Values::Display, 0.9893292002, (40, 20), 0.9544413236),
        (radiance(true), radiance(false), Values::Radiance, 0.9955744935, (48, 32), 0.9763673156),
    ] {
        let map = ssim(&image, &reference, SIZE, values);
        let is_inner = |i: &usize| (5..91).contains(&(i % 96)) && (5..59).contains(&(i / 96));
        let inner: Vec<f64> = (0..map.len()).filter(is_inner).map(|i| map[i]).collect();
        near(mean(&inner), wanted, 1e-7);
        near(map[at.1 * 96 + at.0], wanted_at, 1e-7);
    }
}

#[test]
fn ssim_of_flat_greys_is_its_first_factor() {
    // Without structure only the luminance term remains: (2ab + C1) / (a^2 + b^2 + C1). This includes edges and
    // pictures smaller than the window.
    let linear = |v: f64| (((v + 0.055) / 1.055).powf(2.4)) as f32;
    let wanted = (2.0 * 0.5 * 0.25 + 1e-4) / (0.25 + 0.0625 + 1e-4);
    for map in [
        ssim(&flat(linear(0.5)), &flat(linear(0.25)), SIZE, Values::Display),
        ssim(&[[linear(0.5); 3]; 6], &[[linear(0.25); 3]; 6], [3, 2], Values::Display),
    ] {
        map.iter().for_each(|s| near(*s, wanted, 1e-6));
    }
}

#[test]
fn broken_values_show_where_they_are_and_nowhere_else() {
    for broken in [f32::NAN, f32::INFINITY] {
        let mut image = radiance(false);
        image[1000][1] = broken;
        for map in [
            flip_of(&image, &radiance(false), Values::Radiance),
            ssim(&image, &radiance(false), SIZE, Values::Radiance),
            flip_of(&radiance(false), &image, Values::Radiance),
            ssim(&radiance(false), &image, SIZE, Values::Radiance),
        ] {
            for (i, error) in map.iter().enumerate() {
                assert_eq!(error.is_nan(), i == 1000, "pixel {i}");
            }
        }
    }
}

#[test]
fn a_picture_without_light_can_be_the_reference() {
    let (lit, black) = (radiance(false), flat(0.0));
    let map = flip_of(&lit, &black, Values::Radiance);
    assert!(mean(&map) > 0.5 && map.iter().all(|e| (0.0..=1.0).contains(e)), "{}", mean(&map));
    let half: Vec<_> = lit.iter().enumerate().map(|(i, c)| if i % 4 == 0 { *c } else { [0.0; 3] }).collect();
    let map = flip_of(&lit, &half, Values::Radiance);
    assert!(mean(&map) > 0.3 && map.iter().all(|e| (0.0..=1.0).contains(e)), "{}", mean(&map));
    assert!(ssim(&lit, &black, SIZE, Values::Radiance).iter().all(|s| *s < 0.6));
}

#[test]
fn weighted_quantiles_weigh_by_value() {
    // The cumulative weights of the sorted values are 0.1, 0.3, 0.6 and 1.0.
    let map = [0.4, 0.1, 0.3, 0.2];
    for (share, wanted) in [(0.05, 0.1), (0.25, 0.2), (0.5, 0.3), (0.75, 0.4)] {
        assert_eq!(weighted_quantile(&map, share), wanted);
    }
    assert_eq!(weighted_quantile(&[0.0; 3], 0.5), 0.0);
    assert!(weighted_quantile(&[0.1, f64::NAN], 0.5).is_nan());
}

fn write(path: &Path, picture: &[[f32; 3]]) {
    let texels: Vec<[f32; 4]> = picture.iter().map(|c| [c[0], c[1], c[2], 1.0]).collect();
    write_exr(path, SIZE[0], SIZE[1], &[Layer::rgb("", &texels)], "").expect("an EXR file");
}

/// A folder with a.exr, its reference b.exr, and three masks: the region that differs, a region far from it, and
/// nothing.
fn files(name: &str) -> std::path::PathBuf {
    let at = folder(name);
    write(&at.join("a.exr"), &radiance(true));
    write(&at.join("b.exr"), &radiance(false));
    let white = |is_white: bool| [f32::from(u8::from(is_white)); 3];
    write(&at.join("inside.exr"), &picture(|x, y| white(is_inside(x, y))));
    write(&at.join("left.exr"), &picture(|x, _| white(x < 10)));
    write(&at.join("nothing.exr"), &flat(0.0));
    at
}

#[test]
fn every_metric_is_printed_and_masked() {
    let at = files("compare-metrics");
    let table = works(&at, &["compare", "a.exr", "b.exr"]);
    let json = |args: &[&str]| -> serde_json::Value {
        let args = [&["compare", "a.exr", "b.exr", "--json"], args].concat();
        serde_json::from_str(&works(&at, &args)).expect("JSON")
    };
    let all = json(&[]);
    for name in [
        "mae",
        "mare",
        "rmse",
        "relmse",
        "relmse-trimmed",
        "median-relative",
        "bias",
        "psnr",
        "ssim",
        "flip",
        "flip-median",
    ] {
        assert!(all[name].is_f64(), "{name}: {all}");
        assert!(table.lines().any(|l| l.starts_with(&format!("{name} "))), "{name}: {table}");
    }
    near(all["flip"].as_f64().expect("flip"), 0.055844, 2e-5);
    assert!(all["flip-q1"].as_f64() < all["flip-median"].as_f64(), "{all}");
    assert!(all["flip-median"].as_f64() < all["flip-q3"].as_f64(), "{all}");
    // Inside, all values differ by half. Ten or more pixels away nothing differs.
    let inside = json(&["--mask", "inside.exr"]);
    assert_eq!(inside["pixels"], 32 * 32);
    assert!(inside["flip"].as_f64().expect("flip") > 4.0 * all["flip"].as_f64().expect("flip"), "{inside}");
    near(inside["bias"].as_f64().expect("bias"), 0.5, 1e-6);
    let left = json(&["--mask", "left.exr"]);
    assert_eq!((&left["ssim"], &left["flip"], &left["mae"]), (&1.0.into(), &0.0.into(), &0.0.into()));
    assert!(left["psnr"].is_null(), "infinite: {left}");
    assert!(
        json(&["--ppd", "30"])["flip"].as_f64() > all["flip"].as_f64(),
        "fewer pixels per degree must give a larger error"
    );
}

#[test]
fn limits_hold_in_the_direction_of_each_metric() {
    let at = files("compare-limits");
    let with = |args: &[&'static str]| [&["compare", "a.exr", "b.exr"], args].concat();
    works(&at, &with(&["--fail-above", "flip=0.06", "--fail-below", "ssim=0.9", "--fail-below", "psnr=-10"]));
    fails(&at, &with(&["--fail-above", "flip=0.05"]), 1, &["a.exr: flip is 0.055", "above 0.05"]);
    fails(&at, &with(&["--fail-below", "ssim=0.999"]), 1, &["ssim is 0.99", "below 0.999"]);
    let both = ["--fail-below", "psnr=99", "--fail-above", "mae=0"];
    fails(&at, &with(&both), 1, &["psnr is", "below 99", "mae is", "above 0"]);
    fails(&at, &with(&["--fail-above", "ssim=0.9"]), 2, &["ssim is better the larger it is", "--fail-below ssim"]);
    fails(&at, &with(&["--fail-below", "flip=0.9"]), 2, &["flip is better the smaller it is", "--fail-above flip"]);
    for wrong in ["beauty=1", "ssim", "ssim=x", "ssim=nan"] {
        fails(&at, &["compare", "a.exr", "b.exr", "--fail-below", wrong], 2, &["one of psnr, ssim"]);
    }
    fails(&at, &with(&["--fail-above", "flip=-1"]), 2, &["one of mae"]);
    fails(&at, &with(&["--ppd", "0"]), 2, &["1 to 1000"]);
    fails(&at, &with(&["--diff-of", "flip"]), 2, &["--diff <FILE.png>"]);

    // A value that is not a number fails every limit, unless it is masked.
    let mut broken = radiance(true);
    broken[20 * 96 + 40] = [f32::NAN; 3];
    write(&at.join("nan.exr"), &broken);
    for limit in [["--fail-above", "flip=1"], ["--fail-below", "ssim=-1"], ["--fail-below", "psnr=0"]] {
        fails(&at, &[&["compare", "nan.exr", "b.exr"], &limit[..]].concat(), 1, &["is not a number"]);
    }
    works(
        &at,
        &["compare", "nan.exr", "b.exr", "--mask", "left.exr", "--fail-above", "flip=0", "--fail-below", "ssim=1"],
    );
}

#[test]
fn heat_maps_are_black_where_nothing_differs() {
    let at = files("compare-heat");
    for of in ["relmse", "abs", "flip", "ssim"] {
        let out = works(&at, &["compare", "a.exr", "b.exr", "--diff", "d.png", "--diff-of", of]);
        assert!(out.contains("d.png: from "), "the scale must be printed: {out}");
        let map = image::open(at.join("d.png")).expect("a PNG").to_rgb8();
        assert_eq!(map.dimensions(), (SIZE[0], SIZE[1]));
        let (far, middle) = (map.get_pixel(5, 5).0, map.get_pixel(46, 30).0);
        assert!(far.iter().all(|v| *v < 5), "{of}: {far:?}");
        assert!(middle.iter().any(|v| *v > 5), "{of}: {middle:?}");
        // With a mask that excludes all differing pixels, the map is black.
        works(&at, &["compare", "a.exr", "b.exr", "--diff", "d.png", "--diff-of", of, "--mask", "left.exr"]);
        let map = image::open(at.join("d.png")).expect("a PNG").to_rgb8();
        assert!(map.pixels().all(|p| p.0.iter().all(|v| *v < 5)), "{of}");
    }
    fails(&at, &["compare", "a.exr", "b.exr", "--diff", "no/d.png"], 1, &["no/d.png", "does not exist"]);
    assert_eq!(left(&at), ["a.exr", "b.exr", "d.png", "inside.exr", "left.exr", "nothing.exr"]);
}

#[test]
fn png_files_are_compared_as_they_are_shown() {
    let at = folder("compare-png");
    let grey =
        |name: &str, code: u8| write_png(&at.join(name), 8, 8, &[code, code, code, 255].repeat(64)).expect("a PNG");
    grey("black.png", 0);
    grey("white.png", 255);
    let found: serde_json::Value =
        serde_json::from_str(&works(&at, &["compare", "black.png", "white.png", "--json"])).expect("JSON");
    // Black against white: FLIP by the formula above, SSIM is C1 / (1 + C1).
    near(found["flip"].as_f64().expect("flip"), 0.967399, 1e-5);
    near(found["ssim"].as_f64().expect("ssim"), 1e-4 / (1.0 + 1e-4), 1e-9);
}

#[test]
fn what_cannot_be_compared_is_one_line() {
    let at = files("compare-bad");
    write_png(&at.join("small.png"), 8, 8, &[0; 256]).expect("a PNG");
    std::fs::write(at.join("text.exr"), "hello").expect("a file");
    let whole = std::fs::read(at.join("a.exr")).expect("a file");
    std::fs::write(at.join("half.exr"), &whole[..whole.len() / 2]).expect("a file");
    fails(&at, &["compare", "small.png", "b.exr"], 1, &["small.png: 8x8 pixels against 96x64 of b.exr"]);
    fails(&at, &["compare", "a.exr", "b.exr", "--mask", "small.png"], 1, &["small.png: 8x8 pixels against 96x64"]);
    fails(&at, &["compare", "a.exr", "b.exr", "--mask", "nothing.exr"], 1, &["nothing.exr: the mask leaves no pixel"]);
    fails(&at, &["compare", "a.exr", "b.exr", "--layer", "none"], 1, &["a.exr", "no layer 'none'"]);
    fails(&at, &["compare", "small.png", "small.png", "--layer", "none"], 1, &["small.png", "no layer 'none'"]);
    for file in ["missing.exr", "text.exr", "half.exr", "missing.png"] {
        fails(&at, &["compare", file, "b.exr"], 1, &[file]);
        fails(&at, &["compare", "b.exr", file], 1, &[file]);
    }
}
