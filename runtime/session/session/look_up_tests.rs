//! Tests the first phases of content that jumps.

use crate::optics::PupilDistribution;
use crate::session::scripted::{Application, content_of, shown};
use crate::session::stage::*;
use crate::session::*;
use crate::solve::{Problem, StartTable, random_phases};
use std::sync::Arc;
use std::time::Duration;

const SIDE: usize = 64;

fn moved(stage: &Scripted, shift: usize) -> LiveColor {
    shifted_color(&stage.scenes[0], shift)
}

/// If a different picture arrives, the phases of its table show it better than the last ones, and refinement continues
/// with them. A nearly identical picture keeps the phases.
#[test]
fn another_picture_begins_with_the_phases_of_the_table() {
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
        let mut refiner = LiveRefiner::new(stage.begun(), policy, cpu).unwrap().with_start_tables(tables);
        refiner.aim(aim).unwrap();
        refiner.follow(&[moved(&stage, 0)]).unwrap();
        (0..8).for_each(|_| assert_eq!(refiner.round_while(|_, _| true).unwrap(), 1));
        refiner.settle().unwrap();
        refiner.follow(&[moved(&stage, 1)]).unwrap();
        assert!(!refiner.needs_reinit(), "the same picture, one pixel on");
        refiner.follow(&[moved(&stage, SIDE / 2)]).unwrap();
        refiner
    };
    let mut good = refined(stage.tables());
    let before = good.phases().unwrap()[0].to_vec();
    assert!(good.needs_reinit());
    assert_eq!((good.fit().unwrap(), good.needs_reinit()), (1, false));
    let table = &stage.tables()[0];
    let color = moved(&stage, SIDE / 2);
    let looked_up = table.as_ref().unwrap().phases(&color.problem, color.exposure).unwrap();
    assert!(good.phases().unwrap()[0] != before && good.phases().unwrap()[0] == looked_up);
    let losses = [before, looked_up].map(|phases| {
        good.begin_with(&[phases]).unwrap();
        good.round_while(|_, _| true).unwrap();
        good.settle().unwrap();
        good.estimated_db().unwrap()
    });
    assert!(losses[1] > losses[0], "after one step from the last and from the table's phases: {losses:?} dB");
    // Without a table the phases are kept.
    assert!(!refined(Vec::new()).needs_reinit());
}

/// A session whose content jumps starts with phases of a table, counts that, and its recording replays to the same
/// result.
#[test]
fn a_session_of_jumping_content_is_the_same_again() {
    let stage = Scripted::new("planes8", SIDE, 1);
    let here = tempfile::tempdir().unwrap();
    let kept = here.path().join("kept");
    let tables = stage.tables();
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

/// Colors that share their sub-frames start a different picture together with the drives of their table, which show it
/// better.
#[test]
fn another_picture_begins_with_drives_of_the_table() {
    let whole = joint_colors(&joint_display());
    let table = drive_table(&whole);
    let slide = inverted(&whole);
    let refined = |tables: Vec<Option<Arc<StartTable>>>| {
        let policy = Policy { restart: f64::INFINITY, ..Policy::default() };
        let mut refiner = LiveRefiner::new(whole.clone(), policy, cpu).unwrap().with_start_tables(tables);
        refiner.aim(tests::aim(2e-3)).unwrap();
        (0..6).for_each(|_| assert_eq!(refiner.round_while(|_, _| true).unwrap(), 3));
        let same = |color: &LiveColor| LiveColor { phases: Vec::new(), ..shifted_color(color, 1) };
        refiner.follow(&whole.iter().map(same).collect::<Vec<_>>()).unwrap();
        assert!(!refiner.needs_reinit(), "the same picture, one pixel on");
        assert_eq!(refiner.follow(&slide).unwrap(), Followed::default());
        refiner
    };
    let mut refiner = refined(vec![Some(Arc::clone(&table))]);
    let last = refiner.sent().unwrap()[0].to_vec();
    assert!(refiner.needs_reinit());
    assert_eq!((refiner.fit().unwrap(), refiner.needs_reinit(), refiner.fit().unwrap()), (3, false, 0));
    let (problems, exposures): (Vec<&Problem>, Vec<f64>) = slide.iter().map(|c| (&c.problem, c.exposure)).unzip();
    let looked_up = table.drives(&problems, &exposures).unwrap().expect("a drive's table");
    let apart = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| 1.0 - (a - b).cos()).fold(0.0, f32::max);
    assert!(apart(refiner.sent().unwrap()[0], &looked_up) < 1e-6 && apart(&last, &looked_up) > 0.5);
    let random = random_phases(last.len(), 3);
    let [table_db, last_db, random_db] = [&looked_up, &last, &random].map(|drives| {
        refiner.begin_with(std::slice::from_ref(drives)).unwrap();
        (0..2).for_each(|_| assert_eq!(refiner.round_while(|_, _| true).unwrap(), 3));
        refiner.estimated_db().unwrap()
    });
    println!(
        "after one step {table_db:.2} dB from the table, {last_db:.2} from the last drives, {random_db:.2} from random ones"
    );
    assert!(table_db > last_db + 0.5 && table_db > random_db + 0.5);
    // Tables of single colors do not fit a drive.
    assert!(!refined(vec![Some(Arc::new(StartTable::even(3))); 3]).needs_reinit());
    // A session without a hologram has its first phases from the table. An SLM as small as this one has no table of its
    // own.
    let mut begun = slide.clone();
    refinement::live_refiner::look_up::begin_with_tables(&mut begun, &[Some(table)]).unwrap();
    for color in &begun {
        assert_eq!(color.phases, color.laser.as_ref().unwrap().phases(&looked_up));
    }
    assert_eq!(start_tables(&whole, &mut |_| true).unwrap(), [None]);
}
