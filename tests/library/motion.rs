//! Eyes and content that move during the sub-frames, against float64 (OPTICS 15).

use crate::model::{Bench, RADIUS, optics};
use eyebox::low_level::engine::{Buffer, Engine, Kernel, cpu::CpuEngine};
use eyebox::low_level::evaluate;
use eyebox::low_level::optics::{DisplayModel, Pupil, WindowFactor};
use eyebox::low_level::plan::{
    Comparison, ModelTables, Moment, Moving, Planner, PupilPass, Purpose, ViewLayout, Viewpoint,
};
use eyebox::low_level::scene::{Pyramid, ViewGrid};
use eyebox_kernels::compare;
use eyebox_tests::both::every_fault;
use eyebox_tests::gradient::{assert_derivative, gradient_of, intensity_loss, random_targets, unwrapped_phases};
use eyebox_tests::{Oracle, error_power, fft2, loaded, noise, phases, step_with_targets};
use rustfft::num_complex::Complex64;
use std::f64::consts::TAU;
use std::sync::Arc;

/// Returns the image that an eye sees in its own frame, averaged over the sub-frames of `moments` that it sees, in
/// float64.
fn seen(bench: &Bench, phases: &[f64], moments: &[Moment]) -> Vec<f64> {
    let o = bench.oracle.optics;
    let (h, w) = (o.height, o.width);
    let bin = |k: usize, n: usize| if k < n - n / 2 { k as f64 } else { k as f64 - n as f64 };
    let count = moments.iter().filter(|m| m.seen).count() as f64;
    let mut sum = vec![0.0; h * w];
    for (mut spectrum, moment) in bench.spectra(phases).into_iter().zip(moments).filter(|(_, m)| m.seen) {
        let pupil = bench.model.true_pupil(&moment.pupil);
        let kernel = bench.oracle.kernel(&pupil);
        for (i, (u, k)) in spectrum.iter_mut().zip(&kernel).enumerate() {
            let (ky, kx) = (bin(i / w, h) / h as f64, bin(i % w, w) / w as f64);
            *u *= k * Complex64::cis(TAU * (ky * moment.eye[1] + kx * moment.eye[0]));
        }
        fft2(&mut spectrum, h, w, true);
        let share = o.share(pupil.diameter) * count;
        sum.iter_mut().zip(spectrum).for_each(|(s, v)| *s += v.norm_sqr() / share);
    }
    sum
}

/// Returns a stream of six sub-frames with one pupil each. An eye of fractional velocity sees four of them, from the
/// `a`-th on.
fn window_of_four(a: usize) -> Vec<Moment> {
    let one = |f: usize| {
        let (i, t) = (f as f64, (f as f64 - 2.5) / 4.0);
        let pupil = Pupil { x: 2e-3 + 2e-4 * i, y: -1e-3, diameter: 7e-3 - 1e-4 * i, depth: 2e-3 };
        Moment { pupil, eye: [3.3 * t, -1.7 * t], content: [0.0; 2], seen: (a..a + 4).contains(&f) }
    };
    (0..6).map(one).collect()
}

fn planner(model: DisplayModel, h: usize, w: usize, frames: usize) -> Planner {
    let plain = Planner::new(optics(h, w), frames, WindowFactor::Full);
    Planner { model: ModelTables::new(model, RADIUS, 256, plain.slm, plain.grid), ..plain }
}

#[test]
fn what_a_moving_eye_sees_agrees_with_float64() {
    let (h, w) = (40, 48);
    let (exact, rounded) = phases(6 * h * w, 1);
    for model in [DisplayModel::default(), every_fault()] {
        let bench = Bench { model: model.clone(), oracle: Oracle { optics: optics(h, w), frames: 6 } };
        let planner = planner(model, h, w, 6);
        let mut engine = loaded(&planner, Purpose::View, &rounded);
        for a in 0..3 {
            let moments = window_of_four(a);
            engine.run(&planner.view_step(vec![planner.moving_pass(&moments, &Comparison::default())])).unwrap();
            let error = error_power(&engine.read(Buffer::Image(0)).unwrap(), &seen(&bench, &exact, &moments));
            assert!(error < 1e-12, "from {a}: error power {error:.1e} of signal");
        }
    }
}

/// An eye at rest with sub-frames at rest is no moving eye. The list, and therefore the bits, are the same.
#[test]
fn at_rest_it_is_the_view() {
    let planner = planner(DisplayModel::default(), 30, 41, 3);
    let (_, rounded) = phases(3 * 30 * 41, 2);
    let pupil = Pupil::from_mm([1.0, -2.0, 6.0, 3.0]);
    let resting = Moving::resting(pupil, 3);
    let comparison = Comparison::default();
    assert_eq!(planner.viewpoint(&Viewpoint::Moving(resting), &comparison), planner.pupil_pass(&pupil, &comparison));
    // The kernel gives the same up to rounding.
    let mut engine = loaded(&planner, Purpose::View, &rounded);
    let still: Vec<f64> =
        evaluate::views(&mut engine, &planner, &[pupil]).unwrap()[0].iter().map(|x| f64::from(*x)).collect();
    engine.run(&planner.view_step(vec![planner.moving_pass(&resting.moments(3), &comparison)])).unwrap();
    assert!(error_power(&engine.read(Buffer::Image(0)).unwrap(), &still) < 1e-12);
}

/// Each sub-frame shows the one before, moved by whole pixels. An eye that moves with them sees one of them sharp, and
/// an eye at rest sees a blur.
#[test]
fn who_follows_what_moves_sees_it_sharp() {
    let (h, w) = (40, 48);
    let (_, first) = phases(h * w, 3);
    let roll = |i: usize| (0..h * w).map(move |at| ((at / w + h - 2 * i % h) % h, (at % w + i) % w));
    let stream: Vec<f32> = (0..6).flat_map(|i| roll(i).map(|(y, x)| first[y * w + x]).collect::<Vec<_>>()).collect();
    let planner = planner(DisplayModel::default(), h, w, 6);
    let mut engine = loaded(&planner, Purpose::View, &stream);
    let pupil = Pupil::from_mm([2.0, -1.0, 7.0, 2.0]);
    let mut image = |moving: Moving| {
        engine
            .run(&planner.view_step(vec![planner.viewpoint(&Viewpoint::Moving(moving), &Comparison::default())]))
            .unwrap();
        engine.read(Buffer::Image(0)).unwrap()
    };
    let rest = Moving::resting(pupil, 6);
    // Per set, this is twelve pixels down and six to the left.
    let follows = image(Moving { eye: [-6.0, 12.0], ..rest });
    let one = image(Moving { eye: [-6.0, 12.0], first: 2, count: 1, ..rest });
    let stays = image(rest);
    // A single sub-frame has its times in sets of one. It is displaced from its place in the set.
    let deviation = |x: &[f32]| {
        let mean = x.iter().sum::<f32>() / x.len() as f32;
        (x.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / x.len() as f32).sqrt()
    };
    assert!((deviation(&follows) / deviation(&one) - 1.0).abs() < 1e-4, "{} {}", deviation(&follows), deviation(&one));
    assert!(deviation(&follows) > 1.5 * deviation(&stays), "{} {}", deviation(&follows), deviation(&stays));
}

/// The gradient of the loss over every window of 4 in 6, with a fractional velocity and a pupil per sub-frame.
#[test]
fn the_gradient_over_the_windows_of_a_stream_is_the_derivative() {
    let (h, w, frames) = (20, 24, 6);
    let (exact, rounded) = unwrapped_phases(frames * h * w, 4);
    let targets = random_targets(3, h * w);
    for model in [DisplayModel::default(), every_fault()] {
        let bench = Bench { model: model.clone(), oracle: Oracle { optics: optics(h, w), frames } };
        let planner = planner(model, h, w, frames);
        let comparison = Comparison { mode: compare::INTENSITY, exposure: 0.8, batch: 3, ..Comparison::default() };
        let passes: Vec<PupilPass> = (0..3).map(|a| planner.moving_pass(&window_of_four(a), &comparison)).collect();
        let mut engine = loaded(&planner, Purpose::Adam, &rounded);
        step_with_targets(&planner, &mut engine, passes, &targets, true);
        let want = |phases: &[f64]| intensity_loss(&targets, 0.8, |a| seen(&bench, phases, &window_of_four(a)));
        // The bound is the same as without motion, from the precision of float32. (In float64 it is 1e-6.)
        assert_derivative(&gradient_of(&mut engine), &exact, 2, 2e-5, "windows of four", want);
    }
}

/// The target is the mean of the target images of all moments, each displaced as the eye moves. For an eye that follows
/// the content it is the still target image.
#[test]
fn the_photograph_is_integrated_over_the_motion() {
    let (h, w) = (48, 64);
    let plain = Planner::new(optics(h, w), 2, WindowFactor::Full);
    let grid = ViewGrid { rows: 3, columns: 3, cell: plain.slm.eyebox() / 3.0 };
    let views: Vec<Vec<f32>> =
        (0..9).map(|v| noise(h * w, v).iter().map(|x| (0.5 + 0.5 * x) as f32).collect()).collect();
    let pyramid = Arc::new(Pyramid::new(&views, h, w));
    let planner = Planner { views: Some(ViewLayout::new(grid, &pyramid)), ..plain };
    let mut engine = CpuEngine::new();
    engine.load(&planner.shape(Purpose::View), Some(pyramid)).unwrap();
    let mut photograph = |moving: Moving| {
        let pass = planner.viewpoint(&Viewpoint::Moving(moving), &Comparison::default());
        engine.run(&planner.photograph_step(vec![pass])).unwrap();
        engine.read(Buffer::Target(0)).unwrap()
    };
    let rest = Moving::resting(Pupil::from_mm([2.0, -1.0, 7.0, 2.0]), 2);
    let still = photograph(rest);
    assert_eq!(photograph(Moving { eye: [5.3, -1.2], content: [5.3, -1.2], ..rest }), still, "an eye that follows");
    // The two moments are a quarter of a set before and after the middle, so T(r) is the mean of T(r + (g - v) t).
    let blurred = photograph(Moving { eye: [8.0, 0.0], content: [0.0, 4.0], ..rest });
    let at = |y: i64, x: i64| f64::from(still[(y.rem_euclid(h as i64) * w as i64 + x.rem_euclid(w as i64)) as usize]);
    let places = (0..h as i64).flat_map(|y| (0..w as i64).map(move |x| (y, x)));
    let want: Vec<f64> = places.map(|(y, x)| 0.5 * (at(y + 1, x - 2) + at(y - 1, x + 2))).collect();
    assert!(error_power(&blurred, &want) < 1e-10, "{:e}", error_power(&blurred, &want));
}

/// An eye at rest adds no cost. The list has kernels for motion only if an eye moves.
#[test]
fn kernels_for_motion_are_there_where_an_eye_moves() {
    let planner = planner(DisplayModel::default(), 30, 40, 4);
    let rest = Moving::resting(Pupil::from_mm([1.0, 0.0, 5.0, 0.0]), 4);
    let kernels = |moving: Moving| {
        let pass = planner.viewpoint(&Viewpoint::Moving(moving), &Comparison::default());
        let step = planner.project_step(vec![pass], usize::MAX, 1.0, 1.0, 0.0);
        step.list.iter().filter(|d| matches!(d.kernel, Kernel::Motion | Kernel::MotionBack)).count()
    };
    assert_eq!(kernels(rest), 0);
    assert_eq!(kernels(Moving { eye: [1.0, 0.0], ..rest }), 2);
    assert_eq!(kernels(Moving { first: 1, count: 2, ..rest }), 2);
}
