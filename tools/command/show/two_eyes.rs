//! `eyebox show --display TWO.toml` shows a scene to both eyes, on two panels.

use super::application;
use super::args::{OutputTo, ShowSettings};
use super::content::{self, Show, is_phases};
#[cfg(target_os = "linux")]
use super::openxr;
use super::playback;
use super::session::{attend, conclude, keep_powers};
use super::tracked::{self, KeptSession, Refined, ShowOptions, Stage};
use super::tracking::tracking_of_two;
use super::walk;
use crate::groups::SceneArgs;
use crate::subject::{self, Steered, SubjectOptions};
use crate::{Failure, common, progress};
use eyebox::low_level::hologram::{Hologram, Opening, Sequence};
use eyebox::low_level::optics::{Stereo, TwoEyes, dioptres};
use eyebox::low_level::reason;
use eyebox::low_level::scene;
use eyebox::low_level::session::{Cost, Ended, Output, Session, SessionOptions, Status, TwoEyed, TwoEyesReport};
use serde_json::{Value, json};
use std::any::Any;
use std::path::Path;
use std::time::Duration;

/// Returns the display of two panels, if `--display` names one.
pub fn display(subject: &SubjectOptions) -> Result<Option<TwoEyes>, Failure> {
    Ok(subject.display.display.as_deref().map(TwoEyes::load).transpose()?.flatten())
}

/// Shows the content on both panels and prints the statistics.
pub fn show(args: &Show, settings: &ShowSettings, two: &TwoEyes) -> Result<(), Failure> {
    refuse(args)?;
    let subjects = two.names.clone().map(|name| {
        let mut subject = args.subject.clone();
        subject.display.display = Some(name);
        subject
    });
    let tracked = args.live.tracker().is_some();
    let content = content(args, &subjects[0], two)?;
    walk::refuse(args, matches!(content, Content::Splats(_)))?;
    match content {
        Content::Each(content) if !tracked => played(args, settings, two, &subjects, &content),
        content if tracked => refined(args, settings, two, &subjects, &content),
        _ => Err(Failure::Arguments(reason!(
            "application-of-two-eyes",
            "an application for two panels needs an eye tracker. Add --tracker"
        ))),
    }
}

/// The content of both eyes.
enum Content {
    /// A scene or a hologram for each eye.
    Each([String; 2]),
    /// Splats for each eye, which are drawn for the tracked pupil.
    Splats([String; 2]),
    /// Frames of an application, by its name.
    Application(String),
    /// Frames of an OpenXR application that is started with these words.
    #[cfg(target_os = "linux")]
    OpenXr(Vec<String>),
}

/// Refuses options of content for one eye.
fn refuse(args: &Show) -> Result<(), Failure> {
    let given = [
        (args.live.view, "--view"),
        (args.live.tracker() == Some("mouse"), "--tracker mouse"),
        (args.follow.camera.is_some(), "--camera"),
        (args.journal.is_some(), "--journal"),
        (args.replay.is_some(), "--replay"),
        (args.subject.scene.is_some(), "--scene"),
        (args.stream.follow, "--follow"),
    ];
    match given.iter().find(|(given, _)| *given) {
        None => Ok(()),
        Some((_, option)) => Err(Failure::Arguments(reason!(
            "one-eye-option",
            "{option} is for content of one eye, and the display has two panels. Leave it out"
        ))),
    }
}

/// Returns the content of the left and the right eye.
fn content(args: &Show, left: &SubjectOptions, two: &TwoEyes) -> Result<Content, Failure> {
    match args.what.as_slice() {
        #[cfg(target_os = "linux")]
        [first, command @ ..] if first == "openxr" => Ok(Content::OpenXr(command.to_vec())),
        [left, right] if is_phases(left) && is_phases(right) => Ok(Content::Each([left.clone(), right.clone()])),
        [scene] if !is_phases(scene) => {
            if let Some(name) = scene.strip_prefix("live:") {
                return Ok(Content::Application(name.into()));
            }
            let display = common::display(&left.display)?;
            let colors = common::colors(&left.display, &display)?;
            let scenes = common::scene_of_eyes(&SceneArgs::new(scene, &left.options), &display, &colors, two.eyes())?;
            let is_drawn = args.live.tracker().is_some() && scene::is_splats(scene);
            Ok(if is_drawn { Content::Splats(scenes) } else { Content::Each(scenes) })
        }
        _ => Err(Failure::Arguments(reason!(
            "content-of-two-eyes",
            "two panels show one scene, one application, or two holograms, the one of the left eye first"
        ))),
    }
}

/// Returns the output for both panels.
fn output(args: &Show, two: &TwoEyes, simulated: bool) -> Output {
    let asked = &args.live.shown.output;
    if two.places.are_halves() || !asked.is_shown() {
        return asked.output(simulated);
    }
    let [left, right] = asked.of_two();
    let of = |one: OutputTo| Box::new(one.output(simulated));
    Output::Pair { left: of(left), right: of(right) }
}

fn options(args: &Show) -> SessionOptions {
    let mut options = args.live.shown.options();
    options.duration = args.live.duration.map(|s| Duration::from_secs_f64(s.min(1e9)));
    (options.record, options.trace) = (args.live.record.clone(), args.live.trace.clone());
    options
}

/// Content of both eyes, with the depths that each eye may focus at.
type Loaded = [(Steered, Option<[f64; 2]>); 2];

/// Loads the content of both eyes. A program that is started with it ends when the second value is dropped.
fn loaded(
    args: &Show,
    settings: &ShowSettings,
    subjects: &[SubjectOptions; 2],
    content: &Content,
    stage: &Stage,
) -> Result<(Loaded, Option<Box<dyn Any>>), Failure> {
    let stated = |steered: Steered| {
        let depths = args.subject.options.depth_before(steered.encoder.display());
        (steered, depths)
    };
    let application = |settings: &ShowSettings, name: &str| {
        let both = application::of_two_eyes(args, settings, name, subjects, stage)?;
        Ok::<Loaded, Failure>(both.map(stated))
    };
    match content {
        Content::Splats(scenes) => {
            let both = walk::of_two_eyes(args, scenes, subjects, stage)?;
            Ok((both.map(|(steered, depths)| (steered, Some(depths))), None))
        }
        Content::Each(each) => {
            let load = |eye: usize| {
                subject::load(&each[eye], &subjects[eye], (None, args.stream.looped), &stage.engines).map(stated)
            };
            Ok(([load(0)?, load(1)?], None))
        }
        Content::Application(name) => Ok((application(settings, name)?, None)),
        #[cfg(target_os = "linux")]
        Content::OpenXr(command) => {
            let mut program = openxr::Program::new(command)?;
            let both = application(&openxr::settings_of(settings.clone()), openxr::NAME)?;
            program.start()?;
            Ok((both, Some(Box::new(program))))
        }
    }
}

/// Shows content that is refined for the pupils of both eyes.
fn refined(
    args: &Show,
    settings: &ShowSettings,
    two: &TwoEyes,
    subjects: &[SubjectOptions; 2],
    content: &Content,
) -> Result<(), Failure> {
    let cost = content::refined(args, settings)?;
    content::endless_needs_duration(args, cost, true)?;
    let stage = Stage::open(&args.subject, &args.live)?;
    let (both, _program) = loaded(args, settings, subjects, content, &stage)?;
    let [(left, left_depths), (right, right_depths)] = both;
    let both = [left, right];
    let engine = both[0].engine.clone();
    eprintln!("{}, {engine}", about(&both));
    let trackings = trackings(args, two, &both, cost)?;
    let [left, right] = both;
    let [of_left, of_right] = trackings;
    let prepare = |steered: Steered, depths, tracking| -> Result<Refined, Failure> {
        common::say_model_age(steered.encoder.display());
        let policy = args.subject.experiment.policy()?;
        let (kept, settings) = (KeptSession::default(), settings.clone());
        let showing =
            ShowOptions { policy, tracker: args.live.tracker(), simulated: cost, depths, kept, settings, walk: None };
        tracked::refined(steered, Some(tracking), None, &stage.engines, &args.live, showing)
    };
    let (left, right) = (prepare(left, left_depths, of_left)?, prepare(right, right_depths, of_right)?);
    let focal_length = left.hologram.focal_length;
    let shown = left.hologram.clone();
    let mut options = options(args);
    options.gpu = stage.gpu();
    let session = TwoEyed::live(left.live, right.live, two.stereo, two.places);
    let ended = run(args, session, output(args, two, cost.is_some()), options, |now, before, seconds| {
        tracked::line(now, before, seconds, focal_length)
    })?;
    tracked::summary(&ended.statistics, focal_length);
    keep_powers(&shown, args.live.record.as_deref())?;
    let focus = ended.statistics.live.as_ref().and_then(|live| live.focus);
    let focus = focus.map(|depths| depths.map(|z| dioptres(z, focal_length)));
    finish(args, ended, &json!({ "engine": engine, "focus_dioptres": focus }))
}

/// Opens the tracker of both eyes.
fn trackings(
    args: &Show,
    two: &TwoEyes,
    both: &[Steered; 2],
    cost: Option<Cost>,
) -> Result<[eyebox::low_level::session::Tracking; 2], Failure> {
    let eyepieces = both.each_ref().map(tracked::eyepiece);
    let reach = both[0].hologram.made_for().map_or(0.0, |display| display.eyebox_min() / 2.0);
    let tracker = args.live.tracker().unwrap_or("simulated");
    tracking_of_two(tracker, &args.live.tracker, cost.is_none(), eyepieces, reach, two.ipd)
}

/// Shows holograms of both eyes as they were solved.
fn played(
    args: &Show,
    settings: &ShowSettings,
    two: &TwoEyes,
    subjects: &[SubjectOptions; 2],
    content: &[String; 2],
) -> Result<(), Failure> {
    let (shown, stream) = (&args.live.shown, &args.stream);
    let mut sequences = Vec::with_capacity(2);
    if is_phases(&content[0]) {
        for (name, subject) in content.iter().zip(subjects) {
            let path = Path::new(name);
            content::nothing_is_solved(args, path)?;
            let display = content::display_for(subject, Some(path))?;
            let color = subject.display.color.one();
            let opening =
                Opening { unfinished: args.unfinished.unfinished, ..subject.unit.opening(Some(&display), color) };
            sequences.push((opening.sequence(path).map_err(|e| args.unfinished.failure(e))?, display));
        }
    } else {
        let stage = Stage::open(&args.subject, &args.live)?;
        for (scene, subject) in content.iter().zip(subjects) {
            let (hologram, _, display) = subject::solved(scene, subject, &stage.engines)?;
            sequences.push((Sequence::single(Path::new(scene), hologram), display));
        }
    }
    let mut plays = Vec::with_capacity(2);
    for (sequence, display) in sequences {
        common::say_model_age(&display);
        plays.push(playback::content(sequence, &display, stream, settings)?);
    }
    let (Some(right), Some(left)) = (plays.pop(), plays.pop()) else { unreachable!("both eyes have content") };
    let mut options = options(args);
    let endless = left.looped && options.duration.is_none();
    let simulated = playback::is_simulated(shown, stream, &options, endless)?;
    if shown.output.is_shown() {
        options.gpu = Some(common::display_gpu(&args.subject.engine.device, shown.validation)?);
    }
    let (of_left, sub_frames) = (left.sequence.about().clone(), left.encoder.packed().slots.len() as u64);
    let session = TwoEyed::play(left, right, two.stereo, two.places);
    let ended = run(args, session, output(args, two, simulated), options, |now, before, seconds| {
        playback::line(now, before, seconds, sub_frames)
    })?;
    playback::summary(&ended.statistics);
    keep_powers(&of_left, args.live.record.as_deref())?;
    finish(args, ended, &json!({}))
}

/// Runs the session until it ends.
fn run(
    args: &Show,
    content: TwoEyed,
    output: Output,
    options: SessionOptions,
    line: impl Fn(&Status, &Status, f64) -> String,
) -> Result<Ended, Failure> {
    let stats = args.live.stats.as_deref();
    stats.iter().try_for_each(|file| eyebox::low_level::files::check_place(file))?;
    progress::catch_interrupt();
    let session = Session::start(content, output, options)?;
    let shown = session.about();
    eprintln!("{}: {:.2} sets a second for each eye", shown.presenter, shown.sets_per_second());
    Ok(attend(session, stats, line))
}

fn finish(args: &Show, ended: Ended, more: &Value) -> Result<(), Failure> {
    if let Some(report) = &ended.statistics.two_eyes {
        eprintln!("{}", line_of(report));
    }
    conclude(ended, (args.live.stats.as_deref(), args.live.json), more)
}

fn line_of(report: &TwoEyesReport) -> String {
    let TwoEyesReport { stereo, video_frames, differing, apart, .. } = report;
    let rule = if *stereo == Stereo::Together { "together" } else { "independent" };
    let lights = apart.map_or(String::new(), |apart| {
        format!(
            ", and the panels lit {:.2} ms apart (at most {:.2} ms), {} of {} in other video frames",
            apart.mean_ms(),
            apart.largest_ms(),
            apart.in_other_periods,
            apart.video_frames
        )
    });
    format!("two eyes, {rule}: {differing} of {video_frames} video frames had sets of different times{lights}")
}

fn about(both: &[Steered; 2]) -> String {
    let name = |steered: &Steered| {
        let Hologram { scene, height, width, .. } = &steered.hologram;
        format!("{scene} ({height}x{width})")
    };
    format!("left eye {}, right eye {}", name(&both[0]), name(&both[1]))
}
