//! Methods other than random pupils, against float64 and against their definitions.

use eyebox::low_level::engine::{Buffer, Engine, Kernel, cpu::CpuEngine};
use eyebox::low_level::evaluate;
use eyebox::low_level::optics::{Color, Display, Optics, Padding, Pupil, WindowFactor};
use eyebox::low_level::plan::{Comparison, Planner, Purpose, ViewLayout, Viewpoint};
use eyebox::low_level::scene::{self, Pyramid, Request, ViewGrid};
use eyebox::low_level::solve::{self, Flow, Method, Optimizer, Problem, Settings};
use eyebox_kernels::compare::INTENSITY;
use eyebox_tests::both::{assert_silent, vulkan};
use eyebox_tests::gradient::{assert_derivative, gradient_of};
use eyebox_tests::{Oracle, error_power, noise, phases};
use rustfft::num_complex::Complex64;
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// float32 rounds to 6e-8, and a view has a few dozen roundings in a row.
const VIEW: f64 = 1e-12;

/// Computes the definition (Choi et al. 2022), a sum over the pixels of the window, without any transform.
fn stft(phases: &[f64], [height, width]: [usize; 2], samples: usize, [ny, nx]: [f64; 2]) -> Vec<f64> {
    let hann = |j: usize| (PI * (j + 1) as f64 / (samples + 1) as f64).sin().powi(2);
    let sum: f64 = (0..samples).map(hann).sum();
    let half = (samples as i64 - 1) / 2;
    let at = |y: usize, x: usize| {
        let mut total = Complex64::default();
        for j in 0..samples {
            for i in 0..samples {
                let (dy, dx) = (j as i64 - half, i as i64 - half);
                let row = (y as i64 + dy).rem_euclid(height as i64) as usize;
                let column = (x as i64 + dx).rem_euclid(width as i64) as usize;
                let turn = -TAU * (ny * dy as f64 + nx * dx as f64);
                total += hann(j) * hann(i) * Complex64::from_polar(1.0, phases[row * width + column] + turn);
            }
        }
        (total / (sum * sum)).norm_sqr()
    };
    (0..height * width).map(|i| at(i / width, i % width)).collect()
}

#[test]
fn the_stft_is_its_definition() {
    let o = Optics::new(45, 60, 8e-6, 520e-9, 0.4).unwrap();
    let (rows, columns, samples) = (3, 5, 5);
    let grid = ViewGrid { rows, columns, cell: o.eyebox() / 5.0 };
    let views: Vec<Vec<f32>> = (0..15).map(|_| vec![0.5; 45 * 60]).collect();
    let pyramid = Arc::new(Pyramid::new(&views, 45, 60));
    let mut planner = Planner::new(o, 2, WindowFactor::One);
    planner.views = Some(ViewLayout::new(grid, &pyramid));
    let (exact, rounded) = phases(2 * 45 * 60, 4);
    let mut engine = CpuEngine::new();
    engine.load(&planner.shape(Purpose::View), Some(pyramid)).unwrap();
    engine.write(Buffer::Phases, &rounded).unwrap();
    // An even field transmits the power of the windows, sum w^2 / (sum w)^2 on each axis.
    let axis = 1.5 / (samples as f64 + 1.0);
    for view in [0, 4, 7, 13] {
        let viewpoint = Viewpoint::Stft { view, samples, filter: f64::INFINITY };
        let seen = evaluate::images(&mut engine, &planner, &[viewpoint]).unwrap().remove(0);
        let (x, y) = grid.position(view);
        let turns = [y / o.eyebox(), x / o.eyebox()];
        let frames: Vec<_> = exact.chunks_exact(45 * 60).map(|f| stft(f, [45, 60], samples, turns)).collect();
        let want: Vec<f64> = (0..45 * 60).map(|i| (frames[0][i] + frames[1][i]) / (2.0 * axis * axis)).collect();
        let error = error_power(&seen, &want);
        assert!(error < VIEW, "view {view}: error power {error:.1e} of signal");
        // The target is the view itself.
        let target = evaluate::targets(&mut engine, &planner, &[viewpoint]).unwrap().remove(0);
        assert!(target.iter().all(|t| (t - 0.5).abs() < 1e-4));
    }
    // The filter blocks light outside its area only.
    let filtered = Viewpoint::Stft { view: 0, samples, filter: 0.5 * o.eyebox() };
    let open = Viewpoint::Stft { view: 0, samples, filter: f64::INFINITY };
    let seen = evaluate::images(&mut engine, &planner, &[filtered, open]).unwrap();
    assert!(seen[0].iter().sum::<f32>() < 0.2 * seen[1].iter().sum::<f32>());
}

/// Returns the term of which the kernel `equalise_eyebox` is the derivative, from the energies of the patches in
/// float64.
fn unevenness(o: Optics, phases: &[f64], frames: usize, eyebox: f64, patches: usize) -> f64 {
    let (h, w) = (o.height as i64, o.width as i64);
    let (bin_y, bin_x) = o.bin_size();
    let rows = ((eyebox / bin_y).round() as i64).min(h);
    let columns = ((eyebox / bin_x).round() as i64).min(w);
    let spectra = Oracle { optics: o, frames }.spectra(phases);
    let n = patches as i64;
    let mut energies = Vec::new();
    for a in 0..n {
        for b in 0..n {
            let off = |p: i64| (p as f64 + 0.5) / n as f64 - 0.5;
            if off(a).hypot(off(b)) > 0.5 + 1e-9 {
                continue;
            }
            let mut sum = 0.0;
            for spectrum in &spectra {
                for j in a * rows / n..(a + 1) * rows / n {
                    for k in b * columns / n..(b + 1) * columns / n {
                        let (y, x) = ((j - rows / 2).rem_euclid(h), (k - columns / 2).rem_euclid(w));
                        sum += spectrum[(y * w + x) as usize].norm_sqr();
                    }
                }
            }
            energies.push(sum);
        }
    }
    let mean = energies.iter().sum::<f64>() / energies.len() as f64;
    energies.iter().map(|e| (e / mean - 1.0).powi(2)).sum::<f64>() / energies.len() as f64
}

/// Adam's first moment after one step without pupils is a tenth of the gradient of the term.
#[test]
fn the_evenness_term_is_a_derivative() {
    let o = Optics::new(36, 40, 8e-6, 520e-9, 0.4).unwrap();
    let (frames, eyebox, patches, weight) = (2, 0.021, 5, 0.7);
    let (exact, rounded) = phases(frames * 36 * 40, 8);
    let planner = Planner::new(o, frames, WindowFactor::Full);
    let mut engine = CpuEngine::new();
    engine.load(&planner.shape(Purpose::Adam), None).unwrap();
    engine.write(Buffer::Phases, &rounded).unwrap();
    let step =
        planner.with_equalised_eyebox(planner.adam_step(Vec::new(), usize::MAX, 1, 0.0), eyebox, patches, weight);
    engine.run(&step).unwrap();
    let want = |phases: &[f64]| weight * unevenness(o, phases, frames, eyebox, patches);
    assert_derivative(&gradient_of(&mut engine), &exact, 3, 1e-4, "the evenness term", want);
}

#[test]
fn the_projection_evens_the_eyebox_out() {
    let o = Optics::new(60, 60, 8e-6, 520e-9, 0.4).unwrap();
    let planner = Planner::new(o, 1, WindowFactor::Full);
    // With smooth phases nearly all light goes through the middle.
    let smooth: Vec<f32> = noise(3600, 3).iter().map(|x| 0.5 * *x as f32).collect();
    let before = unevenness(o, &smooth.iter().map(|p| f64::from(*p)).collect::<Vec<_>>(), 1, 0.02, 7);
    let mut engine = CpuEngine::new();
    engine.load(&planner.shape(Purpose::Project), None).unwrap();
    engine.write(Buffer::Phases, &smooth).unwrap();
    for _ in 0..40 {
        let step = planner.project_step(Vec::new(), usize::MAX, 1.0, 1.0, 0.0);
        engine.run(&planner.with_equalised_eyebox(step, 0.02, 7, 1.0)).unwrap();
    }
    let after: Vec<f64> = engine.read(Buffer::Phases).unwrap().iter().map(|p| f64::from(*p)).collect();
    let after = unevenness(o, &after, 1, 0.02, 7);
    assert!(before > 1.0 && after < 0.01 * before, "{before} became {after}");
}

fn problem(size: usize) -> Problem {
    let display = Display { height: size, width: size, ..Display::preset("small").unwrap() };
    let colors = [Color::Blue];
    let field = scene::load("builtin:still-life", &Request::new(&display, &colors)).unwrap();
    Problem::new(&field, Color::Blue, &display, Padding::default()).unwrap()
}

/// Each method gives a hologram of good quality, on both engines alike.
#[test]
fn every_method_solves_on_both_engines() {
    let problem = problem(64);
    let mut device = vulkan();
    for method in Method::ALL {
        let settings = Settings { method, frames: 2, steps: 6, pupils: 4, depth: [-4e-4, 4e-4], ..Settings::default() };
        let solve = |engine: &mut dyn Engine| {
            solve::solve(&problem, &settings, engine, &mut |_| Flow::Continue).unwrap_or_else(|e| panic!("{e}"))
        };
        let (got, want) = (solve(&mut device), solve(&mut CpuEngine::new()));
        assert_eq!(want.phases.len(), 2 * 64 * 64, "{}", method.name());
        assert!(want.phases.iter().all(|p| p.is_finite()));
        // Rounding errors grow from step to step, but both engines end at holograms of the same quality.
        let apart = (got.validation.mean() - want.validation.mean()).abs();
        assert!(apart < 0.05, "{}: {} and {} dB", method.name(), got.validation.mean(), want.validation.mean());
        assert!(want.validation.mean() > 15.0, "{}: {} dB", method.name(), want.validation.mean());
    }
    assert_silent(device);
}

#[test]
fn each_method_is_best_at_its_own() {
    let problem = problem(128);
    let eyebox = problem.eyebox;
    let mut engine = CpuEngine::new();
    let depths = [-6e-4, 0.0, 6e-4];
    let mut score = |method: Method, pupils: &[Pupil]| {
        let settings = Settings { method, frames: 4, steps: 40, depth: [-6e-4, 6e-4], ..Settings::default() };
        let solution = solve::solve(&problem, &settings, &mut engine, &mut |_| Flow::Continue).unwrap();
        let planner = problem.planner(4, WindowFactor::Full);
        engine.load(&planner.shape(Purpose::View), Some(Arc::clone(&problem.pyramid))).unwrap();
        engine.write(Buffer::Phases, &solution.phases).unwrap();
        let viewpoints = pupils.iter().map(|p| Viewpoint::Pupil(*p)).collect();
        solve::Validator::new(&mut engine, &planner, viewpoints).unwrap().score(&mut engine, &planner).unwrap()
    };
    let stack: Vec<Pupil> = depths.iter().map(|&depth| Pupil { x: 0.0, y: 0.0, diameter: eyebox, depth }).collect();
    let sides = [(0.3, 0.0), (-0.3, 0.1), (0.0, -0.3), (0.2, 0.25)];
    let sides = sides.map(|(x, y)| Pupil { x: x * eyebox, y: y * eyebox, diameter: eyebox / 4.0, depth: 0.0 });
    // LF2FS optimizes the focal stack through the whole eyebox, SLFH the views of random pupils.
    let (slfh, lf2fs) = (score(Method::Slfh, &stack).mean(), score(Method::Lf2fs, &stack).mean());
    assert!(lf2fs > slfh + 1.0, "focal stack: LF2FS {lf2fs}, SLFH {slfh}");
    let (slfh, lf2fs) = (score(Method::Slfh, &sides).mean(), score(Method::Lf2fs, &sides).mean());
    assert!(slfh > lf2fs + 1.0, "from the side: SLFH {slfh}, LF2FS {lf2fs}");
    // Without its filter, the light of all views together is the same at each pixel of the SLM. There is then no
    // picture.
    let views: Vec<Pupil> = [(0.0, 0.0), (0.2, 0.0), (0.0, 0.2)]
        .map(|(x, y)| Pupil { x: x * eyebox, y: y * eyebox, diameter: eyebox / 3.0, depth: 0.0 })
        .to_vec();
    let (stft, open) = (score(Method::Stft, &views).mean(), score(Method::StftUnfiltered, &views).mean());
    assert!(stft > open + 5.0, "STFT {stft}, without its filter {open}");
    // Smooth phase is good in the middle, and has almost no light at the side.
    for method in [Method::Smooth, Method::Dpac] {
        let both: Vec<Pupil> = stack[1..2].iter().chain(&sides).copied().collect();
        let all = score(method, &both).psnr;
        let side = all[1..].iter().copied().fold(f64::NEG_INFINITY, f64::max);
        assert!(all[0] > 25.0 && all[0] > side + 10.0, "{}: {all:?}", method.name());
    }
}

/// The double phase of a field with known values. Two neighbors form each value.
#[test]
fn double_phase_shows_the_central_view() {
    let problem = problem(96);
    let settings = Settings {
        method: Method::Dpac,
        frames: 2,
        depth: [-6e-4, 6e-4],
        optimizer: Optimizer::adam(),
        ..Settings::default()
    };
    let mut engine = CpuEngine::new();
    let solution = solve::solve(&problem, &settings, &mut engine, &mut |_| Flow::Continue).unwrap();
    // The second sub-frame has the other half of the checkerboard. The two add up to the same value, pixel by pixel.
    let (first, second) = solution.phases.split_at(96 * 96);
    let sum =
        |i: usize| Complex64::from_polar(0.5, f64::from(first[i])) + Complex64::from_polar(0.5, f64::from(second[i]));
    let bright = (0..96 * 96).map(|i| sum(i).norm()).fold(0.0, f64::max);
    assert!((bright - 1.0).abs() < 1e-3, "the brightest value takes all of the amplitude: {bright}");
    assert!(solution.validation.mean() > 28.0, "{:?}", solution.validation.psnr);
}

/// A solve for the levels of an SLM is better than the same hologram rounded to them. The gain is larger if there are
/// fewer levels.
#[test]
fn levels_are_optimised_for() {
    let problem = problem(96);
    let mut device = vulkan();
    for optimizer in [Optimizer::projection(), Optimizer::adam()] {
        let steps = if matches!(optimizer, Optimizer::Adam { .. }) { 80 } else { 40 };
        let base = Settings { optimizer, steps, frames: 4, pupils: 8, depth: [-4e-4, 4e-4], ..Settings::default() };
        let mut engine = CpuEngine::new();
        let free = solve::solve(&problem, &base, &mut engine, &mut |_| Flow::Continue).unwrap();
        // Adam's straight-through steps gain nothing, but must not lose anything.
        let gains = if matches!(optimizer, Optimizer::Adam { .. }) { [-0.15; 3] } else { [0.1, 0.1, -0.05] };
        for (n, gain) in [2, 4, 256].into_iter().zip(gains) {
            let levels = solve::even_levels(n);
            let settings = Settings { levels: solve::Levels::Given(levels.clone()), ..base.clone() };
            let solved = solve::solve(&problem, &settings, &mut engine, &mut |_| Flow::Continue).unwrap();
            let nearest = |p: f32| {
                let off = |l: &f64| (f64::from(p) - l + PI).rem_euclid(TAU) - PI;
                levels.iter().copied().min_by(|a, b| off(a).abs().total_cmp(&off(b).abs())).unwrap() as f32
            };
            let turn = |p: f32, l: f32| (p - l + 3.0 * PI as f32).rem_euclid(TAU as f32) - PI as f32;
            let far = solved.phases.iter().map(|p| turn(*p, nearest(*p)).abs()).fold(0.0, f32::max);
            assert!(far < 1e-5, "{n} levels: a phase {far} off any");
            // The same hologram, rounded after the solve and scored on the same pupils.
            let rounded: Vec<f32> = free.phases.iter().map(|p| nearest(*p)).collect();
            let shown = score(&problem, &base, &rounded, &mut engine);
            let mean = score(&problem, &base, &solved.phases, &mut engine);
            assert!(mean > shown + gain, "{n} levels, {optimizer:?}: {mean} dB solved for, {shown} dB rounded");
            if n == 4 {
                let other = solve::solve(&problem, &settings, &mut device, &mut |_| Flow::Continue).unwrap();
                let other = score(&problem, &base, &other.phases, &mut engine);
                assert!((other - mean).abs() < 0.3, "{other} dB on Vulkan, {mean} on the CPU");
            }
        }
    }
    assert_silent(device);
}

/// Returns the mean PSNR through a fixed set of pupils.
fn score(problem: &Problem, settings: &Settings, phases: &[f32], engine: &mut dyn Engine) -> f64 {
    let planner = problem.planner(settings.frames, WindowFactor::Full);
    engine.load(&planner.shape(Purpose::View), Some(Arc::clone(&problem.pyramid))).unwrap();
    engine.write(Buffer::Phases, phases).unwrap();
    let e = problem.eyebox;
    let places = [(0.0, 0.0, 0.5), (0.3, 0.1, 0.2), (-0.2, 0.3, 0.3), (0.1, -0.3, 0.2)];
    let viewpoints =
        places.map(|(x, y, d)| Viewpoint::Pupil(Pupil { x: x * e, y: y * e, diameter: d * e, depth: 1e-4 }));
    solve::Validator::new(engine, &planner, viewpoints.to_vec()).unwrap().score(engine, &planner).unwrap().mean()
}

/// The list of a method has its kernels at the right places.
#[test]
fn the_lists_of_methods() {
    let o = Optics::new(32, 32, 8e-6, 520e-9, 0.4).unwrap();
    let planner = Planner::new(o, 1, WindowFactor::One);
    let comparison = Comparison { mode: INTENSITY, ..Comparison::default() };
    let pupil_pass = planner.viewpoint(&Viewpoint::Stft { view: 0, samples: 5, filter: 0.02 }, &comparison);
    let step =
        planner.with_equalised_eyebox(planner.project_step(vec![pupil_pass], usize::MAX, 0.5, 1.0, 0.0), 0.02, 9, 0.5);
    let names: Vec<_> = step.list.iter().map(|d| d.kernel.name()).collect();
    let want = "modulate field_forward energy clear transfer taper photograph resample pass_pupil window_inverse intensity compare apply_factor window_forward pupil_adjoint equalise_eyebox change_inverse project";
    assert_eq!(names.join(" "), want);
    assert_eq!(Kernel::by_name("equalise_eyebox"), Some(Kernel::EqualiseEyebox));
    assert_eq!(Kernel::by_name("even"), Some(Kernel::EqualiseEyebox), "its former name");
    for (before, kernel) in [
        ("drive_back", Kernel::DriveAdjoint),
        ("lag_back", Kernel::LagAdjoint),
        ("return_pupil", Kernel::PupilAdjoint),
        ("turn", Kernel::PhaseGradient),
        ("turn_mask", Kernel::PhaseGradientMask),
        ("turn_subpixels", Kernel::PhaseGradientSubpixels),
    ] {
        assert_eq!(Kernel::by_name(before), Some(kernel));
    }
}
