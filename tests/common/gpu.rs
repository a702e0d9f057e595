//! A device with all checks, and GLSL expressions evaluated on it.

use std::ops::Deref;
use std::path::Path;
use std::process::Command;
use std::sync::{LazyLock, Mutex, MutexGuard, OnceLock};

use lightskin::gpu::{Cmd, Frame, Gpu, Options, Pipeline, Validation};

/// Environment variable that is set in a test that runs in its own process.
const APART: &str = "LIGHTSKIN_TEST_APART";

/// Runs the calling test in its own process. Returns true if the test has run there, so that the caller must return.
///
/// The validation layer of Debian 12 looks up a device's data in a map without a lock. While one thread opens or closes
/// a device, no other thread may call Vulkan; otherwise one of them occasionally jumps to address 0. Most tests
/// therefore share devices that stay open, and tests that open their own device run in their own process.
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

/// Opens a device that the test closes itself. Only allowed after `apart`.
pub(crate) fn open(validation: Validation) -> Gpu {
    assert!(is_apart(), "a test that opens a device begins with `if apart() {{ return }}`");
    opened(validation)
}

fn opened(validation: Validation) -> Gpu {
    Gpu::new(&Options { device: None, validation }).expect("a Vulkan device and the validation layer")
}

/// Access of one test to a shared device that stays open.
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
            // The device may be broken, so no other test gets it. Closing it would disturb other tests.
            std::mem::forget(gpu);
        } else {
            free().push(gpu);
        }
    }
}

/// A shared device with all checks enabled. The test fails if there is no device; a software device is enough.
pub(crate) fn gpu() -> Turn {
    let gpu = free().pop();
    Turn(Some(gpu.unwrap_or_else(|| opened(Validation::Sync))))
}

/// The devices that no test is using. The first call opens as many as tests will probably need.
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

/// Records a frame. With `timed`, zones are submitted separately if the device needs that for correct times.
pub(crate) fn frame_of(
    gpu: &Gpu,
    timed: bool,
    record: impl FnOnce(&Cmd<'_>) -> lightskin::Result<()>,
) -> lightskin::Result<Frame> {
    if timed { gpu.timed_frame(record) } else { gpu.frame(record) }
}

/// Rounding errors that tests should expect, relative to llvmpipe's. llvmpipe rounds every operation on its own and to the
/// nearest number. GPUs fuse multiplications with additions, and approximate quotients, roots, logarithms and powers.
pub(crate) fn rounding(gpu: &Gpu) -> f64 {
    if gpu.report().name.starts_with("llvmpipe") { 1.0 } else { 20.0 }
}

/// Fails if there are messages of the validation layer.
#[track_caller]
pub(crate) fn assert_clean(gpu: &Gpu) {
    let messages = gpu.messages();
    assert!(messages.is_empty(), "the validation layer says:\n{}", messages.join("\n"));
}

/// Evaluates a GLSL expression of type `vec4` for every input and returns the results in order. The expression sees the
/// input as `x[0]` to `x[N - 1]`, three values from index i as `v(i)`, and the files of `glsl/` in `includes`.
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
    let pipeline = from_spirv(gpu, "test.map", &code, &[]).expect("pipeline");
    let from = gpu.buffer_from("test.inputs", inputs.as_flattened()).expect("inputs");
    let to = gpu.buffer("test.outputs", 16 * inputs.len() as u64).expect("outputs");
    gpu.run_once("test.map", |cmd| {
        cmd.bind(&pipeline, &[(&from).into(), (&to).into()]);
        cmd.dispatch(inputs.len() as u32, 1, 1);
    })
    .expect("run");
    gpu.read(&to).expect("outputs")
}

/// Makes a pipeline from code of `compile`, or from code that is refused because it is no module.
#[allow(unsafe_code, reason = "the compiler and the tests vouch for the code")]
pub(crate) fn from_spirv(
    gpu: &Gpu,
    name: &'static str,
    code: &[u32],
    constants: &[u32],
) -> lightskin::Result<Pipeline> {
    // SAFETY: glslang wrote the code for this Vulkan version. The tests' shaders stay within their buffers and images.
    // Code that is no module never reaches the driver.
    unsafe { gpu.compute_from_spirv(name, code, constants) }
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
