//! Shows content of one eye, as it was solved or refined for the eye.

use super::args::{ClockName, ShowSettings, StreamArgs, WalkArgs};
use super::bench_follower::FollowArgs;
use super::playback;
use super::tracked::{self, LiveOptions, Stage};
use crate::Failure;
use crate::common;
use crate::phases::UnfinishedArgs;
use crate::solve::SolveProgress;
use crate::subject::{self, Steered, SubjectOptions};
use clap::Args;
use eyebox::low_level::hologram::{Phases, Sequence};
use eyebox::low_level::optics::Display;
use eyebox::low_level::produce::{SceneJob, SceneSolution, solve_scene};
use eyebox::low_level::reason;
use eyebox::low_level::session::Cost;
use eyebox::low_level::solve::Settings;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The arguments of `eyebox show`.
#[derive(Args)]
pub struct Show {
    /// NAME.zarr (a hologram, a sequence or a far field in tiles), bare phases, scenes, live:NAME, or openxr. Scenes
    /// are solved first, and several scenes or a folder of light-field folders become a sequence. With live:NAME, an
    /// application sends frames. With openxr -- ./application, eyebox starts an OpenXR application and shows its frames
    #[arg(required = true, value_name = "WHAT")]
    pub what: Vec<String>,
    #[command(flatten)]
    pub subject: SubjectOptions,
    #[command(flatten)]
    pub live: LiveOptions,
    #[command(flatten)]
    pub stream: StreamArgs,
    #[command(flatten)]
    pub unfinished: UnfinishedArgs,
    #[command(flatten)]
    pub follow: FollowArgs,
    #[command(flatten)]
    pub walk: WalkArgs,
    /// Sub-frames of live content, of scenes that follow each other, or of a scene with --camera [default: 8]
    #[arg(help_heading = "Quality", long, value_name = "N", value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(1..=64))]
    pub frames: Option<usize>,
    /// Keep the frames and decisions of live:NAME in a new folder, so that they can be shown again
    #[arg(help_heading = "Output", long, value_name = "OUT_DIR", conflicts_with = "replay")]
    pub journal: Option<PathBuf>,
    /// Show a journal of live:NAME again, byte for byte, on a simulated clock. The other options must be the same
    #[arg(help_heading = "Output", long, value_name = "DIR")]
    pub replay: Option<PathBuf>,
}

impl Show {
    /// Returns the number of sub-frames of content that is not solved yet.
    pub(super) fn frames(&self) -> Result<usize, Failure> {
        let of_settings = self.subject.experiment.given()?.get("frames")?;
        Ok(self.frames.or(of_settings).unwrap_or(Settings::default().frames))
    }
}

/// Refuses settings of solves and refinements for phases that are shown as they are.
pub(super) fn nothing_is_solved(args: &Show, path: &Path) -> Result<(), Failure> {
    let what = path.display().to_string();
    subject::refuse_quality(&what, &args.subject)?;
    let of_shows = |set: &&String| ["show.", "viewing."].iter().any(|table| set.starts_with(table));
    match args.subject.experiment.set.iter().find(|set| !of_shows(set)) {
        Some(set) => Err(Failure::Arguments(reason!(
            "settings-of-phases",
            "{set} is for content that is solved or refined, and {what} is shown as it was solved. Leave it out, or give --tracker"
        ))),
        None => Ok(()),
    }
}

pub(super) fn is_phases(what: &str) -> bool {
    !what.starts_with("builtin:") && subject::is_hologram(Path::new(what))
}

/// Loads the display. If no size is given, it has the size of the holograms in the file.
pub(super) fn display(args: &Show, file: Option<&Path>) -> Result<Display, Failure> {
    display_for(&args.subject, file)
}

/// Loads the display of these options, as [`display`] does.
pub(super) fn display_for(subject: &SubjectOptions, file: Option<&Path>) -> Result<Display, Failure> {
    let asked = &subject.display;
    let sequence = file.filter(|file| !Phases::are_at(file)).map(Sequence::open).and_then(Result::ok);
    let mut display = match &sequence {
        Some(shown) => common::display_of(asked.display.as_deref(), asked.size, asked.force, shown.about())?,
        None => common::display(asked)?,
    };
    subject.eye.replace(&mut display.prescription)?;
    if let (Some(sequence), None, Some(_)) = (&sequence, asked.size, &asked.display) {
        let [_, _, height, width] = sequence.shape();
        (display.height, display.width) = (height, width);
    }
    Ok(display)
}

/// Solves scenes that follow each other into a file. Each solve starts from the one before.
pub(super) fn solve(args: &Show, scenes: Vec<String>, file: &Path) -> Result<Display, Failure> {
    let display = display(args, None)?;
    let colors = common::colors(&args.subject.display, &display)?;
    let mut engine = common::engine(&args.subject.engine)?;
    let size = [display.height, display.width];
    let mut given = args.subject.experiment.given()?.before(display.focal_length)?;
    let frames = args.frames()?;
    given.insert("frames", Some(frames));
    let quality = args.subject.quality.with(&given)?;
    let chosen = quality.choose(engine.as_ref(), size, frames, colors.len())?.map(|chosen| chosen.settings);
    let settings = given.over(&given.with_quality(&Settings::default(), chosen.as_ref()))?;
    let rate = args.stream.rate.map_or([30, 1], eyebox::low_level::present::Rate::fraction);
    let mut job = SceneJob::new(&scenes[0], &display);
    job.scenes = scenes;
    job.colors = colors;
    job.reading = args.subject.options.reading(display.focal_length);
    job.force = args.subject.display.force;
    job.settings = settings;
    job.take_own(&given)?;
    job.sequence.rate = rate;
    let mut watch = SolveProgress::of_job(&job, engine.describe(), None, false);
    let solved = solve_scene(&job, Some(file), engine.as_mut(), &mut |event| watch.see(event))?;
    if let SceneSolution::Sequence(solved) = &solved
        && solved.done < solved.count
    {
        return Err(Failure::Arguments(reason!(
            "interrupted",
            "interrupted: {} of {} scenes were solved",
            solved.done,
            solved.count
        )));
    }
    Ok(display)
}

/// Shows holograms without a tracker, as they were solved.
pub(super) fn play(args: &Show, settings: &ShowSettings, sequence: Sequence, display: Display) -> Result<(), Failure> {
    kept_of_applications(args)?;
    common::say_model_age(&display);
    let refused = [
        (settings.step_time.is_some(), "show.step_time"),
        (args.live.unsteered, "--unsteered"),
        (settings.whole_sets, "show.whole_sets"),
        (settings.display_latency > 0.0, "show.display_latency"),
    ];
    if let Some((_, option)) = refused.iter().find(|(given, _)| *given) {
        return Err(Failure::Arguments(reason!(
            "without-tracker",
            "{option} is for content that is refined while it is shown. Give --tracker"
        )));
    }
    let mut options = args.live.shown.options();
    options.duration = args.live.duration.map(|s| Duration::from_secs_f64(s.min(1e9)));
    (options.record, options.trace) = (args.live.record.clone(), args.live.trace.clone());
    let device = &args.subject.engine.device;
    let engine = device.engine(args.subject.engine.engine)?;
    let (shown, stream) = (&args.live.shown, &args.stream);
    playback::play(playback::Playing {
        sequence,
        display,
        shown,
        settings,
        stream,
        engine,
        device,
        options,
        stats: args.live.stats.as_deref(),
        prints: args.live.json,
    })
}

/// Shows content with a tracker, refined for the eye.
pub(super) fn follow(args: &Show, settings: ShowSettings, what: &str) -> Result<(), Failure> {
    kept_of_applications(args)?;
    let cost = refined(args, &settings)?;
    if args.stream.rate.is_some() && subject::is_hologram(Path::new(what)) {
        // A sequence keeps its own rate.
        return Err(Failure::Arguments(reason!(
            "rate-with-tracker",
            "--rate is for playback. With --tracker a sequence keeps its own rate"
        )));
    }
    let endless = !Sequence::is_at(Path::new(what)) || args.stream.looped;
    endless_needs_duration(args, cost, endless)?;
    let stage = Stage::open(&args.subject, &args.live)?;
    let steered = subject::load(what, &args.subject, (None, args.stream.looped), &stage.engines)?;
    show(args, settings, steered, cost, stage)
}

pub(super) fn show(
    args: &Show,
    settings: ShowSettings,
    steered: Steered,
    cost: Option<Cost>,
    stage: Stage,
) -> Result<(), Failure> {
    common::say_model_age(steered.encoder.display());
    // A journal contains the samples of the tracker.
    let tracker = if args.replay.is_some() { None } else { args.live.tracker() };
    let kept = tracked::KeptSession { journal: args.journal.clone(), replay: args.replay.clone() };
    let depths = args.subject.options.depth_before(steered.encoder.display());
    let policy = args.subject.experiment.policy()?;
    tracked::show(
        steered,
        &args.live,
        tracked::ShowOptions { policy, tracker, simulated: cost, depths, kept, settings, walk: None },
        stage,
    )
}

/// Returns the cost of work on a simulated clock, and refuses options that refinement does not have.
pub(super) fn refined(args: &Show, settings: &ShowSettings) -> Result<Option<Cost>, Failure> {
    let stream = &args.stream;
    let given = [
        ((settings.speed - 1.0).abs() > 0.0, "show.speed"),
        (stream.follow, "--follow"),
        (stream.at > 0, "--at"),
        (stream.start_at.is_some(), "--start-at"),
        (settings.sync > 0.0, "show.sync"),
        (settings.mark > 0, "show.mark"),
        (settings.keep_phase, "show.keep_phase"),
    ];
    let refuse = |reason| Err(Failure::Arguments(reason));
    if let Some((_, option)) = given.iter().find(|(given, _)| *given) {
        return refuse(reason!("with-tracker", "{option} is for playback. Leave it out, or --tracker"));
    }
    let simulated = stream.clock == Some(ClockName::Simulated);
    if simulated && args.live.shown.output.is_shown() {
        return refuse(reason!("without-offscreen", "a simulated clock needs --output offscreen"));
    }
    let time = |ms: f64| Duration::from_secs_f64((ms * 1e-3).min(1e3));
    match (simulated, settings.step_time) {
        (true, Some(step)) => Ok(Some(Cost::Fixed { step: time(step), encode: time(settings.encode_time) })),
        (true, None) => {
            refuse(reason!("no-step-time", "a simulated clock needs the time of a step: --set show.step_time=MS"))
        }
        (false, Some(_)) => {
            refuse(reason!("step-time", "show.step_time is for a simulated clock. Add --clock simulated"))
        }
        (false, None) => Ok(None),
    }
}

pub(super) fn kept_of_applications(args: &Show) -> Result<(), Failure> {
    match args.journal.is_some() || args.replay.is_some() {
        true => Err(Failure::Arguments(reason!(
            "journal-without-live",
            "--journal and --replay are for live:NAME. Other content is the same in each run"
        ))),
        false => Ok(()),
    }
}

pub(super) fn endless_needs_duration(args: &Show, cost: Option<Cost>, endless: bool) -> Result<(), Failure> {
    match endless && cost.is_some() && args.live.duration.is_none() {
        true => Err(Failure::Arguments(reason!("endless", "a simulated clock would run forever. Give --duration"))),
        false => Ok(()),
    }
}
