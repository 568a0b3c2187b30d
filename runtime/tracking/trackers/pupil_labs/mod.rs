//! Reads Pupil Core's network interface (docs.pupil-labs.com/core/developer/network-api).
//!
//! Pupil Remote answers requests at port 50020, and names the port at which pupil data is published as MessagePack.
//!
//! Sample times are of Pupil's own clock, which may begin anywhere, also below zero. Samples and the answers to
//! requests for the time, every few seconds, map that clock to the steady one. Positions are shares of the eye camera's
//! picture, so they need a calibration.

mod zmtp;

use super::clock::{ForeignClock, Stamp};
use super::source::{Complaints, news};
use super::{About, Dropped, Event, Quantity, Reading, Sample, Source, TimeUnit, TrackerError, Unit, now_ns};
use eyebox_base::error::Reason;
use eyebox_base::reason;
use serde::Deserialize;
use std::collections::VecDeque;
use std::io;
use std::time::Duration;
use zmtp::{Socket, invalid};

const CONNECT: Duration = Duration::from_millis(500);
const ANSWER: Duration = Duration::from_millis(200);
/// Time between attempts to connect.
const RETRY_NS: u64 = 1_000_000_000;
/// Time between requests for the time.
const TIME_NS: u64 = 5_000_000_000;
/// Shortest and longest time between two pictures of one camera.
const PERIOD_NS: [u64; 2] = [2_000_000, 40_000_000];
/// An eye that has been silent for this time is not waited for.
const ALONE_NS: u64 = 500_000_000;

/// The used fields of a pupil datum. Other fields are ignored.
#[derive(Debug, Clone, PartialEq, Deserialize)]
struct Datum {
    id: u8,
    confidence: f64,
    norm_pos: [f64; 2],
    timestamp: f64,
    #[serde(default)]
    diameter_3d: Option<f64>,
}

/// A connection to Pupil Core.
struct Link {
    remote: Socket,
    data: Socket,
    asked_ns: u64,
}

/// Pupil Core over the network. It connects again when the connection is lost.
pub struct PupilCoreSource {
    host: String,
    port: u16,
    latency_ns: u64,
    link: Option<Link>,
    tried_ns: Option<u64>,
    said: String,
    wrong: Complaints,
    clock: ForeignClock,
    /// The last reading with the number of its eye and its tracker time. It waits for the reading of the other eye.
    waiting: Option<(usize, i64, Sample)>,
    /// Last arrival of each eye.
    heard_ns: [Option<u64>; 2],
    /// Pupil's time of each eye's last picture, and the time between two pictures. Readings within half of it are a
    /// pair.
    pictures: [(Option<i64>, u64); 2],
    heard_3d_ns: [Option<u64>; 2],
    ready: VecDeque<Sample>,
}

impl PupilCoreSource {
    /// Creates a source that connects at its first request.
    pub fn new(host: &str, port: u16, latency_ns: u64) -> Self {
        Self {
            host: host.into(),
            port,
            latency_ns,
            link: None,
            tried_ns: None,
            said: String::new(),
            wrong: Complaints::default(),
            clock: ForeignClock::of(TimeUnit::Seconds),
            waiting: None,
            heard_ns: [None; 2],
            pictures: [(None, 8_000_000); 2],
            heard_3d_ns: [None; 2],
            ready: VecDeque::new(),
        }
    }

    fn name(&self) -> String {
        format!("pupil://{}:{}", self.host, self.port)
    }

    fn connect(&mut self) -> io::Result<Link> {
        let mut remote = Socket::connect(&self.host, self.port, "REQ", CONNECT)?;
        let answer = remote.ask("SUB_PORT", ANSWER)?.ok_or_else(|| invalid("no answer to SUB_PORT"))?;
        let port = std::str::from_utf8(&answer).ok().and_then(|t| t.trim().parse::<u16>().ok()).filter(|p| *p != 0);
        let port = port.ok_or_else(|| invalid("the answer to SUB_PORT is not a port"))?;
        let mut data = Socket::connect(&self.host, port, "SUB", CONNECT)?;
        data.subscribe("pupil.")?;
        let mut link = Link { remote, data, asked_ns: now_ns() };
        for _ in 0..5 {
            link.ask_time(&mut self.clock)?;
        }
        Ok(link)
    }

    /// Converts a message to samples that are ready. The error states the problem of the message.
    fn take(&mut self, parts: &[Vec<u8>], received_ns: u64) -> Result<(), Reason> {
        let [topic, payload, ..] = parts else { return Err(reason!("no-payload", "a message without a payload")) };
        let datum: Datum = rmp_serde::from_slice(payload).map_err(|e| e.to_string())?;
        let eye = usize::from(datum.id);
        if eye > 1 || !is_time(datum.timestamp) {
            return Err(reason!("pupil", "eye {} at {} s", datum.id, datum.timestamp));
        }
        let in_3d = datum.diameter_3d.is_some() || topic.ends_with(b"3d");
        let lately = |at: Option<u64>, ns: u64| at.is_some_and(|at| received_ns.saturating_sub(at) < ns);
        if in_3d {
            self.heard_3d_ns[eye] = Some(received_ns);
        } else if lately(self.heard_3d_ns[eye], ALONE_NS) {
            return Ok(()); // It is the same picture by the other method.
        }
        self.heard_ns[eye] = Some(received_ns);
        let Stamp { tracker_ns, time_ns } = self.clock.place(nanoseconds(datum.timestamp), received_ns);
        let (last, period) = &mut self.pictures[eye];
        if let Some(step) = last.replace(tracker_ns).and_then(|last| u64::try_from(tracker_ns.checked_sub(last)?).ok())
        {
            *period = (*period * 3 + step.clamp(PERIOD_NS[0], PERIOD_NS[1])) / 4;
        }
        let near = self.pictures[eye].1 / 2;
        let [x, y] = datum.norm_pos;
        let reading = Reading {
            // Pupil's y counts upwards.
            position: [x, 1.0 - y],
            diameter: datum.diameter_3d.map(|d| d * 1e-3),
            confidence: datum.confidence,
            valid: datum.confidence > 0.0,
            ..Reading::new(Quantity::Pupil, Unit::Normalized, [0.5, 0.5])
        }
        .checked();
        let mut sample = Sample::empty(received_ns);
        sample.tracker_ns = Some(tracker_ns);
        sample.time_ns = time_ns.saturating_sub(self.latency_ns);
        // Eye 0 is the right eye.
        *if eye == 0 { &mut sample.right } else { &mut sample.left } = Some(reading);
        if let Some((other, at, mut first)) = self.waiting.take() {
            if other != eye && at.abs_diff(tracker_ns) <= near {
                first.left = first.left.or(sample.left);
                first.right = first.right.or(sample.right);
                first.time_ns = first.time_ns.midpoint(sample.time_ns);
                first.tracker_ns = Some(at.midpoint(tracker_ns));
                first.received_ns = received_ns;
                self.ready.push_back(first);
                return Ok(());
            }
            self.ready.push_back(first);
        }
        if lately(self.heard_ns[1 - eye], ALONE_NS) {
            self.waiting = Some((eye, tracker_ns, sample));
        } else {
            self.ready.push_back(sample);
        }
        Ok(())
    }

    fn lost(&mut self, reason: &io::Error) -> Event {
        self.link = None;
        self.waiting = None;
        let text = format!("{}: {reason}", self.name());
        news(&mut self.said, text).unwrap_or(Event::Nothing)
    }
}

impl Link {
    /// Requests Pupil's time. The answer shows it at its arrival, as a sample does.
    fn ask_time(&mut self, clock: &mut ForeignClock) -> io::Result<()> {
        self.asked_ns = now_ns();
        let answer = self.remote.ask("t", ANSWER)?;
        let seconds = answer.and_then(|a| std::str::from_utf8(&a).ok()?.trim().parse::<f64>().ok());
        let Some(seconds) = seconds.filter(|s| is_time(*s)) else {
            // A late answer would be taken for the answer to the next request.
            return Err(invalid("no time in answer to t"));
        };
        clock.place(nanoseconds(seconds), now_ns());
        Ok(())
    }
}

/// True if a number can be a time in seconds, of any origin, within 300 years.
fn is_time(seconds: f64) -> bool {
    seconds.abs() < 9e9
}

fn nanoseconds(seconds: f64) -> i128 {
    (seconds * 1e9).round() as i128
}

impl Source for PupilCoreSource {
    fn about(&self) -> About {
        let state = if self.link.is_some() { "connected" } else { "not connected" };
        About { name: self.name(), kind: "network", rate_hz: None, notes: vec![state.into()] }
    }

    fn next(&mut self, timeout: Duration) -> Result<Event, TrackerError> {
        if let Some(sample) = self.ready.pop_front() {
            return Ok(Event::Sample(sample, None));
        }
        let now = now_ns();
        let Some(link) = &mut self.link else {
            if self.tried_ns.is_some_and(|at| now.saturating_sub(at) < RETRY_NS) {
                std::thread::sleep(timeout.min(Duration::from_nanos(RETRY_NS)));
                return Ok(Event::Nothing);
            }
            self.tried_ns = Some(now);
            return Ok(match self.connect() {
                Ok(link) => {
                    self.link = Some(link);
                    self.said.clear();
                    Event::Note(format!("{}: connected", self.name()))
                }
                Err(e) => self.lost(&e),
            });
        };
        if now.saturating_sub(link.asked_ns) > TIME_NS
            && let Err(e) = link.ask_time(&mut self.clock)
        {
            return Ok(self.lost(&e));
        }
        if let Some(event) = self.clock.event() {
            return Ok(Event::Note(format!("{}: {event}", self.name())));
        }
        let Some(link) = &mut self.link else { return Ok(Event::Nothing) };
        match link.data.message(timeout) {
            Ok(Some(parts)) => {
                let received = now_ns();
                if let Err(reason) = self.take(&parts, received) {
                    let what = format!("an invalid message ({reason})");
                    if let Some(note) = self.wrong.add(received, &self.name(), what) {
                        return Ok(note);
                    }
                }
                Ok(self.ready.pop_front().map_or(Event::Nothing, |s| Event::Sample(s, None)))
            }
            Ok(None) => {
                // The reading of the other eye does not arrive any more.
                let late = self.waiting.take_if(|(_, _, s)| now_ns().saturating_sub(s.received_ns) > PERIOD_NS[1]);
                Ok(late.map_or(Event::Nothing, |(_, _, s)| Event::Sample(s, None)))
            }
            Err(e) => Ok(self.lost(&e)),
        }
    }

    fn dropped(&self) -> Dropped {
        Dropped { messages: self.wrong.count, clock_sets: self.clock.sets, ..Dropped::default() }
    }
}

#[cfg(test)]
mod tests;
