//! Tests that kernels stay in their bound ranges and declare aliased bindings, and that halves are read exactly.

use super::engine::VulkanEngine;
use crate::engine::{Buffer, Engine, Purpose, Step, Storage};
use crate::gpu::guards::{Guards, flags};
use crate::gpu::test_options::watched;
use crate::gpu::{Commands, DeviceKind, Gpu, Options};
use crate::optics::{DisplayModel, Optics, Padding, Pupil, WindowFactor};
use crate::plan::{Comparison, ModelTables, Planner, ViewLayout};
use crate::scene::{Pyramid, ViewGrid};
use eyebox_kernels::compare::{INTENSITY, PROJECTION};
use eyebox_kernels::{half, modulate};
use eyebox_spirv as spirv;
use std::collections::BTreeSet;
use std::sync::Arc;

fn open(plan_as: DeviceKind) -> Gpu {
    let options = Options { plan_as: Some(plan_as), ..watched() };
    Gpu::open(&options).unwrap_or_else(|e| panic!("{e}"))
}

/// A step over three pupils in two groups. The window of one pupil wraps.
struct Case {
    planner: Planner,
    pyramid: Arc<Pyramid>,
    purpose: Purpose,
    step: Step,
}

fn case(
    [height, width, padding]: [usize; 3],
    frames: usize,
    levels: usize,
    purpose: Purpose,
    storage: Storage,
    model: DisplayModel,
) -> Case {
    let slm = Optics::new(height, width, 8e-6, 520e-9, 0.4).unwrap();
    let mut planner = Planner { storage, levels, ..Planner::new(slm, frames, WindowFactor::Two) };
    if padding > 0 {
        planner = planner.with_padding(Padding { rows: padding, columns: padding });
    }
    let (rows, columns) = (planner.grid.height, planner.grid.width);
    planner.model = ModelTables::new(model, 11e-3, 256, slm, planner.grid);
    let grid = ViewGrid { rows: 3, columns: 3, cell: slm.eyebox() / 3.0 };
    let view = |v: usize| (0..rows * columns).map(|i| ((i * 37 + v * 101) % 211) as f32 / 211.0).collect();
    let views: Vec<Vec<f32>> = (0..9).map(view).collect();
    let pyramid = Arc::new(Pyramid::new(&views, rows, columns));
    planner.views = Some(ViewLayout::new(grid, &pyramid));
    let half = slm.eyebox() / 2.0;
    let mode = if purpose == Purpose::Adam { INTENSITY } else { PROJECTION };
    let comparison = Comparison { mode, exposure: 0.8, batch: 3, ..Comparison::default() };
    let passes = [(-0.7, 0.8, 0.4), (0.1, -0.05, 1.6), (0.3, 0.2, 0.7)].map(|(x, y, d)| {
        planner.pupil_pass(&Pupil { x: x * half, y: y * half, diameter: d * half, depth: 4e-3 }, &comparison)
    });
    let step = match purpose {
        Purpose::Adam => planner.adam_step(passes.to_vec(), usize::MAX, 3, 0.1),
        _ => planner.project_step(passes.to_vec(), 3000, 0.5, 2.0, 0.5),
    };
    let step = if levels > 0 { planner.with_equalised_eyebox(step, 0.8 * slm.eyebox(), 5, 0.4) } else { step };
    Case { planner, pyramid, purpose, step }
}

/// Returns the bits of losses, phases and moments of two steps, and of a view.
fn run(engine: &mut VulkanEngine, case: &Case) -> Vec<u64> {
    let shape = case.planner.shape(case.purpose);
    engine.load(&shape, Some(Arc::clone(&case.pyramid))).unwrap();
    let phases: Vec<f32> = (0..shape.frames * shape.pixels()).map(|i| ((i * 29) % 71) as f32 * 0.08 - 2.8).collect();
    engine.write(Buffer::Phases, &phases).unwrap();
    let mut bits = Vec::new();
    for _ in 0..2 {
        let begun = engine.begin_step(&case.step, std::slice::from_ref(&(0..case.step.list.len()))).unwrap();
        bits.extend(engine.end_step(begun).unwrap().losses.iter().map(|loss| loss.to_bits()));
    }
    engine.run(&case.planner.view_step(case.step.pupil_passes.clone())).unwrap();
    for buffer in [Buffer::Phases, Buffer::Momentum, Buffer::Image(0), Buffer::Image(2)] {
        bits.extend(engine.read(buffer).unwrap().iter().map(|value| u64::from(value.to_bits())));
    }
    bits
}

/// With NaN on both sides of every range of every dispatch, the results are equal and the NaN stays.
#[test]
fn every_kernel_keeps_to_its_ranges() {
    use Purpose::{Adam, Project};
    let mut aliased = BTreeSet::new();
    for plan_as in [DeviceKind::Discrete, DeviceKind::Cpu] {
        let mut plain = VulkanEngine::new(&open(plan_as)).unwrap();
        let mut guarded = VulkanEngine::new(&open(plan_as)).unwrap();
        guarded.guard();
        for storage in [Storage::F32, Storage::F16] {
            // These have an even and an odd number of columns.
            let ideal = DisplayModel::default;
            let mut cases = vec![
                case([44, 64, 0], 3, 0, Project, storage, ideal()),
                case([30, 31, 2], 1, 0, Adam, storage, ideal()),
            ];
            if plan_as == DeviceKind::Discrete {
                // These sizes are convolutions.
                cases.push(case([31, 38, 0], 2, 11, Project, storage, ideal()));
                cases.push(case([40, 36, 4], 2, 0, Adam, storage, ideal()));
                let model = DisplayModel { lag: 0.1, undiffracted: vec![[0.2; 5]], ..ideal() };
                cases.push(case([40, 36, 4], 2, 0, Project, storage, model));
            }
            for case in cases {
                let what = format!("as {plan_as}, {storage:?}, {:?}", case.planner.grid);
                let want = run(&mut plain, &case);
                let got = run(&mut guarded, &case);
                let guards = guarded.guards();
                assert!(std::mem::take(&mut guards.count) > 2 * case.step.pupil_passes.len(), "{what}");
                assert_eq!(guards.faults(), Vec::<String>::new(), "{what}");
                assert!(got == want, "{what}: other results between guards");
                aliased.extend(std::mem::take(&mut guards.aliased));
            }
        }
        let messages = [plain.gpu().messages(), guarded.gpu().messages()];
        drop((plain, guarded));
        assert!(messages.iter().all(|m| m.lock().unwrap().is_empty()), "{messages:?}");
    }
    // Written ranges overlapped in memory, and the modules must declare that.
    let met: BTreeSet<&str> = aliased.iter().map(|(module, ..)| *module).collect();
    for module in ["project", "adam", "project_rows", "adam_rows", "fft_pass", "fft_chirp", "compare_rows"] {
        assert!(met.contains(module), "nothing of {module} met: {met:?}");
    }
    for (name, a, b) in aliased {
        let flags = flags(name);
        let of = |binding: usize| flags.iter().filter(move |f| f.binding == binding as u32);
        let is_written = of(a).chain(of(b)).any(|f| f.is_written);
        assert!(!is_written || of(a).chain(of(b)).all(|f| f.is_aliased), "{name}: bindings {a} and {b} may be one");
    }
}

/// A list in as many submissions as dispatches gives the same results, and the times of all of it.
#[test]
fn a_list_in_parts_is_the_list() {
    let case = case([44, 64, 0], 3, 0, Purpose::Project, Storage::F16, DisplayModel::default());
    let mut whole = VulkanEngine::new(&open(DeviceKind::Discrete)).unwrap();
    let want = run(&mut whole, &case);
    let mut cut = VulkanEngine::new(&open(DeviceKind::Discrete)).unwrap();
    cut.pretend_slow();
    cut.time_kernels(true);
    // A list that is cut again reuses the same command buffers.
    for _ in 0..2 {
        let before = cut.gpu().counts();
        assert!(run(&mut cut, &case) == want);
        assert!(cut.gpu().counts().since(before).submissions > 30, "{:?}", cut.gpu().counts());
    }
    assert!(cut.timings().iter().all(|t| t.calls > 0 && t.seconds >= 0.0) && !cut.timings().is_empty());
    let messages = cut.gpu().messages();
    drop((whole, cut));
    assert_eq!(*messages.lock().unwrap(), Vec::<String>::new());
}

/// A binding that is declared with two value types is two buffers in one memory.
#[test]
fn bindings_with_two_names_are_known_to_be_one() {
    for module in spirv::ALL {
        let flags = flags(module.name);
        for one in flags.iter().filter(|f| f.is_written) {
            let same: Vec<_> = flags.iter().filter(|f| f.binding == one.binding).collect();
            assert!(same.len() == 1 || same.iter().all(|f| f.is_aliased), "{}: binding {}", module.name, one.binding);
        }
    }
}

/// The guards find accesses to ranges that are too short by a value, before or after.
#[test]
fn what_leaves_its_range_is_found() {
    let mut gpu = Commands::new(&open(DeviceKind::Cpu)).unwrap();
    gpu.device.pipelines().maker.is_guarded = true;
    gpu.recorder.guards = Some(Guards::default());
    let phases = gpu.filled(bytemuck::cast_slice(&[0.5f32; 64]), "phases").unwrap();
    let field = gpu.block(8 * 64, "field").unwrap();
    let pipeline = gpu.pipeline(&spirv::MODULATE, 2, &[]).unwrap();
    let run = |gpu: &mut Commands, begin: u64, size: u64, place: modulate::Args| {
        let mut push: Vec<u8> = bytemuck::bytes_of(&place).to_vec();
        push.extend(bytemuck::cast_slice(&[64u32, 64, 1f32.to_bits()]));
        gpu.recorder.begin(0).unwrap();
        gpu.recorder.dispatch(pipeline, &[phases.all(), field.range(begin, size)], &push, [1, 8, 1]).unwrap();
        gpu.recorder.submit("modulate").unwrap();
        gpu.recorder.guards.as_mut().unwrap().faults()
    };
    let place = modulate::Args { height: 8, width: 8, grid_height: 8, grid_width: 8, top: 0, left: 0 };
    assert_eq!(run(&mut gpu, 0, 8 * 64, place), Vec::<String>::new());
    let behind = run(&mut gpu, 0, 8 * 63, place);
    assert!(behind.len() == 1 && behind[0].contains("modulate") && behind[0].contains("[1]"), "{behind:?}");
    assert_eq!(behind[0].matches("504").count(), 2, "{behind:?}");
}

/// Each of the 65,536 halves is read as its value and stored unchanged.
#[test]
fn all_halves_are_read_exactly() {
    let mut gpu = Commands::new(&open(DeviceKind::Cpu)).unwrap();
    let all: Vec<u16> = (0..=u16::MAX).collect();
    let block = gpu.filled(bytemuck::cast_slice(&all), "halves").unwrap();
    let count = all.len() / 2;
    // The factor is one, because |z|^2 alone would hide errors in small values.
    let ones = gpu.filled(bytemuck::cast_slice(&vec![1.0f32; count]), "ones").unwrap();
    let pipeline = gpu.pipeline(spirv::APPLY_FACTOR.stored(true), 2, &[]).unwrap();
    let push = [count as u32, count as u32];
    gpu.recorder.begin(0).unwrap();
    let groups = [(count as u32).div_ceil(eyebox_kernels::WIDTH), 1, 1];
    gpu.recorder.dispatch(pipeline, &[ones.all(), block.all()], bytemuck::cast_slice(&push), groups).unwrap();
    gpu.recorder.submit("halves").unwrap();
    let mut got = vec![0u16; all.len()];
    gpu.download(&block, bytemuck::cast_slice_mut(&mut got), [(0, 0, 2 * all.len() as u64)]).unwrap();
    // The kind of NaN does not matter.
    let value = |bits: u16| if bits & 0x7fff > 0x7c00 { 0x7e00 } else { bits };
    let want = half::pack(&half::unpack(&all));
    let wrong = got.iter().zip(&want).enumerate().find(|(_, (got, want))| value(**got) != value(**want));
    assert_eq!(wrong, None, "which, what was read, what it is");
}
