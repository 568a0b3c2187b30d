//! Tests of what content that jumps is begun with.

use super::scripted::{Application, EXPOSURE, Scripted, content_of, shown};
use super::tests::cpu;
use super::*;
use crate::engine::cpu::CpuEngine;
use crate::optics::{Padding, PupilDistribution};
use crate::scene::{Pyramid, ViewGrid};
use crate::solve::{Flow, Problem, Settings, solve};
use std::sync::Arc;
use std::time::Duration;

const SIDE: usize = 64;

/// Phases that show every pupil white light, in fewer steps than usual.
fn fixed(stage: &Scripted) -> Vec<Vec<f32>> {
    let problem = &stage.scenes[0].problem;
    let white = Problem {
        views: ViewGrid { rows: 1, columns: 1, cell: problem.eyebox },
        pyramid: Arc::new(Pyramid::new(&[vec![1.0f32; SIDE * SIDE]], SIDE, SIDE)),
        mean: 1.0,
        padding: Padding::default(),
        ..problem.clone()
    };
    let settings =
        Settings { steps: 16, efficiency: Some(0.7), diameter: [2.5e-3, 8e-3], depth: [0.0; 2], ..Settings::default() };
    vec![solve(&white, &settings, &mut CpuEngine::new(), &mut |_| Flow::Continue).unwrap().phases]
}

fn moved(stage: &Scripted, shift: usize) -> SteeredColor {
    study::moved_color(&stage.scenes[0], shift)
}

/// Where another picture comes, a retrieval from phases that fit any picture shows it better than the last phases; from phases that
/// fit none, the last phases are kept. What is nearly the same picture is not looked at.
#[test]
fn the_better_of_a_retrieval_and_the_last_phases_is_taken() {
    let stage = Scripted::new("planes8", SIDE, 1);
    let aim = PupilDistribution {
        centre: [4e-3, 0.0],
        spread: 2e-4,
        diameter: [3.8e-3, 4.2e-3],
        focus: [0.0; 2],
        elsewhere: 0.0,
    };
    let refined = |fixed: Vec<Vec<f32>>| {
        let policy = Policy { restart: f64::INFINITY, ..Policy::default() };
        let mut steerer = Steerer::new(stage.begun(), policy, cpu).unwrap().with_fixed_phases(fixed);
        steerer.aim(aim).unwrap();
        steerer.follow(&[moved(&stage, 0)]).unwrap();
        (0..8).for_each(|_| assert_eq!(steerer.round_while(|_, _| true).unwrap(), 1));
        steerer.settle().unwrap();
        steerer.follow(&[moved(&stage, 1)]).unwrap();
        assert!(!steerer.wants_fit(), "the same picture, one pixel on");
        steerer.follow(&[moved(&stage, SIDE / 2)]).unwrap();
        steerer
    };
    let mut good = refined(fixed(&stage));
    let before = good.phases().unwrap()[0].to_vec();
    assert!(good.wants_fit());
    let fitted = good.fit().unwrap();
    assert_eq!((fitted.retrieved, fitted.kept, good.wants_fit()), (1, 0, false));
    assert!(good.phases().unwrap()[0] != before);
    // All light on the axis, where the pupil is not.
    let mut bad = refined(vec![vec![0.0; before.len()]]);
    let fitted = bad.fit().unwrap();
    assert_eq!((fitted.retrieved, fitted.kept), (0, 1));
    assert!(bad.phases().unwrap()[0] == before, "the phases before are gone on with");
    // Where there is nothing else to begin with, nothing is looked at.
    assert!(!refined(Vec::new()).wants_fit());
}

/// A session whose content jumps begins with a retrieval, says so, and is the same again from what was kept of it.
#[test]
fn a_session_of_jumping_content_is_the_same_again() {
    let stage = Scripted::new("planes8", SIDE, 1);
    let here = tempfile::tempdir().unwrap();
    let kept = here.path().join("kept");
    let fixed = fixed(&stage);
    let mut app = Application::new(&stage, 10, [50_000_000, i64::MAX]);
    app.scenes = (0..2).map(|k| moved(&stage, SIDE / 2 * k)).collect();
    assert_eq!(app.scenes[0].exposure, EXPOSURE);
    let cost = Cost::Fixed { step: Duration::from_millis(2), encode: Duration::from_micros(300) };
    let mut live = stage.live(app, cost, 9);
    (live.journal, live.fixed_phases) = (Some(kept.clone()), fixed.clone());
    let (statistics, first) = shown(live, 60, 0.6);
    let showing = statistics.live.as_ref().unwrap().showing.as_ref().unwrap();
    let [own, before, retrieved] = showing.starts;
    println!("{own} own, {before} kept, {retrieved} retrieved, of {} scenes", showing.scenes);
    assert!(retrieved >= 3 && own == 0 && before + retrieved <= showing.scenes, "{:?}", showing.starts);
    assert_eq!(showing.to_json()["began_with_retrieval"], retrieved);
    let engines: EngineOpener = Box::new(cpu);
    let mut again = Live::new(stage.begun(), stage.encoder(), engines, None);
    (again.replay, again.policy.restart, again.fixed_phases) = (Some(kept), f64::INFINITY, fixed);
    let (_, second) = shown(again, 60, 10.0);
    let (first, second) = (content_of(&first), content_of(&second));
    assert!(first.len() > 25 && first == second, "{} {}", first.len(), second.len());
}
