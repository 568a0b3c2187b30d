//! `eyebox play`.

mod args;
mod monitors;

pub use args::{Monitors, OutputArgs, OutputName, Play};
pub use monitors::monitors;

use crate::args::EngineName;
use crate::session::{attend, conclude, ended_by};
use crate::{Failure, common, progress};
use args::ClockName;
use eyebox::encode;
use eyebox::hologram::Opening;
use eyebox::session::{self, Output, Session, SessionOptions, SinkFile, Statistics, Status};
use serde_json::json;
use std::time::{Duration, UNIX_EPOCH};

/// Plays a hologram or a sequence, and says what was shown.
pub fn run(args: &Play) -> Result<(), Failure> {
    let display = common::display_of_size(&args.display, args.size, args.force)?;
    // Who waits for the rest takes what there is.
    let unfinished = args.unfinished.unfinished || args.follow;
    let opening = Opening { unfinished, ..args.unit.opening(Some(&display), args.color.one()) };
    let sequence = opening.sequence(&args.file).map_err(|e| args.unfinished.failure(e))?;
    let mut play = session::Play::new(sequence, &display)?;
    let output = output(args, args.looped || play.looped)?;
    play.rate = args.rate.unwrap_or(play.rate);
    play.speed = args.speed;
    play.looped |= args.looped;
    (play.follow, play.first, play.ahead) = (args.follow, args.first, args.ahead);
    play.start_at = args.start_at.map(|unix| UNIX_EPOCH + Duration::from_secs_f64(unix.min(1e12)));
    (play.sync_s, play.mark, play.keep_phase) = (args.sync, args.mark, args.keep_phase);
    let encodes = args.device.engine(args.engine)? == EngineName::Vulkan;
    let shows = args.shown.output != OutputName::Offscreen;
    let gpu = if encodes || shows { Some(common::display_gpu(&args.device, args.shown.validation)?) } else { None };
    play.device = gpu.clone().filter(|_| encodes);
    let [_, frames, height, width] = play.sequence.shape();
    let colors = play.sequence.about().named_colors();
    let (count, rate) = (play.sequence.count(), play.rate);
    args.stats.iter().try_for_each(|file| eyebox::files::check_place(file))?;
    progress::catch_interrupt();
    let mut options = args.options();
    options.gpu = gpu;
    let session = Session::start(play, output, options)?;
    let about = session.about();
    let (sub_frames, sets, set_frames) = (about.sub_frames, about.sets_per_second(), about.set_frames);
    let what = args.file.display();
    eprintln!("{what}: {count} holograms of {height}x{width} at {rate} a second, {sub_frames} sub-frames a set");
    eprintln!(
        "{} on {}: a set takes {set_frames} video frame{}, {sets:.2} sets and {:.0} sub-frames a second",
        display.name,
        about.presenter,
        if set_frames == 1 { "" } else { "s" },
        sets * sub_frames as f64
    );
    encode::flicker(&display, &colors, frames, about.display_rate.hz()).inspect(|slow| tracing::warn!("{slow}"));
    let ended = attend(session, args.stats.as_deref(), |now, before, seconds| line(now, before, seconds, sub_frames));
    summary(&ended.statistics);
    conclude(ended, args.stats.as_deref(), &json!({}))
}

/// Where it is shown; refuses what does not go together.
fn output(args: &Play, endless: bool) -> Result<Output, Failure> {
    let simulated = match args.clock {
        Some(clock) => clock == ClockName::Simulated,
        None => args.record.is_some(),
    };
    let refuse = |reason: &str| Err(Failure::Asked(reason.into()));
    if args.record.is_some() && !simulated {
        return refuse("--record takes longer than a video frame: leave out --clock real");
    }
    if args.start_at.is_some() && simulated {
        return refuse("--start-at is a time of day, and a simulated clock has none");
    }
    if endless && args.duration.is_none() && simulated {
        return refuse("a simulated clock would go on for ever: give --duration");
    }
    let raw = args.raw.clone().map(SinkFile::Raw);
    let sink = raw.or_else(|| args.shared.clone().map(SinkFile::Shared));
    if args.shown.output != OutputName::Offscreen && (simulated || sink.is_some()) {
        return refuse("--record, --raw, --shared and a simulated clock go with --output offscreen");
    }
    Ok(args.shown.output(simulated, sink))
}

impl Play {
    fn options(&self) -> SessionOptions {
        let mut options = self.shown.options();
        options.duration = self.duration.map(|s| Duration::from_secs_f64(s.min(1e9)));
        (options.record, options.trace) = (self.record.clone(), self.trace.clone());
        options
    }
}

fn summary(statistics: &Statistics) {
    let (report, how) = (&statistics.report, ended_by(statistics));
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
fn line(now: &Status, before: &Status, seconds: f64, sub_frames: u64) -> String {
    let (a, b) = (&now.account, &before.account);
    let (fps, sets) = ((a.shown - b.shown) as f64 / seconds, (a.sets - b.sets) as f64 / seconds);
    format!(
        "{fps:.1} holograms/s, {:.0} sub-frames/s, {} dropped, {} missed presents, jitter {:.2} ms",
        sets * sub_frames as f64,
        a.drops(),
        a.missed_presents,
        now.timing.jitter_ms()
    )
}
