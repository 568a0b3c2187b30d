//! Gives a pulse with the light of each set, on a thread of its own, and keeps what became of each pulse.
//!
//! The present thread announces a set when it hands its first video frame over, which is before its light. The thread
//! waits for the light. A pulse that would be later than half a video frame is not given but counted.

use crate::files::{FileError, GrowingFile};
use crate::mailbox::Mailbox;
use crate::optics::{TriggerOn, TriggerOut};
use crate::present::trigger::{Given, TriggerError, TriggerOutput, open_output};
use crate::present::{Clock, RealClock};
use crate::session::frame_log::error::SessionError;
use crate::session::frame_log::latency::Histogram;
use crate::session::frame_log::notes::Notes;
use crate::session::frame_log::threads::{join, put_unless, spawn};
use crate::session::frame_log::trace::Track;
use serde_json::{Value, json};
use std::collections::VecDeque;
use std::path::Path;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// The sets and reports of light that can wait for the thread.
const WAITING: usize = 256;
/// The sets that wait for the report of their light.
const UNREPORTED: usize = 32;
/// The interval between attempts to open a lost line again.
const AGAIN: Duration = Duration::from_secs(1);
/// The name of the list in a folder of recorded video frames.
pub(crate) const LIST: &str = "triggers.csv";

/// The light of a multiplex set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct SetLight {
    /// The number of the set, from 0. Repeated sets count.
    pub set: u64,
    /// The number of its hologram in the content, or of the refined set.
    pub content: u64,
    /// The number of its first video frame of the display.
    pub video_frame: u64,
    /// True if the set shows new content.
    pub new: bool,
    /// The predicted time of its first light (ns on the clock of the player).
    pub predicted_ns: i64,
    /// The time of its first light as the display reports it (ns on the clock of the player), or `None` without a
    /// report.
    pub reported_ns: Option<i64>,
}

/// A function that receives the light of each set, on a thread of its own, as soon as the display has reported it.
pub type LightObserver = Box<dyn FnMut(&SetLight) + Send>;

/// The outcome of a pulse.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Outcome {
    Sent,
    /// It would have been later than half a video frame.
    Late,
    /// The line had no room for it.
    Full,
    /// The line was lost.
    Lost,
    /// This set is to have none.
    None,
}

impl Outcome {
    fn name(self) -> &'static str {
        match self {
            Self::Sent => "sent",
            Self::Late => "late",
            Self::Full => "full",
            Self::Lost => "lost",
            Self::None => "",
        }
    }
}

/// The statistics of the pulses of a session.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct TriggerReport {
    /// The pulses that left this program.
    pub sent: u64,
    /// The pulses that were not given, because they would have been later than half a video frame.
    pub late: u64,
    /// The pulses for which the line had no room.
    pub full: u64,
    /// The pulses that were due while the line was lost.
    pub lost: u64,
    /// The times from the moment of a pulse to its end on this side (ms).
    pub lateness_ms: Histogram,
    /// The times from the light that the display reports to the pulse (ms), of pulses after it.
    pub after_light_ms: Histogram,
    /// The pulses that were given before the light that the display reports.
    pub before_light: u64,
}

impl TriggerReport {
    fn new() -> Self {
        let histogram = || Histogram::new(0.02, 4096);
        let (lateness_ms, after_light_ms) = (histogram(), histogram());
        Self { sent: 0, late: 0, full: 0, lost: 0, lateness_ms, after_light_ms, before_light: 0 }
    }

    /// Returns the report for programs, with the keys of `docs/triggers.md`.
    pub fn to_json(&self) -> Value {
        json!({
            "sent": self.sent, "late": self.late, "full": self.full, "lost": self.lost,
            "lateness_ms": self.lateness_ms.to_json(), "after_light_ms": self.after_light_ms.to_json(),
            "before_light": self.before_light,
        })
    }
}

enum Message {
    Set { light: SetLight, has_pulse: bool },
    Lit { video_frame: u64, at_ns: i64 },
    End,
}

/// The thread that gives pulses.
pub(crate) struct TriggerThread {
    send: Mailbox<Message>,
    thread: JoinHandle<(Work, Result<(), SessionError>)>,
    sets: u64,
    trigger: Option<TriggerOut>,
    /// The messages that found no room, because the thread did not keep up.
    missed: u64,
}

impl TriggerThread {
    /// Opens the line, and starts the thread if there is a line or an observer. Without a real `clock`, pulses are given
    /// at once. With `record`, a list is written there.
    pub(crate) fn start(
        trigger: Option<TriggerOut>,
        observer: Option<LightObserver>,
        clock: Option<RealClock>,
        period_ns: i64,
        record: Option<&Path>,
        notes: Notes,
        track: Track,
    ) -> Result<Option<Self>, SessionError> {
        if trigger.is_none() && observer.is_none() {
            return Ok(None);
        }
        let line = trigger.as_ref().map(open_output).transpose()?;
        let list = match record.filter(|_| trigger.is_some()) {
            Some(folder) => Some(GrowingFile::new(&folder.join(LIST))?),
            None => None,
        };
        let send = Mailbox::new(WAITING);
        let receive = send.clone();
        let mut work = Work {
            delay_ns: trigger.as_ref().map_or(0, |t| (t.delay_us * 1e3) as i64),
            trigger: trigger.clone(),
            line,
            observer,
            clock,
            period_ns,
            notes,
            track,
            rows: VecDeque::with_capacity(UNREPORTED + 1),
            report: TriggerReport::new(),
            tried: Instant::now(),
        };
        let thread = spawn("gives pulses", move || {
            let result = work.run(&receive, list);
            (work, result)
        })?;
        Ok(Some(Self { send, thread, sets: 0, trigger, missed: 0 }))
    }

    /// Announces a set whose first video frame was handed over.
    pub(crate) fn set(&mut self, content: u64, video_frame: u64, new: bool, predicted_ns: i64) {
        let light = SetLight { set: self.sets, content, video_frame, new, predicted_ns, reported_ns: None };
        self.sets += 1;
        let has_pulse = self.trigger.as_ref().is_some_and(|t| new || t.on == TriggerOn::Set);
        self.put(Message::Set { light, has_pulse }, has_pulse);
    }

    /// Passes on the time at which a video frame lit up.
    pub(crate) fn lit(&mut self, video_frame: u64, at_ns: i64) {
        self.put(Message::Lit { video_frame, at_ns }, false);
    }

    fn put(&mut self, message: Message, has_pulse: bool) {
        if self.send.put(message).is_err() && has_pulse {
            self.missed += 1;
        }
    }

    /// Ends the thread after its last pulse. Returns the report if there is a line.
    pub(crate) fn stop(self) -> Result<(Option<TriggerReport>, Track), SessionError> {
        let Self { send, thread, trigger, missed, .. } = self;
        put_unless(&send, Message::End, AGAIN, || thread.is_finished());
        let (work, result) = join("gives pulses", thread)?;
        result?;
        let mut report = work.report;
        report.late += missed;
        Ok((trigger.map(|_| report), work.track))
    }
}

/// The pulse of a set.
struct Row {
    light: SetLight,
    outcome: Outcome,
    wanted_ns: i64,
    given_ns: Option<i64>,
}

/// The state of the thread.
struct Work {
    trigger: Option<TriggerOut>,
    line: Option<Box<dyn TriggerOutput>>,
    observer: Option<LightObserver>,
    clock: Option<RealClock>,
    period_ns: i64,
    delay_ns: i64,
    notes: Notes,
    track: Track,
    /// The sets whose light the display has not reported.
    rows: VecDeque<Row>,
    report: TriggerReport,
    /// The time of the last attempt to open the line.
    tried: Instant,
}

impl Work {
    fn run(&mut self, receive: &Mailbox<Message>, mut list: Option<GrowingFile>) -> Result<(), SessionError> {
        if let Some(list) = &mut list {
            list.add(|out| writeln!(out, "set,content,video_frame,new,wanted_ns,given_ns,reported_light_ns,pulse"))?;
        }
        // A failure of the list does not end the pulses.
        let mut written = Ok(());
        loop {
            match receive.take_within(Duration::from_millis(200)) {
                Some(Message::Set { light, has_pulse }) => {
                    let row = self.pulse(light, has_pulse);
                    self.rows.push_back(row);
                }
                Some(Message::Lit { video_frame, at_ns }) => {
                    if let Some(row) = self.rows.iter_mut().find(|row| row.light.video_frame == video_frame) {
                        row.light.reported_ns = Some(at_ns);
                    }
                }
                Some(Message::End) => break,
                None => {
                    if let Some(list) = &mut list {
                        written = written.and_then(|()| list.tend());
                    }
                }
            }
            while self.rows.front().is_some_and(|row| row.light.reported_ns.is_some()) || self.rows.len() > UNREPORTED {
                written = written.and(self.finish_row(list.as_mut()));
            }
        }
        while !self.rows.is_empty() {
            written = written.and(self.finish_row(list.as_mut()));
        }
        let finished = list.map_or(Ok(()), GrowingFile::finish);
        Ok(written.and(finished)?)
    }

    fn now_ns(&self, otherwise: i64) -> i64 {
        self.clock.map_or(otherwise, |clock| clock.now_ns())
    }

    /// Waits for the light of a set and gives its pulse.
    fn pulse(&mut self, light: SetLight, has_pulse: bool) -> Row {
        let wanted_ns = light.predicted_ns.saturating_add(self.delay_ns);
        let mut row = Row { light, outcome: Outcome::None, wanted_ns, given_ns: None };
        if !has_pulse {
            return row;
        }
        if let Some(clock) = self.clock {
            clock.wait_until_ns(wanted_ns);
        }
        let begun = Instant::now();
        let begun_ns = self.now_ns(wanted_ns);
        row.outcome = match begun_ns.saturating_sub(wanted_ns) > self.period_ns / 2 {
            true => Outcome::Late,
            false => self.give(light.set),
        };
        self.track.span("pulse", light.set, begun);
        let count = match row.outcome {
            Outcome::Sent => {
                // A line ends after its width, and its first edge counts.
                row.given_ns = Some(begun_ns);
                self.report.lateness_ms.add((begun_ns - wanted_ns).max(0) as f64 * 1e-6);
                &mut self.report.sent
            }
            Outcome::Late => &mut self.report.late,
            Outcome::Full => &mut self.report.full,
            Outcome::Lost | Outcome::None => &mut self.report.lost,
        };
        *count += 1;
        row
    }

    fn give(&mut self, number: u64) -> Outcome {
        if self.line.is_none() && self.tried.elapsed() >= AGAIN {
            self.tried = Instant::now();
            self.line = self.trigger.as_ref().and_then(|trigger| open_output(trigger).ok());
            if self.line.is_some() {
                self.notes.send("the line of [trigger_out] is back");
            }
        }
        let Some(line) = &mut self.line else { return Outcome::Lost };
        match line.pulse(number) {
            Ok(Given::Sent) => Outcome::Sent,
            Ok(Given::Full) => Outcome::Full,
            Err(error) => {
                self.lose(&error);
                Outcome::Lost
            }
        }
    }

    fn lose(&mut self, error: &TriggerError) {
        self.notes
            .send(format!("{error}. Content continues without pulses, and the line is opened again if it returns"));
        (self.line, self.tried) = (None, Instant::now());
    }

    /// Takes the oldest set, of which no more is to be learned.
    fn finish_row(&mut self, list: Option<&mut GrowingFile>) -> Result<(), FileError> {
        let Some(Row { light, outcome, wanted_ns, given_ns }) = self.rows.pop_front() else { return Ok(()) };
        if let Some(observer) = &mut self.observer {
            observer(&light);
        }
        if let (Some(given), Some(reported)) = (given_ns, light.reported_ns) {
            match given >= reported {
                true => self.report.after_light_ms.add((given - reported) as f64 * 1e-6),
                false => self.report.before_light += 1,
            }
        }
        let Some(list) = list else { return Ok(()) };
        let number = |ns: Option<i64>| ns.map(|ns| ns.to_string()).unwrap_or_default();
        let SetLight { set, content, video_frame, new, reported_ns, .. } = light;
        let (given, reported, new, pulse) = (number(given_ns), number(reported_ns), u8::from(new), outcome.name());
        list.add(|out| writeln!(out, "{set},{content},{video_frame},{new},{wanted_ns},{given},{reported},{pulse}"))
    }
}
