//! `eyebox show --tracker` refines the hologram on the display for the tracked pupil while it is shown.

use super::args::{OutputArgs, ShowSettings};
use super::tracking::{TrackerArgs, tracking};
use super::viewing::Viewing;
use crate::common::{self, Engines};
use crate::progress::JobBar;
use crate::show::session::{attend, conclude, ended_by, keep_powers};
use crate::subject::{Steered, SubjectOptions};
use crate::values::{S, positive_in};
use crate::{Failure, progress};
use clap::Args;
use eyebox::low_level::encode;
use eyebox::low_level::gaze::Eyepiece;
use eyebox::low_level::gpu::{Gpu, Options as VulkanOptions};
use eyebox::low_level::hologram::{Hologram, Unfinished};
use eyebox::low_level::optics::{Color, Display, depth_in_words, depths_in_words, dioptres};
use eyebox::low_level::reason;
use eyebox::low_level::session::{
    self, Cost, FrameFreshness, Histogram, LitSources, LiveStatistics, Policy, RepeatReason, Session, SidecarOpener,
    SourceSwitch, Stage as Part, Statistics, Status, Tracking, WalkHandle,
};
use eyebox::low_level::solve::Flow;
use serde_json::{Map, Value, json};
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The options of a hologram that is refined for the tracked pupil.
#[derive(Args)]
pub struct LiveOptions {
    #[command(flatten)]
    pub tracker: TrackerArgs,
    #[command(flatten)]
    pub shown: OutputArgs,
    /// Stop after this time, s [default: on ctrl-C, or at the end of the content]
    #[arg(help_heading = "Time", long, value_name = "S", value_parser = positive_in(S))]
    pub duration: Option<f64>,
    /// Show the hologram for the whole eyebox, without pupil steering
    #[arg(help_heading = "Steps", long)]
    pub unsteered: bool,
    /// Show in a window the image that the tracked eye sees. Without --tracker the mouse in that window is the eye.
    /// The key s switches the refinement off and on
    #[arg(help_heading = "Window", long)]
    pub view: bool,
    /// Statistics of the shown frames and their latency, as JSON
    #[arg(help_heading = "Output", long, value_name = "OUT.json")]
    pub stats: Option<PathBuf>,
    /// One JSON object on standard output, as in --stats
    #[arg(help_heading = "Output", long)]
    pub json: bool,
    /// Keep the pictures of new sets as PNG, as many as the disk takes, and their times, in a new folder. On a
    /// simulated clock, all of them are kept
    #[arg(help_heading = "Output", long, value_name = "OUT_DIR")]
    pub record: Option<PathBuf>,
    /// Trace of the work of each thread for chrome://tracing
    #[arg(help_heading = "Output", long, value_name = "OUT.json")]
    pub trace: Option<PathBuf>,
}

impl LiveOptions {
    /// Returns the tracker, which is the mouse in the window with `--view` alone.
    pub fn tracker(&self) -> Option<&str> {
        self.tracker.tracker.as_deref().or(self.view.then_some("mouse"))
    }
}

/// The folder that keeps a session, or that has a session to show again.
#[derive(Default)]
pub struct KeptSession {
    /// A new folder for this session.
    pub journal: Option<PathBuf>,
    /// The folder of an earlier session.
    pub replay: Option<PathBuf>,
}

/// The options for showing refined content, besides the options of all content.
pub struct ShowOptions<'a> {
    /// The settings of the refinement, and the condition for its restart.
    pub policy: Policy,
    /// The tracker, if an eye is tracked.
    pub tracker: Option<&'a str>,
    /// The cost of work on a simulated clock, or None on the clock of the system.
    pub simulated: Option<Cost>,
    /// Depths at which eyes may focus without a tracker, meters. None is the range that the hologram was solved for.
    pub depths: Option<[f64; 2]>,
    pub kept: KeptSession,
    /// The table `show` of the settings.
    pub settings: ShowSettings,
    /// The camera in front of splats, which the window of `--view` moves.
    pub walk: Option<WalkHandle>,
}

/// The engines and the device of a session.
pub struct Stage {
    pub engines: Engines,
    gpu: Option<Gpu>,
}

impl Stage {
    /// Returns the device that shows, if the session needs one.
    pub fn gpu(&self) -> Option<Gpu> {
        self.gpu.clone()
    }

    /// Opens the engines, and the device if the session needs one.
    pub fn open(how: &SubjectOptions, live: &LiveOptions) -> Result<Self, Failure> {
        let shows = live.view || live.shown.output.is_shown();
        let vulkan = VulkanOptions { present: shows, validation: live.shown.validation, ..VulkanOptions::default() };
        let engines = Engines::new(&how.engine, &vulkan)?;
        let gpu = match engines.gpu()? {
            None if shows => Some(common::display_gpu(&how.engine.device, live.shown.validation)?),
            gpu => gpu,
        };
        Ok(Self { engines, gpu })
    }
}

/// Shows refined content and prints the statistics.
pub fn show(steered: Steered, args: &LiveOptions, showing: ShowOptions<'_>, stage: Stage) -> Result<(), Failure> {
    let Stage { engines, gpu } = stage;
    let ShowOptions { policy, tracker, simulated, depths, kept, settings, walk } = showing;
    let eyepiece = eyepiece(&steered);
    let (mouse, tracking) = match tracker {
        None => (None, None),
        Some(tracker) => {
            let real = simulated.is_none();
            let reach = steered.hologram.made_for().map_or(0.0, |display| display.eyebox_min() / 2.0);
            let (mouse, tracking) = tracking(tracker, &args.tracker, args.view, real, eyepiece, reach)?;
            (mouse, Some(tracking))
        }
    };
    let about = tracking.as_ref().map_or("no eye tracker".into(), Tracking::describe);
    eprintln!(
        "{}: {} of {}, {}x{}; {}",
        steered.scenes.as_ref().map_or_else(|| steered.hologram.scene.clone(), |scenes| scenes.describe()),
        common::counted(steered.hologram.frames, "sub-frame"),
        common::counted(steered.colors.len(), "color"),
        steered.hologram.height,
        steered.hologram.width,
        steered.engine
    );
    let sidecar_window = match gpu.clone().filter(|_| args.view) {
        Some(_) if steered.field.is_some() => {
            return Err(Failure::Arguments(reason!(
                "view-of-tiles",
                "--view shows whole holograms, and a far field in tiles has none"
            )));
        }
        Some(gpu) => Some(Viewing::new(&steered, engines.opener(), mouse, walk)?.opener(gpu)),
        None => None,
    };
    let Refined { live, hologram, display, sent, engine, unfinished } = refined(
        steered,
        tracking,
        sidecar_window,
        &engines,
        args,
        ShowOptions { policy, tracker, simulated, depths, kept, settings, walk: None },
    )?;
    let mut options = args.shown.options();
    options.gpu = gpu;
    options.duration = args.duration.map(|s| Duration::from_secs_f64(s.min(1e9)));
    (options.record, options.trace) = (args.record.clone(), args.trace.clone());
    args.stats.iter().try_for_each(|file| eyebox::low_level::files::check_place(file))?;
    progress::catch_interrupt();
    let session = Session::start(live, args.shown.output.output(simulated.is_some()), options)?;
    let shown = session.about();
    let roll = if shown.rolls { ", which roll" } else { "" };
    eprintln!("{about}; {}: {:.2} sets a second{roll}", shown.presenter, shown.sets_per_second());
    let slow = encode::flicker(&display, &sent, hologram.frames, shown.display_rate.hz());
    slow.inspect(|slow| tracing::warn!("{slow}"));
    let focal_length = hologram.focal_length;
    let ended = attend(session, args.stats.as_deref(), |now, before, seconds| line(now, before, seconds, focal_length));
    summary(&ended.statistics, focal_length);
    let focus = ended.statistics.live.as_ref().and_then(|live| live.focus);
    let focus = focus.map(|depths| depths.map(|z| dioptres(z, focal_length)));
    let memory = common::memory_kib("VmRSS").map(|kib| kib / 1024);
    keep_powers(&hologram, args.record.as_deref())?;
    let mut more = json!({ "engine": engine, "memory_mib": memory, "focus_dioptres": focus, "unfinished": unfinished });
    if let Some(joint) = &hologram.metadata.joint_color {
        more["joint_color"] = json!(joint);
    }
    conclude(ended, (args.stats.as_deref(), args.json), &more)
}

/// Content that is refined, with its hologram for the whole eyebox.
pub struct Refined {
    pub live: session::Live,
    pub hologram: Hologram,
    pub display: Display,
    /// The colors that are sent to the display.
    pub sent: Vec<Color>,
    /// The name of the engine.
    pub engine: String,
    pub unfinished: Option<Unfinished>,
}

/// Prepares content for a session, with the settings of the command.
pub fn refined(
    steered: Steered,
    tracking: Option<Tracking>,
    sidecar_window: Option<SidecarOpener>,
    engines: &Engines,
    args: &LiveOptions,
    showing: ShowOptions<'_>,
) -> Result<Refined, Failure> {
    let ShowOptions { policy, simulated, depths, kept, settings, .. } = showing;
    let Steered { hologram, colors, parts, scenes, field, encoder, engine, unfinished } = steered;
    let (display, sent) = (encoder.display().clone(), encoder.colors().to_vec());
    let mut live = session::Live::new(parts, encoder, engines.source(), tracking);
    (live.policy, live.steered, live.sidecar_window) = (policy, !args.unsteered, sidecar_window);
    live.switch = settings.sources_out.as_deref().map(|file| switch(file, &colors)).transpose()?;
    live.display_latency = Duration::from_secs_f64((settings.display_latency * 1e-3).min(10.0));
    (live.journal, live.replay, live.whole_sets) = (kept.journal, kept.replay, settings.whole_sets);
    live.moments = settings.moments == super::args::Moments::On;
    if live.replay.is_some() {
        // A replay does not restart, as any session whose first scene has still to come.
        live.policy.restart = f64::INFINITY;
    }
    (live.scenes, live.field, live.cost) = (scenes, field, simulated.unwrap_or(Cost::Measured));
    let depths = depths.or(hologram.metadata.solve.as_ref().map(|solve| solve.depth));
    live.whole.focus = depths.unwrap_or(live.whole.focus);
    // The frames of an application have no phases, so tables give the first ones.
    if live.replay.is_some() || live.scenes.as_ref().is_some_and(|scenes| !scenes.begins_with_one()) {
        live = live.with_start_tables(&mut fitting())?;
    }
    Ok(Refined { live, hologram, display, sent, engine, unfinished })
}

/// Returns a switch that writes the sources that light each set to a file, by their numbers from 1.
fn switch(file: &Path, colors: &[Color]) -> Result<SourceSwitch, Failure> {
    let failed =
        |e: std::io::Error| Failure::Arguments(reason!("sources-out", "show.sources_out {}: {e}", file.display()));
    let mut out = File::options().write(true).create(true).truncate(true).open(file).map_err(failed)?;
    let (colors, name) = (colors.to_vec(), file.display().to_string());
    let mut told = false;
    Ok(Box::new(move |lit: &LitSources<'_>| {
        let numbers = |places: &Vec<usize>| places.iter().map(|at| at + 1).collect::<Vec<_>>();
        let sources: Map<String, Value> =
            colors.iter().zip(lit.colors).map(|(color, places)| (color.to_string(), json!(numbers(places)))).collect();
        let line = json!({ "set": lit.set, "start_ns": lit.start_ns, "sources": sources });
        if let Err(error) = writeln!(out, "{line}")
            && !std::mem::replace(&mut told, true)
        {
            tracing::warn!("sources_out {name}: {error}; the display continues");
        }
    }))
}

/// Returns a function that shows the share of the tables of first phases that is fitted.
pub fn fitting() -> impl FnMut(f64) -> bool {
    let bar = JobBar::new(true);
    move |share| bar.show("fitting first phases, once for this display", share) == Flow::Continue
}

/// Returns the eyepiece that converts a tracker's dioptres to depths before the hologram.
pub fn eyepiece(steered: &Steered) -> Eyepiece {
    let hologram = &steered.hologram;
    let depths = hologram.metadata.solve.as_ref().map_or([f64::NEG_INFINITY, f64::INFINITY], |s| s.depth);
    Eyepiece { focal_length: hologram.focal_length, depths }
}

pub fn summary(statistics: &Statistics, focal_length: f64) {
    let Some(live) = &statistics.live else { return };
    let (report, a) = (&statistics.report, &statistics.report.account);
    eprintln!(
        "ended by {} after {:.2} s: {} {}, {} of them new and {} shown again{}; {} missed presents; presents on time had a jitter of {:.3} ms",
        ended_by(statistics),
        report.seconds,
        a.sets - a.idle_sets,
        if live.rolls { "video frames of sets that roll" } else { "sets" },
        live.sets_new,
        live.sets_repeated,
        because(live),
        a.missed_presents,
        report.timing.jitter_ms()
    );
    let at = |h: &Histogram, share| h.percentile(share).map_or("-".into(), |v| format!("{v:.2}"));
    let light = live.latency.of(Part::SampleToLight);
    eprintln!(
        "{} steps, {} restarts; sample to light p50 {} ms, p99 {} ms; the newest sample {} ms old at its light; pupil error p50 {} mm, p90 {} mm{}",
        live.steps,
        live.restarts,
        at(light, 0.5),
        at(light, 0.99),
        live.latency.sample_age_ms().map_or("-".into(), |ms| format!("{ms:.0}")),
        at(live.latency.error_mm(), 0.5),
        at(live.latency.error_mm(), 0.9),
        live.focus.map_or(String::new(), |z| format!("; focused at {}", depths_in_words(z, focal_length)))
    );
    let Some(content) = &live.showing else { return };
    let sets: Vec<String> =
        FrameFreshness::ALL.iter().zip(content.sets).map(|(s, n)| format!("{n} {}", s.name())).collect();
    eprintln!(
        "{}: {} scenes taken and {} shown, {} refused; arrival to light p50 {} ms, p99 {} ms; content of the sets: {}",
        content.source,
        content.scenes,
        content.shown,
        content.refused,
        at(&content.arrival_to_light, 0.5),
        at(&content.arrival_to_light, 0.99),
        sets.join(", ")
    );
}

/// Returns the reasons for which sets were shown again, in words.
fn because(live: &LiveStatistics) -> String {
    let causes = RepeatReason::ALL.iter().zip(live.repeats).filter(|(_, n)| *n > 0);
    let causes: Vec<String> = causes.map(|(cause, n)| format!("{n} {}", cause.name())).collect();
    if causes.is_empty() { String::new() } else { format!(" ({})", causes.join(", ")) }
}

/// Returns the line that is updated while the content is shown.
pub fn line(now: &Status, before: &Status, seconds: f64, focal_length: f64) -> String {
    let (a, b) = (now.live.unwrap_or_default(), before.live.unwrap_or_default());
    let at = |value: Option<f64>| value.map_or("-".into(), |v| format!("{v:.2}"));
    format!(
        "{:.1} new sets/s, {:.0} steps/s, sample to light p50 {} ms, newest sample {} ms old, pupil error p50 {} mm, focus {}",
        (a.sets_new - b.sets_new) as f64 / seconds,
        (a.steps - b.steps) as f64 / seconds,
        at(a.sample_to_light_ms),
        a.sample_age_ms.map_or("-".into(), |ms| format!("{ms:.0}")),
        at(a.pupil_error_mm),
        a.focus.map_or("-".into(), |z| depth_in_words(z, focal_length))
    )
}
