//! Tests of first drive values that all colors share.

use super::made_by::Levels;
use super::made_by::MadeBy;
use super::shared::ColorsInLight;
use super::{By, StartTable, Table};
use crate::engine::EngineError;
use crate::engine::cpu::CpuEngine;
use crate::optics::{Color, Display, Laser, Optics, Padding};
use crate::scene::{self, Pyramid, Request, ViewGrid};
use crate::solve::joint::solve_joint_begun_by;
use crate::solve::{
    FirstPhases, Flow, Joint, JointProblem, Method, Problem, Progress, Settings, SolveError, Warm, random_phases,
    solve_joint,
};
use std::sync::{Arc, LazyLock};

const ALL: [Color; 3] = [Color::Red, Color::Green, Color::Blue];
const FRAMES: usize = 4;

/// Colors of a display, and the lasers with which a solve of them begins.
fn colors([height, width]: [usize; 2]) -> (Vec<Problem>, Vec<Laser>) {
    let display = Display { height, width, ..Display::preset("paper").unwrap() };
    let field = scene::load("builtin:still-life", &Request { views: 5, ..Request::new(&display, &ALL) }).unwrap();
    let lasers = display.slopes(&ALL).into_iter().map(|slope| Laser { slope, powers: vec![1.0; FRAMES] });
    (ALL.map(|color| Problem::new(&field, color, &display, Padding::default()).unwrap()).into(), lasers.collect())
}

static CASE: LazyLock<(Vec<Problem>, Vec<Laser>, StartTable)> = LazyLock::new(|| {
    let (problems, lasers) = colors([64, 96]);
    let table = StartTable::quick_shared(&problems.iter().collect::<Vec<_>>(), &lasers);
    (problems, lasers, table)
});

fn slopes(lasers: &[Laser]) -> Vec<f64> {
    lasers.iter().map(|laser| laser.slope).collect()
}

/// Largest distance of phases, 0 to 2.
fn apart(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| 1.0 - (a - b).cos()).fold(0.0, f32::max)
}

/// An even picture of a brightness.
fn even(problem: &Problem, light: f32) -> Problem {
    let (height, width) = (problem.optics.height, problem.optics.width);
    let views = ViewGrid { rows: 1, columns: 1, cell: problem.eyebox };
    Problem { views, pyramid: Arc::new(Pyramid::new(&[vec![light; height * width]], height, width)), ..problem.clone() }
}

/// The same display and lasers have the same table, byte by byte. An ended fit continues. Other powers or slopes have
/// another table.
#[test]
fn the_same_drive_has_the_same_table() {
    let (problems, lasers, _) = &*CASE;
    let problems: Vec<&Problem> = problems.iter().collect();
    let made_by = |lasers: &[Laser]| MadeBy::of_shared(&problems, lasers).unwrap().sized(16, [4, 2]);
    let ours = made_by(lasers);
    let (mut whole, mut parts) = (Levels::default(), Levels::default());
    ours.fit_shared(&problems, lasers, &mut whole, &mut |_| true).unwrap();
    ours.fit_shared(&problems, lasers, &mut parts, &mut |share| share < 0.5).unwrap();
    assert!(whole.are_all() && !parts.are_all());
    ours.fit_shared(&problems, lasers, &mut parts, &mut |_| true).unwrap();
    let bytes = ours.bytes(&whole);
    assert_eq!(ours.bytes(&parts), bytes);
    assert_eq!(ours.parse(&bytes), Some(whole));
    let (mut dimmer, mut steeper) = (lasers.clone(), lasers.clone());
    (dimmer[1].powers[0], dimmer[1].powers[1], steeper[2].slope) = (0.5, 1.5, 1.7);
    for other in [made_by(&dimmer), made_by(&steeper), MadeBy::of(problems[0], FRAMES).sized(16, [4, 2])] {
        assert!(other.parse(&bytes).is_none() && other.text() != ours.text());
    }
}

/// The table is read at the mean brightness of the colors, at any exposures.
#[test]
fn drives_are_looked_up_by_the_mean_of_the_colors() {
    let (problems, _, table) = &*CASE;
    let drives = |light: [f32; 3], exposures: [f64; 3]| {
        let even: Vec<Problem> = problems.iter().zip(light).map(|(problem, light)| even(problem, light)).collect();
        table.drives(&even.iter().collect::<Vec<_>>(), &exposures).unwrap().expect("a drive's table")
    };
    let wanted = drives([0.5; 3], [1.0; 3]);
    let apart = |drives: &[f32]| apart(drives, &wanted);
    assert!(apart(&drives([0.8, 0.1, 0.6], [1.0; 3])) < 1e-3);
    assert!(apart(&drives([0.25, 0.5, 1.0], [0.5, 1.0, 2.0])) < 1e-3);
    assert!(apart(&drives([0.5, 0.5, 0.9], [1.0; 3])) > 0.1);
    // A table of one color has no drive values.
    let of_one = StartTable::even(FRAMES);
    assert!(!of_one.is_of_shared() && table.is_of_shared());
    assert!(of_one.drives(&[&problems[0]], &[1.0]).unwrap().is_none());
    let By::Drive(Table { frames, .. }) = &table.0 else { panic!("the table of one color") };
    assert_eq!(*frames, FRAMES);
}

/// Through pupils without steps, the mean over the colors is far better before and after the first step.
#[test]
fn a_joint_solve_gains_by_the_table() {
    let (problems, lasers, table) = &*CASE;
    let exposures = [0.45; 3];
    let looked_up = table.drives(&problems.iter().collect::<Vec<_>>(), &exposures).unwrap().expect("a drive's table");
    let slopes = slopes(lasers);
    let problem = JointProblem { colors: problems, slopes: &slopes, exposures: Some(&exposures), powers: None };
    let after = |phases: &[f32], steps: usize| {
        let settings =
            Settings { frames: FRAMES, steps, joint: Some(Joint { brightness: 3.0 }), ..Settings::default() };
        let from = Some(Warm { phases, progress: 0.4 });
        let solved = solve_joint(&problem, &settings, from, &mut CpuEngine::new(), &mut |_| Flow::Continue).unwrap();
        solved.colors.iter().map(|color| color.validation.mean()).sum::<f64>() / 3.0
    };
    let random = random_phases(looked_up.len(), 1);
    let [table, by_random] = [&looked_up, &random].map(|phases| [0, 1].map(|steps| after(phases, steps)));
    println!("{table:.2?} dB from the table, {by_random:.2?} from random drives, after no step and one");
    assert!(table[0] > by_random[1] + 1.0 && table[1] > by_random[1] + 1.5);
}

/// Without a step a joint solve shows its first drive values, at exposures that hide their unevenness. Given drive
/// values and exposures stay.
#[test]
fn a_joint_solve_shows_what_it_begins_with() {
    let (problems, lasers, table) = &*CASE;
    let slopes = slopes(lasers);
    let problem = JointProblem { colors: problems, slopes: &slopes, exposures: None, powers: None };
    let settings = Settings { frames: FRAMES, steps: 0, efficiency: Some(0.45), ..Settings::default() };
    let given = random_phases(FRAMES * 64 * 96, 5);
    let solved = |problem: &JointProblem<'_>, from: Option<Warm<'_>>| {
        let mut begun = None;
        let mut begin =
            |(colors, by, exposures): ColorsInLight<'_>, _: &Settings, _, _: &mut dyn FnMut(&Progress) -> Flow| {
                assert_eq!(by, lasers);
                begun = table.drives(&colors.iter().collect::<Vec<_>>(), exposures)?;
                Ok(begun.clone())
            };
        let mut observe = |_: &Progress| Flow::Continue;
        let solved =
            solve_joint_begun_by(problem, &settings, from, &mut begin, &mut CpuEngine::new(), &mut observe).unwrap();
        (solved.colors, begun)
    };
    let at_once = |problem: &Problem| 1.3 * problem.mean / 0.45;
    let (colors, begun) = solved(&problem, None);
    let drives = begun.expect("it was begun");
    for ((color, laser), problem) in colors.iter().zip(lasers).zip(problems) {
        assert!(
            apart(&color.phases, &laser.phases(&drives)) < 1e-6
                && (color.exposure / at_once(problem) - 1.0).abs() < 1e-9
        );
    }
    let (colors, begun) = solved(&JointProblem { exposures: Some(&[0.4; 3]), ..problem }, None);
    assert!(begun.is_some() && colors.iter().all(|color| (color.exposure - 0.4).abs() < 1e-9));
    let (colors, begun) = solved(&problem, Some(Warm { phases: &given, progress: 0.0 }));
    assert!(begun.is_none() && apart(&colors[0].phases, &lasers[0].phases(&given)) < 1e-6);
}

/// A joint solve fits the table if its display has one. It uses no table on a small SLM, with another method, or with
/// random first phases.
#[test]
fn joint_solves_begin_by_a_table_where_one_fits() {
    let fits = |problems: &[Problem], settings: &Settings| {
        let mut fitted = false;
        let slopes = slopes(&CASE.1);
        let problem = JointProblem { colors: problems, slopes: &slopes, exposures: Some(&[0.45; 3]), powers: None };
        // The observer ends it at the first call.
        let settings = Settings { frames: FRAMES, pupils: 1, ..settings.clone() };
        let ended = solve_joint(&problem, &settings, None, &mut CpuEngine::new(), &mut |progress| {
            fitted |= progress.fitting.is_some();
            Flow::Stop
        });
        (fitted, ended)
    };
    // No other display has this pitch, so no cache has its table.
    let other = |problem: &Problem| Problem {
        optics: Optics { pitch: 1.003 * problem.optics.pitch, ..problem.optics },
        ..problem.clone()
    };
    let small: Vec<Problem> = CASE.0.iter().map(other).collect();
    let (table, random) = (Settings::default(), Settings { first_phases: FirstPhases::Random, ..Settings::default() });
    let (fitted, ended) = fits(&small, &Settings { steps: 0, ..table.clone() });
    assert!(fitted && matches!(ended, Err(SolveError::Engine(EngineError::Stopped))));
    for settings in [
        table.clone(),
        Settings { steps: 0, ..random.clone() },
        Settings { steps: 0, method: Method::Lf2fs, ..table.clone() },
    ] {
        let (fitted, ended) = fits(&small, &settings);
        assert!(!fitted && ended.is_ok(), "{settings:?}");
    }
    let large: Vec<Problem> = colors([256, 256]).0.iter().map(other).collect();
    // Without its table the solve continues from random drive values.
    let (fitted, ended) = fits(&large, &table);
    assert!(fitted && ended.unwrap().colors[0].steps == 1);
    let masked = Problem { optics: Optics { mask_factor: 2, ..large[1].optics }, ..large[1].clone() };
    assert!(!StartTable::fits_shared(&[&large[0], &masked, &large[2]]));
}
