//! `eyebox show` without a tracker shows holograms as they were solved.

use super::args::{ClockName, OutputArgs, ShowSettings, StreamArgs};
use super::session::{attend, conclude, ended_by, keep_powers};
use crate::args::{DeviceArgs, EngineName};
use crate::{Failure, common, progress};
use eyebox::low_level::encode;
use eyebox::low_level::hologram::Sequence;
use eyebox::low_level::optics::Display;
use eyebox::low_level::reason;
use eyebox::low_level::session::{self, Session, SessionOptions, Statistics, Status};
use serde_json::json;
use std::path::Path;
use std::time::{Duration, UNIX_EPOCH};

/// The holograms to play, with their options.
pub struct Playing<'a> {
    pub sequence: Sequence,
    /// The display that the holograms are encoded for.
    pub display: Display,
    pub shown: &'a OutputArgs,
    pub stream: &'a StreamArgs,
    /// The table `show` of the settings.
    pub settings: &'a ShowSettings,
    /// The engine that encodes.
    pub engine: EngineName,
    /// The device of the engine.
    pub device: &'a DeviceArgs,
    /// The other options of the session.
    pub options: SessionOptions,
    /// The file of the statistics in JSON.
    pub stats: Option<&'a Path>,
    /// True if the statistics are also printed on standard output.
    pub prints: bool,
}

/// Plays the holograms and prints the statistics.
pub fn play(playing: Playing<'_>) -> Result<(), Failure> {
    let Playing { sequence, display, shown, stream, settings, engine, device, mut options, stats, prints } = playing;
    let mut play = content(sequence, &display, stream, settings)?;
    let what = play.sequence.path().display().to_string();
    let output = shown.output.output(is_simulated(shown, stream, &options, play.looped)?);
    let encodes = matches!(engine, EngineName::Vulkan | EngineName::VulkanFrom(_));
    let shows = shown.output.is_shown();
    let gpu = if encodes || shows { Some(common::display_gpu(device, shown.validation)?) } else { None };
    play.device = gpu.clone().filter(|_| encodes);
    let [_, frames, height, width] = play.sequence.shape();
    let (shown_of, colors, record) =
        (play.sequence.about().clone(), play.encoder.colors().to_vec(), options.record.clone());
    let (count, rate) = (play.sequence.count(), play.rate);
    stats.iter().try_for_each(|file| eyebox::low_level::files::check_place(file))?;
    progress::catch_interrupt();
    options.gpu = gpu;
    let session = Session::start(play, output, options)?;
    let about = session.about();
    let (sub_frames, sets, set_frames) = (about.sub_frames, about.sets_per_second(), about.set_frames);
    let holograms = match count {
        1 => "1 hologram".into(),
        count => format!("{count} holograms at {rate} per second"),
    };
    eprintln!("{what}: {holograms}, {height}x{width}, {sub_frames} sub-frames per set");
    eprintln!(
        "{} on {}: a set takes {set_frames} video frame{}, {sets:.2} sets and {:.0} sub-frames per second",
        display.name,
        about.presenter,
        if set_frames == 1 { "" } else { "s" },
        sets * sub_frames as f64
    );
    encode::flicker(&display, &colors, frames, about.display_rate.hz()).inspect(|slow| tracing::warn!("{slow}"));
    let ended = attend(session, stats, |now, before, seconds| line(now, before, seconds, sub_frames));
    summary(&ended.statistics);
    keep_powers(&shown_of, record.as_deref())?;
    let more = shown_of.metadata.joint_color.map_or_else(|| json!({}), |joint| json!({ "joint_color": joint }));
    conclude(ended, (stats, prints), &more)
}

/// Prepares a sequence for a session, with the settings of the command.
pub fn content(
    sequence: Sequence,
    display: &Display,
    stream: &StreamArgs,
    settings: &ShowSettings,
) -> Result<session::Play, Failure> {
    let mut play = session::Play::new(sequence, display)?;
    play.rate = stream.rate.unwrap_or(play.rate);
    play.speed = settings.speed;
    play.looped |= stream.looped;
    (play.follow, play.first, play.ahead) = (stream.follow, stream.at, settings.ahead);
    play.start_at = stream.start_at.map(|unix| UNIX_EPOCH + Duration::from_secs_f64(unix.min(1e12)));
    (play.sync_s, play.mark, play.keep_phase) = (settings.sync, settings.mark, settings.keep_phase);
    Ok(play)
}

/// Returns whether the clock is simulated, and refuses options that do not fit together.
pub fn is_simulated(
    shown: &OutputArgs,
    stream: &StreamArgs,
    options: &SessionOptions,
    endless: bool,
) -> Result<bool, Failure> {
    let records = options.record.is_some();
    let simulated = match stream.clock {
        Some(clock) => clock == ClockName::Simulated,
        None => records && !shown.output.is_shown(),
    };
    let refuse = |reason| Err(Failure::Arguments(reason));
    if stream.start_at.is_some() && simulated {
        return refuse(reason!("start-at", "--start-at is a time of day, and a simulated clock has none"));
    }
    if endless && options.duration.is_none() && simulated {
        return refuse(reason!("endless", "a simulated clock would run forever. Give --duration"));
    }
    if shown.output.is_shown() && simulated {
        return refuse(reason!("without-offscreen", "a simulated clock needs --output offscreen"));
    }
    Ok(simulated)
}

pub fn summary(statistics: &Statistics) {
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
        "{:.2} holograms, {:.2} sets and {:.0} sub-frames per second; presents on time had a jitter of {:.3} ms, at most {:.3} ms",
        report.content_fps(),
        report.sets_per_second(),
        report.sets_per_second() * report.planes as f64,
        report.timing.jitter_ms(),
        report.timing.largest_jitter_ms(),
    );
}

/// Returns the line that is updated while playing.
pub fn line(now: &Status, before: &Status, seconds: f64, sub_frames: u64) -> String {
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
