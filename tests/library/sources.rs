//! Switchable sources (OPTICS 12). The tests compare views with float64, in turn and together, the gradient, borders
//! between sources, and the gain of a refinement for the sources that are lit.

use super::model::optics;
use eyebox::low_level::engine::cpu::CpuEngine;
use eyebox::low_level::evaluate;
use eyebox::low_level::optics::{
    Color, Display, Padding, Pupil, PupilDistribution, SourceMode, SourcesLit, WindowFactor,
};
use eyebox::low_level::plan::{Comparison, Planner, Purpose};
use eyebox::low_level::scene;
use eyebox::low_level::solve::{self, Flow, Problem, RefineSettings, Refiner, Settings};
use eyebox_kernels::compare;
use eyebox_tests::gradient::{assert_derivative, gradient_of, intensity_loss, random_targets};
use eyebox_tests::{Oracle, error_power, fft2, loaded, phases, step_with_targets};
use rustfft::num_complex::Complex64;
use std::f64::consts::TAU;

/// Returns three sources next to each other, spaced by an eyebox of green light (26 mm), in turn or not.
fn three(in_turn: bool) -> Vec<SourceMode> {
    let mode = |i: usize| SourceMode {
        angle: [65e-3 * (i as f64 - 1.0), 4e-3 * i as f64],
        weight: [1.0, 0.7, 1.2][i],
        source: i,
        turn: if in_turn { [i, 3] } else { SourceMode::ALWAYS },
        ..SourceMode::centred(520e-9)
    };
    (0..3).map(mode).collect()
}

/// Computes OPTICS 12 in float64. The spectrum of each sub-frame is cut at the place to which each source that is lit
/// moves the pupil.
fn view(oracle: &Oracle, modes: &[SourceMode], phases: &[f64], pupil: &Pupil) -> Vec<f64> {
    let (o, frames) = (oracle.optics, oracle.frames);
    let (h, w) = (o.height, o.width);
    let spectra = oracle.spectra(phases);
    let share = o.share(pupil.diameter) * frames as f64;
    let bin = |k: usize, n: usize| if k < n - n / 2 { k as f64 } else { k as f64 - n as f64 };
    let mut seen = vec![0.0; h * w];
    for mode in modes {
        let kernel = |i: usize| {
            let to_pupil = mode.wavelength * o.focal_length;
            let x = to_pupil * bin(i % w, w) / (w as f64 * o.pitch) + o.focal_length * mode.angle[0];
            let y = to_pupil * bin(i / w, h) / (h as f64 * o.pitch) + o.focal_length * mode.angle[1];
            let a = (x * x + y * y) / o.focal_length.powi(2);
            let turns = pupil.depth / mode.wavelength * (a / (1.0 + (1.0 - a).sqrt()));
            let passes = (x - pupil.x).powi(2) + (y - pupil.y).powi(2) < (pupil.diameter / 2.0).powi(2);
            if passes { Complex64::cis(-TAU * turns) } else { Complex64::default() }
        };
        for (f, spectrum) in spectra.iter().enumerate() {
            let power = match mode.turn {
                [_, 1] => 1.0,
                [place, count] if f % count == place => {
                    frames as f64 / (0..frames).filter(|f| f % count == place).count() as f64
                }
                _ => continue,
            };
            let mut field: Vec<Complex64> = spectrum.iter().enumerate().map(|(i, u)| u * kernel(i)).collect();
            fft2(&mut field, h, w, true);
            seen.iter_mut().zip(field).for_each(|(s, v)| *s += power * mode.weight * v.norm_sqr() / share);
        }
    }
    seen
}

/// Pupils inside one source's eyebox, on a border, and at the edge of all eyeboxes.
const PUPILS: [[f64; 4]; 4] =
    [[0.5, 2.0, 6.0, 3.0], [13.0, 1.0, 5.0, -2.0], [-26.0, 3.0, 4.0, 1.0], [37.0, 9.0, 5.0, 0.0]];

#[test]
fn views_agree_with_float64() {
    for (h, w, frames, in_turn) in [(30, 41, 3, true), (48, 32, 5, true), (24, 50, 2, false)] {
        let oracle = Oracle { optics: optics(h, w), frames };
        let (exact, rounded) = phases(frames * h * w, 1);
        let modes = three(in_turn);
        let planner = Planner::new(oracle.optics, frames, WindowFactor::Full).with_source(&modes);
        let mut engine = loaded(&planner, Purpose::View, &rounded);
        for mm in PUPILS {
            let pupil = Pupil::from_mm(mm);
            let seen = evaluate::views(&mut engine, &planner, &[pupil]).unwrap().remove(0);
            let wanted = view(&oracle, &modes, &exact, &pupil);
            let error = error_power(&seen, &wanted);
            assert!(wanted.iter().sum::<f64>() > 0.0 && error < 1e-12, "{h}x{w} through {mm:?}: {error:.1e} of signal");
        }
    }
}

/// Adam's first moment after one step is a tenth of the gradient.
#[test]
fn the_gradient_is_the_derivative() {
    for in_turn in [true, false] {
        let (oracle, modes) = (Oracle { optics: optics(20, 24), frames: 4 }, three(in_turn));
        let pupils = [Pupil::from_mm([13.5, -2.0, 7.0, 4.0]), Pupil::from_mm([-20.0, 1.0, 5.0, -1.0])];
        let (exact, rounded) = phases(4 * 480, 4);
        let targets = random_targets(2, 480);
        let planner = Planner::new(oracle.optics, 4, WindowFactor::Full).with_source(&modes);
        let comparison = Comparison { mode: compare::INTENSITY, exposure: 0.7, batch: 2, ..Comparison::default() };
        let mut engine = loaded(&planner, Purpose::Adam, &rounded);
        let passes = pupils.iter().map(|p| planner.pupil_pass(p, &comparison)).collect();
        let (step, losses) = step_with_targets(&planner, &mut engine, passes, &targets, true);
        let want = |phases: &[f64]| intensity_loss(&targets, 0.7, |i| view(&oracle, &modes, phases, &pupils[i]));
        let loss = losses.iter().sum::<f64>() / (step.pupil_passes[0].count() * 2) as f64;
        assert!((loss / want(&exact) - 1.0).abs() < 1e-6, "{loss} and {}", want(&exact));
        let what = format!("in turn {in_turn}");
        assert_derivative(&gradient_of(&mut engine), &exact, 1, 2e-5, &what, want);
    }
}

/// A single source in the middle changes no bit of the solved phases.
#[test]
fn one_centred_source_is_no_source() {
    let plain = Display { height: 48, width: 64, ..Display::preset("small").unwrap() };
    let mut one = plain.clone();
    one.sources.each = vec![Default::default()];
    let field = scene::load("builtin:still-life", &scene::Request::new(&plain, &[Color::Green])).unwrap();
    let solved = |display: &Display| {
        let problem = Problem::new(&field, Color::Green, display, Padding::default()).unwrap();
        let settings =
            Settings { frames: 2, steps: 3, pupils: 4, depth: field.reach(display).0, ..Settings::default() };
        solve::solve(&problem, &settings, &mut CpuEngine::new(), &mut |_| Flow::Continue).unwrap().phases
    };
    assert!(solved(&plain) == solved(&one));
}

/// At the border of two sources that are an eyebox apart, each bin counts once. The number of bins is the same as
/// inside (OPTICS 12).
#[test]
fn a_border_shares_no_bin() {
    let o = optics(200, 240);
    let modes: Vec<SourceMode> =
        three(false).into_iter().map(|m| SourceMode { angle: [m.angle[0], 0.0], ..m }).collect();
    let planner = Planner::new(o, 1, WindowFactor::One).with_source(&modes);
    let bins = |x: f64| {
        let pass = planner.pupil_pass(&Pupil::from_mm([x, 2.0, 6.0, 0.0]), &Comparison::default());
        let mut all = Vec::new();
        for mode in pass.each_mode() {
            for (j, [first, end]) in mode.spans.iter().enumerate() {
                let of = |k: u32| o.index_of(mode.window.y0 + j as i64, mode.window.x0 + i64::from(k));
                all.extend((*first..*end).map(of));
            }
        }
        let count = all.len();
        all.sort_unstable();
        all.dedup();
        assert_eq!(all.len(), count, "at {x} mm a bin counts twice");
        (count, pass.mode_count())
    };
    let (inside, alone) = bins(0.0);
    for x in [-13.0, 11.0, 12.3, 13.0, 14.9] {
        let (count, modes) = bins(x);
        assert!((count as f64 / inside as f64 - 1.0).abs() < 0.03, "{count} of {inside} at {x} mm");
        assert_eq!((modes, alone), (2, 1));
    }
}

/// A refinement follows the eye from one source to the next and reports the sources that are lit. Its quality there is
/// the same as in the middle.
#[test]
fn a_refinement_takes_its_sources_with_the_eye() {
    let mut display = Display { height: 96, width: 96, ..Display::preset("small").unwrap() };
    display.wavelengths.retain(|w| w.color == Color::Green);
    let place = |i: usize| [26.0 * ((i % 3) as f64 - 1.0), 26.0 * ((i / 3) as f64 - 1.0)];
    display.sources.each = (0..9)
        .map(|i| eyebox::low_level::optics::SwitchedSource { eyebox_mm: Some(place(i)), ..Default::default() })
        .collect();
    display.sources.lit = SourcesLit::Steered;
    let request = scene::Request::new(&display, &[Color::Green]);
    let field = scene::load("builtin:still-life", &request).unwrap();
    let problem = Problem::new(&field, Color::Green, &display, Padding::default()).unwrap();
    let first = solve::random_phases(4 * 96 * 96, 3);
    let refined = |x: f64, y: f64| {
        let mut refiner =
            Refiner::new(problem.clone(), &first, 0.35, RefineSettings::default(), Box::new(CpuEngine::new())).unwrap();
        let pupil = Pupil::from_mm([x, y, 4.0, 0.0]);
        refiner.aim(PupilDistribution::around(&pupil, 0.1e-3)).unwrap();
        for _ in 0..16 {
            refiner.step().unwrap();
        }
        let sums = refiner.look(&[pupil]).unwrap();
        (refiner.sources().to_vec(), sums[0].psnr(0.35))
    };
    let (lit, middle) = refined(0.0, 0.0);
    assert_eq!(lit, [4]);
    for (x, y, wanted) in
        [(26.0, 0.0, &[5][..]), (13.0, 0.0, &[4, 5]), (-26.0, 26.0, &[6]), (13.0, -13.0, &[1, 2, 4, 5])]
    {
        let (lit, db) = refined(x, y);
        assert_eq!(lit, wanted, "at ({x}, {y}) mm");
        assert!(db > middle - 1.5, "at ({x}, {y}) mm {db:.2} dB, {middle:.2} in the middle");
    }
}
