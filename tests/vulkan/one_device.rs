//! A program uses one Vulkan device for all its work. The test counts the devices in the output of the loader, in a
//! separate process.

use eyebox::low_level::encode::{Encoder, PhaseSet};
use eyebox::low_level::engine::vulkan::{Transforms, VulkanEncoder, VulkanEngine};
use eyebox::low_level::engine::{Backend, Buffer, Choice, Engine, Storage};
use eyebox::low_level::gpu::{Options, PhasesOnDevice, PixelOrder};
use eyebox::low_level::optics::{Color, Display, Padding};
use eyebox::low_level::scene::{self, Request};
use eyebox::low_level::solve::{Flow, Problem, RefineSettings, Refiner, Settings, solve};
use eyebox_tests::both::gpu;
use std::process::{Command, Output};
use std::sync::PoisonError;

#[path = "../../runtime/eyebox/examples/own_vulkan_device.rs"]
mod own;

pub(crate) const INSIDE: &str = "EYEBOX_TEST_INSIDE";

/// Runs one of these tests again in its own process, with `variables`.
pub(crate) fn again(test: &str, variables: &[(&str, &str)]) -> Output {
    let mut child = Command::new(std::env::current_exe().expect("this test's file"));
    child.args(["--exact", test, "--nocapture"]).env(INSIDE, "1").envs(variables.iter().copied());
    let output = child.output().expect("the test runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stdout));
    output
}

/// Makes engines of three colors, an encoder and transforms.
fn program() {
    let backend = Backend::open(Choice::Vulkan, &Options::default()).expect("a device");
    let engines: Vec<_> = (0..3).map(|_| backend.engine().expect("an engine")).collect();
    let gpu = backend.gpu().expect("a Vulkan backend").expect("a device");
    let display = Display { height: 8, width: 8, ..Display::preset("planes24").expect("a preset") };
    let encoder = Encoder::new(&display, &[Color::Red, Color::Green, Color::Blue], 8).expect("an encoder");
    let device = VulkanEncoder::new(&gpu, encoder.plan()).expect("an encoder on the device");
    let transforms = Transforms::new(&gpu).expect("transforms");
    assert!(device.gpu().is(&gpu) && transforms.gpu().is(&gpu) && engines.len() == 3);
}

#[test]
fn a_program_makes_one_device() {
    if std::env::var_os(INSIDE).is_some() {
        return program();
    }
    let output = again("one_device::a_program_makes_one_device", &[("VK_LOADER_DEBUG", "all")]);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(said.matches("vkCreateDevice layer callstack setup").count(), 1, "{said}");
}

/// The example runs under the validation layer, which writes its findings to the output.
#[test]
fn a_program_brings_its_own_device() {
    if std::env::var_os(INSIDE).is_some() {
        return own::main().unwrap_or_else(|e| panic!("{e}"));
    }
    let output =
        again("one_device::a_program_brings_its_own_device", &[("VK_INSTANCE_LAYERS", "VK_LAYER_KHRONOS_validation")]);
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(said.contains(" dB") && !said.contains("VUID") && !said.contains("Validation"), "{said}");
}

/// One device refines and encodes every color. In the steady state no phases are read back to the host, and the bytes
/// equal the bytes of the CPU's encoder.
#[test]
fn refining_and_encoding_reads_no_phases_back() {
    let gpu = gpu();
    let display = Display { height: 24, width: 32, ..Display::preset("planes24").expect("a preset") };
    let colors = [Color::Red, Color::Green, Color::Blue];
    let field =
        scene::load("builtin:plane", &Request { views: 3, ..Request::new(&display, &colors) }).expect("a scene");
    let mut refiners: Vec<Refiner> = (colors.into_iter())
        .map(|color| {
            let problem = Problem::new(&field, color, &display, Padding::default()).expect("a problem");
            let phases: Vec<f32> = (0..8 * 24 * 32).map(|i| (i * 37 % 101) as f32 * 0.06).collect();
            let engine = Box::new(VulkanEngine::new(&gpu).expect("an engine"));
            // The test sets float32, because GPUs prefer halves, and halves take half the bytes.
            let steering = RefineSettings { storage: Some(Storage::F32), ..RefineSettings::default() };
            Refiner::new(problem, &phases, 1.0, steering, engine).expect("a refinement")
        })
        .collect();
    let encoder = Encoder::new(&display, &colors, 8).expect("an encoder");
    let mut device = VulkanEncoder::new(&gpu, encoder.plan()).expect("an encoder on the device");
    let mut pictures = device.pictures(PixelOrder::Bgra).expect("pictures");
    let loaded = gpu.counts();
    let first = refiners[0].phases().expect("read");
    let read = gpu.counts();
    for round in 0..4 {
        if round == 2 {
            // In a jump the phases for the whole eyebox come from the device's own memory.
            let before = gpu.counts();
            refiners.iter_mut().for_each(|r| r.begin_again().expect("the stored phases"));
            let jump = gpu.counts().since(before);
            assert_eq!((jump.uploaded, jump.read_back, jump.submissions, jump.blocks), (0, 0, 3, 0));
        }
        refiners.iter_mut().for_each(|r| assert!(r.step().expect("a step").is_finite()));
        let phases: Vec<PhasesOnDevice<'_>> =
            refiners.iter().map(|r| r.phases_on_device().expect("on the device")).collect();
        device.encode_on_device(&phases).expect("encoded");
        device.draw(&mut pictures).expect("drawn");
    }
    assert_eq!(gpu.counts().phases_read_back, read.phases_read_back, "{:?}", gpu.counts());
    assert_eq!((loaded.phases_read_back, read.phases_read_back), (0, 4 * first.len() as u64));
    let mut got = encoder.frames();
    device.download(got.bytes_mut()).expect("read");
    let phases: Vec<Vec<f32>> = refiners.iter_mut().map(|r| r.phases().expect("read")).collect();
    let slices: Vec<&[f32]> = phases.iter().map(|p| &p[..]).collect();
    assert!(encoder.encode(&PhaseSet::trusted(&slices)).expect("encoded") == got);
    assert!(phases[0] != first);
    refiners[0].begin_again().expect("the stored phases");
    assert!(refiners[0].phases().expect("read") == first);
    let messages = gpu.messages();
    drop((refiners, device, pictures, gpu));
    let heard = messages.lock().unwrap_or_else(PoisonError::into_inner);
    assert!(heard.is_empty(), "{heard:?}");
}

/// Validations keep the best phases on the device, which are read once, at the end.
#[test]
fn a_solve_reads_its_phases_once() {
    let gpu = gpu();
    let display = Display { height: 24, width: 32, ..Display::preset("paper").expect("a preset") };
    let field = scene::load("builtin:plane", &Request { views: 3, ..Request::new(&display, &[Color::Green]) })
        .expect("a scene");
    let problem = Problem::new(&field, Color::Green, &display, Padding::default()).expect("a problem");
    let settings = Settings { steps: 9, frames: 2, pupils: 2, efficiency: Some(0.5), ..Settings::default() };
    let mut scores = Vec::new();
    let mut engine = VulkanEngine::new(&gpu).expect("an engine");
    let solution = solve(&problem, &settings, &mut engine, &mut |p| {
        scores.extend(p.validation.map(|v| v.mean()));
        Flow::Continue
    });
    let solution = solution.expect("a solution");
    scores.dedup();
    assert!(scores.len() > 1, "one validation is better than the one before: {scores:?}");
    assert_eq!(gpu.counts().phases_read_back, 4 * 2 * 24 * 32);
    // These are the best phases, not the phases of the last step.
    engine.restore().expect("the stored phases");
    assert!(engine.read(Buffer::Phases).expect("read") == solution.phases);
}

/// One place of the source makes devices.
#[test]
fn devices_are_made_in_one_place() {
    fn search(folder: &std::path::Path, found: &mut Vec<String>) {
        for entry in std::fs::read_dir(folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                search(&path, found);
            } else if path.extension().is_some_and(|e| e == "rs") {
                let calls = std::fs::read_to_string(&path).expect("a file").matches(".create_device(").count();
                found.extend((0..calls).map(|_| path.display().to_string()));
            }
        }
    }
    let runtime = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../runtime");
    let mut found = Vec::new();
    search(&runtime, &mut found);
    // Statistics of compilers are for tests. Their devices run nothing.
    found.retain(|f| !f.contains("examples") && !f.ends_with("gpu/vulkan/statistics.rs"));
    assert!(found.len() == 1 && found[0].ends_with("gpu/vulkan/device.rs"), "{found:?}");
}
