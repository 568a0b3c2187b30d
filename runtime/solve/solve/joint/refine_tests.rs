//! Tests of the refinement of all colors at once.

use super::tests::setting;
use super::{Joint, JointPart, JointProblem, JointRefiner, check, solve_joint};
use crate::engine::Engine;
use crate::engine::EngineError;
use crate::engine::cpu::CpuEngine;
use crate::evaluate::Sums;
use crate::optics::{Color, Display, Laser, Padding, Pupil, PupilDistribution, phase_of, powers_in_sequence};
use crate::plan::Storage;
use crate::scene::{self, Request};
use crate::solve::{Flow, Problem, Refinable, RefineSettings, Refiner, Settings, Strategy, random_phases};

const ALL: [Color; 3] = [Color::Red, Color::Green, Color::Blue];
const SIZE: [usize; 2] = [48, 64];
const AIM: PupilDistribution = PupilDistribution {
    centre: [3e-3, -2e-3],
    spread: 3e-4,
    diameter: [3.5e-3, 4.5e-3],
    focus: [0.0, 0.0],
    elsewhere: 0.0,
};

fn cpu() -> Result<Box<dyn Engine>, EngineError> {
    Ok(Box::new(CpuEngine::new()))
}

fn display() -> Display {
    Display { height: SIZE[0], width: SIZE[1], ..Display::preset("small").unwrap() }
}

fn problems(colors: &[Color]) -> Vec<Problem> {
    let display = display();
    let field = scene::load("builtin:still-life", &Request { views: 3, ..Request::new(&display, colors) }).unwrap();
    colors.iter().map(|c| Problem::new(&field, *c, &display, Padding::default()).unwrap()).collect()
}

/// Colors in light of these powers, at exposures of the usual size.
fn parts(powers: &[Vec<f64>]) -> Vec<JointPart> {
    let slopes = display().slopes(&ALL);
    let lasers = slopes.into_iter().zip(powers).map(|(slope, powers)| Laser { slope, powers: powers.clone() });
    let parts = problems(&ALL).into_iter().zip(lasers).zip([0.35, 0.4, 0.3]);
    parts.map(|((problem, laser), exposure)| JointPart { problem, exposure, laser }).collect()
}

fn pupils(centers: &[[f64; 2]]) -> Vec<Pupil> {
    centers.iter().map(|&[x, y]| Pupil::from_mm([x, y, 4.0, 0.0])).collect()
}

/// Mean PSNR over colors and pupils in dB.
fn seen(refiner: &mut JointRefiner, exposures: &[f64], pupils: &[Pupil]) -> f64 {
    let mut of = |(color, exposure): (usize, &f64)| {
        let sums: Vec<Sums> = refiner.look(color, pupils).unwrap();
        sums.iter().map(|s| s.psnr(*exposure)).sum::<f64>() / sums.len() as f64
    };
    exposures.iter().enumerate().map(&mut of).sum::<f64>() / exposures.len() as f64
}

#[test]
fn the_eye_sees_better_and_the_eyebox_hardly_worse() {
    let (problems, slopes) = (problems(&ALL), display().slopes(&ALL));
    let problem = JointProblem { colors: &problems, slopes: &slopes, exposures: None, powers: None };
    let settings = Settings { frames: 4, steps: 16, joint: Some(Joint::default()), ..Settings::default() };
    let settings = Settings { diameter: [2e-3, 18e-3], ..settings };
    let solved = solve_joint(&problem, &settings, None, &mut CpuEngine::new(), &mut |_| Flow::Continue).unwrap();
    let exposures: Vec<f64> = solved.colors.iter().map(|c| c.exposure).collect();
    let lasers =
        slopes.iter().zip(&solved.powers).map(|(slope, powers)| Laser { slope: *slope, powers: powers.clone() });
    let parts = problems.iter().zip(lasers).zip(&exposures);
    let parts: Vec<_> =
        parts.map(|((problem, laser), e)| JointPart { problem: problem.clone(), exposure: *e, laser }).collect();
    let reference = slopes.iter().position(|slope| *slope == 1.0).unwrap();
    let drives = &solved.colors[reference].phases;
    let there = pupils(&[[3.0, -2.0], [3.3, -1.8], [2.7, -2.4]]);
    let elsewhere = pupils(&[[-6.0, 5.0], [-4.0, -6.0], [6.0, 6.0]]);
    for (strategy, least) in [(RefineSettings::default().strategy, 1.0), (Strategy::Adam { rate: 0.05 }, 0.5)] {
        let steering = RefineSettings { strategy, ..RefineSettings::default() };
        let mut refiner = JointRefiner::new(parts.clone(), drives, steering, cpu).unwrap();
        // It starts with the solved phases.
        for (phases, color) in refiner.phases().iter().zip(&solved.colors) {
            let off = phases.iter().zip(&color.phases).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(off < 1e-5, "{off}");
        }
        let before = [&there, &elsewhere].map(|pupils| seen(&mut refiner, &exposures, pupils));
        refiner.aim(AIM).unwrap();
        for _ in 0..8 {
            assert!(refiner.step().unwrap().is_finite());
        }
        let after = [&there, &elsewhere].map(|pupils| seen(&mut refiner, &exposures, pupils));
        assert!(after[0] > before[0] + least, "{strategy:?}: {before:?} before, {after:?} after");
        assert!(after[1] > before[1] - 1.0, "{strategy:?}: {before:?} before, {after:?} after");
        // Colors still have one drive value.
        let drive = refiner.phases()[reference].clone();
        for (part, phases) in parts.iter().zip(refiner.phases()) {
            assert_eq!(part.laser.phases(&drive), *phases);
        }
        refiner.begin_again().unwrap();
        assert!((seen(&mut refiner, &exposures, &there) - before[0]).abs() < 1e-6);
    }
}

/// The requested change of the drive values is the derivative of the mean of the colors' losses through the same
/// pupils.
#[test]
fn what_is_asked_of_the_drives_is_a_derivative() {
    let powers = [vec![0.4, 1.9, 0.7], vec![1.0, 0.2, 1.8], vec![1.5, 1.5, 0.0]];
    // These values are away from the wrap, which would disturb a difference.
    let drives: Vec<f64> =
        random_phases(3 * SIZE[0] * SIZE[1], 5).iter().map(|p| 3.15 + 0.98 * f64::from(*p)).collect();
    let phases = |drives: &[f64]| drives.iter().map(|d| phase_of(*d, 1.0)).collect::<Vec<_>>();
    let steering = RefineSettings { strategy: Strategy::Adam { rate: 0.05 }, pupils: 3, ..RefineSettings::default() };
    let mut refiner = JointRefiner::new(parts(&powers), &phases(&drives), steering, cpu).unwrap();
    refiner.aim(AIM).unwrap();
    let before = refiner.loss().unwrap();
    let JointRefiner { colors, shared } = &mut refiner;
    assert!(shared.ask(colors).unwrap().is_some());
    // Adam uses twice the sum over the colors, divided by their number.
    let gradient: Vec<f64> = shared.drives.asked.iter().map(|g| 2.0 / 3.0 * f64::from(*g)).collect();
    let loss = shared.losses().iter().sum::<f64>() / 3.0;
    assert!((loss / before - 1.0).abs() < 1e-6, "{loss} {before}");
    let steep = gradient.iter().map(|g| g * g).sum::<f64>().sqrt();
    let widest = gradient.iter().map(|g| g.abs() / steep).fold(0.0, f64::max);
    for seed in 0..2 {
        // The directions are down the gradient, and a separate one.
        let other = random_phases(drives.len(), 9).into_iter().map(|p| f64::from(p) / 3.2 * widest);
        let along: Vec<f64> = match seed {
            0 => gradient.iter().map(|g| g / steep).collect(),
            _ => gradient.iter().zip(other).map(|(g, o)| g / steep + 3.0 * o).collect(),
        };
        let step = 0.03 / along.iter().map(|v| v.abs()).fold(0.0, f64::max);
        let at = |by: f64| {
            let moved: Vec<f64> = drives.iter().zip(&along).map(|(d, v)| d + by * v).collect();
            // The drawn pupils stay valid until a step was taken.
            let mut other = JointRefiner::new(parts(&powers), &phases(&moved), steering, cpu).unwrap();
            other.aim(AIM).unwrap();
            other.loss().unwrap()
        };
        let numeric = (at(step) - at(-step)) / (2.0 * step);
        let exact: f64 = gradient.iter().zip(&along).map(|(g, v)| g * v).sum();
        assert!((numeric / exact - 1.0).abs() < 1e-2, "direction {seed}: {numeric} {exact}");
    }
}

/// One color whose phases are the drive values, in even light, is refined like any hologram of one color.
#[test]
fn of_one_colour_it_is_the_ordinary_refinement() {
    let problem = problems(&ALL[..1]).remove(0);
    let phases = random_phases(4 * SIZE[0] * SIZE[1], 3);
    for strategy in [RefineSettings::default().strategy, Strategy::Adam { rate: 0.05 }] {
        let steering = RefineSettings { strategy, repeats: 2, ..RefineSettings::default() };
        let laser = Laser { slope: 1.0, powers: vec![1.0; 4] };
        let part = JointPart { problem: problem.clone(), exposure: 0.35, laser };
        let mut joint = JointRefiner::new(vec![part], &phases, steering, cpu).unwrap();
        let mut plain = Refiner::new(problem.clone(), &phases, 0.35, steering, cpu().unwrap()).unwrap();
        joint.aim(AIM).unwrap();
        plain.aim(AIM).unwrap();
        for step in 0..5 {
            let [a, b] = [joint.step().unwrap(), plain.step().unwrap()];
            assert!((a / b - 1.0).abs() < 1e-3, "{strategy:?}, step {step}: {a} {b}");
        }
        let plain = plain.phases().unwrap();
        let off = joint.phases()[0].iter().zip(&plain).map(|(a, b)| f64::from(1.0 - (a - b).cos()));
        // Adam's first steps also have the sign of the smallest gradients.
        let off = off.sum::<f64>() / plain.len() as f64;
        assert!(off < 1e-4, "{strategy:?}: {off}");
    }
}

/// A color whose laser is lit in only one sub-frame looks like a hologram of that sub-frame.
#[test]
fn powers_are_the_light_of_sub_frames() {
    let pixels = SIZE[0] * SIZE[1];
    let drives = random_phases(3 * pixels, 6);
    let mut joint =
        JointRefiner::new(parts(&powers_in_sequence(3, 3)), &drives, RefineSettings::default(), cpu).unwrap();
    let pupils = pupils(&[[1.0, 2.0], [-4.0, 3.0]]);
    for (color, part) in parts(&powers_in_sequence(3, 3)).into_iter().enumerate() {
        let phases = &joint.phases()[color][color * pixels..][..pixels];
        let alone = Refiner::new(part.problem, phases, part.exposure, RefineSettings::default(), cpu().unwrap());
        let [alone, joint] = [alone.unwrap().look(&pupils).unwrap(), joint.look(color, &pupils).unwrap()];
        for (alone, joint) in alone.iter().zip(&joint) {
            let [alone, joint] = [alone, joint].map(|sums| sums.psnr(part.exposure));
            assert!((alone - joint).abs() < 1e-3, "color {color}: {alone} {joint} dB");
        }
    }
}

#[test]
fn what_cannot_be_is_refused_in_a_line() {
    let drives = vec![0.0; 2 * SIZE[0] * SIZE[1]];
    let refused = |parts: Vec<JointPart>, steering| {
        let made = JointRefiner::new(parts, &drives, steering, cpu);
        setting(made.err().expect("a refusal"))
    };
    let with = |change: &dyn Fn(&mut Vec<JointPart>)| {
        let mut parts = parts(&[vec![1.0; 2], vec![1.0; 2], vec![1.0; 2]]);
        change(&mut parts);
        parts
    };
    let (plain, halves) =
        (RefineSettings::default(), RefineSettings { storage: Some(Storage::F16), ..RefineSettings::default() });
    let padded = |parts: &mut Vec<JointPart>| {
        parts[1].problem.padding = Padding { rows: 16, columns: 0 };
    };
    assert_eq!(refused(with(&|_| ()), halves).1, Storage::F16.name());
    assert_eq!(refused(with(&|p| p.clear()), plain).1, "0");
    assert_eq!(refused(with(&|p| p[0].laser.slope = 1.5), plain).0, check::DISPERSION);
    for powers in [vec![2.0; 2], vec![1.0; 3]] {
        let (_, value) = refused(with(&|p| p[1].laser.powers.clone_from(&powers)), plain);
        assert_eq!(value, format!("{powers:?}"));
    }
    assert_eq!(refused(with(&padded), plain).0, check::PADDING);
}
