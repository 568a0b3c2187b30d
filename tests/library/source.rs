//! Light with a source (OPTICS 12). The tests compare modes and their gradient with float64, and one centered mode with
//! a display without a source.

use super::model::{RADIUS, optics};
use eyebox::low_level::engine::{Buffer, Engine, Memory};
use eyebox::low_level::evaluate;
use eyebox::low_level::optics::{
    Color, Display, DisplayModel, Iris, Optics, Padding, Prescription, Pupil, SourceKind, SourceMode, SourceShape,
    WindowFactor,
};
use eyebox::low_level::plan::{Comparison, EyeTables, ModelTables, Planner, Purpose, Viewpoint};
use eyebox::low_level::scene;
use eyebox::low_level::solve::{self, Flow, Optimizer, Problem, Settings};
use eyebox_kernels::compare;
use eyebox_tests::gradient::{assert_derivative, gradient_of, intensity_loss, random_targets};
use eyebox_tests::{Oracle, error_power, fft2, loaded, noise, phases, step_with_targets};
use rustfft::num_complex::Complex64;
use std::f64::consts::TAU;

/// Returns modes off the axis and off the wavelength, with unequal weights. No angle is a whole number of bins.
fn three() -> Vec<SourceMode> {
    let mode = |angle, nm: f64, weight| SourceMode { angle, weight, ..SourceMode::centred(nm * 1e-9) };
    vec![mode([1.3e-3, -2.1e-3], 520.0, 0.5), mode([-2.7e-3, 0.4e-3], 523.1, 0.3), mode([0.2e-3, 3.3e-3], 516.2, 0.2)]
}

/// Returns a display model and an eye that act on the light at its place of arrival.
fn bench() -> (DisplayModel, Prescription) {
    let model = DisplayModel {
        fill: 0.9,
        wavefront: [(4, 0.2), (7, -0.1), (12, 0.05)].into(),
        iris: Iris { x: 0.2e-3, y: -0.1e-3, scale: 1.02 },
        ..DisplayModel::default()
    };
    let mut eye = Prescription::new(-0.4, 0.3, 35.0);
    (eye.zernikes_um, eye.measured_mm) = ([(7, 0.2), (12, 0.1)].into(), 5.0);
    (model, eye)
}

/// The equations in float64.
struct Lit<'a> {
    oracle: Oracle,
    modes: &'a [SourceMode],
    bench: Option<(DisplayModel, Prescription)>,
}

impl Lit<'_> {
    fn view(&self, phases: &[f64], asked: &Pupil) -> Vec<f64> {
        let o = self.oracle.optics;
        let (h, w) = (o.height, o.width);
        let iris = self.bench.as_ref().map_or(*asked, |(model, _)| model.true_pupil(asked));
        let share = o.share(iris.diameter) * self.oracle.frames as f64;
        let spectra = self.oracle.spectra(phases);
        let mut seen = vec![0.0; h * w];
        for mode in self.modes {
            let kernel: Vec<Complex64> = (0..h * w).map(|i| self.kernel(mode, &iris, i)).collect();
            for spectrum in &spectra {
                let mut field: Vec<Complex64> = spectrum.iter().zip(&kernel).map(|(u, k)| u * k).collect();
                fft2(&mut field, h, w, true);
                seen.iter_mut().zip(field).for_each(|(s, v)| *s += mode.weight * v.norm_sqr() / share);
            }
        }
        seen
    }

    /// Returns K of a mode at one bin, in the order of the DFT, which is `K(q + t / lambda; p, lambda)`.
    fn kernel(&self, mode: &SourceMode, iris: &Pupil, i: usize) -> Complex64 {
        let o = self.oracle.optics;
        let bin = |k: usize, n: usize| if k < n - n / 2 { k as f64 } else { k as f64 - n as f64 };
        let (kx, ky) = (bin(i % o.width, o.width), bin(i / o.width, o.height));
        let to_pupil = mode.wavelength * o.focal_length;
        let x = to_pupil * (kx / (o.width as f64 * o.pitch) + mode.angle[0] / mode.wavelength);
        let y = to_pupil * (ky / (o.height as f64 * o.pitch) + mode.angle[1] / mode.wavelength);
        if (x - iris.x).powi(2) + (y - iris.y).powi(2) >= (iris.diameter / 2.0).powi(2) {
            return Complex64::default();
        }
        let a = (x * x + y * y) / o.focal_length.powi(2);
        let plain = Complex64::cis(-TAU * iris.depth / mode.wavelength * (a / (1.0 + (1.0 - a).sqrt())));
        let Some((model, eye)) = &self.bench else { return plain };
        let aperture = model.pixel_aperture(ky / o.height as f64, 1) * model.pixel_aperture(kx / o.width as f64, 1);
        let turns = model.wavefront_turns(x, y, RADIUS) * o.wavelength / mode.wavelength;
        let own = Optics { wavelength: mode.wavelength, ..o };
        plain * aperture * Complex64::cis(TAU * (turns + eye.turns(&own, iris, x, y)))
    }

    fn planner(&self, factor: WindowFactor) -> Planner {
        let o = self.oracle.optics;
        let plain = Planner::new(o, self.oracle.frames, factor);
        let Some((model, eye)) = &self.bench else { return plain.with_source(self.modes) };
        let model = ModelTables::new(model.clone(), RADIUS, 256, o, o);
        Planner { model, eye: EyeTables::new(Some(eye)), ..plain }.with_source(self.modes)
    }
}

#[test]
fn views_agree_with_float64() {
    let modes = three();
    for (h, w, frames) in [(30, 41, 3), (48, 32, 2), (7, 13, 1)] {
        let (exact, rounded) = phases(frames * h * w, 1);
        for bench in [None, Some(bench())] {
            let lit = Lit { oracle: Oracle { optics: optics(h, w), frames }, modes: &modes, bench };
            let planner = lit.planner(WindowFactor::Full);
            let mut engine = loaded(&planner, Purpose::View, &rounded);
            for mm in [[1.0, -2.0, 6.0, 3.0], [-7.0, 4.0, 9.0, -15.0], [11.5, 0.0, 5.0, 1.0]] {
                let pupil = Pupil::from_mm(mm);
                let seen = evaluate::views(&mut engine, &planner, &[pupil]).unwrap().remove(0);
                let error = error_power(&seen, &lit.view(&exact, &pupil));
                assert!(error < 1e-12, "{h}x{w} through {mm:?}: error power {error:.1e} of signal");
            }
        }
    }
}

/// Adam's first moment after one step is a tenth of the gradient. The test compares it with finite differences of the
/// float64 loss, with a display model and an eye, over whole spectra.
#[test]
fn the_gradient_is_the_derivative() {
    let (o, frames, modes) = (optics(20, 24), 2, three());
    let lit = Lit { oracle: Oracle { optics: o, frames }, modes: &modes, bench: Some(bench()) };
    let pupils = [Pupil::from_mm([3.0, -2.0, 9.0, 4.0]), Pupil::from_mm([-5.0, 1.0, 5.0, -1.0])];
    let (exact, rounded) = phases(frames * 480, 4);
    let targets = random_targets(2, 480);
    let planner = lit.planner(WindowFactor::Full);
    let comparison = Comparison { mode: compare::INTENSITY, exposure: 0.7, batch: 2, ..Comparison::default() };
    let mut engine = loaded(&planner, Purpose::Adam, &rounded);
    let pupil_passes = pupils.iter().map(|p| planner.pupil_pass(p, &comparison)).collect();
    let (step, losses) = step_with_targets(&planner, &mut engine, pupil_passes, &targets, true);
    let want = |phases: &[f64]| intensity_loss(&targets, 0.7, |i| lit.view(phases, &pupils[i]));
    let loss = losses.iter().sum::<f64>() / (step.pupil_passes[0].count() * 2) as f64;
    assert!((loss / want(&exact) - 1.0).abs() < 1e-6, "{loss} and {}", want(&exact));
    assert_derivative(&gradient_of(&mut engine), &exact, 1, 2e-5, "three modes on a bench", want);
}

/// The windows of all modes have one size, and show the same image as the whole spectrum.
#[test]
fn windows_hold_every_mode() {
    let (o, modes) = (optics(96, 128), three());
    let lit = Lit { oracle: Oracle { optics: o, frames: 2 }, modes: &modes, bench: None };
    let planner = lit.planner(WindowFactor::Two);
    let pupil = Pupil::from_mm([2.0, -1.0, 4.0, 2.0]);
    let pass = planner.pupil_pass(&pupil, &Comparison::default());
    assert_eq!((pass.mode_count(), pass.weight), (3, 0.5));
    assert!(pass.count() < 96 * 128 && pass.modes.iter().all(|mode| mode.count() == pass.count()));
    let (exact, rounded) = phases(2 * 96 * 128, 3);
    let mut engine = loaded(&planner, Purpose::View, &rounded);
    engine.run(&planner.view_step(vec![pass])).unwrap();
    let image = engine.read(Buffer::Image(0)).unwrap();
    let mean = |sum: f64, count: usize| sum / count as f64;
    let got = mean(image.iter().map(|v| f64::from(*v)).sum(), image.len());
    let want = mean(lit.view(&exact, &pupil).iter().sum(), o.height * o.width);
    assert!((got / want - 1.0).abs() < 1e-5, "{got} and {want}");
}

/// A source of one mode on the axis changes no bit of a view or of a step.
#[test]
fn one_centred_mode_is_no_source() {
    let o = optics(40, 48);
    let (_, rounded) = phases(2 * 40 * 48, 6);
    let centred = [SourceMode::centred(o.wavelength)];
    let run = |modes: &[SourceMode], adam: bool| {
        let planner = Planner::new(o, 2, WindowFactor::Two).with_source(modes);
        let purpose = if adam { Purpose::Adam } else { Purpose::Project };
        let mut engine = loaded(&planner, purpose, &rounded);
        let pupils = [Pupil::from_mm([1.0, 2.0, 4.0, 3.0]), Pupil::from_mm([0.0, 3.0, 5.0, -1.0])];
        let mode = if adam { compare::INTENSITY } else { compare::PROJECTION };
        let comparison = Comparison { mode, exposure: 0.5, batch: 2, ..Comparison::default() };
        let passes: Vec<_> = pupils.iter().map(|p| planner.pupil_pass(p, &comparison)).collect();
        let targets: Vec<Vec<f32>> =
            passes.iter().map(|p| noise(p.count(), 3).iter().map(|x| (0.5 + 0.5 * x) as f32).collect()).collect();
        let (_, losses) = step_with_targets(&planner, &mut engine, passes, &targets, adam);
        (losses, engine.read(Buffer::Phases).unwrap(), engine.read(Buffer::Momentum).unwrap())
    };
    for adam in [false, true] {
        assert!(run(&centred, adam) == run(&[], adam));
    }
}

/// A tilt by whole bins is a linear phase on the SLM (OPTICS 12).
#[test]
fn a_tilt_is_a_linear_phase() {
    let (h, w) = (48, 64);
    let o = optics(h, w);
    let (_, plain) = phases(h * w, 8);
    let (down, along) = (5.0, -7.0);
    let ramp = |i: usize| TAU * (down * (i / w) as f64 / h as f64 + along * (i % w) as f64 / w as f64);
    let tilted: Vec<f32> = plain.iter().enumerate().map(|(i, p)| (f64::from(*p) + ramp(i)) as f32).collect();
    let angle = [along * o.wavelength / (w as f64 * o.pitch), down * o.wavelength / (h as f64 * o.pitch)];
    let see = |planner: &Planner, phases: &[f32]| {
        let mut engine = loaded(planner, Purpose::View, phases);
        evaluate::views(&mut engine, planner, &[Pupil::from_mm([1.0, 2.0, 7.0, 3.0])]).unwrap().remove(0)
    };
    let planner = Planner::new(o, 1, WindowFactor::Full);
    let wanted: Vec<f64> = see(&planner, &tilted).into_iter().map(f64::from).collect();
    let mode = SourceMode { angle, ..SourceMode::centred(o.wavelength) };
    let error = error_power(&see(&planner.with_source(&[mode]), &plain), &wanted);
    assert!(error < 1e-10, "error power {error:.1e}");
}

/// In the light of a source, one sub-frame has a better score than with a point. This is true for both optimizers.
#[test]
fn solving_with_a_source_averages_speckle() {
    let plain = Display { height: 96, width: 96, ..Display::preset("small").unwrap() };
    let mut wide = plain.clone();
    let mut terms = eyebox::low_level::optics::SourceTerms::default();
    (terms.kind, terms.image_mm, terms.samples) = (Some(SourceKind::Led), Some(2.0), Some(3));
    wide.source.insert(Color::Green.into(), terms);
    let field = scene::load("builtin:still-life", &scene::Request::new(&plain, &[Color::Green])).unwrap();
    let solved = |display: &Display, optimizer: Optimizer| {
        let problem = Problem::new(&field, Color::Green, display, Padding::default()).unwrap();
        let settings = Settings {
            frames: 1,
            steps: 12,
            pupils: 6,
            diameter: [3.5e-3, 4.5e-3],
            depth: field.reach(display).0,
            optimizer,
            ..Settings::default()
        };
        let mut engine = eyebox::low_level::engine::cpu::CpuEngine::new();
        let solution = solve::solve(&problem, &settings, &mut engine, &mut |_| Flow::Continue).unwrap();
        solution.validation.mean()
    };
    for optimizer in [Optimizer::projection(), Optimizer::adam()] {
        let (point, source) = (solved(&plain, optimizer), solved(&wide, optimizer));
        assert!(source > point + 0.5, "{optimizer:?}: {point:.2} dB with a point, {source:.2} dB with a source");
    }
}

/// A solve with fewer modes for wide pupils gives the same grain as with all modes. Over pupils of many widths it has
/// the same quality with less work.
#[test]
fn wide_pupils_need_few_modes() {
    let plain = Display { height: 96, width: 96, ..Display::preset("small").unwrap() };
    let mut wide = plain.clone();
    let mut terms = eyebox::low_level::optics::SourceTerms::default();
    (terms.image_mm, terms.shape, terms.samples) = (Some(2.0), Some(SourceShape::Square), Some(3));
    wide.source.insert(Color::Green.into(), terms);
    let field = scene::load("builtin:still-life", &scene::Request::new(&plain, &[Color::Green])).unwrap();
    let problem = Problem::new(&field, Color::Green, &wide, Padding::default()).unwrap();
    let planner = problem.planner(1, WindowFactor::Two).with_fewer_modes(problem.eyebox);
    let through = |planner: &Planner, mm: f64| {
        planner.viewpoint(&Viewpoint::Pupil(Pupil::from_mm([0.5, 1.0, mm, 1.0])), &Comparison::default())
    };
    let counts: Vec<usize> = [2.0, 4.0, 8.0, 16.0].map(|mm| through(&planner, mm).mode_count()).into();
    assert_eq!(counts, [9, 4, 3, 2]);
    let whole = Planner { factor: WindowFactor::Full, ..planner.clone() };
    assert_eq!(through(&whole, 16.0).mode_count(), 9, "a view has all modes");

    let (_, rounded) = phases(96 * 96, 5);
    let mut engine = loaded(&planner, Purpose::View, &rounded);
    let all = Planner { fewer: [].into(), ..planner.clone() };
    for mm in [5.0, 8.0, 16.0] {
        let mut contrast = |planner: &Planner| {
            engine.run(&planner.view_step(vec![through(planner, mm)])).unwrap();
            evaluate::contrast(&engine.read(Buffer::Image(0)).unwrap())
        };
        let (few, many) = (contrast(&planner), contrast(&all));
        assert!((few / many - 1.0).abs() < 0.06, "{mm} mm: {few} with fewer modes, {many} with all");
    }

    let solved = |all_modes: bool| {
        let settings = Settings {
            frames: 1,
            steps: 15,
            pupils: 8,
            diameter: [2e-3, 18e-3],
            depth: field.reach(&wide).0,
            all_modes,
            ..Settings::default()
        };
        let mut engine = eyebox::low_level::engine::cpu::CpuEngine::new();
        let solution = solve::solve(&problem, &settings, &mut engine, &mut |_| Flow::Continue).unwrap();
        let work = solve::Cost::new(&problem, &settings, Memory::Host, 512).step.iter().sum::<f64>();
        (solution.validation.mean(), work)
    };
    let ((few, less), (many, more)) = (solved(false), solved(true));
    assert!(few > many - 0.1 && less < 0.6 * more, "{few:.2} dB for {less:.0}, {many:.2} dB for {more:.0}");
}
