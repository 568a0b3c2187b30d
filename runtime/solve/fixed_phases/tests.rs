//! Tests of the phases that any picture can begin with.

use super::{Kept, MadeBy, fixed_phases, laid_out};
use crate::engine::cpu::CpuEngine;
use crate::evaluate::Sums;
use crate::optics::{Color, Display, Geometry, Optics, Padding, Pupil, PupilDistribution};
use crate::scene::{self, Pyramid, Request};
use crate::solve::{Problem, Refiner, Steering, random_phases};
use std::f32::consts::PI;
use std::sync::Arc;

const FRAMES: usize = 4;
const SIZE: [usize; 2] = [80, 112];

fn problem(display: &Display) -> Problem {
    let request = Request { views: 3, ..Request::new(display, &[Color::Green]) };
    let field = scene::load("builtin:still-life", &request).unwrap();
    Problem::new(&field, Color::Green, display, Padding::default()).unwrap()
}

fn small() -> Problem {
    let [height, width] = SIZE;
    problem(&Display { height, width, ..Display::preset("small").unwrap() })
}

/// Fewer pixels and steps than usual: a tenth of the time.
fn fitted(problem: &Problem) -> Vec<f32> {
    let made_by = MadeBy { tile: 64, steps: 20, ..MadeBy::of(problem, FRAMES, [0.0; 2]) };
    laid_out(&made_by.fit(problem).unwrap(), FRAMES, SIZE)
}

fn refiner(problem: &Problem, phases: &[f32]) -> Refiner {
    Refiner::new(problem.clone(), phases, 0.35, Steering::default(), Box::new(CpuEngine::new())).unwrap()
}

fn pupils() -> Vec<Pupil> {
    [[0.0, 0.0, 4.0], [4.0, -2.0, 4.0], [-5.0, 3.0, 3.0], [-2.0, -6.0, 5.0]]
        .map(|[x, y, d]| Pupil::from_mm([x, y, d, 0.0]))
        .to_vec()
}

/// Mean PSNR at the eye after a retrieval and so many steps for a pupil there, dB.
fn seen_after(problem: &Problem, phases: &[f32], steps: usize) -> f64 {
    let mut refiner = refiner(problem, phases);
    let aim = PupilDistribution {
        centre: [4e-3, -2e-3],
        spread: 3e-4,
        diameter: [3.5e-3, 4.5e-3],
        focus: [0.0; 2],
        elsewhere: 0.0,
    };
    refiner.aim(aim).unwrap();
    assert!(refiner.retrieve(phases).unwrap().is_finite());
    (0..steps).for_each(|_| assert!(refiner.step().unwrap().is_finite()));
    let there = [[4.0, -2.0], [4.3, -1.8], [3.7, -2.4]].map(|[x, y]| Pupil::from_mm([x, y, 4.0, 0.0]));
    let sums = refiner.look(&there).unwrap();
    sums.iter().map(|s| s.psnr(0.35)).sum::<f64>() / 3.0
}

/// Every pupil sees light of one brightness; through random phases it is speckled.
#[test]
fn every_pupil_sees_an_even_picture() {
    let problem = small();
    let [height, width] = SIZE;
    let white = Pyramid::new(&vec![vec![1.0f32; height * width]; 9], height, width);
    let even = Problem { pyramid: Arc::new(white), ..problem.clone() };
    // At the exposure that fits, what differs from white is what is not even.
    let unevenness = |phases: &[f32]| {
        let sums = refiner(&even, phases).look(&pupils()).unwrap();
        let exposure = Sums::fit_exposure(&sums).unwrap();
        sums.iter().map(|s| s.psnr(exposure)).fold(f64::INFINITY, f64::min)
    };
    let (fixed, random) = (unevenness(&fitted(&problem)), unevenness(&random_phases(FRAMES * height * width, 1)));
    println!("even to {fixed:.2} dB, random phases to {random:.2} dB");
    assert!(fixed > random + 0.6, "even to {fixed} dB, random phases to {random} dB");
}

/// A picture that nothing was solved for: one step from fitted phases shows it better than one step from random phases.
#[test]
fn a_retrieval_from_fitted_phases_beats_one_from_random_phases() {
    let problem = small();
    let (fixed, random) = (fitted(&problem), random_phases(FRAMES * SIZE[0] * SIZE[1], 1));
    let [once, after] = [0, 2].map(|steps| [&fixed, &random].map(|phases| seen_after(&problem, phases, steps)));
    println!("{once:?} after the retrieval, {after:?} after two steps more");
    assert!(once[0] > once[1] + 0.6 && after[0] > after[1] + 0.4, "{once:?} after it, {after:?} after two steps more");
    // The same again, to the bit.
    assert!(fitted(&problem) == fixed);
}

#[test]
fn tiles_are_laid_out_and_kept() {
    let tile: Vec<f32> = (0..8).map(|i| i as f32).collect();
    let wanted = [[0.0, 1.0, 0.0], [2.0, 3.0, 2.0], [0.0, 1.0, 0.0], [4.0, 5.0, 4.0], [6.0, 7.0, 6.0], [4.0, 5.0, 4.0]];
    assert_eq!(laid_out(&tile, 2, [3, 3]), wanted.concat());
    let problem = small();
    let made_by = MadeBy { tile: 2, ..MadeBy::of(&problem, 2, [0.0; 2]) };
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("deeper").join("tile.json");
    assert_eq!(made_by.load(&file), None);
    Kept { made_by: made_by.text(), phases: vec![0, 16384, 32768, 49152, 1, 2, 3, 65535] }.save(&file);
    let kept = made_by.load(&file).expect("what was kept");
    assert!((kept[1] - 0.5 * PI).abs() < 1e-6 && (kept[2] + PI).abs() < 1e-6 && kept[7] < 0.0, "{kept:?}");
    assert_eq!(MadeBy::of(&problem, 2, [0.0, 1e-3]).load(&file), None, "another display's");
    let whole = std::fs::read(&file).unwrap();
    std::fs::write(&file, &whole[..whole.len() - 4]).unwrap();
    assert_eq!(made_by.load(&file), None, "cut off");
    // In the far field no tile of the SLM is like another.
    let optics = Optics { geometry: Geometry::FarField, ..problem.optics };
    let far = Problem { optics, ..problem };
    assert!(fixed_phases(&far, 2, [0.0; 2], || unreachable!("nothing is fitted")).unwrap().is_none());
}
