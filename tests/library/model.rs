//! Displays with their faults. The tests compare the lists through every term of a model with float64, and check the
//! gain of a solve with the model.

use eyebox::low_level::engine::{Buffer, Engine, Kernel, cpu::CpuEngine};
use eyebox::low_level::evaluate;
use eyebox::low_level::optics::{
    Color, Display, DisplayModel, Geometry, Level, ModelOf, ModelTerms, Optics, Padding, Pupil, WindowFactor,
};
use eyebox::low_level::plan::{Comparison, ModelTables, Planner, Purpose};
use eyebox::low_level::quality::{ColorJob, ModelWorth};
use eyebox::low_level::scene::{self, LightField};
use eyebox::low_level::solve::{self, Flow, Problem, Settings};
use eyebox_kernels::compare;
use eyebox_tests::both::every_fault;
use eyebox_tests::gradient::{assert_derivative, gradient_of, intensity_loss, random_targets, unwrapped_phases};
use eyebox_tests::{Oracle, error_power, fft2, loaded, phases, step_with_targets};
use rustfft::num_complex::Complex64;
use std::f64::consts::TAU;
use std::time::Duration;

/// Radius of the disc of the wavefront in meters.
pub(crate) const RADIUS: f64 = 11e-3;

pub(crate) fn optics(h: usize, w: usize) -> Optics {
    Optics::new(h, w, 8e-6, 520e-9, 0.4).unwrap()
}

/// The equations in float64.
pub(crate) struct Bench {
    pub(crate) model: DisplayModel,
    pub(crate) oracle: Oracle,
}

impl Bench {
    fn size(&self) -> (usize, usize) {
        (self.oracle.optics.height, self.oracle.optics.width)
    }

    /// Returns the spectrum of each sub-frame, with the pixels' aperture and the relay.
    pub(crate) fn spectra(&self, phases: &[f64]) -> Vec<Vec<Complex64>> {
        let ((h, w), model, frames) = (self.size(), &self.model, self.oracle.frames);
        let (level, source) = (model.level_map([h, w]), model.source_amplitude([h, w]));
        let rest = model.undiffracted_share([h, w]);
        let driven: Vec<f64> =
            phases.iter().enumerate().map(|(i, p)| model.look_up(p.rem_euclid(TAU), level[i % (h * w)]).0).collect();
        let shares = model.lag_shares(frames);
        let one = |f: usize| {
            let before = |i: usize, k: usize| driven[(f + frames - k) % frames * h * w + i];
            // Each sub-pixel has the drive of its pixel.
            let p = if model.crosstalk.is_some() { model.subpixels } else { 1 };
            let (rows, columns) = (p * h, p * w);
            let pixel = |i: usize| i / columns / p * w + i % columns / p;
            let lagged = |i: usize| shares.iter().enumerate().map(|(k, share)| share * before(i, k)).sum::<f64>();
            let mut wave: Vec<Complex64> = (0..rows * columns).map(|i| lagged(pixel(i)).into()).collect();
            if let Some(kernels) = model.crosstalk_kernels(h, w, p) {
                let mut kernel: Vec<Complex64> =
                    (0..rows * columns).map(|i| (kernels[0][i / columns] * kernels[1][i % columns]).into()).collect();
                fft2(&mut kernel, rows, columns, false);
                fft2(&mut wave, rows, columns, false);
                wave.iter_mut().zip(&kernel).for_each(|(z, k)| *z *= k);
                fft2(&mut wave, rows, columns, true);
            }
            let field = |(i, phase): (usize, &Complex64)| {
                source[pixel(i)] * (model.modulated_share() * Complex64::cis(phase.re) + rest[pixel(i)])
            };
            let mut field: Vec<Complex64> = wave.iter().enumerate().map(field).collect();
            fft2(&mut field, rows, columns, false);
            let bin = |k: usize, n: usize| if k < n - n / 2 { k as f64 } else { k as f64 - n as f64 };
            let (bin_y, bin_x) = self.oracle.optics.bin_size();
            let central = |i: usize| {
                let (ky, kx) = (bin(i / w, h), bin(i % w, w));
                let at = |k: f64, count: usize| (k as i64).rem_euclid(count as i64) as usize;
                let aperture = model.pixel_aperture(ky / h as f64, p) * model.pixel_aperture(kx / w as f64, p);
                let relay = Complex64::cis(TAU * model.wavefront_turns(kx * bin_x, ky * bin_y, RADIUS));
                field[at(ky, rows) * columns + at(kx, columns)] * aperture * relay / (p * p) as f64
            };
            (0..h * w).map(central).collect()
        };
        (0..frames).map(one).collect()
    }

    pub(crate) fn view(&self, phases: &[f64], pupil: &Pupil) -> Vec<f64> {
        let (h, w) = self.size();
        let pupil = self.model.true_pupil(pupil);
        let kernel = self.oracle.kernel(&pupil);
        let share = self.oracle.optics.share(pupil.diameter) * self.oracle.frames as f64;
        let mut seen = vec![0.0; h * w];
        for mut spectrum in self.spectra(phases) {
            spectrum.iter_mut().zip(&kernel).for_each(|(u, k)| *u *= k);
            fft2(&mut spectrum, h, w, true);
            seen.iter_mut().zip(spectrum).for_each(|(s, v)| *s += v.norm_sqr() / share);
        }
        seen
    }
}

/// Returns each term alone, and all of them together.
fn models() -> Vec<(&'static str, DisplayModel)> {
    let all = every_fault();
    let with = |put: &dyn Fn(&mut DisplayModel)| {
        let mut model = DisplayModel::default();
        put(&mut model);
        model
    };
    vec![
        ("level", with(&|m| m.level = all.level)),
        ("bend", with(&|m| m.bend = all.bend)),
        ("lag", with(&|m| m.lag = all.lag)),
        ("crosstalk", with(&|m| m.crosstalk = all.crosstalk)),
        ("crosstalk on 2 x 2 sub-pixels", with(&|m| (m.crosstalk, m.subpixels) = (all.crosstalk, 2))),
        ("fill", with(&|m| m.fill = all.fill)),
        ("source", with(&|m| m.source = all.source)),
        ("undiffracted", with(&|m| m.undiffracted = all.undiffracted.clone())),
        ("wavefront", with(&|m| m.wavefront = all.wavefront.clone())),
        ("iris", with(&|m| m.iris = all.iris)),
        ("all on 3 x 3 sub-pixels", with(&|m| (*m, m.subpixels) = (all.clone(), 3))),
        ("all", all),
    ]
}

/// The comparison covers sizes that are not square, and an odd number of sub-frames.
#[test]
fn views_through_every_term_agree_with_float64() {
    for (h, w, frames) in [(30, 41, 3), (48, 32, 2), (7, 13, 1)] {
        let (exact, rounded) = phases(frames * h * w, 1);
        for (name, model) in models() {
            let bench = Bench { model: model.clone(), oracle: Oracle { optics: optics(h, w), frames } };
            let plain = Planner::new(optics(h, w), frames, WindowFactor::Full);
            let planner = Planner { model: ModelTables::new(model, RADIUS, 256, plain.slm, plain.grid), ..plain };
            let mut engine = loaded(&planner, Purpose::View, &rounded);
            for mm in [[1.0, -2.0, 6.0, 3.0], [-7.0, 4.0, 9.0, -15.0]] {
                let pupil = Pupil::from_mm(mm);
                let seen = evaluate::views(&mut engine, &planner, &[pupil]).unwrap();
                let error = error_power(&seen[0], &bench.view(&exact, &pupil));
                assert!(error < 1e-12, "{name} on {h}x{w} through {mm:?}: error power {error:.1e} of signal");
            }
        }
    }
}

/// Adam's first moment after one step is a tenth of the gradient. Through every term it is the derivative of the loss.
#[test]
fn gradients_through_every_term_are_the_derivatives() {
    let (o, frames) = (optics(20, 24), 3);
    let pupils = [Pupil::from_mm([3.0, -2.0, 9.0, 4.0]), Pupil::from_mm([-5.0, 1.0, 5.0, -1.0])];
    let (exact, rounded) = unwrapped_phases(frames * 480, 4);
    let targets = random_targets(2, 480);
    for (name, model) in models() {
        let bench = Bench { model: model.clone(), oracle: Oracle { optics: o, frames } };
        let planner = Planner::new(o, frames, WindowFactor::Full);
        let planner = Planner { model: ModelTables::new(model, RADIUS, 256, o, o), ..planner };
        let comparison = Comparison { mode: compare::INTENSITY, exposure: 0.7, batch: 2, ..Comparison::default() };
        let mut engine = loaded(&planner, Purpose::Adam, &rounded);
        let pupil_passes = pupils.iter().map(|p| planner.pupil_pass(p, &comparison)).collect();
        step_with_targets(&planner, &mut engine, pupil_passes, &targets, true);
        let want = |phases: &[f64]| intensity_loss(&targets, 0.7, |i| bench.view(phases, &pupils[i]));
        assert_derivative(&gradient_of(&mut engine), &exact, 2, 2e-5, name, want);
    }
}

/// The model of an ideal display does not change the list, and each term adds only the kernels that it needs.
#[test]
fn terms_that_are_off_cost_nothing() {
    let o = optics(32, 32);
    assert!(ModelTables::new(DisplayModel::default(), RADIUS, 256, o, o).is_none());
    let names = |model: DisplayModel| {
        let planner = Planner::new(o, 2, WindowFactor::One);
        let planner = Planner { model: ModelTables::new(model, RADIUS, 256, o, o), ..planner };
        let pass = planner.pupil_pass(&Pupil::from_mm([0.0, 0.0, 5.0, 0.0]), &Comparison::default());
        let step = planner.project_step(vec![pass], usize::MAX, 1.0, 1.0, 0.0);
        step.list.iter().map(|d| d.kernel).collect::<Vec<_>>()
    };
    let plain = names(DisplayModel::default());
    for (name, model) in models() {
        let more = match name {
            "iris" => 0,
            "fill" | "wavefront" => 1,
            "lag" => 5,
            "crosstalk" | "crosstalk on 2 x 2 sub-pixels" => 7,
            "all" | "all on 3 x 3 sub-pixels" => 10,
            _ => 3,
        };
        let names = names(model);
        assert_eq!(names.len(), plain.len() + more, "{name}: {names:?}");
        assert_eq!(names.contains(&Kernel::Modulate), matches!(name, "iris" | "fill" | "wavefront"));
    }
}

/// Relative work that a model adds to a step, by the estimates of its kernels. It is small with one value per pixel,
/// and less than the work of the step with 2 x 2.
#[test]
fn what_a_model_adds_to_a_step_is_small() {
    let added = |put: &dyn Fn(&mut DisplayModel)| {
        let o = optics(256, 256);
        let work = |model: DisplayModel| {
            let model = ModelTables::new(model, RADIUS, 256, o, o).map(|tables| tables.for_steps());
            let planner = Planner { model, ..Planner::new(o, 8, WindowFactor::One) };
            // Diameters of 2 to 20 mm, even on a logarithmic scale.
            let diameter = |i: i32| 2.0 * 10f64.powf((f64::from(i) + 0.5) / 16.0);
            let comparison = Comparison { batch: 16, ..Comparison::default() };
            let passes =
                (0..16).map(|i| planner.pupil_pass(&Pupil::from_mm([0.0, 0.0, diameter(i), 0.0]), &comparison));
            let step = planner.project_step(passes.collect::<Vec<_>>(), usize::MAX, 1.0, 1.0, 0.0);
            let shape = planner.shape(Purpose::Project);
            step.list.iter().map(|d| d.work(&step, &shape)).sum::<f64>()
        };
        let mut model = DisplayModel::default();
        put(&mut model);
        work(model) / work(DisplayModel::default()) - 1.0
    };
    let fault = every_fault();
    let of = |sigma: f64, subpixels: usize| {
        added(&|m| (m.crosstalk, m.subpixels) = (Some([[1.2, sigma].into(); 4]), subpixels))
    };
    let all = added(&|m| *m = fault.clone());
    let [one, two, strong] = [of(2.03, 1), of(2.03, 2), of(1.0, 1)];
    eprintln!("crosstalk {one:.3}, stronger {strong:.3}, on 2 x 2 sub-pixels {two:.3}, every fault {all:.3}");
    assert!(one < 0.15 && strong < 0.15 && all < 0.15 && two < 1.0);
}

/// The steps of a solve truncate crosstalk at weights that have no visible effect.
#[test]
fn what_steps_leave_out_of_crosstalk_shows_nowhere() {
    let (o, frames) = (optics(96, 80), 2);
    let (_, rounded) = phases(frames * 96 * 80, 1);
    for (q, sigma, subpixels) in [(1.2, 2.03, 1), (1.2, 1.0, 1), (0.9, 1.5, 2), (2.0, 0.5, 1)] {
        let mut model = DisplayModel::default();
        (model.crosstalk, model.subpixels) = (Some([[q, sigma].into(); 4]), subpixels);
        let exact = ModelTables::new(model, RADIUS, 256, o, o).unwrap();
        let spectrum = |model| {
            let planner = Planner { model: Some(model), ..Planner::new(o, frames, WindowFactor::Full) };
            let mut engine = loaded(&planner, Purpose::View, &rounded);
            let pass = planner.pupil_pass(&Pupil::from_mm([0.0, 0.0, 60.0, 0.0]), &Comparison::default());
            engine.run(&planner.view_step(vec![pass])).unwrap();
            engine.read(Buffer::Field).unwrap().iter().map(|v| f64::from(*v)).collect::<Vec<_>>()
        };
        let (whole, cut) = (spectrum(exact.clone()), spectrum(exact.for_steps()));
        let error: f64 = whole.iter().zip(&cut).map(|(a, b)| (a - b).powi(2)).sum();
        let error = error / whole.iter().map(|a| a * a).sum::<f64>();
        eprintln!("q {q}, sigma {sigma}: {error:.1e}");
        assert!(error < 3e-5 && (error > 0.0 || q > 1.9), "q {q}, sigma {sigma}: {error:.1e}");
    }
}

/// A solve with the model compensates known faults of the display, which are crosstalk, zero-order light and an uneven
/// source.
#[test]
fn solving_with_the_model_regains_what_the_display_loses() {
    let ideal = Display { height: 64, width: 64, ..Display::preset("small").unwrap() };
    assert_eq!(ideal.geometry, Geometry::Relay);
    let terms = ModelTerms {
        crosstalk: every_fault().crosstalk.map(|c| [c[0]; 4]),
        undiffracted: Some(vec![[0.2, 0.0, 0.0, 0.0, 0.0]]),
        source: Some([0.0, 0.0, -0.4, 0.0, -0.4]),
        fill: Some(1.0),
        level: Some(Level::Even(1.0)),
        ..ModelTerms::default()
    };
    let real = Display { model: [(ModelOf::Green, terms)].into(), ..ideal.clone() };
    let field = scene::load("builtin:still-life", &scene::Request::new(&ideal, &[Color::Green])).unwrap();
    let problem = |display| Problem::new(&field, Color::Green, display, Padding::default()).unwrap();
    let settings = Settings { steps: 30, diameter: [6e-3, 16e-3], depth: [0.0, 2e-3], ..Settings::default() };
    let mut engine = CpuEngine::new();
    let mut solved =
        |display| solve::solve(&problem(display), &settings, &mut engine, &mut |_| Flow::Continue).unwrap();
    let (unaware, aware) = (solved(&ideal), solved(&real));
    let lost = seen_on(&problem(&real), &unaware.phases);
    let (kept, best) = (seen_on(&problem(&real), &aware.phases), seen_on(&problem(&ideal), &unaware.phases));
    eprintln!("ideal {best:.2} dB, on the real display {lost:.2}, solved for it {kept:.2}");
    assert!(kept > lost + 2.0 && best > kept, "ideal {best:.2} dB, on the real display {lost:.2}, for it {kept:.2}");
}

/// Returns an ideal display and the same with strong crosstalk, a scene, and settings for a solve through wide pupils.
fn strong_crosstalk() -> ([Display; 2], LightField, Settings) {
    let ideal = Display { height: 64, width: 64, ..Display::preset("small").unwrap() };
    let terms = ModelTerms { crosstalk: Some([[1.2, 1.0].into(); 4]), ..ModelTerms::default() };
    let real = Display { model: [(ModelOf::Green, terms)].into(), ..ideal.clone() };
    let field = scene::load("builtin:still-life", &scene::Request::new(&ideal, &[Color::Green])).unwrap();
    let settings = Settings { steps: 20, diameter: [6e-3, 16e-3], depth: [0.0, 2e-3], ..Settings::default() };
    ([ideal, real], field, settings)
}

/// Under strong crosstalk no drive jumps from one end of the range to the other. No drive is at a value that rounding
/// to levels would move there.
#[test]
fn phases_do_not_wrap_where_neighbours_would_suffer() {
    let ([ideal, real], field, settings) = strong_crosstalk();
    let problem = |display| Problem::new(&field, Color::Green, display, Padding::default()).unwrap();
    let mut engine = CpuEngine::new();
    let mut solved =
        |display| solve::solve(&problem(display), &settings, &mut engine, &mut |_| Flow::Continue).unwrap().phases;
    let (unaware, aware) = (solved(&ideal), solved(&real));
    let highest = |phases: &[f32]| phases.iter().map(|p| f64::from(*p).rem_euclid(TAU)).fold(0.0, f64::max);
    assert!(highest(&unaware) > 6.27 && highest(&aware) < TAU * 255.0 / 256.0 + 1e-5, "{}", highest(&aware));
    let (lost, kept) = (seen_on(&problem(&real), &unaware), seen_on(&problem(&real), &aware));
    assert!(kept > lost + 3.0, "solved without {lost:.2} dB, with the model {kept:.2}");
}

/// Strong crosstalk requires a lower target intensity. The exposure for this display gives a higher PSNR than the
/// exposure for the ideal display.
#[test]
fn the_exposure_is_that_of_the_display_as_it_is() {
    let ([ideal, real], field, settings) = strong_crosstalk();
    let problem = |display| Problem::new(&field, Color::Green, display, Padding::default()).unwrap();
    let mut engine = CpuEngine::new();
    let mut solved = |display, settings: &Settings| {
        solve::solve(&problem(display), settings, &mut engine, &mut |_| Flow::Continue).unwrap()
    };
    let (unaware, aware) = (solved(&ideal, &settings), solved(&real, &settings));
    assert!((0.5..0.7).contains(&(aware.exposure / unaware.exposure)), "{} {}", aware.exposure, unaware.exposure);
    let bright = solved(&real, &Settings { efficiency: Some(unaware.efficiency), ..settings.clone() });
    assert!((bright.exposure / unaware.exposure - 1.0).abs() < 1e-6);
    let [before, after] = [&bright, &aware].map(|solution| seen_on(&problem(&real), &solution.phases));
    eprintln!("for the ideal display's exposure {before:.2} dB, for its own {after:.2}");
    assert!(after > before + 0.8, "for the ideal display's exposure {before:.2} dB, for its own {after:.2}");
}

/// The double-phase method inverts the look-up table.
#[test]
fn the_double_phase_method_takes_back_the_look_up_table() {
    let ideal = Display { height: 64, width: 64, ..Display::preset("small").unwrap() };
    let terms = ModelTerms { level: Some(Level::Even(1.15)), bend: Some([0.3, -0.2]), ..ModelTerms::default() };
    let real = Display { model: [(ModelOf::Green, terms)].into(), ..ideal.clone() };
    let field = scene::load("builtin:still-life", &scene::Request::new(&ideal, &[Color::Green])).unwrap();
    let problem = |display| Problem::new(&field, Color::Green, display, Padding::default()).unwrap();
    let settings = Settings { method: solve::Method::Dpac, depth: [0.0, 2e-3], ..Settings::default() };
    let mut engine = CpuEngine::new();
    let mut solved =
        |display| solve::solve(&problem(display), &settings, &mut engine, &mut |_| Flow::Continue).unwrap().phases;
    let (unaware, aware) = (solved(&ideal), solved(&real));
    let model = real.model(Color::Green);
    let off = |(drive, phase): (&f32, &f32)| {
        let apart = model.look_up(f64::from(*drive).rem_euclid(TAU), 1.15).0 - f64::from(*phase);
        1.0 - apart.cos()
    };
    let worst = aware.iter().zip(&unaware).map(off).fold(0.0, f64::max);
    assert!(worst < 1e-10 && aware != unaware, "{worst:e}");
}

/// The loss without each term is measured. It is large for crosstalk and zero for a weak lag, and one sub-pixel is
/// sufficient.
#[test]
fn terms_that_show_nothing_are_found() {
    let small = Display { height: 48, width: 48, ..Display::preset("small").unwrap() };
    let terms = ModelTerms { crosstalk: Some([[1.2, 2.03].into(); 4]), lag: Some(1e-4), ..ModelTerms::default() };
    let display = Display { model: [(ModelOf::All, terms)].into(), ..small };
    let field = scene::load("builtin:still-life", &scene::Request::new(&display, &[Color::Green])).unwrap();
    let base = Settings { diameter: [6e-3, 16e-3], depth: [0.0, 2e-3], frames: 4, ..Settings::default() };
    let (color, levels) = (Color::Green, solve::Levels::Any);
    let subject = ColorJob { field: &field, color, display: &display, base, levels };
    let mut engine = CpuEngine::new();
    let mut measure =
        |seconds| ModelWorth::measure(&subject, Duration::from_secs(seconds), &mut engine).unwrap().unwrap();
    let worth = measure(600);
    eprintln!("{worth:?}");
    let lost = |name: &str| worth.lost_db.iter().find(|(term, _)| *term == name).unwrap().1;
    assert!(lost("crosstalk") > 0.5 && lost("lag").abs() < 0.05, "{worth:?}");
    assert_eq!((worth.kept(), worth.subpixels()), (vec!["crosstalk"], Some(1)), "{worth:?}");
    let auto = display.with_model_of(color, |model| worth.apply(model));
    assert_eq!(auto.model(color).terms(), ["crosstalk"]);
    // Other colors keep their terms.
    assert_eq!(auto.model(Color::Red).terms(), ["lag", "crosstalk"]);
    // Without time nothing is measured, so no term is left out.
    assert_eq!(measure(0).kept(), ["lag", "crosstalk"]);
}

/// Returns the mean PSNR of these phases through twelve pupils. One exposure fits all pupils.
pub(crate) fn seen_on(problem: &Problem, phases: &[f32]) -> f64 {
    let planner = problem.planner(8, WindowFactor::Full);
    let mut engine = CpuEngine::new();
    engine.load(&planner.shape(Purpose::View), Some(problem.pyramid.clone())).unwrap();
    engine.write(Buffer::Phases, phases).unwrap();
    let place = |i: usize, step: f64| ((i as f64 * step).fract() - 0.5) * 10e-3;
    let pupils: Vec<Pupil> = (0..12)
        .map(|i| Pupil { x: place(i, 0.618), y: place(i, 0.755), diameter: 6e-3 + i as f64 * 0.8e-3, depth: 1e-3 })
        .collect();
    let seen = evaluate::views(&mut engine, &planner, &pupils).unwrap();
    let wanted = evaluate::photographs(&mut engine, &planner, &pupils).unwrap();
    let pairs = || seen.iter().zip(&wanted).map(|(s, w)| (&s[..], &w[..]));
    let exposure = evaluate::fit_exposure(pairs()).unwrap() as f32;
    let psnr = |(seen, wanted): (&[f32], &[f32])| {
        evaluate::psnr(&seen.iter().map(|v| v * exposure).collect::<Vec<_>>(), wanted).unwrap()
    };
    pairs().map(psnr).sum::<f64>() / 12.0
}
