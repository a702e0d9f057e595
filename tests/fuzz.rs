//! Mutants: files with random changes. Each must give a result, or one line that names the file, the place and the
//! remedy.
//!
//! A few kinds of scenes are always tested, within this process. `LIGHTSKIN_FUZZ=10000` runs the tool itself on that
//! many files of all kinds: scenes, skies, pictures, kept bakes and samples, sessions. Each run may take 10 s of
//! processor time and 2 GiB of address space.
//! With `LIGHTSKIN_DATA` the scenes there are mutated, too. A mutant depends on its number alone:
//! `LIGHTSKIN_FUZZ=37..38` repeats number 37. Failing files are in `target/tmp/fuzz/found`, and all error lines in
//! `target/tmp/fuzz/told/errors.txt`.

mod run;
mod seeds;

use crate::common::{glb, one_line, written};
use crate::malformed::load_safely;
use seeds::{Kind, Seed};
use serde_json::{Value, json};

/// Pseudorandom numbers from a seed.
struct Random(u64);

impl Random {
    fn new(number: u64) -> Self {
        let mut random = Self(number.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0x2545_F491_4F6C_DD1D);
        (0..4).for_each(|_| _ = random.below(1));
        random
    }

    fn below(&mut self, count: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 16) as usize % count.max(1)
    }

    fn of<'a, T>(&mut self, items: &'a [T]) -> &'a T {
        &items[self.below(items.len())]
    }
}

/// JSON values at the limits of numbers, texts or lists.
fn hostile(random: &mut Random) -> Value {
    let numbers = [0.0, -1.0, 0.5, 1.0, 1e-38, 1e-300, 1e9, 1e15, 1e18, 3e38, 1e39, 1e300, -1e30];
    let whole = [0, 1, 2, 3, 255, 256, 65535, 65536, 1 << 31, u32::MAX as u64, 1 << 40, u64::MAX];
    match random.below(8) {
        0..=2 => json!(random.of(&whole)),
        3..=4 => json!(random.of(&numbers)),
        5 => json!(random.of(&["", "SCALAR", "MAT4", "MASK", "BLEND", "../a", "\u{1b}[31m\n", "%00"])),
        6 => random.of(&[json!(null), json!(true), json!([]), json!({}), json!([{}]), json!([0, 0])]).clone(),
        _ => json!(random.below(20)),
    }
}

/// Changes one value anywhere in a tree: replaces, removes, duplicates or renames it.
fn mutate_json(json: &mut Value, depth: usize, random: &mut Random) {
    let children = match json {
        Value::Array(list) => list.len(),
        Value::Object(object) => object.len(),
        _ => 0,
    };
    if children == 0 || (depth > 1 && random.below(10) == 0) {
        *json = hostile(random);
        return;
    }
    let chosen = random.below(children);
    let way = random.below(40);
    match json {
        Value::Array(list) if way == 0 => drop(list.remove(chosen)),
        Value::Array(list) if way == 1 => list.push(list[chosen].clone()),
        Value::Array(list) => mutate_json(&mut list[chosen], depth + 1, random),
        Value::Object(object) => {
            let key = object.keys().nth(chosen).expect("is below their number").clone();
            match way {
                0 => drop(object.remove(&key)),
                1 => drop(object.insert(format!("{key}x"), json!(1))),
                _ => mutate_json(&mut object[&key], depth + 1, random),
            }
        }
        _ => unreachable!("has children"),
    }
}

/// Changes bytes at or after `start`.
fn mutate_bytes(bytes: &mut Vec<u8>, start: usize, random: &mut Random) {
    if bytes.len() <= start {
        return;
    }
    if random.below(16) == 0 {
        bytes.truncate(start + random.below(bytes.len() - start));
        return;
    }
    // Half of the mutants have their changes near the start, because headers are most sensitive.
    let length = bytes.len() - start;
    let span = if random.below(2) == 0 { length } else { length.min(120) };
    for _ in 0..1 + random.below(4) {
        let at = start + random.below(span);
        match random.below(6) {
            // In JSON, digits are indices, counts and offsets. With another digit they still parse.
            0 | 1 if bytes[at].is_ascii_digit() => bytes[at] = b'0' + random.below(10) as u8,
            0 => bytes[at] ^= 1 << random.below(8),
            1 | 2 => bytes[at] = *random.of(&[0, 1, 0x7F, 0x80, 0xFF]),
            3 => bytes[at] = random.below(256) as u8,
            4 => {
                let number = *random.of(&[f32::NAN, f32::INFINITY, 3e38, -3e38, 1e19, 1e-38, -0.0, 0.0]);
                let at = at & !3;
                bytes.iter_mut().skip(at).zip(number.to_le_bytes()).for_each(|(byte, new)| *byte = new);
            }
            _ => {
                let end = (at + 1 + random.below(16)).min(bytes.len());
                bytes[at..end].fill(0);
            }
        }
    }
}

/// JSON and binary chunk of a GLB file.
fn chunks(bytes: &[u8]) -> Option<(Value, Vec<u8>)> {
    let word = |at: usize| Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?) as usize);
    let end = word(12)?.checked_add(20)?;
    let json = serde_json::from_slice(bytes.get(20..end)?).ok()?;
    Some((json, bytes.get(end + 8..).unwrap_or_default().to_vec()))
}

/// A seed's file with random changes.
fn mutant(seed: &Seed, random: &mut Random) -> Vec<u8> {
    let mut bytes = seed.bytes.clone();
    let tree = match seed.kind {
        Kind::Scene => chunks(&bytes).or_else(|| Some((serde_json::from_slice(&bytes).ok()?, Vec::new()))),
        Kind::Session => serde_json::from_slice(&bytes).ok().map(|json| (json, Vec::new())),
        _ => None,
    };
    match tree {
        Some((mut json, mut binary)) if random.below(5) > 0 => {
            let of_json = if seed.packed.is_some() { 1 } else { 3 };
            if binary.is_empty() || random.below(4) < of_json {
                (0..1 + random.below(5) / 3).for_each(|_| mutate_json(&mut json, 0, random));
            } else {
                mutate_bytes(&mut binary, seed.packed.unwrap_or(0), random);
            }
            if bytes.starts_with(b"glTF") { glb(&json, &binary) } else { json.to_string().into_bytes() }
        }
        _ => {
            // Hashed data gets a new hash after the change. Otherwise its old hash alone would cause a refusal.
            let end = bytes.len();
            match seed.kind {
                Kind::Bake if random.below(8) > 0 => {
                    mutate_bytes(&mut bytes, 84, random);
                    bytes.resize(bytes.len().max(84), 0);
                    let length = (bytes.len() - 84) as u64;
                    bytes[44..52].copy_from_slice(&length.to_le_bytes());
                    let hash = blake3::hash(&bytes[84..]);
                    bytes[52..84].copy_from_slice(hash.as_bytes());
                }
                Kind::Samples if random.below(8) > 0 => {
                    bytes.truncate(end - 32);
                    mutate_bytes(&mut bytes, 44, random);
                    let hash = blake3::hash(&bytes);
                    bytes.extend_from_slice(hash.as_bytes());
                }
                _ => mutate_bytes(&mut bytes, 0, random),
            }
            bytes
        }
    }
}

#[test]
fn mutants_of_scenes_end_in_a_scene_or_an_error() {
    let seeds = seeds::scenes();
    for seed in &seeds {
        load_safely(&written("mutant.glb", &seed.bytes)).expect("the original is valid");
    }
    let (mut loaded, mut refused) = (0, 0);
    for number in 0..3000 {
        let mut random = Random::new(number);
        let seed = if number % 2 == 0 { &seeds[0] } else { random.of(&seeds) };
        match load_safely(&written("mutant.glb", &mutant(seed, &mut random))) {
            Ok(_) => loaded += 1,
            Err(error) => {
                one_line(error);
                refused += 1;
            }
        }
    }
    println!("{loaded} loaded, {refused} refused");
    assert!(loaded > 500 && refused > 500);
}
