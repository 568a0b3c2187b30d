//! The ends of every range, on both engines, against float64. The result is finite and within the stated error, or an
//! error that names the limit.
//!
//! The longest cases are shortened. `EYEBOX_EXTREMES=full cargo test --release -p eyebox-tests --test library
//! extremes::` runs them at full length (results are in docs/measurements.md).

use eyebox::low_level::engine::{Buffer, Engine, cpu::CpuEngine};
use eyebox::low_level::evaluate;
use eyebox::low_level::optics::{Color, Display, Optics, OpticsError, Padding, Pupil, Wavelength, WindowFactor};
use eyebox::low_level::plan::{Comparison, Kernel, Planner, Purpose, Storage};
use eyebox::low_level::scene::LightField;
use eyebox::low_level::solve::{self, Flow, Method, Optimizer, Problem, Settings, Solution, SolveError, Stop};
use eyebox_tests::both::{assert_silent, vulkan};
use eyebox_tests::{Oracle, error_power, half_roundings, noise, phases};
use std::f64::consts::{PI, TAU};

/// float32 rounds to 6e-8, which is a power of 4e-15. A transform of a million points adds about twenty such roundings.
/// The tests require 1e-10 of the signal's power, and results are nearer to 1e-13.
const BOUND: f64 = 1e-10;

/// Halves add one rounding when the field is made, one when it passes the pupil, and at most four along each axis of
/// two transforms. An intensity has at most twice the error of its field.
fn bound(storage: Storage) -> f64 {
    match storage {
        Storage::F32 => BOUND,
        Storage::F16 => 2.0 * half_roundings(18),
    }
}

fn full() -> bool {
    std::env::var("EYEBOX_EXTREMES").is_ok_and(|v| v == "full")
}

/// Compares the views of both engines through these pupils with float64, at each window factor of the views, and with
/// both storages.
fn views_agree(engines: &mut [&mut dyn Engine], optics: Optics, frames: usize, pupils: &[Pupil], what: &str) {
    let planner = Planner::new(optics, frames, WindowFactor::Full);
    let (exact, rounded) = phases(frames * optics.height * optics.width, 5);
    let oracle = Oracle { optics, frames };
    let want: Vec<Vec<f64>> = pupils.iter().map(|p| oracle.view(&exact, p)).collect();
    for storage in Storage::ALL {
        let planner = Planner { storage, ..planner.clone() };
        for engine in engines.iter_mut() {
            engine.load(&planner.shape(Purpose::View), None).unwrap_or_else(|e| panic!("{what}: {e}"));
            engine.write(Buffer::Phases, &rounded).unwrap();
            let seen = evaluate::views(*engine, &planner, pupils).unwrap_or_else(|e| panic!("{what}: {e}"));
            for ((seen, want), pupil) in seen.iter().zip(&want).zip(pupils) {
                assert!(seen.iter().all(|v| v.is_finite()), "{what}, {pupil:?}");
                let error = error_power(seen, want);
                let on = engine.describe();
                assert!(error < bound(storage), "{what}, {pupil:?}, {storage:?}, {on}: {error:.1e} of the signal");
            }
        }
    }
}

#[test]
fn depths_wavelengths_and_pitches() {
    let (mut cpu, mut device) = (CpuEngine::new(), vulkan());
    for wavelength in [380e-9, 520e-9, 1000e-9] {
        // Most frequencies are evanescent if the pitch is half a micrometer.
        for pitch in [0.5e-6, 1.0e-6, 8e-6, 50e-6] {
            let optics = Optics::new(24, 30, pitch, wavelength, 0.4).unwrap();
            let e = optics.eyebox();
            let pupil = |x: f64, y: f64, d: f64, depth: f64| Pupil { x: x * e, y: y * e, diameter: d * e, depth };
            let pupils: Vec<Pupil> = [0.0, 1e-6, -1e-6, 3e-3, -0.1, 1.0, 10.0, -10.0]
                .iter()
                .flat_map(|&z| [pupil(0.0, 0.0, 1.5, z), pupil(0.21, -0.17, 0.4, z)])
                .collect();
            let what = format!("{:.0} nm, {:.1} um", wavelength * 1e9, pitch * 1e6);
            views_agree(&mut [&mut cpu, &mut device], optics, 2, &pupils, &what);
        }
    }
    assert_silent(device);
}

#[test]
fn pupils_from_less_than_a_bin_to_more_than_the_eyebox() {
    let (mut cpu, mut device) = (CpuEngine::new(), vulkan());
    let optics = Optics::new(40, 36, 8e-6, 520e-9, 0.4).unwrap();
    let (bin_y, bin_x) = optics.bin_size();
    let e = optics.eyebox();
    let at = |x: f64, y: f64, diameter: f64| Pupil { x, y, diameter, depth: 2e-3 };
    let pupils = [
        // On a bin, that bin passes. Between bins no bin passes, and the eye sees black.
        at(3.0 * bin_x, -2.0 * bin_y, 0.1 * bin_x),
        at(3.5 * bin_x, -2.5 * bin_y, 0.1 * bin_x),
        // The edge is exactly on bins, on one axis and on both.
        at(0.0, 0.0, 8.0 * bin_x),
        at(0.5 * bin_x, 0.5 * bin_y, 5.0 * bin_x),
        at(0.0, 0.0, 10.0 * bin_y),
        // The pupils touch the edge of the eyebox from inside, extend over it, are in its corner, almost outside, and
        // larger than it.
        at(e / 2.0 - 2e-3, 0.0, 4e-3),
        at(e / 2.0, 0.0, 6e-3),
        at(-e / 2.0, e / 2.0, 5e-3),
        at(0.0, e / 2.0 + 2.9e-3, 6e-3),
        at(0.0, 0.0, 3.0 * e),
        at(1e-3, 0.0, 1e3),
    ];
    views_agree(&mut [&mut cpu, &mut device], optics, 3, &pupils, "pupils");
    // A pupil wholly outside sees black, not NaN.
    let planner = Planner::new(optics, 3, WindowFactor::Full);
    let seen = evaluate::views(&mut cpu, &planner, &[at(1.0, 0.0, 1e-3), pupils[1]]).unwrap();
    assert!(seen.iter().flatten().all(|v| *v == 0.0));
    // The smaller windows pass the same bins as the full one.
    for pupil in &pupils[..9] {
        let bins = |factor| {
            let planner = Planner { factor, ..planner.clone() };
            let pupil_pass = planner.pupil_pass(pupil, &Comparison::default());
            pupil_pass.spans.iter().map(|s| u64::from(s[1] - s[0])).sum::<u64>()
        };
        assert_eq!(bins(WindowFactor::One), bins(WindowFactor::Full), "{pupil:?}");
        assert_eq!(bins(WindowFactor::Two), bins(WindowFactor::Full), "{pupil:?}");
    }
    assert_silent(device);
}

#[test]
fn grids_from_one_pixel_to_a_plm() {
    let (mut cpu, mut device) = (CpuEngine::new(), vulkan());
    let pupils = [Pupil::from_mm([0.0, 0.0, 30.0, 1.0]), Pupil::from_mm([3.0, -2.0, 8.0, -4.0])];
    let largest = if full() { (2464, 4160) } else { (616, 1040) };
    let sizes = [(1, 1), (1, 2), (1, 257), (509, 1), (97, 61), (2, 1021), largest];
    for (height, width) in sizes {
        let optics = Optics::new(height, width, 10.8e-6, 520e-9, 0.4).unwrap();
        views_agree(&mut [&mut cpu, &mut device], optics, 1, &pupils, &format!("{height} x {width}"));
    }
    let optics = Optics::new(20, 26, 8e-6, 520e-9, 0.4).unwrap();
    views_agree(&mut [&mut cpu, &mut device], optics, 64, &pupils, "64 sub-frames");
    assert_silent(device);
}

/// All light is in one bin. This value of the spectrum is the largest that any phases make, and is the usual value
/// times the root of the number of points. Halves can store it, and the image is correct.
#[test]
fn all_light_in_one_bin() {
    let (mut cpu, mut device) = (CpuEngine::new(), vulkan());
    let largest = if full() { (1080, 1920) } else { (270, 480) };
    for (height, width) in [(1, 1), (2, 256), (61, 97), largest] {
        let optics = Optics::new(height, width, 8e-6, 520e-9, 0.4).unwrap();
        let planner = Planner { storage: Storage::F16, ..Planner::new(optics, 1, WindowFactor::One) };
        let points = height * width;
        // A constant phase has all light in the bin at zero, a checkerboard of half turns in the bin at the corner.
        for (checks, phase) in [(false, 0.0f32), (false, 1.1), (true, -2.0)] {
            if checks && (height % 2 + width % 2 > 0) {
                continue;
            }
            let turned = |i: usize| checks && !(i / width + i % width).is_multiple_of(2);
            let phases: Vec<f32> =
                (0..points).map(|i| if turned(i) { phase + std::f32::consts::PI } else { phase }).collect();
            let (bin_y, bin_x) = optics.bin_size();
            let corner =
                if checks { [-(height as f64) / 2.0 * bin_y, -(width as f64) / 2.0 * bin_x] } else { [0.0; 2] };
            let pupil = Pupil { y: corner[0], x: corner[1], diameter: 4e-3, depth: 2e-3 };
            for engine in [&mut cpu as &mut dyn Engine, &mut device] {
                engine.load(&planner.shape(Purpose::View), None).unwrap();
                engine.write(Buffer::Phases, &phases).unwrap();
                let seen = evaluate::views(engine, &planner, &[pupil]).unwrap();
                let what = format!("{height} x {width}, checks {checks}, {}", engine.describe());
                let at = if checks { height / 2 * width + width / 2 } else { 0 };
                let field = engine.read(Buffer::Field).unwrap();
                let bin = f64::from(field[2 * at]).hypot(f64::from(field[2 * at + 1]));
                let want = points as f64 * f64::from(planner.shape(Purpose::View).field_scale());
                assert!(want <= 32768.0 && (bin / want - 1.0).abs() < 1e-2, "{what}: {bin}, not {want}");
                // The image is even, and its brightness is the total light over the share of the pupil.
                let share = optics.share(pupil.diameter);
                let even = vec![1.0 / share; seen[0].len()];
                let error = error_power(&seen[0], &even);
                assert!(error < bound(Storage::F16), "{what}: {error:.1e} of the signal");
            }
        }
    }
    assert_silent(device);
}

/// Largest wrapped phase, half a turn and a rounding.
const CIRCLE: f32 = std::f32::consts::PI + 1e-5;

/// Linear light by row and column.
type Picture<'a> = &'a dyn Fn(usize, usize) -> f32;

/// Returns the problem of a light field of 3 x 3 views that all show this picture.
fn problem(size: usize, picture: Picture) -> Problem {
    let display = Display { height: size, width: size, ..Display::preset("small").unwrap() };
    let view: Vec<f32> = (0..size * size).map(|i| picture(i / size, i % size)).collect();
    let field = LightField {
        name: "extreme".into(),
        grid: [3, 3],
        height: size,
        width: size,
        colors: vec![Color::Green],
        planes: vec![vec![view; 9]],
        view_pitch: None,
        disparity: None,
        depth: None,
        made: None,
    };
    Problem::new(&field, Color::Green, &display, Padding::default()).unwrap()
}

fn run(problem: &Problem, settings: &Settings, engine: &mut dyn Engine) -> Solution {
    solve::solve(problem, settings, engine, &mut |_| Flow::Continue).unwrap_or_else(|e| panic!("{e}"))
}

fn sound(solution: &Solution, what: &str) {
    assert!(solution.phases.iter().all(|p| p.abs() <= CIRCLE), "{what}: phases are finite and wrapped");
    assert!(solution.exposure.is_finite() && solution.exposure > 0.0, "{what}: exposure {}", solution.exposure);
    assert!(!solution.validation.mean().is_nan(), "{what}: {:?}", solution.validation);
    assert!(!matches!(solution.stop, Stop::NotFinite { .. }), "{what}: {:?}", solution.stop);
}

#[test]
fn targets_from_black_to_1e30() {
    let mut device = vulkan();
    let texture = |y: usize, x: usize| 0.2 + 0.6 * (((y / 3 + x / 3) % 2) as f32);
    let cases: [(&str, Picture); 6] = [
        ("black", &|_, _| 0.0),
        ("one pixel", &|y, x| if (y, x) == (10, 12) { 1.0 } else { 0.0 }),
        ("saturated", &|_, _| 1.0),
        ("1e-30", &|y, x| 1e-30 * texture(y, x)),
        ("1e+30", &|y, x| 1e30 * texture(y, x)),
        ("ordinary", &texture),
    ];
    let both = [Optimizer::projection(), Optimizer::adam()].map(|o| Storage::ALL.map(|s| (o, s)));
    let mut plain = Vec::new();
    for (optimizer, storage) in both.into_iter().flatten() {
        let few = Settings { frames: 2, steps: 12, pupils: 4, depth: [-1e-3, 1e-3], ..Settings::default() };
        let settings = Settings { optimizer, storage, ..few };
        let mut found = Vec::new();
        for (name, picture) in &cases {
            let problem = problem(32, picture);
            let what = format!("{name}, {optimizer:?}, {storage:?}");
            let (cpu, gpu) = (run(&problem, &settings, &mut CpuEngine::new()), run(&problem, &settings, &mut device));
            sound(&cpu, &what);
            sound(&gpu, &what);
            let apart = (cpu.validation.mean() - gpu.validation.mean()).abs();
            // Rounding errors grow from step to step, most if a target image is nearly all black.
            let allowed = if *name == "one pixel" && storage == Storage::F16 { 1.0 } else { 0.3 };
            assert!(apart < allowed || cpu.validation.mean() == gpu.validation.mean(), "{what}: {apart} dB apart");
            found.push(cpu);
        }
        // The loss by halves is small compared to the error after so small a number of steps.
        match storage {
            Storage::F32 => plain = found.iter().map(|f| f.validation.mean()).collect(),
            Storage::F16 => {
                for ((name, _), (found, plain)) in cases.iter().zip(found.iter().zip(&plain)) {
                    let price = plain - found.validation.mean();
                    let most = if *name == "one pixel" { 1.0 } else { 0.1 };
                    assert!(price < most || found.validation.mean() == *plain, "{name}, {optimizer:?}: {price} dB");
                }
            }
        }
        // The same picture with scaled light has the same quality and the same relative brightness.
        for (i, unit) in [(3, 1e-30), (4, 1e30)] {
            let (other, own) = (&found[i], &found[5]);
            let decibels = own.validation.mean() - 20.0 * f64::log10(unit);
            assert!(
                (other.validation.mean() - decibels).abs() < 0.05,
                "{unit}: {} not {decibels}",
                other.validation.mean()
            );
            assert!((other.exposure / unit / own.exposure - 1.0).abs() < 1e-2, "{unit}: {}", other.exposure);
        }
    }
    assert_silent(device);
}

#[test]
fn exposures_and_rates_far_off() {
    let problem = problem(32, &|y, x| 0.1 + 0.8 * (((y / 4 + x / 5) % 2) as f32));
    let base = Settings { frames: 2, steps: 30, pupils: 4, depth: [-1e-3, 1e-3], ..Settings::default() };
    // The image is 60 dB too bright, or as dark as the light allows. The projection limits its ratio, and nothing
    // overflows.
    for efficiency in [1e-6, 1e-3, 1.0] {
        for optimizer in [Optimizer::projection(), Optimizer::adam()] {
            let settings = Settings { efficiency: Some(efficiency), optimizer, ..base.clone() };
            for storage in Storage::ALL {
                let settings = Settings { storage, ..settings.clone() };
                let what = format!("efficiency {efficiency}, {optimizer:?}, {storage:?}");
                sound(&run(&problem, &settings, &mut CpuEngine::new()), &what);
            }
        }
    }
    let first = solve::random_phases(2 * 32 * 32, base.seed);
    for rate in [0.0, 1e3] {
        for optimizer in [
            Optimizer::Adam { rate: [rate, rate], amplitude: false },
            Optimizer::Adam { rate: [rate, rate], amplitude: true },
            Optimizer::Projection { gain: [rate, rate], momentum: 0.5, overlap_power: 0.5 },
        ] {
            for storage in Storage::ALL {
                let settings = Settings { optimizer, storage, ..base.clone() };
                let solution = run(&problem, &settings, &mut CpuEngine::new());
                sound(&solution, &format!("{optimizer:?}, {storage:?}"));
                // Binary angles begin at the angle nearest to the phase.
                let as_before = |(a, b): (&f32, &f32)| a == b || storage == Storage::F16 && (a - b).sin().abs() < 5e-5;
                assert_eq!(
                    rate == 0.0,
                    solution.phases.iter().zip(&first).all(as_before),
                    "{optimizer:?}: a rate of 0 leaves the phases as they are"
                );
            }
        }
    }
}

/// If an exposure is beyond float32, the solve ends, names the kernel, and keeps its last valid phases.
#[test]
fn numbers_that_are_none_stop_the_solve_and_are_traced() {
    let problem = problem(32, &|y, x| 0.1 + 0.8 * (((y / 4 + x / 5) % 2) as f32));
    let mut device = vulkan();
    let base = Settings { frames: 2, steps: 30, pupils: 4, depth: [-1e-3, 1e-3], ..Settings::default() };
    let settings = Settings { efficiency: Some(1e-25), ..base.clone() };
    for engine in [&mut CpuEngine::new() as &mut dyn Engine, &mut device] {
        let solution = run(&problem, &settings, engine);
        assert_eq!(solution.stop, Stop::NotFinite { step: 1, kernel: Some(Kernel::Compare) }, "{}", engine.describe());
        assert_eq!(solution.phases, solve::random_phases(2 * 32 * 32, base.seed), "the step was not taken");
    }
    // The solver finds phases that are not finite before other values.
    let adam = Optimizer::Adam { rate: [f64::MAX, f64::MAX], amplitude: false };
    let solution = run(&problem, &Settings { optimizer: adam, ..base.clone() }, &mut CpuEngine::new());
    assert_eq!(solution.stop, Stop::NotFinite { step: 2, kernel: None });
    assert!(solution.phases.iter().all(|p| p.is_finite()));
    assert_silent(device);
}

/// These values fit float32, but not halves. If all light of a constant phase enters a pupil of a ten-thousandth of the
/// eyebox, it is ten thousand times too bright. With float32 the solve continues. With halves it skips the step and
/// names the kernel whose values became too large.
#[test]
fn what_is_too_large_for_halves_is_named() {
    let texture = problem(256, &|y, x| 0.1 + 0.8 * (((y / 4 + x / 5) % 2) as f32));
    let narrow = Problem { eyebox: 0.2e-3, ..texture };
    let mut device = vulkan();
    let settings = Settings { method: Method::Smooth, steps: 2, pupils: 2, depth: [0.0, 0.0], ..Settings::default() };
    let mut cpu = CpuEngine::new();
    for engine in [&mut cpu as &mut dyn Engine, &mut device] {
        let what = engine.describe();
        sound(&run(&narrow, &settings, engine), &what);
        let halves = Settings { storage: Storage::F16, ..settings.clone() };
        let solution = run(&narrow, &halves, engine);
        assert_eq!(solution.stop, Stop::NotFinite { step: 1, kernel: Some(Kernel::ApplyFactor) }, "{what}");
        assert!(solution.phases.iter().all(|p| *p == 0.0), "{what}: the step was not taken");
    }
    assert_silent(device);
}

/// The same change turns phases again and again. They stay on the circle, at the values of float64.
#[test]
fn a_hundred_thousand_steps_of_drift() {
    let optics = Optics::new(4, 4, 8e-6, 520e-9, 0.4).unwrap();
    let planner = Planner::new(optics, 1, WindowFactor::Full);
    let mut device = vulkan();
    let lengths = if full() { [100_000, 100_000] } else { [100_000, 2_000] };
    for (engine, steps) in [&mut CpuEngine::new() as &mut dyn Engine, &mut device].into_iter().zip(lengths) {
        // With u = 1 everywhere and du = i, every phase turns by gain in each step. The test writes the change instead
        // of computing it.
        for adam in [false, true] {
            let purpose = if adam { Purpose::Adam } else { Purpose::Project };
            engine.load(&planner.shape(purpose), None).unwrap();
            let start: Vec<f32> = noise(16, 3).iter().map(|x| (x * PI) as f32).collect();
            engine.write(Buffer::Phases, &start).unwrap();
            let rate = 0.3712;
            let mut want: Vec<f64> = start.iter().map(|p| f64::from(*p)).collect();
            for t in 1..=steps {
                // The change turns along with the phases, so Im(conj(u) du) stays the same.
                let phases = engine.read(Buffer::Phases).unwrap();
                let change: Vec<f32> = phases.iter().flat_map(|p| [-p.sin(), p.cos()]).collect();
                engine.write(Buffer::Change, &change).unwrap();
                let step = if adam {
                    planner.adam_step(Vec::new(), usize::MAX, t, rate)
                } else {
                    planner.project_step(Vec::new(), usize::MAX, 1.0, rate, 0.0)
                };
                engine.run_part(&step, step.list.len() - 1..step.list.len()).unwrap();
                // A step of Adam has the size of the rate, against the sign of the gradient. A step of the projection
                // is gain times the change.
                let turn = if adam { -rate } else { rate };
                want.iter_mut().for_each(|p| *p = (*p + turn + PI).rem_euclid(TAU) - PI);
                // Adam's second moment takes 1/1000 of each new value. Half a unit in its last place, a thousand times,
                // is a part in 30000 of the step. These errors add up, so the test checks each step separately.
                if adam {
                    let now = engine.read(Buffer::Phases).unwrap();
                    for (now, before) in now.iter().zip(&phases) {
                        let off = f64::from(*now) - f64::from(*before) - turn;
                        let off = (off + PI).rem_euclid(TAU) - PI;
                        assert!(off.abs() < 1e-4 * rate, "step {t}: {off:e} radians off");
                    }
                }
            }
            let got = engine.read(Buffer::Phases).unwrap();
            // Each step has one rounding of half a unit in the last place of pi (1.2e-7 radians), and one in the sine.
            // In the worst case all have the same sign.
            let worst = steps as f64 * 2.4e-7;
            for (got, want) in got.iter().zip(&want) {
                assert!(got.abs() <= CIRCLE, "{got} is on the circle");
                let off = (f64::from(*got) - want + PI).rem_euclid(TAU) - PI;
                assert!(adam || off.abs() < worst, "{}: {off:e} radians off after {steps} steps", engine.describe());
            }
            if adam {
                let second = engine.read(Buffer::Second).unwrap();
                // The gradient is 2 Im(..) = 2, so its moments settle at 2 and 4.
                assert!(second.iter().all(|v| v.is_finite() && *v > 0.0), "{second:?}");
                let first = engine.read(Buffer::Momentum).unwrap();
                let ratio = f64::from(first[0]) / f64::from(second[0]).sqrt();
                assert!((ratio.abs() - 1.0).abs() < 1e-3 || steps < 10_000, "moments {} {}", first[0], second[0]);
            }
        }
    }
    assert_silent(device);
}

/// Errors for impossible values name the limit.
#[test]
fn limits_are_named() {
    for (height, width) in [(0, 5), (5, 0), (65537, 1)] {
        let error = Optics::new(height, width, 8e-6, 520e-9, 0.4).unwrap_err();
        assert!(matches!(error, OpticsError::Size { .. }) && error.to_string().contains("65536"), "{error}");
    }
    for frames in [0, 5000] {
        let error = Settings { frames, ..Settings::default() }.check().unwrap_err();
        assert!(matches!(&error, SolveError::Setting { value, .. } if *value == frames.to_string()), "{error}");
        assert!(error.to_string().contains("4096"), "{error}");
    }
    let wavelength = |nm: f64| Wavelength { color: Color::Green, wavelength: nm * 1e-9 };
    let display = Display { wavelengths: vec![wavelength(380.0)], ..Display::preset("small").unwrap() };
    assert!(display.optics(Color::Green).is_ok() && display.optics(Color::Red).is_err());
}
