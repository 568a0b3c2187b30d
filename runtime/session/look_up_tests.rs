//! Tests of what content that jumps is begun with.

use super::scripted::{Application, EXPOSURE, Scripted, content_of, shown};
use super::tests::cpu;
use super::*;
use crate::optics::PupilDistribution;
use crate::solve::StartTable;
use std::sync::Arc;
use std::time::Duration;

const SIDE: usize = 64;

/// A table of the stage's display, fitted in fewer steps than usual.
fn tables(stage: &Scripted) -> Vec<Option<Arc<StartTable>>> {
    let color = &stage.begun()[0];
    vec![Some(Arc::new(StartTable::quick(&color.problem, color.frames())))]
}

fn moved(stage: &Scripted, shift: usize) -> SteeredColor {
    study::moved_color(&stage.scenes[0], shift)
}

/// Where another picture comes, the phases that a table has for it show it better than the last ones; those of a table that fits no
/// picture do not. What is nearly the same picture is not looked at.
#[test]
fn the_better_of_the_table_s_phases_and_the_last_ones_is_taken() {
    let stage = Scripted::new("planes8", SIDE, 1);
    let aim = PupilDistribution {
        centre: [4e-3, 0.0],
        spread: 2e-4,
        diameter: [3.8e-3, 4.2e-3],
        focus: [0.0; 2],
        elsewhere: 0.0,
    };
    let refined = |tables: Vec<Option<Arc<StartTable>>>| {
        let policy = Policy { restart: f64::INFINITY, ..Policy::default() };
        let mut steerer = Steerer::new(stage.begun(), policy, cpu).unwrap().with_start_tables(tables);
        steerer.aim(aim).unwrap();
        steerer.follow(&[moved(&stage, 0)]).unwrap();
        (0..8).for_each(|_| assert_eq!(steerer.round_while(|_, _| true).unwrap(), 1));
        steerer.settle().unwrap();
        steerer.follow(&[moved(&stage, 1)]).unwrap();
        assert!(!steerer.wants_fit(), "the same picture, one pixel on");
        steerer.follow(&[moved(&stage, SIDE / 2)]).unwrap();
        steerer
    };
    let mut good = refined(tables(&stage));
    let before = good.phases().unwrap()[0].to_vec();
    assert!(good.wants_fit());
    let fitted = good.fit().unwrap();
    assert_eq!((fitted.looked_up, fitted.kept, good.wants_fit()), (1, 0, false));
    assert!(good.phases().unwrap()[0] != before);
    // A table all of whose light is on the axis, where the pupil is not.
    let mut bad = refined(vec![Some(Arc::new(StartTable::even(stage.begun()[0].frames())))]);
    let fitted = bad.fit().unwrap();
    assert_eq!((fitted.looked_up, fitted.kept), (0, 1));
    assert!(bad.phases().unwrap()[0] == before, "the phases before are gone on with");
    // Where there is nothing else to begin with, nothing is looked at.
    assert!(!refined(Vec::new()).wants_fit());
}

/// A session whose content jumps begins with phases of a table, says so, and is the same again from what was kept of it.
#[test]
fn a_session_of_jumping_content_is_the_same_again() {
    let stage = Scripted::new("planes8", SIDE, 1);
    let here = tempfile::tempdir().unwrap();
    let kept = here.path().join("kept");
    let tables = tables(&stage);
    let mut app = Application::new(&stage, 10, [50_000_000, i64::MAX]);
    app.scenes = (0..2).map(|k| moved(&stage, SIDE / 2 * k)).collect();
    assert_eq!(app.scenes[0].exposure, EXPOSURE);
    let cost = Cost::Fixed { step: Duration::from_millis(2), encode: Duration::from_micros(300) };
    let mut live = stage.live(app, cost, 9);
    (live.journal, live.start_tables) = (Some(kept.clone()), tables.clone());
    let (statistics, first) = shown(live, 60, 0.6);
    let showing = statistics.live.as_ref().unwrap().showing.as_ref().unwrap();
    let [own, before, looked_up] = showing.starts;
    println!("{own} own, {before} kept, {looked_up} looked up, of {} scenes", showing.scenes);
    assert!(looked_up >= 1 && own == 0 && before + looked_up <= showing.scenes, "{:?}", showing.starts);
    assert_eq!(showing.to_json()["began_with_table"], looked_up);
    let engines: EngineOpener = Box::new(cpu);
    let mut again = Live::new(stage.begun(), stage.encoder(), engines, None);
    (again.replay, again.policy.restart, again.start_tables) = (Some(kept), f64::INFINITY, tables);
    let (_, second) = shown(again, 60, 10.0);
    let (first, second) = (content_of(&first), content_of(&second));
    assert!(first.len() > 25 && first == second, "{} {}", first.len(), second.len());
}
