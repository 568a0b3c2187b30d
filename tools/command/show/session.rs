//! Attends a session of `eyebox show` until it ends, and prints its statistics.

use crate::talk::print_report;
use crate::{Failure, common, progress};
use eyebox::low_level::encoded;
use eyebox::low_level::error::Reason;
use eyebox::low_level::files;
use eyebox::low_level::hologram::Hologram;
use eyebox::low_level::reason;
use eyebox::low_level::session::{
    ControllerReport, Ended, Ending, PulseReport, Session, SessionError, SessionEvent, Statistics, Status,
    TriggerReport,
};
use serde_json::{Value, json};
use std::io::{IsTerminal, Write};
use std::path::Path;
use std::time::{Duration, Instant};

/// Time between two checks for ctrl-C.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

/// Prints the notes of a session until it ends or ctrl-C stops it, and returns its end. `line` makes the line that is
/// updated while the session runs, from the present status, the one before, and the seconds between. The file `stats`
/// receives the statistics so far every second.
pub fn attend(session: Session, stats: Option<&Path>, line: impl Fn(&Status, &Status, f64) -> String) -> Ended {
    progress::catch_interrupt();
    let terminal = std::io::stderr().is_terminal();
    let clear = || {
        if terminal {
            eprint!("\r\x1b[K");
        }
    };
    let light = |at_ns: u64| eprintln!("first light {:.2} s after the start", common::seconds_to(at_ns));
    let (mut before, mut lit) = (Status::default(), false);
    // A pipe or a device receives the statistics only once, at the end.
    let grows = |file: &&Path| file.metadata().map_or(true, |there| there.is_file());
    let mut stats = stats.filter(grows).map(|file| (file, Instant::now()));
    loop {
        match session.event(POLL_INTERVAL) {
            Some(SessionEvent::Note(note)) => {
                clear();
                eprintln!("note: {note}");
            }
            Some(_) => break,
            None => {}
        }
        if progress::interrupted() {
            break;
        }
        let now = session.status();
        if let (false, Some(at_ns)) = (lit, now.first_light_ns) {
            lit = true;
            clear();
            light(at_ns);
        }
        if let Some((file, _)) = stats.filter(|(_, written)| written.elapsed() >= Duration::from_secs(1)) {
            let mut so_far = now.report(session.about()).to_json();
            if now.live.is_some() {
                so_far = json!({ "playback": so_far });
            }
            so_far["ended_by"] = Value::Null;
            so_far["first_light_s"] = json!(now.first_light_ns.map(common::seconds_to));
            // An error of this is reported once, at the end.
            let written = files::write_file(file, |out| writeln!(out, "{so_far:#}"));
            stats = written.ok().map(|()| (file, Instant::now()));
        }
        let passed = now.seconds - before.seconds;
        if terminal && passed >= 0.5 {
            eprint!("\r\x1b[K{}", line(&now, &before, passed));
            let _ = std::io::stderr().flush();
            before = now;
        } else if !terminal && passed >= progress::EVERY.as_secs_f64() {
            eprintln!("{}", line(&now, &before, passed));
            before = now;
        }
    }
    clear();
    let ended = session.stop();
    ended.statistics.first_light_ns.filter(|_| !lit).inspect(|at_ns| light(*at_ns));
    ended
}

/// Returns the reason for the end in words.
pub fn ended_by(statistics: &Statistics) -> &'static str {
    if statistics.ended_by == Ending::Stopped { "ctrl-C" } else { statistics.ended_by.name() }
}

/// Writes the statistics to a file and to standard output as requested, with the numbers that only the command has.
/// Prints the faults.
pub fn conclude(ended: Ended, (stats, prints): (Option<&Path>, bool), more: &Value) -> Result<(), Failure> {
    let Ended { statistics, result } = ended;
    let mut written = Ok(());
    if stats.is_some() || prints {
        let mut all = statistics.to_json();
        for (key, value) in more.as_object().into_iter().flatten() {
            all[key] = value.clone();
        }
        all["ended_by"] = json!(ended_by(&statistics));
        all["first_light_s"] = json!(statistics.first_light_ns.map(common::seconds_to));
        all["peak_memory_mib"] = json!(common::peak_memory_mib());
        if let Some(file) = stats {
            written = files::write_file(file, |out| writeln!(out, "{all:#}"));
        }
        if prints {
            print_report(all);
        }
    }
    if let Some(controller) = &statistics.controller {
        eprintln!("{}", controller_line(controller));
    }
    trigger_lines(&statistics).iter().for_each(|line| eprintln!("{line}"));
    if statistics.pictures_left_out > 0 {
        let count = statistics.pictures_left_out;
        eprintln!("note: {count} pictures were not kept, because the disk was slower than the display");
    }
    statistics.validation.iter().for_each(|message| eprintln!("validation: {message}"));
    common::peak_memory_mib().inspect(|mib| eprintln!("peak memory {mib} MiB"));
    result.map_err(lost)?;
    written?;
    match statistics.validation.len() {
        0 => Ok(()),
        count => Err(Failure::Arguments(reason!("validation", "the validation layer found {count} faults, above"))),
    }
}

/// Returns the statistics of the pulses of a session in words.
fn trigger_lines(statistics: &Statistics) -> Vec<String> {
    let mut lines = Vec::new();
    if let Some(TriggerReport { sent, late, full, lost, lateness_ms, .. }) = &statistics.trigger_out {
        let late_us =
            lateness_ms.percentile(0.99).map_or_else(String::new, |ms| format!(", 99 % within {:.0} us", ms * 1e3));
        lines.push(format!("{sent} pulses sent{late_us}, {late} too late, {full} without room, {lost} without a line"));
    }
    if let Some(PulseReport { received, advanced, too_early, lost, .. }) = statistics.trigger_in {
        lines.push(format!(
            "{received} pulses taken, {advanced} advanced the content, {too_early} too early, {lost} lost"
        ));
    }
    lines
}

/// Returns the statistics of a display's controller in words.
pub fn controller_line(report: &ControllerReport) -> String {
    let planes = report
        .exposure_us
        .map_or_else(|| "its patterns never ran".into(), |us| format!("planes of {us} us at {:.3} Hz", report.rate_hz));
    let ControllerReport { checks, aborts, lost_pictures, errors, .. } = report;
    let asleep = if report.asleep { "asleep" } else { "not asleep" };
    format!(
        "controller {}, {planes}, {aborts} aborts in {checks} checks, {lost_pictures} lost pictures, {errors} errors, {asleep}",
        report.identity.firmware
    )
}

/// Keeps the powers of the lasers of colors that share their sub-frames with what is recorded.
pub fn keep_powers(shown: &Hologram, record: Option<&Path>) -> Result<(), Failure> {
    if let Some(folder) = record {
        encoded::write_powers(shown, folder)?;
    }
    Ok(())
}

/// Returns the failure of a session. A display that goes away while it is in use has its own exit code.
fn lost(error: SessionError) -> Failure {
    if error.is_of_display() { Failure::Lost(Reason::new("display", error)) } else { error.into() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use eyebox::low_level::present::PresentError;

    #[test]
    fn a_display_that_goes_away_and_a_thread_that_fails_have_codes_of_their_own() {
        let gone =
            PresentError::Display { presenter: "the window".into(), reason: reason!("server-gone", "it is gone") };
        let failed = SessionError::Thread { what: "encodes", reason: "failed".into() };
        assert_eq!((lost(gone.into()).exit_code(), lost(failed).exit_code()), (3, 2));
    }
}
