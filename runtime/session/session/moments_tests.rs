//! Tests moving content and eyes in simulated time, the replay of a session, and the delay of content.

use crate::session::scripted::{Application, content_of, shown};
use crate::session::stage::*;
use crate::session::*;
use std::time::Duration;

/// The recording of a session of moving content, with its motion and its shifted phases, replays byte for byte.
#[test]
fn a_session_of_moving_content_is_the_same_again() {
    let stage = Scripted::new("planes8", 64, 1);
    let here = tempfile::tempdir().unwrap();
    let kept = here.path().join("kept");
    let mut app = Application::new(&stage, 30, [50_000_000, i64::MAX]);
    app.scenes = (0..64).map(|k| shifted_color(&stage.scenes[0], 6 * k)).collect();
    let cost = Cost::Fixed { step: Duration::from_millis(2), encode: Duration::from_micros(300) };
    let mut live = stage.live(app, cost, 9);
    live.journal = Some(kept.clone());
    let (statistics, first) = shown(live, 60, 0.6);
    let account = statistics.live.as_ref().unwrap();
    assert!(account.sets_moving > 20 && account.phases_moved > 20, "{} {}", account.sets_moving, account.phases_moved);
    let engines: EngineOpener = Box::new(cpu);
    let mut again = Live::new(stage.begun(), stage.encoder(), engines, None);
    (again.replay, again.policy.restart) = (Some(kept), f64::INFINITY);
    let (_, second) = shown(again, 60, 10.0);
    let (first, second) = (content_of(&first), content_of(&second));
    assert!(first.len() > 25 && first == second, "{} {}", first.len(), second.len());
}

/// The time from the last pixel of a content frame to its first light is at most a period of a set and 2 ms. This is at
/// 120 sets per second with steps of half a millisecond.
#[test]
fn content_is_lit_within_a_period_and_two_milliseconds() {
    let stage = Scripted::new("planes8", 32, 2);
    // The frames start after the margin of the display has settled, which takes four seconds of the idle picture.
    let app = Application::new(&stage, 50, [4_251_300_000, i64::MAX]);
    let cost = Cost::Fixed { step: Duration::from_micros(500), encode: Duration::from_micros(300) };
    let (statistics, _) = shown(stage.live(app, cost, 5), 120, 6.0);
    let showing = statistics.live.unwrap().showing.unwrap();
    let most = showing.arrival_to_light.percentile(1.0).unwrap();
    println!("{most:.2} ms at most, of {} frames", showing.shown);
    assert!(showing.shown > 80 && most <= 1e3 / 120.0 + 2.0, "{most:.2} ms, {} frames", showing.shown);
}
