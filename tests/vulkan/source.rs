//! Light with a source on the device. The tests compare kernels over modes, and whole steps, with the CPU.

use super::steps::{assert_close, assert_same_views, solve, steps};
use eyebox::low_level::engine::cpu::CpuEngine;
use eyebox::low_level::engine::{Engine, EngineError, Kernel, Purpose, Storage};
use eyebox::low_level::optics::{FewerModes, Prescription, SourceMode};
use eyebox::low_level::plan::{Comparison, EyeTables, ModelTables, Viewpoint};
use eyebox_kernels::compare::{AMPLITUDE, INTENSITY, PROJECTION};
use eyebox_tests::both::{Case, assert_silent, compare, every_fault, vulkan};

/// Returns a case in the light of this number of modes, off the axis and off the wavelength. None is off by a whole
/// number of bins.
fn lit(mut case: Case, modes: usize, bench: bool) -> Case {
    let share = (modes * (modes + 1)) as f64 / 2.0;
    let mode = |i: usize| SourceMode {
        angle: [1.7e-3 * i as f64 - 2e-3, 1.1e-3 - 0.9e-3 * i as f64],
        weight: (i + 1) as f64 / share,
        ..SourceMode::centred(520e-9 + 1.3e-9 * i as f64)
    };
    let modes: Vec<SourceMode> = (0..modes).map(mode).collect();
    if bench {
        case.planner.model = ModelTables::new(every_fault(), 11e-3, 256, case.planner.slm, case.planner.grid);
        case.planner.eye = EyeTables::new(Some(&Prescription::new(-0.4, 0.3, 35.0)));
    }
    case.planner = case.planner.with_source(&modes);
    case
}

#[test]
fn kernels_over_modes() {
    let (mut engine, mut twin) = (vulkan(), CpuEngine::new());
    for (height, width, padding, modes) in [(7, 13, 0, 2), (45, 64, 0, 3), (31, 50, 3, 19)] {
        for storage in Storage::ALL {
            let mut case = lit(Case::new(height, width, padding, 15e-3, 2), modes, true);
            case.planner.storage = storage;
            for kernel in [
                Kernel::Overlap,
                Kernel::Transfer,
                Kernel::Relay,
                Kernel::Eye,
                Kernel::PassPupil,
                Kernel::Intensity,
                Kernel::ApplyFactor,
                Kernel::PupilAdjoint,
            ] {
                let step = case.single(Purpose::Project, PROJECTION, 1.0, kernel);
                let worst = compare(&mut engine, &mut twin, &case, Purpose::Project, &step);
                // Halves are rounded in the same way, except for a rare tie.
                let bound = if storage == Storage::F16 { 1e-9 } else { 1e-10 };
                assert!(worst < bound, "{} at {height} x {width}, {modes} modes: {worst:e}", kernel.name());
            }
        }
    }
    assert_silent(engine);
}

/// Steps include pupils in several groups, and an eye that moves.
#[test]
fn both_engines_take_the_same_steps() {
    let mut engine = vulkan();
    for (height, width, padding, frames, modes, bench) in [(45, 64, 0, 3, 3, false), (40, 36, 5, 2, 2, true)] {
        let case = lit(Case::new(height, width, padding, 4e-3, frames), modes, bench);
        for (purpose, mode) in [(Purpose::Project, PROJECTION), (Purpose::Adam, INTENSITY), (Purpose::Adam, AMPLITUDE)]
        {
            let mut all = steps(&case, purpose, mode);
            all.push(case.moving_step(purpose, mode, 3000));
            // The crosstalk of a model amplifies the rounding of each step in the next. The test therefore compares one
            // step at a time.
            for step in &all {
                let one = std::slice::from_ref(step);
                let got = solve(&mut engine, &case, purpose, one);
                let want = solve(&mut CpuEngine::new(), &case, purpose, one);
                assert_close(&got, &want, &format!("{height} x {width}, {modes} modes, {purpose:?}, mode {mode}"));
                assert_eq!(got, solve(&mut engine, &case, purpose, one));
            }
        }
    }
    assert_silent(engine);
}

#[test]
fn both_engines_show_the_same_views() {
    let mut engine = vulkan();
    assert_same_views(&mut engine, &lit(Case::new(54, 70, 0, 4e-3, 4), 4, true));
    assert_silent(engine);
}

/// Both engines refuse tables of a model for another number of modes, and do not read beyond them.
#[test]
fn another_number_of_modes_is_refused() {
    let mut case = lit(Case::new(16, 16, 0, 0.0, 1), 3, true);
    case.planner.model = ModelTables::new(every_fault(), 11e-3, 256, case.planner.slm, case.planner.grid);
    let step = case.step(Purpose::Project, PROJECTION, 0.5, usize::MAX);
    for engine in [&mut vulkan() as &mut dyn Engine, &mut CpuEngine::new()] {
        case.load(engine, Purpose::Project);
        let error = engine.run(&step).unwrap_err();
        let EngineError::Mismatch { reason } = &error else { panic!("{error}") };
        assert!(reason.contains(" 3 ") && reason.contains("with_source"), "{error}");
    }
}

/// Sources take turns and are an eyebox apart. Pupils see one, two or three of them, each in its own sub-frames.
#[test]
fn sources_in_turn_are_the_same_on_both_engines() {
    let mut engine = vulkan();
    for (bench, turns) in [(false, 2), (true, 3)] {
        let mut case = lit(Case::new(45, 64, 0, 4e-3, 4), 3, bench);
        let switched = |(i, mode): (usize, &SourceMode)| SourceMode {
            angle: [mode.angle[0] + 0.03 * (i as f64 - 1.0), mode.angle[1]],
            source: i,
            turn: [i % turns, turns],
            ..*mode
        };
        let modes: Vec<SourceMode> = case.planner.modes.iter().enumerate().map(switched).collect();
        case.planner = case.planner.with_source(&modes);
        for (purpose, mode) in [(Purpose::Project, PROJECTION), (Purpose::Adam, INTENSITY)] {
            let mut all = steps(&case, purpose, mode);
            all.push(case.moving_step(purpose, mode, 3000));
            let counts: Vec<usize> = all[0].pupil_passes.iter().map(|pass| pass.mode_count()).collect();
            assert!(counts.iter().any(|n| *n != counts[0]) || counts[0] < 3, "{counts:?}");
            for step in &all {
                let one = std::slice::from_ref(step);
                let got = solve(&mut engine, &case, purpose, one);
                let want = solve(&mut CpuEngine::new(), &case, purpose, one);
                assert_close(&got, &want, &format!("{turns} in turn, bench {bench}, {purpose:?}"));
            }
        }
    }
    assert_silent(engine);
}

/// Pupils of one step have different numbers of modes.
#[test]
fn pupils_of_different_modes_share_a_step() {
    let mut engine = vulkan();
    let mut case = lit(Case::new(45, 64, 0, 4e-3, 3), 5, false);
    let few = case.planner.modes[..2].iter().map(|mode| SourceMode { weight: 0.5, ..*mode }).collect();
    let between = case.pupils.iter().map(|pupil| pupil.diameter).sum::<f64>() / case.pupils.len() as f64;
    case.planner.fewer = [FewerModes { from: between, modes: few }].into();
    for (purpose, mode) in [(Purpose::Project, PROJECTION), (Purpose::Adam, INTENSITY)] {
        let comparison = Comparison { mode, exposure: 0.6, batch: case.pupils.len(), ..Comparison::default() };
        let passes = || case.pupils.iter().map(|p| case.planner.viewpoint(&Viewpoint::Pupil(*p), &comparison));
        let counts: Vec<usize> = passes().map(|pass| pass.mode_count()).collect();
        assert!(counts.contains(&5) && counts.contains(&2), "{counts:?}");
        for in_flight in [usize::MAX, 3000] {
            let step = match purpose {
                Purpose::Adam => case.planner.adam_step(passes().collect::<Vec<_>>(), in_flight, 1, 0.1),
                _ => case.planner.project_step(passes().collect::<Vec<_>>(), in_flight, 0.5, 2.0, 0.5),
            };
            let got = solve(&mut engine, &case, purpose, std::slice::from_ref(&step));
            let want = solve(&mut CpuEngine::new(), &case, purpose, std::slice::from_ref(&step));
            assert_close(&got, &want, &format!("{purpose:?}, {in_flight} in flight"));
        }
    }
    assert_silent(engine);
}
