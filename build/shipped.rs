//! Reads the SPIR-V shipped with the sources, `build/shaders.lzma`. With it, only those who change shaders need a shader
//! compiler. It has no debug names or lines, its identifiers are in order of appearance, and it is packed by LZMA. The test
//! `shipped` compares it with a fresh compile, and renews it.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::{fs, io};

/// Path of the shipped file.
pub(crate) const FILE: &str = "build/shaders.lzma";

/// Memory limit of unpacking \[KiB\].
const MOST_MEMORY: u32 = 64 << 10;

/// Number of words before the first SPIR-V instruction.
pub(crate) const HEADER: usize = 5;

/// Content of the shipped file: the hash of its GLSL sources, and name and SPIR-V of each shader.
pub(crate) struct Shipped {
    pub(crate) sources: u64,
    pub(crate) shaders: Vec<(String, Vec<u8>)>,
}

/// Reads the shipped file.
pub(crate) fn read() -> io::Result<Shipped> {
    let mut bytes = Vec::new();
    let file = io::BufReader::new(fs::File::open(FILE)?);
    lzma_rust2::LzmaReader::new_mem_limit(file, MOST_MEMORY, None)?.read_to_end(&mut bytes)?;
    let mut rest = bytes.as_slice();
    let mut take = |count: usize| {
        let taken = rest.split_at_checked(count).map(|(taken, left)| {
            rest = left;
            taken
        });
        taken.ok_or_else(|| io::Error::other("is cut off"))
    };
    let number = |bytes: &[u8]| bytes.iter().rev().fold(0, |sum: u64, byte| sum << 8 | u64::from(*byte));
    let sources = number(take(8)?);
    let count = number(take(8)?);
    let mut shaders = Vec::new();
    for _ in 0..count {
        let length = number(take(8)?) as usize;
        let name = String::from_utf8_lossy(take(length)?).trim_end().to_owned();
        let length = number(take(8)?) as usize;
        shaders.push((name, unfolded(take(length)?)));
    }
    Ok(Shipped { sources, shaders })
}

/// Decodes delta-coded SPIR-V, which packs smaller. The second operand of an instruction, most often the identifier of its
/// result, is stored as the difference from the second operand of the instruction before. The operands behind it are stored
/// as differences from it.
fn unfolded(folded: &[u8]) -> Vec<u8> {
    let word = |bytes: &[u8]| bytes.iter().rev().fold(0, |sum: u32, byte| sum << 8 | u32::from(*byte));
    let mut words: Vec<u32> = folded.chunks(4).map(word).collect();
    let (mut at, mut last) = (HEADER, 0_u32);
    while at < words.len() {
        let end = (at + (words[at] >> 16).max(1) as usize).min(words.len());
        if let Some((second, others)) = words[at..end].get_mut(2..).and_then(|operands| operands.split_first_mut()) {
            last = last.wrapping_add(*second);
            *second = last;
            others.iter_mut().for_each(|other| *other = last.wrapping_sub(*other));
        }
        at = end;
    }
    words.iter().flat_map(|word| word.to_le_bytes()).collect()
}

/// FNV-1a hash of all files below `glsl/`, independent of line endings.
pub(crate) fn sources() -> io::Result<u64> {
    fn files(folder: &Path, found: &mut Vec<PathBuf>) -> io::Result<()> {
        for entry in fs::read_dir(folder)? {
            let path = entry?.path();
            if path.is_dir() { files(&path, found)? } else { found.push(path) }
        }
        Ok(())
    }
    let mut found = Vec::new();
    files(Path::new("glsl"), &mut found)?;
    let name = |path: &Path| path.to_string_lossy().replace('\\', "/");
    found.sort_by_key(|path| name(path));
    let mut hash = 0xCBF2_9CE4_8422_2325_u64;
    for path in found {
        let text = fs::read(&path)?;
        for byte in name(&path).bytes().chain(text.into_iter().filter(|byte| *byte != b'\r')).chain([0]) {
            hash = (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01B3);
        }
    }
    Ok(hash)
}
