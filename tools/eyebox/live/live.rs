//! `eyebox live`: a hologram on a display, refined for where the eye is while it is shown.

use super::args::PolicyArgs;
use super::record::Record;
use super::subject::{self, SubjectArgs};
use super::viewing::Viewing;
use super::watching::{self, TrackerArgs, Watching};
use crate::play::{OutputArgs, OutputName, checked, lost};
use crate::values::{not_negative, positive};
use crate::{Failure, common, progress};
use clap::Args;
use eyebox::files;
use eyebox::gpu::Gpu;
use eyebox::live::{self, Beat, BeatCell, Latency, LiveOptions, LiveSource, Stage, Steerer, Watch};
use eyebox::optics::Pupil;
use eyebox::playback::{Flow, Lane, Player, Report, Schedule, Scheduler, Source, Speed, Start, Trace};
use eyebox::present::{Clock, Desktop, DisplayPresenter, Offscreen, Presenter, Rate, RealClock, SECOND_NS};
use eyebox::trackers::simulated;
use serde_json::{Value, json};
use std::collections::VecDeque;
use std::io::{IsTerminal, Write};
use std::path::PathBuf;
use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

/// Spans that a trace keeps for each thread.
const SPANS: usize = 1 << 19;

/// `eyebox live`
#[derive(Args)]
pub struct Live {
    /// What is shown
    #[command(flatten)]
    pub subject: SubjectArgs,
    /// Who looks
    #[command(flatten)]
    pub tracker: TrackerArgs,
    /// Where
    #[command(flatten)]
    pub shown: OutputArgs,
    /// From a video frame's beginning to its light, ms
    #[arg(long, value_name = "MS", default_value_t = 0.0, value_parser = not_negative)]
    pub display_latency: f64,
    /// Seconds to go on for [default: until ctrl-C]
    #[arg(long, value_name = "S", value_parser = positive)]
    pub duration: Option<f64>,
    /// Show the hologram for the whole eyebox: what there is without steering
    #[arg(long)]
    pub unsteered: bool,
    /// Show in a window what the tracked eye sees; there the key s switches steering off and on
    #[arg(long)]
    pub view: bool,
    /// How it follows
    #[command(flatten)]
    pub policy: PolicyArgs,
    /// What was shown, and how late, as JSON
    #[arg(long, value_name = "FILE.json")]
    pub stats: Option<PathBuf>,
    /// Keep the pictures of new sets as PNG, as many as the disk takes, and when they were shown, in a new folder
    #[arg(long, value_name = "DIR")]
    pub record: Option<PathBuf>,
    /// What each thread did when, for chrome://tracing
    #[arg(long, value_name = "FILE.json")]
    pub trace: Option<PathBuf>,
}

/// Shows, follows, and says how it went.
pub fn run(args: &Live) -> Result<(), Failure> {
    let steered = subject::load(&args.subject)?;
    let clock = RealClock::start();
    let frames = steered.encoder.frames();
    let size = [frames.height, frames.width];
    let beside = || if args.view { Desktop::open().map(|d| Some(Box::new(d))) } else { Ok(None) };
    let (mut heard, mut gpu) = (Vec::new(), None);
    let mut output = match args.shown.output {
        OutputName::Window => {
            let desktop = Desktop::open()?;
            let monitor = desktop.choose(args.shown.monitor.as_deref(), size)?;
            let window =
                desktop.fullscreen(gpu.insert(common::display_gpu(args.shown.validation)?), &monitor, clock)?;
            Output::Window(Box::new(window))
        }
        OutputName::Direct => {
            let (display, _, messages) = args.shown.wanted(size).open(clock)?;
            heard.push(messages);
            Output::Other(display, beside()?)
        }
        OutputName::Offscreen => {
            let rate = args.shown.display_rate.map_or_else(|| Rate::new(60, 1), Ok)?;
            Output::Other(Box::new(Offscreen::new(Rc::new(clock), rate, frames.frame_bytes())), beside()?)
        }
    };
    if args.view && gpu.is_none() {
        gpu = Some(common::display_gpu(args.shown.validation)?);
    }
    heard.extend(gpu.as_ref().map(Gpu::messages));
    let shown = show(args, steered, clock, &mut output, gpu.as_ref());
    drop((output, gpu));
    heard.iter().fold(shown, |shown, messages| checked(shown, messages))
}

/// Where video frames go, and the desktop that other windows stand on.
enum Output {
    Window(Box<DisplayPresenter>),
    Other(Box<dyn Presenter>, Option<Box<Desktop>>),
}

impl Output {
    fn presenter(&mut self) -> &mut dyn Presenter {
        match self {
            Self::Window(window) => window.as_mut(),
            Self::Other(presenter, _) => presenter.as_mut(),
        }
    }

    fn desktop(&mut self) -> Option<&mut Desktop> {
        match self {
            Self::Window(window) => window.desktop(),
            Self::Other(_, desktop) => desktop.as_deref_mut(),
        }
    }

    /// Events of windows beside the display; a window of its own takes them while it is asked for its own.
    fn pump(&mut self) -> Result<(), Failure> {
        match self {
            Self::Other(_, Some(desktop)) => desktop.pump_for(Duration::ZERO).map_err(|e| lost(e.into())),
            _ => Ok(()),
        }
    }
}

fn show(
    args: &Live,
    steered: subject::Steered,
    clock: RealClock,
    output: &mut Output,
    gpu: Option<&Gpu>,
) -> Result<(), Failure> {
    let display_rate = args.shown.display_rate.or(output.presenter().rate()).map_or_else(|| Rate::new(60, 1), Ok)?;
    let trace = Trace::new(if args.trace.is_some() { SPANS } else { 0 });
    let planes = (steered.colors.len() * steered.hologram.frames) as u64;
    let set_frames = steered.encoder.packed().video_frames as u64;
    let period_ns = display_rate.time_of_ns(i64::try_from(set_frames).unwrap_or(i64::MAX));
    let idle = steered.encoder.frames();
    let size = [idle.height, idle.width, idle.channels];
    let Watching { watch, mut truth, mouse, about } = watching::start(&args.tracker, args.view, trace.lane("gaze"))?;
    let watch = Arc::new(watch);
    let policy = args.policy.policy();
    let (parts, mut engines) = (steered.parts.clone(), common::opener(&args.subject.engine)?);
    let mut begin = move || Steerer::new(parts.clone(), policy, &mut engines);
    let steerer = begin()?;
    let set_rate = display_rate.hz() / set_frames as f64;
    eprintln!(
        "{}: {} sub-frames of {} colours, {}x{}; {}",
        steered.hologram.scene,
        steered.hologram.frames,
        steered.colors.len(),
        steered.hologram.height,
        steered.hologram.width,
        steered.engine
    );
    eprintln!("{about}; {}: {set_rate:.2} sets a second", output.presenter().describe());
    let beat = Arc::new(BeatCell::new(period_ns, Beat::usual_lead_ns(period_ns)));
    let light_after = Duration::from_nanos(period_ns.unsigned_abs() / 2)
        + Duration::from_secs_f64((args.display_latency * 1e-3).min(10.0));
    let options = LiveOptions {
        clock,
        beat: Arc::clone(&beat),
        light_after,
        steered: !args.unsteered,
        with_phases: args.view,
        again: Box::new(begin),
        lane: trace.lane("refine"),
    };
    let mut viewing = match output.desktop().zip(gpu).filter(|_| args.view) {
        Some((desktop, gpu)) => Some(Viewing::open(gpu, desktop, &steered, &args.subject.engine, mouse)?),
        None => None,
    };
    let (live, mut source) = live::start(steerer, steered.encoder, Arc::clone(&watch), options)?;
    let content_rate = Rate::new(1_000_000_000, u32::try_from(period_ns).unwrap_or(u32::MAX))?;
    let start = Start::WhenReady { idle_sets: 4_u64.div_ceil(set_frames) };
    let speed = Speed::new(1.0).ok_or_else(|| Failure::Asked("no speed".into()))?;
    let schedule = Schedule { display_rate, content_rate, speed, set_frames, start, keep_phase: false };
    let mut record = args.record.as_deref().map(|folder| Record::start(folder, size)).transpose()?;
    progress::catch_interrupt();
    let shared_clock: Rc<dyn Clock> = Rc::new(clock);
    let mut player = Player::new(shared_clock, Scheduler::new(schedule), idle, trace.lane("present"));
    let mut account = Account::new(clock, light_after, watch);
    let begun_ns = clock.now_ns();
    let until_ns = args.duration.map(|s| begun_ns.saturating_add((s * SECOND_NS as f64) as i64));
    let mut status = Status::new();
    let ended = loop {
        let mut began = None;
        let ticked = player.tick(output.presenter(), &mut source, &mut |moment| {
            if moment.video_frame == 0 {
                began = Some(moment.predicted_display_time_ns);
            }
            if let Some(record) = &mut record {
                record.add(moment);
            }
            Ok(())
        });
        match ticked {
            Ok(Flow::Continue) => {}
            Ok(Flow::Ended) => break Ok("the end"),
            Ok(Flow::Closed) => break Ok("closed"),
            Err(error) => break Err(error),
        }
        if let Some(view) = &mut viewing {
            let pupil = account.now();
            view.look(Pupil { depth: args.tracker.focus * 1e-3, ..pupil });
            let note = format!("{:.0} sets a second", set_rate);
            match output.pump().and_then(|()| view.tend(&live, &note)) {
                Ok(true) => {}
                Ok(false) => break Ok("closed"),
                // A view is not worth the display.
                Err(error) => {
                    eprintln!("note: {error}; the display goes on");
                    viewing = None;
                }
            }
        }
        if let Some(start_ns) = began {
            beat.decided(start_ns, source.asked().map_or(start_ns, |at| clock.at_ns(at)));
            account.set(&mut source, start_ns, viewing.as_mut());
        }
        account.look_back(&mut truth);
        let notes = std::iter::from_fn(|| source.message()).chain(std::iter::from_fn(|| account.watch.note()));
        for note in notes {
            status.clear();
            eprintln!("note: {note}");
        }
        if until_ns.is_some_and(|until| clock.now_ns() >= until) {
            break Ok("the duration");
        }
        if progress::interrupted() {
            break Ok("ctrl-C");
        }
        status.show(&account, &source, live.counts(), clock.now_ns() - begun_ns);
    };
    status.clear();
    let how = *ended.as_ref().unwrap_or(&"an error");
    let ended = player.end(output.presenter(), ended);
    let seconds = (clock.now_ns() - begun_ns) as f64 / 1e9;
    let report = Report::new(player.scheduler(), player.timing(), seconds, planes);
    let ([new, repeated], counts) = (source.counts(), live.counts());
    account.summary(&report, how, [new, repeated], counts);
    let mut lanes: Vec<Lane> = vec![player.into_lane()];
    lanes.extend(live.stop());
    if let Some(mut watch) = Arc::into_inner(account.watch) {
        lanes.extend(watch.stop());
    }
    if let Some(file) = &args.trace {
        Trace::write(file, &lanes)?;
    }
    if let Some(file) = &args.stats {
        let all = json!({
            "playback": report.to_json(), "ended_by": how, "presenter": output.presenter().describe(), "tracker": about,
            "engine": steered.engine, "sets_new": new, "sets_repeated": repeated, "steps": counts[1],
            "restarts": counts[0], "latency": account.latency.to_json(), "policy": policy,
            "peak_memory_mib": common::peak_memory_mib(), "memory_mib": memory(),
        });
        files::write_file(file, |out| writeln!(out, "{all:#}"))?;
    }
    if let Some(record) = record {
        let left_out = record.finish()?;
        if left_out > 0 {
            eprintln!("note: {left_out} pictures were not kept: the disk was slower than the display");
        }
    }
    ended.map(drop).map_err(lost)
}

fn memory() -> Value {
    json!(common::memory_kib("VmRSS").map(|kib| kib / 1024))
}

/// What becomes of every set.
struct Account {
    clock: RealClock,
    light_after_ns: i64,
    watch: Arc<Watch>,
    latency: Latency,
    pupil: Option<[f64; 2]>,
    /// Lights whose pupil is not known yet: time on the trackers' clock, where it was expected.
    open: VecDeque<(u64, [f64; 2])>,
}

/// Lights that wait for the tracker at most.
const OPEN: usize = 256;

impl Account {
    fn new(clock: RealClock, light_after: Duration, watch: Arc<Watch>) -> Self {
        let light_after_ns = i64::try_from(light_after.as_nanos()).unwrap_or(i64::MAX);
        let open = VecDeque::with_capacity(OPEN);
        Self { clock, light_after_ns, watch, latency: Latency::default(), pupil: None, open }
    }

    /// A set begins to be lit at `start_ns`.
    fn set(&mut self, source: &mut LiveSource, start_ns: i64, viewing: Option<&mut Viewing>) {
        let light_ns = start_ns.saturating_add(self.light_after_ns);
        if let Some(made) = source.newly_shown() {
            self.latency.shown(&made.stamps, self.clock.now_ns(), light_ns);
            self.pupil = made.stamps.sample_ns.map(|_| made.pupil);
            if let Some(viewing) = viewing {
                viewing.made(made);
            }
        }
        if let Some(pupil) = self.pupil {
            if self.open.len() == OPEN {
                self.open.pop_front();
            }
            self.open.push_back((self.clock.monotonic_ns(light_ns), pupil));
        }
    }

    /// The pupil as it is believed to be now.
    fn now(&self) -> Pupil {
        let seen = self.watch.expect(self.clock.monotonic_ns(self.clock.now_ns())).pupil;
        let diameter = 0.5 * (seen.diameter[0] + seen.diameter[1]);
        Pupil { x: seen.centre[0], y: seen.centre[1], diameter, depth: 0.0 }
    }

    /// Where the pupil was at lights that have passed: truly, for a simulated eye, else as it was measured.
    fn look_back(&mut self, truth: &mut Option<simulated::Eye>) {
        let now = self.clock.monotonic_ns(self.clock.now_ns());
        while let Some((light, expected)) = self.open.front().copied() {
            let position = match truth {
                Some(eye) if light <= now => {
                    let truth = eye.at(light);
                    (truth.lid > 0.5).then_some(truth.position)
                }
                None if self.watch.reaches(light) => self.watch.measured(light),
                None if now.saturating_sub(light) > 2_000_000_000 => None,
                _ => return,
            };
            self.open.pop_front();
            if let Some([x, y]) = position {
                self.latency.missed_by((x - expected[0]).hypot(y - expected[1]));
            }
        }
    }

    fn summary(&self, report: &Report, how: &str, [new, repeated]: [u64; 2], [restarts, steps]: [u64; 2]) {
        let a = &report.account;
        eprintln!(
            "ended by {how} after {:.2} s: {} sets, {new} of them new and {repeated} shown again; {} missed presents; jitter {:.3} ms",
            report.seconds,
            a.sets - a.idle_sets,
            a.missed_presents,
            report.timing.jitter_ms()
        );
        let at = |h: &live::Histogram, share| h.percentile(share).map_or("-".into(), |v| format!("{v:.2}"));
        let light = self.latency.of(Stage::SampleToLight);
        eprintln!(
            "{steps} steps, {restarts} beginnings; sample to light {} ms (half), {} ms (99 of 100); pupil missed by {} mm (half), {} mm (90 of 100)",
            at(light, 0.5),
            at(light, 0.99),
            at(self.latency.error_mm(), 0.5),
            at(self.latency.error_mm(), 0.9)
        );
    }
}

/// The line that is written over.
struct Status {
    last_ns: i64,
    before: [u64; 2],
    shown: bool,
    terminal: bool,
}

impl Status {
    fn new() -> Self {
        Self { last_ns: 0, before: [0; 2], shown: false, terminal: std::io::stderr().is_terminal() }
    }

    fn show(&mut self, account: &Account, source: &LiveSource, [_, steps]: [u64; 2], now_ns: i64) {
        let passed = now_ns - self.last_ns;
        if !self.terminal || passed < SECOND_NS / 2 {
            return;
        }
        let seconds = passed as f64 / 1e9;
        let [new, _] = source.counts();
        let at = |h: &live::Histogram| h.percentile(0.5).map_or("-".into(), |v| format!("{v:.2}"));
        let mut out = std::io::stderr().lock();
        let _ = write!(
            out,
            "\r\x1b[K{:.1} new sets/s, {:.0} steps/s, sample to light {} ms, pupil missed by {} mm",
            (new - self.before[0]) as f64 / seconds,
            (steps - self.before[1]) as f64 / seconds,
            at(account.latency.of(Stage::SampleToLight)),
            at(account.latency.error_mm())
        );
        let _ = out.flush();
        (self.last_ns, self.before, self.shown) = (now_ns, [new, steps], true);
    }

    fn clear(&mut self) {
        if self.shown {
            eprint!("\r\x1b[K");
            self.shown = false;
        }
    }
}
