//! Tests successive scenes that are refined in simulated time, with their times, gain and repeatability.

use crate::engine::cpu::CpuEngine;
use crate::optics::Pupil;
use crate::session::playback::player::SetSource;
use crate::session::refinement::pupil_source::PupilSource;
use crate::session::scripted::{Application, samples, shown};
use crate::session::stage::*;
use crate::session::*;
use crate::solve::{Flow, Refiner, Settings, solve};
use crate::trackers::simulated::{Eye, Settings as EyeSettings};
use std::time::Duration;

const PERIOD_NS: i64 = 16_666_667;
const COST: Cost = Cost::Fixed { step: Duration::from_millis(4), encode: Duration::from_millis(1) };

fn eye() -> EyeSettings {
    EyeSettings { fixation: [0.4, 0.6], pursuit: 0.0, blinks: 0.0, ..EyeSettings::default() }
}

/// Returns the PSNR of phases through a pupil (dB).
pub(super) fn seen(phases: &[f32], exposure: f64, frame: &LiveColor, pupil: Pupil) -> f64 {
    let engine = Box::new(CpuEngine::new());
    let steering = Policy::default().steering;
    let mut refiner = Refiner::new(frame.problem.clone(), phases, exposure, steering, engine).unwrap();
    refiner.look(&[pupil]).unwrap()[0].psnr(exposure)
}

/// Returns the PSNR (dB) at the true eye of every fifth set of a second, with the content frames, `tracked` or over the
/// whole eyebox.
fn seen_of(stage: &Scripted, tracked: bool) -> Vec<(f64, u64, Pupil)> {
    let whole = whole_eyebox(stage.display.eyebox_min(), [0.0; 2]);
    let watch = if tracked { samples(eye()) } else { PupilSource::Nobody(whole) };
    let (_refinement, mut source) = stage.sets(Application::new(stage, 30, [0, i64::MAX]), watch, COST, PERIOD_NS);
    let mut eye = Eye::new(eye(), 0);
    let (mut all, mut newest) = (Vec::new(), None);
    for set in 1..=60i64 {
        let start_ns = set * PERIOD_NS;
        // The decision is made a millisecond before.
        source.settle(0, Target { start_ns, hand_over_ns: start_ns - 1_000_000, turn: 0 }).unwrap();
        source.show(0);
        let Some(made) = source.newly_shown() else { continue };
        let content = made.content.expect("a scene");
        if newest.replace(content) != Some(content) {
            // The sum is a period until the scene is read, a step, encoding and the decision.
            let most_ns = PERIOD_NS + 4_000_000 + 1_000_000 + 1_000_000;
            assert!(start_ns - made.arrived_ns.unwrap() <= most_ns, "{set}: {:?}", made.arrived_ns);
        }
        if set % 5 == 0 && set > 10 {
            let truth = eye.at((start_ns + PERIOD_NS / 2) as u64);
            let [x, y] = truth.position;
            let pupil = Pupil { x, y, diameter: truth.diameter, depth: 0.0 };
            let phases = &made.phases.as_ref().unwrap()[0];
            all.push((seen(phases, EXPOSURE, stage.scene(content), pupil), content, pupil));
        }
    }
    assert!(all.len() >= 9, "{} sets", all.len());
    all
}

/// Live content with an eye tracker is 3 dB better at the eye than the same budget on the whole eyebox. It is within 3
/// dB of a hologram of the frame that was solved for the whole eyebox without a time limit.
#[test]
fn live_content_is_refined_for_the_eye() {
    let stage = Scripted::new("planes8", 64, 4);
    let (steered, whole) = (seen_of(&stage, true), seen_of(&stage, false));
    let mean = |all: &[f64]| all.iter().sum::<f64>() / all.len() as f64;
    let db = |all: &[(f64, u64, Pupil)]| mean(&all.iter().map(|s| s.0).collect::<Vec<_>>());
    let settings = Settings { steps: 60, diameter: [2e-3, 8e-3], depth: [0.0; 2], ..Settings::default() };
    let leisure: Vec<(Vec<f32>, f64)> = stage
        .scenes
        .iter()
        .map(|f| solve(&f.problem, &settings, &mut CpuEngine::new(), &mut |_| Flow::Continue).unwrap())
        .map(|solution| (solution.phases, solution.exposure))
        .collect();
    let way = [0, 1, 2, 3, 2, 1];
    let at_leisure: Vec<f64> = steered
        .iter()
        .map(|(_, content, pupil)| {
            let (phases, exposure) = &leisure[way[*content as usize % 6]];
            seen(phases, *exposure, stage.scene(*content), *pupil)
        })
        .collect();
    let (steered, whole, leisure) = (db(&steered), db(&whole), mean(&at_leisure));
    assert!(
        steered > whole + 3.0 && steered > leisure - 3.0,
        "{steered:.1} steered, {whole:.1} whole, {leisure:.1} at leisure"
    );
}

/// Runs a whole session on a simulated clock, with an application that starts late, ends and starts again. The idle
/// picture is shown until there is content, and then the last good picture. The statistics count this, and a second
/// session shows the same bytes.
#[test]
fn a_session_of_live_content_is_accounted_for_and_is_the_same_again() {
    let stage = Scripted::new("planes8", 64, 4);
    let once = || {
        let app = Application::new(&stage, 30, [200_000_000, 600_000_000]);
        shown(stage.live(app, COST, 3), 60, 0.7)
    };
    let (statistics, frames) = once();
    let live = statistics.live.as_ref().unwrap();
    let showing = live.showing.as_ref().unwrap();
    // In 0.4 s at 30 frames per second there are twelve frames, and each is lit.
    assert!((11..=12).contains(&showing.shown), "{showing:?}");
    assert_eq!(
        (showing.scenes, showing.refused, showing.sets[FrameFreshness::New as usize]),
        (showing.shown, 0, showing.shown)
    );
    assert!(showing.sets[FrameFreshness::ApplicationGone as usize] >= 5, "{:?}", showing.sets);
    // The sum is a period, a step, encoding, and the initial eighth of a period from the decision to the light.
    assert!(showing.arrival_to_light.percentile(1.0).unwrap() <= 16.7 + 4.0 + 1.0 + 2.1);
    let account = statistics.report.account;
    assert_eq!(showing.sets.iter().sum::<u64>(), account.sets - account.idle_sets);
    assert!(account.idle_sets >= 10 && live.sets_new + live.sets_repeated == account.sets - account.idle_sets);
    let idle = frames.iter().take_while(|frame| frame.set.is_none()).count();
    assert!(idle >= 10, "{idle} video frames of the idle picture");
    assert!(frames[idle..].iter().all(|frame| frame.set.is_some()), "the picture stays");
    assert_eq!(once().1, frames);
}
