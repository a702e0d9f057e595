//! Driver statistics of the engine's shaders: registers, spills, occupancy, instructions.

use crate::error::Result;
use crate::frame::tune;
use crate::gpu::{Codegen, Compiled};
use std::collections::BTreeSet;

/// Statistics of a shader compiled with given constants.
pub struct Line {
    /// File name in `glsl/`.
    pub shader: String,
    /// Meaning of its constants.
    pub kind: String,
    /// Registers per thread, and scalar registers that a group of threads shares.
    pub registers: Option<[f64; 2]>,
    /// Spilled registers; on NVIDIA bytes of local memory, which also hold arrays.
    pub spilled: Option<f64>,
    /// Groups of threads that a unit holds at a time.
    pub occupancy: Option<f64>,
    /// Total number of instructions.
    pub instructions: Option<f64>,
    /// Vector instructions of the longest loop per pair of cache and VAL; gathers only.
    pub per_pair: Option<f64>,
}

/// VALs per round of the gather's loop.
const AT_ONCE: u32 = 4;

/// Compiles all kinds of the compute gather for GPUs, then every compute, fragment and vertex shader with its own
/// constants; only shaders whose names begin with `only`.
///
/// # Errors
/// Fails if the driver rejects a shader.
pub fn lines(codegen: &Codegen, only: &str) -> Result<Vec<Line>> {
    let mut all = Vec::new();
    let mut shapes: Vec<_> = tune::candidates(false).iter().map(|ways| (ways.source, ways.caches())).collect();
    // One step beyond the candidates.
    shapes.extend(shapes.clone().iter().filter(|(_, caches)| *caches == 4).map(|(source, _)| (*source, 8)));
    let gathers = [("gather.comp", ""), ("gather_shadowed.comp", ", shadows")];
    for (shader, shadows) in gathers.into_iter().filter(|(shader, _)| shader.starts_with(only)) {
        let kinds = [(0, 0, "one lobe"), (1, 0, "two lobes"), (0, 1, "short rays, lobes of VALs")];
        for (glossy, near, lobes) in &kinds[..if shadows.is_empty() { 2 } else { 3 }] {
            for (source, caches) in &shapes {
                let constants = [*glossy, *source as u32, *caches, 0, 0, *near, *near, 4, 1];
                let used = if shadows.is_empty() { 7 } else { 9 };
                let compiled = codegen.compute(shader, &constants[..used])?;
                let kind = format!("{lobes}, {}, {caches} caches{shadows}", source.name());
                let pairs = f64::from(caches * AT_ONCE);
                let in_loop = compiled.assembly.as_deref().and_then(vector_instructions_of_longest_loop);
                let per_pair = in_loop.map(|count| f64::from(count) / pairs);
                all.push(Line { per_pair, ..line(shader, kind, &compiled) });
            }
        }
    }
    for shader in Codegen::shaders(".comp").filter(|shader| shader.starts_with(only)) {
        all.push(line(shader, String::new(), &codegen.compute(shader, &[])?));
    }
    // Fragment shaders with a vertex shader. A vertex shader has a line where it first occurs, or at last alone.
    let mut paired = BTreeSet::new();
    for shader in Codegen::shaders(".frag") {
        let vertex = Codegen::vertex_shader_of(shader);
        let is_new = paired.insert(vertex);
        let shown = [(vertex, is_new && vertex.starts_with(only)), (shader, shader.starts_with(only))];
        if shown.iter().any(|(_, is_shown)| *is_shown) {
            let both = codegen.raster(vertex, Some(shader))?;
            let shown = shown.iter().zip(&both).filter(|((_, is_shown), _)| *is_shown);
            all.extend(shown.map(|((name, _), compiled)| line(name, String::new(), compiled)));
        }
    }
    for shader in Codegen::shaders(".vert").filter(|name| !paired.contains(name) && name.starts_with(only)) {
        all.push(line(shader, String::new(), &codegen.raster(shader, None)?[0]));
    }
    Ok(all)
}

fn line(shader: &str, kind: String, compiled: &Compiled) -> Line {
    let number = |names: &[&str]| names.iter().find_map(|name| compiled.number(name));
    let registers = number(&["VGPRs", "Register Count"]);
    let spilled = [number(&["Spilled VGPRs", "Spill Count"]), number(&["Spilled SGPRs", "Local Memory Size"])];
    Line {
        shader: shader.to_owned(),
        kind,
        registers: registers.map(|vector| [vector, number(&["SGPRs"]).unwrap_or(0.0)]),
        spilled: spilled.iter().any(Option::is_some).then(|| spilled.into_iter().flatten().sum()),
        occupancy: number(&["Subgroups per SIMD"]),
        instructions: number(&["Instructions", "Instruction Count"]),
        per_pair: None,
    }
}

/// Counts vector instructions (`v_`) of the longest innermost loop in AMD assembly as written by Mesa. A loop runs from
/// a label to the last jump back to it.
fn vector_instructions_of_longest_loop(assembly: &str) -> Option<u32> {
    let lines: Vec<&str> = assembly.lines().map(str::trim).collect();
    let label = |line: &str| line.strip_suffix(':').filter(|name| name.starts_with("BB")).map(str::to_owned);
    let mut labels: Vec<(String, usize)> = Vec::new();
    let mut loops: Vec<(usize, usize)> = Vec::new();
    for (i, line) in lines.iter().enumerate() {
        if let Some(name) = label(line) {
            labels.push((name, i));
        }
        if line.starts_with("s_branch") || line.starts_with("s_cbranch") {
            let target = line.split_whitespace().nth(1).unwrap_or_default();
            if let Some((_, from)) = labels.iter().find(|(name, _)| name == target) {
                loops.push((*from, i));
            }
        }
    }
    let has_inner = |(from, to): &(usize, usize)| loops.iter().any(|l| l.0 > *from && l.1 < *to);
    let vector = |(from, to): &(usize, usize)| lines[*from..*to].iter().filter(|line| line.starts_with("v_")).count();
    loops.iter().filter(|l| !has_inner(l)).map(|l| vector(l) as u32).max()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_loop_is_counted() {
        let text = "BB0:\n\tv_mov_b32_e32 v0, v1 ; 7e0\nBB1:\n\tv_add_f32 v0, v0 ; 1\n\ts_nop 0\n\tv_mul_f32 v1, v1 ; 2\n\ts_cbranch_scc0 BB1 ; 3\n\tv_mov_b32 v2, v3\n";
        assert_eq!(vector_instructions_of_longest_loop(text), Some(2));
        assert_eq!(vector_instructions_of_longest_loop("BB0:\n\tv_mov_b32 v0, v1\n"), None);
    }
}
