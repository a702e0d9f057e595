//! The shipped SPIR-V must be compiled from `glsl/`, without names and lines, with identifiers in order of appearance.

#[path = "../build/shipped.rs"]
mod file;

use lzma_rust2::{LzmaOptions, LzmaWriter};
use std::io::Write;
use std::process::{Command, Stdio};

include!(concat!(env!("OUT_DIR"), "/shaders.rs"));

/// Instructions for debuggers: sources, names, strings, lines, and how the module was compiled.
const DEBUG: [u32; 9] = [2, 3, 4, 5, 6, 7, 8, 317, 330];

/// A module without instructions that only debuggers read. Identifiers are renumbered in order of appearance. So modules with
/// the same code have the same words, and pack together.
fn stripped(spirv: &[u8]) -> Vec<u8> {
    let words: Vec<u32> = bytemuck::pod_collect_to_vec(spirv);
    let mut kept = words[..file::HEADER].to_vec();
    let mut at = file::HEADER;
    while at < words.len() {
        let (length, instruction) = ((words[at] >> 16) as usize, words[at] & 0xFFFF);
        if !DEBUG.contains(&instruction) {
            kept.extend(&words[at..at + length]);
        }
        at += length;
    }
    let optimizer = Command::new("spirv-opt")
        .args(["--compact-ids", "-", "-o", "-"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn();
    let mut optimizer = optimizer.expect("spirv-opt starts; ./scripts/setup installs it");
    optimizer.stdin.take().expect("piped").write_all(bytemuck::cast_slice(&kept)).expect("spirv-opt reads");
    let output = optimizer.wait_with_output().expect("spirv-opt ends");
    assert!(output.status.success(), "spirv-opt: {}", output.status);
    output.stdout
}

/// The inverse of `file::unfolded`.
fn folded(spirv: &[u8]) -> Vec<u8> {
    let mut words: Vec<u32> = spirv.chunks(4).map(|word| u32::from_le_bytes(word.try_into().expect("words"))).collect();
    let (mut at, mut last) = (file::HEADER, 0_u32);
    while at < words.len() {
        let end = at + (words[at] >> 16) as usize;
        if let Some((second, others)) = words[at..end].get_mut(2..).and_then(|operands| operands.split_first_mut()) {
            let result = *second;
            *second = result.wrapping_sub(last);
            others.iter_mut().for_each(|other| *other = result.wrapping_sub(*other));
            last = result;
        }
        at = end;
    }
    words.iter().flat_map(|word| word.to_le_bytes()).collect()
}

/// Packs shaders in the format that `file::read` reads. Names are padded, so that words stay aligned.
fn packed(sources: u64, shaders: &[(String, Vec<u8>)]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let number = |bytes: &mut Vec<u8>, number: usize| bytes.extend((number as u64).to_le_bytes());
    bytes.extend(sources.to_le_bytes());
    number(&mut bytes, shaders.len());
    for (name, spirv) in shaders {
        let (name, spirv) = (format!("{name:64}"), folded(spirv));
        number(&mut bytes, name.len());
        bytes.extend(name.bytes());
        number(&mut bytes, spirv.len());
        bytes.extend(spirv);
    }
    // SPIR-V words have four bytes.
    let options = LzmaOptions {
        dict_size: 16 << 20,
        lc: 0,
        lp: 2,
        pb: 2,
        nice_len: 273,
        depth_limit: 48,
        ..LzmaOptions::with_preset(9)
    };
    let mut packer = LzmaWriter::new_use_header(Vec::new(), &options, Some(bytes.len() as u64)).expect("options");
    packer.write_all(&bytes).expect("in memory");
    packer.finish().expect("all of it")
}

#[test]
fn shipped_shaders_are_those_of_the_sources() {
    let made: Vec<_> = SHADERS.iter().map(|(name, spirv)| ((*name).to_owned(), stripped(spirv))).collect();
    let sources = file::sources().expect("glsl/");
    if std::env::var_os("LIGHTSKIN_BLESS").is_some() {
        std::fs::write(file::FILE, packed(sources, &made)).expect("writes");
    }
    let there = file::read().expect("build/shaders.lzma");
    let pairs = made.iter().zip(&there.shaders);
    let others: Vec<&str> = pairs.filter(|(made, there)| made != there).map(|(made, _)| made.0.as_str()).collect();
    let renew = "renew it: LIGHTSKIN_BLESS=1 cargo test --features glsl -- shipped";
    assert!(others.is_empty(), "{} has different SPIR-V for {}; {renew}", file::FILE, others.join(", "));
    assert_eq!((there.shaders.len(), there.sources), (made.len(), sources), "{renew}");
}
