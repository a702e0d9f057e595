//! A checked device, and GLSL expressions evaluated on it.

use std::cell::Cell;
use std::ops::Deref;
use std::path::Path;
use std::sync::{LazyLock, Mutex, MutexGuard, OnceLock, RwLock, RwLockReadGuard, RwLockWriteGuard};

use lightskin::gpu::{Cmd, Frame, Gpu, Options, Validation};

/// The validation layer of Debian 12 finds the data of a device in a map without a lock: while one thread opens or closes a
/// device, no other may call Vulkan at all, or one of them jumps to address 0 now and then. So tests share devices that
/// stay open, and one that opens its own runs while no other has one.
static TURNS: RwLock<()> = RwLock::new(());

thread_local! {
    /// Whether this thread has a turn already: a test may use two devices.
    static HAS_TURN: Cell<bool> = const { Cell::new(false) };
}

/// A device while a test has it.
pub(crate) struct Turn {
    gpu: Option<Gpu>,
    /// Goes back to the others, rather than being closed.
    kept: bool,
    _turn: Option<Held>,
}

/// Keeps other tests from opening devices, or from using any.
#[expect(dead_code, reason = "held, never read")]
pub(crate) enum Held {
    Shared(RwLockReadGuard<'static, ()>),
    Alone(RwLockWriteGuard<'static, ()>),
}

impl Drop for Held {
    fn drop(&mut self) {
        HAS_TURN.set(false);
    }
}

impl Held {
    /// None where this thread has a turn already.
    fn take(alone: bool) -> Option<Self> {
        (!HAS_TURN.replace(true)).then(|| match alone {
            false => Self::Shared(TURNS.read().unwrap_or_else(|broken| broken.into_inner())),
            true => Self::Alone(TURNS.write().unwrap_or_else(|broken| broken.into_inner())),
        })
    }
}

impl Deref for Turn {
    type Target = Gpu;

    fn deref(&self) -> &Gpu {
        self.gpu.as_ref().expect("there until it is dropped")
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        let Some(gpu) = self.gpu.take().filter(|_| self.kept) else { return };
        if std::thread::panicking() || gpu.wait().is_err() || !gpu.messages().is_empty() {
            // Not fit for the next test; closing it would disturb the others.
            std::mem::forget(gpu);
        } else {
            free().push(gpu);
        }
    }
}

/// A device of the test's own while no other test has one.
pub(crate) fn alone(validation: Validation) -> Turn {
    let turn = exclusively();
    Turn { gpu: Some(open(validation)), kept: false, _turn: turn }
}

/// While it lives, no other test has a device: for those that open theirs themselves.
pub(crate) fn exclusively() -> Option<Held> {
    Held::take(true)
}

/// A device with all checks on that other tests have used before. No device fails the test: software Vulkan is enough.
pub(crate) fn gpu() -> Turn {
    // All that are likely to be needed, before the first is used.
    drop(free());
    let turn = Held::take(false);
    let gpu = free().pop();
    Turn { gpu: Some(gpu.unwrap_or_else(|| open(Validation::Sync))), kept: true, _turn: turn }
}

/// The devices that no test has.
fn free() -> MutexGuard<'static, Vec<Gpu>> {
    static FREE: OnceLock<Mutex<Vec<Gpu>>> = OnceLock::new();
    let opened = || {
        let threads = std::env::var("RUST_TEST_THREADS").ok().and_then(|n| n.parse().ok());
        let threads = threads.or_else(|| std::thread::available_parallelism().ok().map(usize::from)).unwrap_or(1);
        let _alone = exclusively();
        Mutex::new((0..threads.min(8)).map(|_| open(Validation::Sync)).collect())
    };
    FREE.get_or_init(opened).lock().unwrap_or_else(|broken| broken.into_inner())
}

/// A device that the test closes: see `exclusively`.
pub(crate) fn open(validation: Validation) -> Gpu {
    Gpu::new(&Options { device: None, validation }).expect("a Vulkan device and the validation layer")
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
