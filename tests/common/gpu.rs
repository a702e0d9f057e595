//! A checked device, and GLSL expressions evaluated on it.

use std::path::Path;
use std::sync::LazyLock;

use lightskin::gpu::{Cmd, Frame, Gpu, Options, Validation};

/// A device of this test's own, with all checks on. No device fails the test: software Vulkan is enough.
pub(crate) fn gpu() -> Gpu {
    Gpu::new(&Options { device: None, validation: Validation::Sync }).expect("a Vulkan device and the validation layer")
}

/// Records a frame whose zones are submitted alone, as far as the device needs that for right times, or as one.
pub(crate) fn frame_of(
    gpu: &Gpu,
    timed: bool,
    record: impl FnOnce(&Cmd<'_>) -> lightskin::Result<()>,
) -> lightskin::Result<Frame> {
    if timed { gpu.timed_frame(record) } else { gpu.frame(record) }
}

/// Fails if the validation layer has said anything.
#[track_caller]
pub(crate) fn assert_clean(gpu: &Gpu) {
    let messages = gpu.messages();
    assert!(messages.is_empty(), "the validation layer says:\n{}", messages.join("\n"));
}

/// Evaluates a GLSL expression of type `vec4` for every input and gives the results in order. The expression sees the
/// input as `x[0]` to `x[N - 1]`, three from the i-th on as `v(i)`, and what `includes` names in `glsl/`.
#[track_caller]
pub(crate) fn map_on_gpu<const N: usize>(
    gpu: &Gpu,
    includes: &[&str],
    expression: &str,
    inputs: &[[f32; N]],
) -> Vec<[f32; 4]> {
    let includes: String = includes.iter().map(|file| format!("#include \"{file}\"\n")).collect();
    let source = format!(
        "#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
{includes}
layout(local_size_x = 64) in;
layout(binding = 0, scalar) readonly buffer Inputs {{ float inputs[]; }};
layout(binding = 1, scalar) writeonly buffer Outputs {{ vec4 outputs[]; }};
#define v(i) vec3(x[i], x[i + 1], x[i + 2])
void main() {{
    uint at = gl_GlobalInvocationID.x;
    if (at >= outputs.length()) {{
        return;
    }}
    float x[{N}];
    for (uint i = 0u; i < {N}u; ++i) {{
        x[i] = inputs[at * {N}u + i];
    }}
    outputs[at] = {expression};
}}
"
    );
    let code = compile(&source).unwrap_or_else(|error| panic!("{error}\n{source}"));
    let pipeline = gpu.compute_from_spirv("test.map", &code, &[]).expect("pipeline");
    let from = gpu.buffer_from("test.inputs", inputs.as_flattened()).expect("inputs");
    let to = gpu.buffer("test.outputs", 16 * inputs.len() as u64).expect("outputs");
    gpu.run_once("test.map", |cmd| {
        cmd.bind(&pipeline, &[(&from).into(), (&to).into()]);
        cmd.dispatch(inputs.len() as u32, 1, 1);
    })
    .expect("run");
    gpu.read(&to).expect("outputs")
}

/// Compiles a compute shader with the options of `build.rs`.
pub(crate) fn compile(source: &str) -> Result<Vec<u32>, shaderc::Error> {
    static COMPILER: LazyLock<shaderc::Compiler> = LazyLock::new(|| shaderc::Compiler::new().expect("shaderc"));
    let mut options = shaderc::CompileOptions::new()?;
    options.set_target_env(shaderc::TargetEnv::Vulkan, shaderc::EnvVersion::Vulkan1_3 as u32);
    options.set_optimization_level(shaderc::OptimizationLevel::Performance);
    options.set_include_callback(|name, _kind, _from, _depth| {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("glsl").join(name);
        let content = std::fs::read_to_string(&path).map_err(|error| format!("{}: {error}", path.display()))?;
        Ok(shaderc::ResolvedInclude { resolved_name: name.to_owned(), content })
    });
    let kind = shaderc::ShaderKind::Compute;
    Ok(COMPILER.compile_into_spirv(source, kind, "expression", "main", Some(&options))?.as_binary().to_vec())
}
