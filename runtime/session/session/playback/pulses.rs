//! Takes pulses that advance content, on a thread of its own.
//!
//! Each pulse advances by one hologram. A pulse that arrives before the hologram of the last one is on its way to the
//! display is too early. It is counted and advances nothing, so that pulses and holograms stay in step.

use crate::files::GrowingFile;
use crate::mailbox::Mailbox;
use crate::optics::TriggerIn;
use crate::present::RealClock;
use crate::present::trigger::{Pulse, TriggerInput, open_input};
use crate::session::frame_log::error::SessionError;
use crate::session::frame_log::notes::Notes;
use crate::session::frame_log::threads::{EntryWriter, Moment, join, spawn};
use crate::session::playback::player::PresentedFrame;
use serde_json::{Value, json};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// The pulses that can wait for the next video frame.
const WAITING: usize = 1024;
/// The rows that can wait for the disk.
const ROWS: usize = 4096;
/// The interval at which the thread checks for its end.
const POLL_INTERVAL: Duration = Duration::from_millis(50);
/// The interval between attempts to open a lost line again.
const AGAIN: Duration = Duration::from_secs(1);
/// The name of the list in a folder of recorded video frames.
pub(crate) const LIST: &str = "pulses.csv";

/// The statistics of the pulses that advance content.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct PulseReport {
    /// The pulses that arrived.
    pub received: u64,
    /// The pulses that advanced the content.
    pub advanced: u64,
    /// The pulses that arrived before the hologram of the last one was on its way to the display.
    pub too_early: u64,
    /// The pulses that were lost before they arrived, as far as the line shows them.
    pub lost: u64,
}

impl PulseReport {
    /// Returns the report for programs, with the keys of `docs/triggers.md`.
    pub fn to_json(&self) -> Value {
        let Self { received, advanced, too_early, lost } = self;
        json!({ "received": received, "advanced": advanced, "too_early": too_early, "lost": lost })
    }
}

/// A pulse and the hologram that it advanced to.
struct Row {
    number: u64,
    at_ns: i64,
    lost_before: u64,
    /// The hologram and its first video frame, or `None` for a pulse that advanced nothing.
    shown: Option<(u64, u64)>,
}

/// The thread that takes pulses, and the state of the content that they advance.
pub(crate) struct PulseThread {
    pulses: Mailbox<Pulse>,
    stop: Arc<AtomicBool>,
    thread: JoinHandle<()>,
    clock: RealClock,
    report: PulseReport,
    list: Option<EntryWriter<Row>>,
    /// True if the hologram of the last pulse is on its way to the display.
    is_ready: bool,
    /// The pulse whose hologram is awaited.
    awaits: Option<Row>,
}

impl PulseThread {
    /// Opens the line and starts the thread. With `record`, a list is written there.
    pub(crate) fn start(
        trigger: &TriggerIn,
        clock: RealClock,
        record: Option<&Path>,
        notes: Notes,
    ) -> Result<Self, SessionError> {
        let line = open_input(trigger)?;
        let list = record.map(|folder| start_list(&folder.join(LIST))).transpose()?;
        let (pulses, stop) = (Mailbox::new(WAITING), Arc::new(AtomicBool::new(false)));
        let (send, ends, trigger) = (pulses.clone(), Arc::clone(&stop), trigger.clone());
        let thread = spawn("takes pulses", move || take(line, &trigger, &send, &ends, &notes))?;
        let report = PulseReport::default();
        Ok(Self { pulses, stop, thread, clock, report, list, is_ready: false, awaits: None })
    }

    /// Returns true if content is to advance by one hologram. Call it once before each video frame.
    pub(crate) fn advances(&mut self) -> bool {
        let mut advances = false;
        while let Some(Pulse { at_ns, lost_before }) = self.pulses.take() {
            let at_ns = self.clock.at_monotonic_ns(at_ns);
            let row = Row { number: self.report.received, at_ns, lost_before, shown: None };
            self.report.received += 1;
            self.report.lost += lost_before;
            if self.is_ready {
                (self.is_ready, advances) = (false, true);
                self.report.advanced += 1;
                self.awaits = Some(row);
            } else {
                self.report.too_early += 1;
                self.keep(row);
            }
        }
        advances
    }

    /// Looks at a video frame that was handed over.
    pub(crate) fn handed_over(&mut self, frame: &PresentedFrame<'_>) {
        let Some(content) = frame.index.filter(|_| frame.new) else { return };
        self.is_ready = true;
        if let Some(row) = self.awaits.take() {
            self.keep(Row { shown: Some((content, frame.vblank)), ..row });
        }
    }

    fn keep(&self, row: Row) {
        if let Some(list) = &self.list {
            let _ = list.entries.put(Some(row));
        }
    }

    /// Ends the thread and completes the list.
    pub(crate) fn stop(mut self) -> Result<PulseReport, SessionError> {
        self.stop.store(true, Ordering::Release);
        join("takes pulses", self.thread)?;
        if let (Some(row), Some(list)) = (self.awaits.take(), &self.list) {
            let _ = list.entries.put(Some(row));
        }
        if let Some(list) = self.list {
            list.finish()?;
        }
        Ok(self.report)
    }
}

fn start_list(file: &Path) -> Result<EntryWriter<Row>, SessionError> {
    EntryWriter::start("keeps pulses", ROWS, GrowingFile::new(file)?, |out, moment| match moment {
        Moment::Begin => out.add(|out| writeln!(out, "pulse,at_ns,lost_before,content,video_frame")),
        Moment::Entry(Row { number, at_ns, lost_before, shown }) => {
            let [content, frame] = match shown {
                Some((content, frame)) => [content.to_string(), frame.to_string()],
                None => [String::new(), String::new()],
            };
            out.add(|out| writeln!(out, "{number},{at_ns},{lost_before},{content},{frame}"))
        }
        Moment::End => Ok(()),
    })
}

/// Takes pulses until `ends`. A lost line is opened again.
fn take(line: Box<dyn TriggerInput>, trigger: &TriggerIn, send: &Mailbox<Pulse>, ends: &AtomicBool, notes: &Notes) {
    let (mut line, mut arrived) = (Some(line), Vec::new());
    let mut waited = Duration::ZERO;
    while !ends.load(Ordering::Acquire) {
        let Some(open) = &mut line else {
            std::thread::sleep(POLL_INTERVAL);
            waited += POLL_INTERVAL;
            if waited >= AGAIN {
                waited = Duration::ZERO;
                line = open_input(trigger).ok();
                if line.is_some() {
                    notes.send("the line of [trigger_in] is back");
                }
            }
            continue;
        };
        if let Err(error) = open.wait(POLL_INTERVAL, &mut arrived) {
            notes.send(format!("{error}. Content waits, and the line is opened again if it returns"));
            line = None;
        }
        for pulse in arrived.drain(..) {
            let _ = send.put(pulse);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(index: Option<u64>, vblank: u64, new: bool) -> PresentedFrame<'static> {
        PresentedFrame { vblank, predicted_display_time_ns: 0, index, video_frame: 0, new, late: None, picture: &[] }
    }

    /// A pulse counts only when the hologram of the last one was handed over.
    #[test]
    fn pulses_and_holograms_stay_in_step() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join(LIST);
        let mut pulses = PulseThread {
            pulses: Mailbox::new(8),
            stop: Arc::default(),
            thread: spawn("takes pulses", || ()).unwrap(),
            clock: RealClock::start(),
            report: PulseReport::default(),
            list: Some(start_list(&file).unwrap()),
            is_ready: false,
            awaits: None,
        };
        let arrives = |pulses: &PulseThread, at_ns, lost_before| {
            pulses.pulses.put(Pulse { at_ns: pulses.clock.monotonic_ns(at_ns), lost_before }).unwrap();
        };
        arrives(&pulses, 5, 0);
        assert!(!pulses.advances(), "no hologram is shown");
        pulses.handed_over(&frame(None, 0, false));
        arrives(&pulses, 6, 0);
        assert!(!pulses.advances(), "the idle picture is no hologram");
        pulses.handed_over(&frame(Some(0), 1, true));
        assert!(!pulses.advances());
        arrives(&pulses, 7, 0);
        arrives(&pulses, 8, 2);
        assert!(pulses.advances());
        pulses.handed_over(&frame(Some(0), 2, false));
        arrives(&pulses, 9, 0);
        assert!(!pulses.advances(), "its hologram is not shown yet");
        pulses.handed_over(&frame(Some(1), 3, true));
        arrives(&pulses, 10, 1);
        assert!(pulses.advances());
        let report = pulses.stop().unwrap();
        assert_eq!(report, PulseReport { received: 6, advanced: 2, too_early: 4, lost: 3 });
        let list = std::fs::read_to_string(&file).unwrap();
        let rows: Vec<&str> = list.lines().skip(1).collect();
        assert_eq!(rows, ["0,5,0,,", "1,6,0,,", "3,8,2,,", "4,9,0,,", "2,7,0,1,3", "5,10,1,,"]);
    }
}
