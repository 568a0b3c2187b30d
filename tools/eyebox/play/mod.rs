//! `eyebox play`.

mod args;
mod monitors;

pub use args::{Monitors, OutputArgs, OutputName, Play};
pub use monitors::monitors;

use crate::Failure;
use crate::args::EngineName;
use crate::common;
use crate::progress;
use args::ClockName;
use eyebox::encode::{Encoder, PhaseSet};
use eyebox::files;
use eyebox::gpu::{Gpu, Options as GpuOptions};
use eyebox::hologram::Sequence;
use eyebox::optics::{Color, Display};
use eyebox::playback::{
    Clock, Desktop, Direct, Flow, Lane, Marks, Offscreen, Options, PlaybackError, Player, Presenter, Rate, RealClock,
    Recorder, Report, SECOND_NS, Schedule, Scheduler, SimulatedClock, Sink, Source, Speed, Start, Stream,
    StreamEncoder, Trace, sync_phases,
};
use serde_json::json;
use std::io::{IsTerminal, Write};
use std::rc::Rc;
use std::sync::{Arc, Mutex};
use std::time::{SystemTime, UNIX_EPOCH};

/// Spans that a trace keeps for each thread: half an hour at 120 Hz.
const SPANS: usize = 1 << 19;

/// What was opened before anything is shown.
struct Opened {
    display: Display,
    encoder: Encoder,
    sequence: Sequence,
    content_rate: Rate,
    display_rate: Rate,
}

/// Plays a hologram or a sequence, and says what was shown.
pub fn run(args: &Play) -> Result<(), Failure> {
    let opened = open(args)?;
    let simulated = match args.clock {
        Some(clock) => clock == ClockName::Simulated,
        None => args.record.is_some(),
    };
    if args.record.is_some() && !simulated {
        return Err(Failure::Asked("--record takes longer than a video frame: leave out --clock real".into()));
    }
    if args.start_at.is_some() && simulated {
        return Err(Failure::Asked("--start-at is a time of day, and a simulated clock has none".into()));
    }
    let endless = (args.looped || opened.sequence.is_single()) && args.duration.is_none();
    if endless && simulated {
        return Err(Failure::Asked("a simulated clock would go on for ever: give --duration".into()));
    }
    if args.shown.output != OutputName::Offscreen {
        if simulated || args.raw.is_some() || args.shared.is_some() {
            return Err(Failure::Asked(
                "--record, --raw, --shared and a simulated clock go with --output offscreen".into(),
            ));
        }
        return on_display(args, opened);
    }
    let clock: Rc<dyn Clock> = if simulated { Rc::new(SimulatedClock::default()) } else { Rc::new(RealClock::start()) };
    let frames = opened.encoder.frames();
    let size = [frames.height, frames.width, frames.channels];
    let sink = match (&args.raw, &args.shared) {
        (Some(file), _) => Some(Sink::raw(file)?),
        (None, Some(file)) => Some(Sink::shared(file, size)?),
        (None, None) => None,
    };
    let mut offscreen = Offscreen::new(Rc::clone(&clock), opened.display_rate, frames.frame_bytes()).with_sink(sink);
    play(args, opened, clock, &mut offscreen)
}

/// Plays in a window or on a display of its own.
fn on_display(args: &Play, mut opened: Opened) -> Result<(), Failure> {
    let clock = Rc::new(RealClock::start());
    let frames = opened.encoder.frames();
    let wanted = args.shown.wanted([frames.height, frames.width]);
    let (mut display, rate, messages) = wanted.open(Rc::clone(&clock))?;
    opened.display_rate = rate.unwrap_or(opened.display_rate);
    let played = play(args, opened, clock, &mut *display);
    drop(display);
    checked(played, &messages)
}

/// A display that is not memory.
pub struct Wanted<'a> {
    /// One that no desktop drives; else a window.
    pub direct: bool,
    /// Which.
    pub monitor: Option<&'a str>,
    /// Rows, columns of a video frame.
    pub size: [usize; 2],
    /// Video frames a second.
    pub rate: Option<Rate>,
    /// Whether Vulkan's use is checked.
    pub validation: bool,
}

/// It, its rate where that is known, and what the validation layer says.
pub type Shown = (Box<dyn Presenter>, Option<Rate>, Arc<Mutex<Vec<String>>>);

impl Wanted<'_> {
    /// Opens it.
    pub fn open(&self, clock: Rc<RealClock>) -> Result<Shown, Failure> {
        if self.direct {
            let display = Direct::open(self.validation)?.take(self.monitor, self.size, self.rate, clock)?;
            let messages = display.messages();
            // Its own rate is the mode's, which may be 59.94 where 60 was asked for.
            let rate = display.rate();
            return Ok((Box::new(display), rate, messages));
        }
        let desktop = Desktop::open()?;
        let monitor = desktop.choose(self.monitor, self.size)?;
        let window = desktop.window(&monitor, clock, self.validation)?;
        let (rate, messages) = (self.rate.or(window.rate()), window.messages());
        Ok((Box::new(window), rate, messages))
    }
}

/// What the validation layer said, when all that it watched is gone.
pub fn checked(played: Result<(), Failure>, messages: &Mutex<Vec<String>>) -> Result<(), Failure> {
    let messages = messages.lock().map(|m| m.clone()).unwrap_or_default();
    messages.iter().for_each(|m| eprintln!("validation: {m}"));
    if played.is_ok() && !messages.is_empty() {
        return Err(Failure::Asked(format!("the validation layer found {} faults, above", messages.len())));
    }
    played
}

fn open(args: &Play) -> Result<Opened, Failure> {
    let mut display = Display::load(&args.display)?;
    if let Some([height, width]) = args.size {
        (display.height, display.width) = (height, width);
    }
    let sequence = Sequence::open(&args.file)?;
    sequence.notes().iter().for_each(|note| eprintln!("note: {note}"));
    let what = args.file.display();
    let about = sequence.about();
    let named = |c: &eyebox::hologram::ColorHologram| {
        c.color.ok_or_else(|| Failure::Asked(format!("{what}: its colours are not named")))
    };
    let colors: Vec<Color> = about.colors.iter().map(named).collect::<Result<_, _>>()?;
    let encoder = Encoder::new(&display, &colors, about.frames)?;
    let ([eh, ew], [h, w]) = (encoder.hologram_size(), [about.height, about.width]);
    if [eh, ew] != [h, w] {
        let name = &display.name;
        return Err(Failure::Asked(format!(
            "{what}: it is {h}x{w} pixels, and the display '{name}' takes {eh}x{ew}: give --size, or the display that it \
             was made for"
        )));
    }
    let [numerator, denominator] = sequence.rate();
    let content_rate = match args.rate {
        Some(rate) => rate,
        None => Rate::new(numerator, denominator)?,
    };
    if args.first >= sequence.count().max(1) && !args.follow {
        let count = sequence.count();
        return Err(Failure::Asked(format!(
            "{what}: it has {count} holograms, the first is 0: --first {}",
            args.first
        )));
    }
    encoder.notes().iter().for_each(|note| eprintln!("note: {note}"));
    let display_rate = args.shown.display_rate.map_or_else(|| Rate::new(60, 1), Ok)?;
    Ok(Opened { display, encoder, sequence, content_rate, display_rate })
}

fn play(args: &Play, opened: Opened, clock: Rc<dyn Clock>, presenter: &mut dyn Presenter) -> Result<(), Failure> {
    let Opened { display, encoder, sequence, content_rate, display_rate } = opened;
    let shape = sequence.shape();
    let set_frames = encoder.packed().video_frames as u64;
    let planes = (shape[0] * shape[1]) as u64;
    let set_rate = display_rate.hz() / set_frames as f64;
    // Enough video frames that the display's beat is known.
    let idle_sets = ((args.sync * set_rate).ceil() as u64).max(4_u64.div_ceil(set_frames));
    let start = match args.start_at {
        None => Start::WhenReady { idle_sets },
        Some(unix) => {
            let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |d| d.as_secs_f64());
            Start::At { display_time_ns: clock.now_ns() + ((unix - now) * SECOND_NS as f64) as i64 }
        }
    };
    let speed = Speed::new(args.speed)
        .ok_or_else(|| Failure::Asked(format!("--speed {}: it must be 0.001 to 1000", args.speed)))?;
    let schedule = Schedule { display_rate, content_rate, speed, set_frames, start, keep_phase: args.keep_phase };
    let idle = {
        let phases = if args.sync > 0.0 { sync_phases(shape) } else { vec![0.0; shape.iter().product()] };
        let each = phases.len() / shape[0];
        let colors: Vec<&[f32]> = phases.chunks_exact(each).collect();
        encoder.encode(&PhaseSet::trusted(&colors))?
    };
    let size = [idle.height, idle.width, idle.channels];
    let mut recorder = args.record.as_deref().map(|folder| Recorder::new(folder, size)).transpose()?;
    let trace = Trace::new(if args.trace.is_some() { SPANS } else { 0 });
    let engine = match args.engine {
        EngineName::Auto | EngineName::Cpu => StreamEncoder::Cpu(encoder),
        EngineName::Vulkan => {
            let options = GpuOptions { allow_cpu: true, validation: args.shown.validation, ..GpuOptions::default() };
            StreamEncoder::Vulkan(encoder, Gpu::open(&options)?)
        }
    };
    eprintln!(
        "{}: {} holograms of {}x{} at {content_rate} a second, {} sub-frames a set",
        args.file.display(),
        sequence.count(),
        shape[2],
        shape[3],
        planes
    );
    eprintln!(
        "{} on {}: a set takes {set_frames} video frame{}, {:.2} sets and {:.0} sub-frames a second",
        display.name,
        presenter.describe(),
        if set_frames == 1 { "" } else { "s" },
        set_rate,
        set_rate * planes as f64
    );
    let options = Options {
        ahead: args.ahead,
        looped: args.looped || sequence.is_single(),
        follow: args.follow,
        first: args.first,
        threads: 0,
        marks: Marks { side: args.mark },
        trace,
    };
    progress::catch_interrupt();
    let mut stream = Stream::start(sequence, engine, options)?;
    let watched = stream.validation();
    let mut player = Player::new(Rc::clone(&clock), Scheduler::new(schedule), idle, trace.lane("present"));
    let begun_ns = clock.now_ns();
    let mut status = Status::new(planes);
    let until_ns = args.duration.map(|s| (s * SECOND_NS as f64) as i64);
    let mut content_since_ns = None;
    let ended = loop {
        let mut observe = |moment: &eyebox::playback::Moment<'_>| match &mut recorder {
            Some(recorder) => recorder.add(moment),
            None => Ok(()),
        };
        match player.tick(presenter, &mut stream, &mut observe) {
            Ok(Flow::Continue) => {}
            Ok(Flow::Ended) => break Ok("the end"),
            Ok(Flow::Closed) => break Ok("closed"),
            Err(error) => break Err(error),
        }
        tell(&mut stream, &mut status);
        if player.scheduler().account().due > 0 {
            let since = *content_since_ns.get_or_insert(player.display_time_ns());
            let passed = player.display_time_ns() - since + display_rate.period_ns();
            if until_ns.is_some_and(|until| passed >= until) {
                break Ok("the duration");
            }
        }
        if progress::interrupted() {
            break Ok("ctrl-C");
        }
        status.show(&player, clock.now_ns() - begun_ns);
    };
    tell(&mut stream, &mut status);
    status.clear();
    let how = *ended.as_ref().unwrap_or(&"an error");
    let ended = player.end(presenter, ended);
    let seconds = (clock.now_ns() - begun_ns) as f64 / 1e9;
    let report = Report::new(player.scheduler(), player.timing(), seconds, planes);
    let margin_ms = player.pacer().margin_ns() as f64 / 1e6;
    summary(&report, how);
    let mut lanes: Vec<Lane> = vec![player.into_lane()];
    lanes.extend(stream.stop());
    if let Some(file) = &args.trace {
        Trace::write(file, &lanes)?;
    }
    if let Some(file) = &args.stats {
        let mut all = report.to_json();
        all["ended_by"] = json!(how);
        all["presenter"] = json!(presenter.describe());
        all["timed_by"] = json!(presenter.timed_by());
        all["display_rate_hz"] = json!(display_rate.hz());
        all["content_rate_hz"] = json!(content_rate.hz());
        all["video_frames_per_set"] = json!(set_frames);
        all["margin_ms"] = json!(margin_ms);
        all["peak_memory_mib"] = json!(common::peak_memory_mib());
        files::write_file(file, |out| writeln!(out, "{all:#}"))?;
    }
    if let Some(recorder) = recorder {
        recorder.finish()?;
    }
    let played = ended.map(drop).map_err(lost);
    watched.map_or(Ok(()), |messages| checked(Ok(()), &messages)).and(played)
}

/// What the stream has to say.
fn tell(stream: &mut Stream, status: &mut Status) {
    while let Some(message) = stream.message() {
        status.clear();
        eprintln!("note: {message}");
    }
}

/// A display that goes away while it is played to has an exit code of its own.
pub fn lost(error: PlaybackError) -> Failure {
    match error {
        PlaybackError::Presenter { .. } => Failure::Lost(error.to_string()),
        other => other.into(),
    }
}

fn summary(report: &Report, how: &str) {
    let a = &report.account;
    let plural = |n: u64, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
    let causes = if a.drops() == 0 { String::new() } else { format!(" ({})", a.causes()) };
    eprintln!(
        "ended by {how} after {:.2} s: {} shown, {} dropped{causes}; {} and {} of the idle picture; {}",
        report.seconds,
        plural(a.shown, "hologram"),
        a.drops(),
        plural(a.sets - a.idle_sets, "set"),
        a.idle_sets,
        plural(a.missed_presents, "missed present"),
    );
    eprintln!(
        "{:.2} holograms and {:.2} sets a second, {:.0} sub-frames a second; jitter {:.3} ms, at most {:.3} ms",
        report.content_fps(),
        report.sets_per_second(),
        report.sets_per_second() * report.planes as f64,
        report.timing.jitter_ms(),
        report.timing.largest_jitter_ms(),
    );
}

/// The line that is written over while playing.
struct Status {
    planes: u64,
    last_ns: i64,
    before: (u64, u64),
    shown: bool,
    terminal: bool,
}

impl Status {
    fn new(planes: u64) -> Self {
        Self { planes, last_ns: 0, before: (0, 0), shown: false, terminal: std::io::stderr().is_terminal() }
    }

    fn show(&mut self, player: &Player, now_ns: i64) {
        let passed = now_ns - self.last_ns;
        if !self.terminal || passed < SECOND_NS / 2 {
            return;
        }
        let a = player.scheduler().account();
        let seconds = passed as f64 / 1e9;
        let (fps, sets) = ((a.shown - self.before.0) as f64 / seconds, (a.sets - self.before.1) as f64 / seconds);
        let mut out = std::io::stderr().lock();
        let _ = write!(
            out,
            "\r\x1b[K{:.1} holograms/s, {:.0} sub-frames/s, {} dropped, {} missed presents, jitter {:.2} ms",
            fps,
            sets * self.planes as f64,
            a.drops(),
            a.missed_presents,
            player.timing().jitter_ms()
        );
        let _ = out.flush();
        (self.last_ns, self.before, self.shown) = (now_ns, (a.shown, a.sets), true);
    }

    fn clear(&mut self) {
        if self.shown {
            eprint!("\r\x1b[K");
            self.shown = false;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_display_that_goes_away_and_a_thread_that_fails_have_codes_of_their_own() {
        let gone = PlaybackError::Presenter { presenter: "the window".into(), reason: "it is gone".into() };
        let failed = PlaybackError::Thread { what: "encodes", reason: "failed".into() };
        assert_eq!((lost(gone).code(), lost(failed).code()), (3, 2));
    }
}
