//! A checked device, and GLSL expressions evaluated on it.

use std::ops::Deref;
use std::path::Path;
use std::process::Command;
use std::sync::{LazyLock, Mutex, MutexGuard, OnceLock};

use lightskin::gpu::{Cmd, Frame, Gpu, Options, Validation};

/// Set where a test runs in a process of its own.
const APART: &str = "LIGHTSKIN_TEST_APART";

/// Runs the test that calls it in a process of its own; says whether it has run there, and its caller is not to go on.
///
/// The validation layer of Debian 12 finds the data of a device in a map without a lock: while one thread opens or closes a
/// device, no other may call Vulkan at all, or one of them jumps to address 0 now and then. So tests share devices that
/// stay open, and those that open and close their own do so apart.
pub(crate) fn apart() -> bool {
    let name = std::thread::current().name().unwrap_or("main").to_owned();
    if is_apart() || name == "main" {
        return false;
    }
    let out = Command::new(std::env::current_exe().expect("this program"))
        .args([name.as_str(), "--exact", "--nocapture"])
        .env(APART, "1")
        .output()
        .expect("runs again");
    let told = [out.stdout, out.stderr].map(|told| String::from_utf8_lossy(&told).into_owned());
    println!("{}", told[0]);
    assert!(out.status.success() && told[0].contains("1 passed"), "{}", told[1]);
    true
}

fn is_apart() -> bool {
    std::env::var_os(APART).is_some() || std::thread::current().name().is_none_or(|name| name == "main")
}

/// A device of the test's own, which it closes. Only `apart`.
pub(crate) fn open(validation: Validation) -> Gpu {
    assert!(is_apart(), "a test that opens a device begins with `if apart() {{ return }}`");
    opened(validation)
}

fn opened(validation: Validation) -> Gpu {
    Gpu::new(&Options { device: None, validation }).expect("a Vulkan device and the validation layer")
}

/// A device that stays open, while a test has it.
pub(crate) struct Turn(Option<Gpu>);

impl Deref for Turn {
    type Target = Gpu;

    fn deref(&self) -> &Gpu {
        self.0.as_ref().expect("there until it is dropped")
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        let Some(gpu) = self.0.take() else { return };
        if std::thread::panicking() || gpu.wait().is_err() || !gpu.messages().is_empty() {
            // Not fit for the next test; closing it would disturb the others.
            std::mem::forget(gpu);
        } else {
            free().push(gpu);
        }
    }
}

/// A device with all checks on that other tests have used before. No device fails the test: software Vulkan is enough.
pub(crate) fn gpu() -> Turn {
    let gpu = free().pop();
    Turn(Some(gpu.unwrap_or_else(|| opened(Validation::Sync))))
}

/// The devices that no test has: at first all that are likely to be needed.
fn free() -> MutexGuard<'static, Vec<Gpu>> {
    static FREE: OnceLock<Mutex<Vec<Gpu>>> = OnceLock::new();
    let all = || {
        let threads = std::env::var("RUST_TEST_THREADS").ok().and_then(|n| n.parse().ok());
        let threads = threads.or_else(|| std::thread::available_parallelism().ok().map(usize::from)).unwrap_or(1);
        let threads = if is_apart() { 1 } else { threads.min(8) };
        Mutex::new((0..threads).map(|_| opened(Validation::Sync)).collect())
    };
    FREE.get_or_init(all).lock().unwrap_or_else(|broken| broken.into_inner())
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
