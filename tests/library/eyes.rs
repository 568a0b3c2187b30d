//! Eyes with a prescription (OPTICS 11). The tests compare the kernel and its depth with float64, one correction with
//! all pupils, and a solve for an eye with a solve for a perfect eye.

use eyebox::low_level::engine::{Buffer, Engine, Kernel, cpu::CpuEngine};
use eyebox::low_level::evaluate;
use eyebox::low_level::optics::{
    Color, Display, Obstruction, Optics, OpticsError, Padding, Prescription, Pupil, PupilDistribution, WindowFactor,
};
use eyebox::low_level::plan::{Comparison, EyeTables, Planner, Purpose};
use eyebox::low_level::scene;
use eyebox::low_level::solve::{
    self, Flow, Problem, PupilRange, RefineSettings, Refiner, Sampler, Sequence, Settings, SolveError,
};
use eyebox_kernels::compare;
use eyebox_tests::gradient::{assert_derivative, gradient_of, intensity_loss, random_targets};
use eyebox_tests::{Oracle, error_power, fft2, loaded, phases, step_with_targets};
use rustfft::num_complex::Complex64;
use std::f64::consts::TAU;

fn optics(h: usize, w: usize) -> Optics {
    Optics::new(h, w, 8e-6, 520e-9, 0.4).unwrap()
}

fn measured(zernikes_um: &[(u32, f64)], measured_mm: f64) -> Prescription {
    let mut eye = Prescription::default();
    (eye.zernikes_um, eye.measured_mm) = (zernikes_um.iter().copied().collect(), measured_mm);
    eye
}

/// Returns an eye with every kind of error at once.
fn every_error() -> Prescription {
    let mut eye = Prescription::new(-0.4, 0.3, 35.0);
    eye.vertex_mm = 12.0;
    eye.zernikes_um = [(4, 0.1), (6, -0.07), (7, 0.2), (8, -0.1), (12, 0.15), (27, 0.02)].into();
    eye.measured_mm = 5.0;
    eye
}

/// Returns the signed bin of place `i` in a transform of length `n`.
fn bin(i: usize, n: usize) -> f64 {
    if i < n - n / 2 { i as f64 } else { i as f64 - n as f64 }
}

/// Returns K with the error of the eye, in float64.
fn kernel(oracle: &Oracle, eye: &Prescription, pupil: &Pupil) -> Vec<Complex64> {
    let (o, (bin_y, bin_x)) = (oracle.optics, oracle.optics.bin_size());
    let plain = oracle.kernel(pupil).into_iter().enumerate();
    plain
        .map(|(i, k)| {
            let (x, y) = (bin(i % o.width, o.width) * bin_x, bin(i / o.width, o.height) * bin_y);
            k * Complex64::cis(TAU * eye.turns(&o, pupil, x, y))
        })
        .collect()
}

fn view(oracle: &Oracle, eye: &Prescription, phases: &[f64], pupil: &Pupil) -> Vec<f64> {
    let (o, kernel) = (oracle.optics, kernel(oracle, eye, pupil));
    let share = o.share(pupil.diameter) * oracle.frames as f64;
    let mut seen = vec![0.0; o.height * o.width];
    for mut spectrum in oracle.spectra(phases) {
        spectrum.iter_mut().zip(&kernel).for_each(|(u, k)| *u *= k);
        fft2(&mut spectrum, o.height, o.width, true);
        seen.iter_mut().zip(spectrum).for_each(|(s, v)| *s += v.norm_sqr() / share);
    }
    seen
}

fn planner(optics: Optics, frames: usize, eye: &Prescription) -> Planner {
    Planner { eye: EyeTables::new(Some(eye)), ..Planner::new(optics, frames, WindowFactor::Full) }
}

/// Returns the image that this eye sees.
fn seen(optics: Optics, frames: usize, eye: &Prescription, phases: &[f32], pupil: Pupil) -> Vec<f32> {
    let planner = planner(optics, frames, eye);
    let mut engine = loaded(&planner, Purpose::View, phases);
    evaluate::views(&mut engine, &planner, &[pupil]).unwrap().remove(0)
}

#[test]
fn views_agree_with_float64() {
    for (h, w, frames) in [(30, 41, 3), (48, 32, 2), (7, 13, 1)] {
        let (exact, rounded) = phases(frames * h * w, 1);
        let oracle = Oracle { optics: optics(h, w), frames };
        for eye in [Prescription::new(-2.0, 0.0, 0.0), Prescription::new(1.5, -3.0, 20.0), every_error()] {
            for mm in [[1.0, -2.0, 6.0, 3.0], [-7.0, 4.0, 9.0, -15.0]] {
                let pupil = Pupil::from_mm(mm);
                let error = error_power(
                    &seen(oracle.optics, frames, &eye, &rounded, pupil),
                    &view(&oracle, &eye, &exact, &pupil),
                );
                assert!(error < 1e-12, "{eye} on {h}x{w} through {mm:?}: error power {error:.1e} of signal");
            }
        }
    }
}

/// Adam's first moment after one step is a tenth of the gradient. It is the derivative of the loss of this eye's view.
#[test]
fn the_gradient_is_the_derivative() {
    let (o, frames, eye) = (optics(20, 24), 2, every_error());
    let oracle = Oracle { optics: o, frames };
    let pupils = [Pupil::from_mm([3.0, -2.0, 9.0, 4.0]), Pupil::from_mm([-5.0, 1.0, 5.0, -1.0])];
    let (exact, rounded) = phases(frames * 480, 4);
    let targets = random_targets(2, 480);
    let planner = planner(o, frames, &eye);
    let comparison = Comparison { mode: compare::INTENSITY, exposure: 0.7, batch: 2, ..Comparison::default() };
    let mut engine = loaded(&planner, Purpose::Adam, &rounded);
    let pupil_passes = pupils.iter().map(|p| planner.pupil_pass(p, &comparison)).collect();
    step_with_targets(&planner, &mut engine, pupil_passes, &targets, true);
    let want = |phases: &[f64]| intensity_loss(&targets, 0.7, |i| view(&oracle, &eye, phases, &pupils[i]));
    assert_derivative(&gradient_of(&mut engine), &exact, 1, 2e-5, "every error of an eye", want);
}

/// A relaxed eye of S dioptres sees content sharp that a perfect eye sees sharp at z - f^2 S.
#[test]
fn a_sphere_is_a_depth() {
    let (o, (_, phases)) = (optics(96, 128), phases(2 * 96 * 128, 3));
    for (sphere, diameter) in [(-0.05, 6.0), (0.1, 4.0), (-0.1, 6.0)] {
        let pupil = Pupil::from_mm([0.0, 0.0, diameter, 1.0]);
        let through = seen(o, 2, &Prescription::new(sphere, 0.0, 0.0), &phases, pupil);
        let depth = pupil.depth - 0.16 * sphere;
        let near = seen(o, 2, &Prescription::default(), &phases, Pupil { depth, ..pupil });
        let near: Vec<f64> = near.iter().map(|v| f64::from(*v)).collect();
        let error = error_power(&through, &near);
        assert!(error < 1e-6, "{sphere} D through {diameter} mm: error power {error:.1e}");
    }
}

/// A point with one correction is a point through every pupil of that eye, displaced by Prentice's rule. The target
/// image has the same displacement.
#[test]
fn one_correction_serves_every_pupil() {
    let (h, w) = (96, 128);
    let (o, eye) = (optics(h, w), Prescription::new(-0.06, 0.04, 30.0));
    let oracle = Oracle { optics: o, frames: 1 };
    let perfect = Prescription::default();
    let middle = Pupil { x: 0.0, y: 0.0, diameter: 1.0, depth: 0.0 };
    let corrected: Vec<Complex64> = kernel(&oracle, &eye, &middle).iter().map(Complex64::conj).collect();
    let spot = |eye: &Prescription, pupil: &Pupil, spectrum: Option<&[Complex64]>| {
        // The engine computes this kernel.
        let planner = planner(o, 1, eye);
        let step = planner.view_step(vec![planner.pupil_pass(pupil, &Comparison::default())]);
        let mut engine = loaded(&planner, Purpose::View, &vec![0.0; h * w]);
        engine.run(&step).unwrap();
        let transfer = engine.read(Buffer::Transfer(0)).unwrap();
        let (y0, x0) = (step.pupil_passes[0].pass.y0 as usize, step.pupil_passes[0].pass.x0 as usize);
        let mut field = vec![Complex64::default(); h * w];
        for (i, k) in transfer.chunks_exact(2).enumerate() {
            let at = (y0 + i / w) % h * w + (x0 + i % w) % w;
            let one = spectrum.map_or(Complex64::from(1.0), |s| s[at]);
            field[at] = Complex64::new(f64::from(k[0]), f64::from(k[1])) * one;
        }
        fft2(&mut field, h, w, true);
        field.iter().map(|z| z.norm()).enumerate().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap()
    };
    for mm in [[4.0, -3.0, 5.0, 0.0], [-5.0, 2.0, 5.0, 0.0]] {
        let pupil = Pupil::from_mm(mm);
        let (at, peak) = spot(&eye, &pupil, Some(&corrected));
        let moved = [bin(at % w, w), bin(at / w, h)];
        let expected = eye.displacement([pupil.x, pupil.y], o.focal_length).map(|metres| metres / o.pitch);
        assert!(moved.iter().zip(expected).all(|(m, e)| (m - e).abs() <= 0.51), "{moved:?}, not {expected:?}");
        assert!(expected.iter().all(|e| e.abs() > 0.9), "{expected:?} tests nothing");
        let best = spot(&perfect, &pupil, None).1;
        assert!(peak > 0.85 * best, "{peak:.3} of {best:.3}");
    }
}

/// The target image of this eye is the image of the scene, displaced by the same rule.
#[test]
fn the_target_is_displaced_by_prentices_rule() {
    let display = Display { height: 48, width: 64, ..Display::preset("small").unwrap() };
    let field = scene::load("builtin:plane", &scene::Request::new(&display, &[Color::Green])).unwrap();
    let photograph = |eye: Option<Prescription>, pupil: Pupil| {
        let display = Display { prescription: eye, ..display.clone() };
        let problem = Problem::new(&field, Color::Green, &display, Padding::default()).unwrap();
        let planner = problem.planner(1, WindowFactor::Full);
        let mut engine = CpuEngine::new();
        engine.load(&planner.shape(Purpose::View), Some(problem.pyramid.clone())).unwrap();
        evaluate::photographs(&mut engine, &planner, &[pupil]).unwrap().remove(0)
    };
    // f Q s is 3 pixels to the left and 5 down.
    let (x, y, eye) = (3e-3, -4e-3, Prescription::new(-0.02, -0.005, 0.0));
    let pupil = Pupil { x, y, diameter: 4e-3, depth: 0.0 };
    let pixels = eye.displacement([x, y], 0.4).map(|m| m / display.pitch);
    assert!((pixels[0] + 3.0).abs() < 1e-9 && (pixels[1] - 5.0).abs() < 1e-9, "{pixels:?}");
    let (plain, moved) = (photograph(None, pupil), photograph(Some(eye), pupil));
    for (i, value) in moved.iter().enumerate() {
        let (row, column) = ((i / 64 + 48 - 5) % 48, (i % 64 + 3) % 64);
        assert!((value - plain[row * 64 + column]).abs() < 1e-5, "at {i}");
    }
    assert!(plain.iter().zip(&moved).any(|(a, b)| (a - b).abs() > 0.05));
}

/// Sphere, cylinder and axis show the same picture as the equivalent coefficients of an aberrometer. If the axis is 0,
/// all of the cylinder acts up and down.
#[test]
fn a_prescription_and_its_coefficients_are_the_same() {
    let (s, c, axis, r) = (-0.6f64, -0.5, 25f64.to_radians(), 3e-3f64);
    let um = 1e6 * r * r;
    let coefficients = [
        (4, -(s + c / 2.0) * um / (4.0 * 3f64.sqrt())),
        (5, c * (2.0 * axis).cos() * um / (4.0 * 6f64.sqrt())),
        (3, c * (2.0 * axis).sin() * um / (4.0 * 6f64.sqrt())),
    ];
    let (written, found) = (Prescription::new(s, c, 25.0), measured(&coefficients, 6.0));
    let (o, (_, phases)) = (optics(48, 64), phases(48 * 64, 5));
    let pupil = Pupil::from_mm([2.0, 1.0, 5.0, 0.0]);
    let [a, b] = [&written, &found].map(|eye| seen(o, 1, eye, &phases, pupil));
    let b: Vec<f64> = b.iter().map(|v| f64::from(*v)).collect();
    assert!(error_power(&a, &b) < 1e-12);
    for (one, other) in written.power().as_flattened().iter().zip(found.power().as_flattened()) {
        assert!((one - other).abs() < 1e-12, "{one} {other}");
    }
    let across = Prescription::new(0.0, 1.0, 0.0);
    let centred = Pupil::from_mm([0.0, 0.0, 4.0, 0.0]);
    assert_eq!(across.turns(&o, &centred, 1e-3, 0.0), 0.0);
    assert!(across.turns(&o, &centred, 0.0, 1e-3) > 0.5);
}

/// A perfect eye does not change the list of kernels, and an eye with errors adds one kernel.
#[test]
fn a_perfect_eye_costs_nothing() {
    let names = |eye: Prescription| {
        let planner = Planner { factor: WindowFactor::One, ..planner(optics(32, 32), 2, &eye) };
        let pass = planner.pupil_pass(&Pupil::from_mm([0.0, 0.0, 5.0, 0.0]), &Comparison::default());
        let step = planner.project_step(vec![pass], usize::MAX, 1.0, 1.0, 0.0);
        step.list.iter().map(|d| d.kernel).collect::<Vec<_>>()
    };
    let (plain, with) = (names(Prescription::default()), names(Prescription::new(-0.1, 0.0, 0.0)));
    assert!(!plain.contains(&Kernel::Eye) && with.contains(&Kernel::Eye) && with.len() == plain.len() + 1);
}

const SIDE: usize = 96;

/// Returns the problem of a scene for an eye.
fn problem_of(eye: Option<Prescription>) -> Problem {
    let display = Display { height: SIDE, width: SIDE, prescription: eye, ..Display::preset("small").unwrap() };
    let field = scene::load("builtin:still-life", &scene::Request::new(&display, &[Color::Green])).unwrap();
    Problem::new(&field, Color::Green, &display, Padding::default()).unwrap()
}

fn solved(problem: &Problem) -> solve::Solution {
    let settings = Settings { steps: 15, frames: 4, diameter: [2e-3, 8e-3], depth: [0.0, 1e-3], ..Settings::default() };
    solve::solve(problem, &settings, &mut CpuEngine::new(), &mut |_| Flow::Continue).unwrap()
}

/// Returns the mean PSNR through these pupils against the target images of the problem's eye. One exposure fits all
/// pupils.
fn decibels(problem: &Problem, phases: &[f32], pupils: &[Pupil]) -> f64 {
    let planner = problem.planner(4, WindowFactor::Full);
    let mut engine = CpuEngine::new();
    engine.load(&planner.shape(Purpose::View), Some(problem.pyramid.clone())).unwrap();
    engine.write(Buffer::Phases, phases).unwrap();
    let seen = evaluate::views(&mut engine, &planner, pupils).unwrap();
    let wanted = evaluate::photographs(&mut engine, &planner, pupils).unwrap();
    let pairs = || seen.iter().zip(&wanted).map(|(s, w)| (&s[..], &w[..]));
    let exposure = evaluate::fit_exposure(pairs()).unwrap() as f32;
    let one = |(seen, wanted): (&[f32], &[f32])| {
        evaluate::psnr(&seen.iter().map(|v| v * exposure).collect::<Vec<_>>(), wanted).unwrap()
    };
    pairs().map(one).sum::<f64>() / pupils.len() as f64
}

/// A hologram for an eye of -0.1 D is as good for that eye as a perfect eye's hologram is for a perfect eye. It is much
/// better for that eye than the perfect eye's hologram. This holds over the whole eyebox, and for a pupil that moves.
#[test]
fn a_hologram_for_an_eye_is_as_good_for_it() {
    let (perfect, short) = (problem_of(None), problem_of(Some(Prescription::new(-0.1, 0.0, 0.0))));
    let (plain, aware) = (solved(&perfect), solved(&short));
    let mut range = PupilRange::over(perfect.eyebox, [0.0, 1e-3]);
    range.diameter = [2e-3, 8e-3];
    let mut sampler = Sampler::new(range, Sequence::Sobol, 77);
    let pupils: Vec<Pupil> = (0..16).map(|_| sampler.draw()).collect();
    let best = decibels(&perfect, &plain.phases, &pupils);
    let (unaware, kept) = (decibels(&short, &plain.phases, &pupils), decibels(&short, &aware.phases, &pupils));
    eprintln!("perfect eye {best:.2} dB; -0.1 D uncorrected {unaware:.2}, corrected {kept:.2}");
    assert!(kept > best - 0.5 && unaware < kept - 2.0, "{best:.2}, {unaware:.2}, {kept:.2}");

    let steering = RefineSettings { repeats: 2, ..RefineSettings::default() };
    let follow = |problem: &Problem, solution: &solve::Solution| {
        let engine = Box::new(CpuEngine::new());
        let mut refiner = Refiner::new(problem.clone(), &solution.phases, solution.exposure, steering, engine).unwrap();
        let mut seen = 0.0;
        for mm in [[-4.0, 2.0], [-3.0, 2.5], [5.0, -3.0]] {
            let pupil = Pupil::from_mm([mm[0], mm[1], 4.0, 0.0]);
            refiner.aim(PupilDistribution::around(&pupil, 0.25e-3)).unwrap();
            (0..4).for_each(|_| assert!(refiner.step().unwrap().is_finite()));
            seen += decibels(problem, &refiner.phases().unwrap(), &[pupil]) / 3.0;
        }
        seen
    };
    let (best, kept) = (follow(&perfect, &plain), follow(&short, &aware));
    eprintln!("while the eye moves: perfect {best:.2} dB, -0.1 D {kept:.2}");
    assert!(kept > best - 0.5, "while the eye moves: {best:.2} and {kept:.2} dB");
}

/// A blur over more than half of the picture is an error that names the widest possible pupil. A method without support
/// for eyes is an error as well.
#[test]
fn what_cannot_be_served_is_refused() {
    let problem = problem_of(Some(Prescription::new(-1.0, 0.0, 0.0)));
    let settings = Settings { steps: 1, diameter: [2e-3, 8e-3], ..Settings::default() };
    let refusal = |settings: &Settings, problem: &Problem| {
        solve::solve(problem, settings, &mut CpuEngine::new(), &mut |_| Flow::Continue).unwrap_err()
    };
    // f |S| d is 3.2 mm. Half of 96 pixels is 0.384 mm, which allows a pupil of 0.96 mm.
    let blur = refusal(&settings, &problem);
    assert!(matches!(blur, SolveError::Optics(OpticsError::Blur { .. })), "{blur}");
    assert!(["3.20 mm", "0.38 mm", "0.96 mm"].iter().all(|mm| blur.to_string().contains(mm)), "{blur}");
    let mild = problem_of(Some(Prescription::new(-0.05, 0.0, 0.0)));
    for method in [solve::Method::Stft, solve::Method::Dpac] {
        let blind = refusal(&Settings { method, ..settings.clone() }, &mild);
        assert!(matches!(&blind, SolveError::Setting { value, .. } if value == method.name()), "{blind}");
    }
}

/// An opacity removes its disc from the disc of the pupil, wherever the pupil is. The remaining light counts as all
/// light.
#[test]
fn an_opacity_is_seen_as_in_float64() {
    let (frames, pupil) = (2, Pupil::from_mm([2.0, -1.0, 4.0, 3.0]));
    let o = optics(96, 80);
    let (exact, rounded) = phases(frames * 96 * 80, 3);
    let oracle = Oracle { optics: o, frames };
    let (bin_y, bin_x) = o.bin_size();
    let width = 0.5 * (bin_y + bin_x);
    let amplitude = |i: usize| {
        let (x, y) = (bin(i % o.width, o.width) * bin_x, bin(i / o.width, o.height) * bin_y);
        let covered = (0.5e-3 - (x - pupil.x).hypot(y - pupil.y)) / width + 0.5;
        1.0 - covered.clamp(0.0, 1.0)
    };
    let mut kernel = oracle.kernel(&pupil);
    let clear = kernel.iter().filter(|k| k.norm_sqr() > 0.0).count() as f64;
    kernel.iter_mut().enumerate().for_each(|(i, k)| *k *= amplitude(i));
    let light = kernel.iter().map(Complex64::norm_sqr).sum::<f64>();
    assert!(light < 0.96 * clear, "the opacity takes light");
    let share = o.share(pupil.diameter) * frames as f64 * light / clear;
    let mut want = vec![0.0; o.height * o.width];
    for mut spectrum in oracle.spectra(&exact) {
        spectrum.iter_mut().zip(&kernel).for_each(|(u, k)| *u *= k);
        fft2(&mut spectrum, o.height, o.width, true);
        want.iter_mut().zip(spectrum).for_each(|(s, v)| *s += v.norm_sqr() / share);
    }
    let planner = Planner::new(o, frames, WindowFactor::Full).obstructed(Obstruction::Opacity, &pupil);
    let mut engine = loaded(&planner, Purpose::View, &rounded);
    let seen = evaluate::views(&mut engine, &planner, &[pupil]).unwrap().remove(0);
    let error = error_power(&seen, &want);
    assert!(error < 1e-12, "error power {error:.1e} of signal");
}
