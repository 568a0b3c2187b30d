//! Tests the gain of the refinement, of motion compensation and of tables of first phases in studies.

use crate::study::{ContentRun, ContentSettings, JumpStart, StudiedContent, StudiedEye, StudySample, StudySettings};
use crate::study::{study, study_content};
use eyebox::low_level::encode::{Encoder, Lighting};
use eyebox::low_level::engine::cpu::CpuEngine;
use eyebox::low_level::optics::Color;
use eyebox::low_level::session::stage::{
    EXPOSURE, Scripted, cpu, drive_table, encoder, inverted, joint_colors, joint_display, one_view, part,
};
use eyebox::low_level::session::{Cost, LiveColor, Policy, SessionError};
use eyebox::low_level::solve::{Flow, Settings, solve};
use eyebox::low_level::trackers::simulated;
use std::sync::Arc;
use std::time::Duration;

const SIDE: usize = 64;

/// An eye that looks at one place for a minute and does not blink.
fn calm_eye() -> simulated::Settings {
    simulated::Settings { fixation: [60.0; 2], blinks: 0.0, noise: 0.02e-3, ..Default::default() }
}

/// Eight sets of content that jumps every three, with one step each.
fn jumping(lighting: Lighting) -> ContentSettings {
    ContentSettings {
        contents: vec![StudiedContent::Jumping],
        sets: 8,
        steps: 1,
        speed: 10,
        jumps_every: 3,
        slides: Vec::new(),
        start: JumpStart::Last,
        start_tables: Vec::new(),
        lighting,
    }
}

/// A study of the stage's color, solved for pupils of 2 to 8 mm, before an eye that pursues nothing.
fn solved_and_studied(stage: &Scripted, content: &ContentSettings) -> Vec<ContentRun> {
    let scene = &stage.scenes[0];
    let settings = Settings { steps: 20, diameter: [2e-3, 8e-3], depth: [0.0; 2], ..Settings::default() };
    let solution = solve(&scene.problem, &settings, &mut CpuEngine::new(), &mut |_| Flow::Continue).unwrap();
    let color = LiveColor { phases: solution.phases, exposure: solution.exposure, ..scene.clone() };
    studied(&[color], content, simulated::Settings { pursuit: 0.0, ..calm_eye() }).unwrap()
}

fn studied(
    colors: &[LiveColor],
    content: &ContentSettings,
    eye: simulated::Settings,
) -> Result<Vec<ContentRun>, SessionError> {
    let study = StudySettings { eye, ..StudySettings::default() };
    study_content(colors, &Policy::default(), content, &study, &mut cpu, &mut |_| Flow::Continue)
}

/// PSNR of the first set after a jump of content that is refined, without motion compensation, dB.
fn after_the_jump(runs: &[ContentRun]) -> f64 {
    let run = runs.iter().find(|r| r.steered && !r.moments).expect("it is shown steered, without moments");
    run.after_jumps(1).expect("sets after a jump")
}

/// In a study, content that jumps also begins with the phases of its table. Its first set is better than from the last
/// phases and from random ones. This also holds for rolling updates, although all of their video frames have one step.
#[test]
fn a_study_of_jumping_content_begins_with_the_table() {
    for (packing, rolls) in [("planes8", false), ("grey8", true)] {
        let stage = Scripted::new(packing, SIDE, 1);
        let [table, last, random] = [JumpStart::Table, JumpStart::Last, JumpStart::Random]
            .map(|start| first_set_after_a_jump(&stage, start, rolls));
        println!("{table} dB from the table, {last} from the last phases, {random} from random ones");
        assert!(table > last + 0.5 && table > random + 0.5, "{table} {last} {random}");
    }
}

/// PSNR of the first set after a jump, with a step for every set, dB.
fn first_set_after_a_jump(stage: &Scripted, start: JumpStart, rolls: bool) -> f64 {
    let lighting = stage.encoder().lighting(rolls);
    assert_eq!(lighting.turns() > 1, rolls);
    let content = ContentSettings { start, start_tables: stage.tables(), ..jumping(lighting) };
    after_the_jump(&studied(&stage.begun(), &content, calm_eye()).unwrap())
}

/// In a study of colors that share their sub-frames, content that jumps begins with the drives of the table, too.
#[test]
fn a_study_of_joint_colors_begins_with_the_table() {
    let whole = joint_colors(&joint_display());
    let table = drive_table(&whole);
    let lighting = Encoder::new(&joint_display(), &[Color::Red], 3).unwrap().lighting(false);
    let first_set = |start| {
        let (slides, start_tables) = (vec![inverted(&whole)], vec![Some(Arc::clone(&table))]);
        let content = ContentSettings { slides, start, start_tables, ..jumping(lighting.clone()) };
        after_the_jump(&studied(&whole, &content, calm_eye()).unwrap())
    };
    let [table, last, random] = [JumpStart::Table, JumpStart::Last, JumpStart::Random].map(first_set);
    println!("{table:.2} dB from the table, {last:.2} from the last drives, {random:.2} from random ones");
    assert!(table > last && table > random + 0.5, "{table} {last} {random}");
}

/// Slides follow each other, and after the last the scene returns. A black slide has no PSNR, so the sets with a PSNR
/// belong to the scene. A slide with another number of colors is refused.
#[test]
fn a_study_of_slides_shows_them_in_turn() {
    let stage = Scripted::new("planes8", SIDE, 1);
    let even = |light: f32| {
        let field = one_view(&stage.display, vec![light; SIDE * SIDE]);
        LiveColor::for_scene(&stage.begun(), &field, &stage.display).unwrap()
    };
    let black = even(0.0);
    let study = |slides| {
        let plain = jumping(stage.encoder().lighting(false));
        let content = ContentSettings { sets: 14, jumps_every: 2, slides, ..plain };
        let eye = simulated::Settings { noise: simulated::Settings::default().noise, ..calm_eye() };
        studied(&stage.begun(), &content, eye)
    };
    let lit = |slides| study(slides).unwrap()[0].samples.iter().map(|s| s.since_jump).collect::<Vec<_>>();
    // The order is scene, black, black, scene, black, black, scene. The first scene has not jumped.
    assert_eq!(lit(vec![black.clone(), black.clone()]), [0, 1, 0, 1, 0, 1]);
    assert_eq!(lit(vec![black.clone()]), [0, 1, 0, 1, 0, 1, 0, 1]);
    let two = [black.clone(), black.clone()].concat();
    assert!(matches!(study(vec![two]), Err(SessionError::Setting(reason)) if reason.code() == "slide-colors"));
    // A slide that is brighter than all of the light raises the exposure, and a darker one does not change it.
    assert_eq!(black[0].exposure, EXPOSURE);
    assert!((even(0.8)[0].exposure - 0.8).abs() < 1e-3, "{}", even(0.8)[0].exposure);
    assert!(black[0].phases.is_empty());
}

fn mean(run: &ContentRun) -> f64 {
    run.summary(8).expect("sets that have settled")[0]
}

/// With motion compensation, content that moves by ten pixels per set is within a decibel of still content. For an eye
/// that follows it, the content is sharp. For an eye at rest, it matches the target image integrated over the motion.
/// Without motion compensation, an eye that follows it sees it smeared. Still and jumping content lose nothing.
#[test]
fn what_moves_is_seen_as_well_as_what_stands_still() {
    let stage = Scripted::new("planes8", 96, 1);
    let content = ContentSettings {
        contents: vec![StudiedContent::Still, StudiedContent::Moving, StudiedContent::Jumping],
        sets: 32,
        steps: 3,
        jumps_every: 16,
        ..jumping(stage.encoder().lighting(false))
    };
    let runs = solved_and_studied(&stage, &content);
    assert_eq!(runs.len(), 16);
    let of = |content, eye, steered, moments| {
        let is = |r: &&ContentRun| (r.content, r.eye, r.steered, r.moments) == (content, eye, steered, moments);
        mean(runs.iter().find(is).expect("one of each"))
    };
    let (still, moving, jumping) = (StudiedContent::Still, StudiedContent::Moving, StudiedContent::Jumping);
    let (rests, follows) = (StudiedEye::Rests, StudiedEye::Follows);
    let all: Vec<String> = runs
        .iter()
        .map(|r| format!("{:?} {:?} {} {}: {:.2}", r.content, r.eye, r.steered, r.moments, mean(r)))
        .collect();
    let all = all.join("\n");
    println!("{all}");
    let at_rest = of(still, rests, true, true);
    assert!((at_rest - of(still, rests, true, false)).abs() < 0.3, "{all}");
    assert!(of(jumping, rests, true, true) > of(jumping, rests, true, false) - 0.3, "{all}");
    for eye in [rests, follows] {
        assert!(of(moving, eye, true, true) > at_rest - 1.0, "{eye:?}:\n{all}");
        assert!(of(moving, eye, true, true) > of(moving, eye, true, false) + 1.0, "{eye:?}:\n{all}");
    }
    assert!(at_rest > of(still, rests, false, false) + 1.5, "steering:\n{all}");
}

/// With rolling updates, each window of the length of a set is a good set, for still content and for content that moves
/// by ten pixels per set. The worst last video frame is within 0.3 dB of the best. With motion compensation, moving
/// content is within a decibel of still content.
#[test]
fn windows_of_sets_that_roll_are_as_good_as_each_other() {
    let stage = Scripted::new("grey8", 64, 1);
    let content = ContentSettings {
        contents: vec![StudiedContent::Still, StudiedContent::Moving],
        sets: 24,
        steps: 8,
        jumps_every: 16,
        ..jumping(stage.encoder().lighting(true))
    };
    let runs = solved_and_studied(&stage, &content);
    let of = |content, eye, moments| {
        let is = |r: &&ContentRun| (r.content, r.eye, r.steered, r.moments) == (content, eye, true, moments);
        runs.iter().find(is).expect("one of each")
    };
    let line = |r: &ContentRun| {
        format!("{:?} {:?} {} {}: {:.2}, {:.2?}", r.content, r.eye, r.steered, r.moments, mean(r), r.windows(8))
    };
    let all = runs.iter().map(line).collect::<Vec<_>>().join("\n");
    println!("{all}");
    assert_eq!(runs[0].samples.len(), 24 * 8);
    let (still, moving) = (StudiedContent::Still, StudiedContent::Moving);
    let (rests, follows) = (StudiedEye::Rests, StudiedEye::Follows);
    let at_rest = mean(of(still, rests, true));
    for (content, eye) in [(still, rests), (moving, rests), (moving, follows)] {
        let [worst, best] = of(content, eye, true).windows(8).unwrap();
        assert!(best - worst < 0.3, "{content:?} {eye:?}: {worst:.2} to {best:.2} dB\n{all}");
    }
    for eye in [rests, follows] {
        let (on, off) = (mean(of(moving, eye, true)), mean(of(moving, eye, false)));
        assert!(on > at_rest - 1.0 && on > off + 1.0, "{eye:?}:\n{all}");
    }
}

/// In simulated time, with a cost that is equal on all machines, the eye sees better after a while, and each set is
/// measured.
#[test]
fn a_simulated_eye_sees_better_when_steered() {
    let cost = Cost::Fixed { step: Duration::from_millis(4), encode: Duration::from_millis(1) };
    let settings = StudySettings { seconds: 1.2, cost, ..StudySettings::default() };
    let mut shares = Vec::new();
    let mut seen = Vec::new();
    let (whole, encoder) = (part(), encoder());
    let parts = [whole.clone()];
    let result = study(&parts, &Policy::default(), &encoder, &settings, &mut cpu, &mut |moment, phases, share| {
        assert_eq!(phases.len(), 1);
        seen.push((moment.new, phases[0] == whole.phases));
        shares.push(share);
        true
    })
    .unwrap();
    let sets = (settings.seconds * 1e9 / settings.period_ns as f64) as usize;
    assert!(result.moments.len().abs_diff(sets) <= 1, "{} of {sets}", result.moments.len());
    assert!(shares.windows(2).all(|w| w[0] < w[1]) && shares.iter().all(|s| (0.0..=1.1).contains(s)));
    let refined = seen.iter().position(|s| s.0).expect("a new set");
    assert!(seen[..refined].iter().all(|s| s.1), "until then it is the hologram for the whole eyebox");
    assert!(seen[refined..].iter().all(|s| !s.1), "and from then on it is not");
    assert!(seen.iter().any(|s| s.0) && result.steps > 0);
    let landed: Vec<&StudySample> =
        result.moments.iter().filter(|m| m.since_landing_ms.is_some_and(|t| t > 150.0)).collect();
    assert!(!landed.is_empty());
    let gain = landed.iter().map(|m| m.gain_db()).sum::<f64>() / landed.len() as f64;
    let error = landed.iter().filter_map(|m| m.error).fold(0.0, f64::max);
    assert!(gain > 0.5 && error < 0.5e-3, "{gain} dB, {error} m");
    // A study that ends early returns its samples until then.
    let few = study(&parts, &Policy::default(), &encoder, &settings, &mut cpu, &mut |_, _, share| share < 0.3);
    assert!((1..sets / 2).contains(&few.unwrap().moments.len()));
    let wrong = StudySettings { period_ns: 0, ..settings };
    assert!(study(&parts, &Policy::default(), &encoder, &wrong, &mut cpu, &mut |_, _, _| true).is_err());
}
