//! Receives [lines](super::line) of JSON in UDP datagrams, so that anyone can write a tracker.
//!
//! The socket listens at the given address, by default loopback, so that no other machine reaches it. It receives from
//! one sender at a time, which is the first until it has been silent for two seconds. A datagram carries one line or a
//! few, 2048 bytes at most. Invalid lines are counted and dropped, with at most one note per second.

use super::clock::{ClockEvent, ForeignClock};
use super::guard::Units;
use super::line::{self, LONGEST_LINE, Line};
use super::resolve::resolve;
use super::source::Complaints;
use super::{About, Dropped, Event, Sample, Source, TrackerError, now_ns};
use eyebox_base::error::Reason;
use eyebox_base::reason;
use std::collections::VecDeque;
use std::net::{SocketAddr, UdpSocket};
use std::time::Duration;

const MOST_LINES: usize = 16;
/// Longest time for the resolution of a name.
const RESOLVED: Duration = Duration::from_secs(5);
const SILENT_NS: u64 = 2_000_000_000;

/// Listens for lines of JSON.
#[derive(Debug)]
pub struct UdpSource {
    socket: UdpSocket,
    address: String,
    latency_ns: u64,
    /// The current sender and its last arrival.
    sender: Option<(SocketAddr, u64)>,
    clock: ForeignClock,
    units: Units,
    /// Number of times that the clocks of earlier senders were set.
    sets: u64,
    waiting: VecDeque<Sample>,
    notes: VecDeque<String>,
    wrong: Complaints,
    buffer: Box<[u8; LONGEST_LINE + 1]>,
}

impl UdpSource {
    /// Listens at an address of this machine.
    ///
    /// # Errors
    /// [`TrackerError::Network`] if there is no such address, or the port is taken.
    pub fn bind(host: &str, port: u16, latency_ns: u64) -> Result<Self, TrackerError> {
        let address = format!("udp://{host}:{port}");
        let wrong = |reason: Reason| TrackerError::Network { address: address.clone(), reason };
        let found = resolve(host, port, RESOLVED).map_err(|e| wrong(e.to_string().into()))?.into_iter().next();
        let found = found.ok_or_else(|| wrong(reason!("no-such-address", "no such address")))?;
        let socket = UdpSocket::bind(found).map_err(|e| wrong(reason!("cannot-listen", "cannot listen: {e}")))?;
        Ok(Self {
            socket,
            address,
            latency_ns,
            sender: None,
            clock: ForeignClock::new(),
            units: Units::default(),
            sets: 0,
            waiting: VecDeque::new(),
            notes: VecDeque::new(),
            wrong: Complaints::default(),
            buffer: Box::new([0; LONGEST_LINE + 1]),
        })
    }

    /// The address at which it listens.
    ///
    /// # Errors
    /// [`TrackerError::Network`] if the system does not report it.
    pub fn local(&self) -> Result<SocketAddr, TrackerError> {
        let wrong = |reason: Reason| TrackerError::Network { address: self.address.clone(), reason };
        self.socket.local_addr().map_err(|e| wrong(e.to_string().into()))
    }

    fn complain(&mut self, now: u64, what: String) -> Event {
        self.wrong.add(now, &self.address, what).unwrap_or(Event::Nothing)
    }

    fn datagram(&mut self, length: usize, now: u64) -> Option<String> {
        if length > LONGEST_LINE {
            return Some(format!("a datagram of more than {LONGEST_LINE} bytes"));
        }
        let (mut wrong, mut read) = (None, Vec::new());
        let lines = self.buffer[..length].split(|b| *b == b'\n').map(<[u8]>::trim_ascii).filter(|l| !l.is_empty());
        let mut empty = true;
        for (i, text) in lines.enumerate() {
            empty = false;
            if i == MOST_LINES {
                wrong = Some(format!("more than {MOST_LINES} lines in a datagram"));
                break;
            }
            match line::parse(text) {
                Ok(line) => read.push(line),
                Err(reason) => wrong = Some(format!("an invalid line ({reason})")),
            }
        }
        read.into_iter().for_each(|line| self.line(line, now));
        if empty { Some("an empty datagram".into()) } else { wrong }
    }

    fn line(&mut self, line: Line, now: u64) {
        if let Some(unit) = line.time_unit {
            self.clock.state(unit);
        }
        self.units.take(&line.readings, line.states_unit);
        let stamp = line.time.map(|time| self.clock.place((time * 1e9).round() as i128, now));
        let time_ns = stamp.map_or(now, |s| s.time_ns).saturating_sub(self.latency_ns);
        self.waiting.push_back(line.sample(time_ns, now, stamp.map(|s| s.tracker_ns)));
        while let Some(event) = self.clock.event() {
            let remedy = match event {
                ClockEvent::NoUnit(_) => ". Send seconds, or name the unit, as in \"t_unit\": \"ms\"",
                _ => "",
            };
            self.notes.push_back(format!("{}: {event}{remedy}", self.address));
        }
    }
}

impl Source for UdpSource {
    fn about(&self) -> About {
        let from = self.sender.map_or("no sender yet".into(), |(s, _)| format!("receives from {s}"));
        About { name: self.address.clone(), kind: "network", rate_hz: None, notes: vec![from] }
    }

    fn next(&mut self, timeout: Duration) -> Result<Event, TrackerError> {
        if let Some(sample) = self.waiting.pop_front() {
            return Ok(Event::Sample(sample, None));
        }
        if let Some(note) = self.notes.pop_front() {
            return Ok(Event::Note(note));
        }
        if let Some(largest) = self.units.in_doubt() {
            return Err(TrackerError::PositionUnit { name: self.address.clone(), largest_mm: largest * 1e3 });
        }
        // A timeout of zero would mean forever.
        let _ = self.socket.set_read_timeout(Some(timeout.max(Duration::from_micros(100))));
        let Ok((length, from)) = self.socket.recv_from(&mut self.buffer[..]) else {
            // No datagram arrived in time. An interrupted call or an ICMP answer counts as nothing, too.
            return Ok(Event::Nothing);
        };
        let now = now_ns();
        let other = self.sender.filter(|(sender, _)| *sender != from);
        if let Some((sender, _)) = other.filter(|(_, at)| now.saturating_sub(*at) < SILENT_NS) {
            return Ok(self.complain(now, format!("a second sender, {from}, besides {sender}")));
        }
        let fresh = self.sender.is_none() || other.is_some();
        if fresh {
            self.sets += self.clock.sets;
            (self.clock, self.units) = (ForeignClock::new(), Units::default());
        }
        let wrong = self.datagram(length, now);
        if !self.waiting.is_empty() {
            self.sender = Some((from, now));
        }
        if let Some(what) = wrong {
            return Ok(self.complain(now, what));
        }
        if fresh && !self.waiting.is_empty() {
            return Ok(Event::Note(format!("{}: receives from {from}", self.address)));
        }
        Ok(self.waiting.pop_front().map_or(Event::Nothing, |s| Event::Sample(s, None)))
    }

    fn dropped(&self) -> Dropped {
        Dropped { messages: self.wrong.count, clock_sets: self.sets + self.clock.sets, ..Dropped::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Instant;

    fn pair() -> (UdpSource, UdpSocket) {
        // Port 0 is any free port.
        let source = UdpSource::bind("127.0.0.1", 0, 0).unwrap();
        let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
        sender.connect(source.local().unwrap()).unwrap();
        (source, sender)
    }

    fn samples(source: &mut UdpSource) -> (Vec<Sample>, Vec<String>) {
        let (mut samples, mut notes, mut nothing) = (Vec::new(), Vec::new(), 0);
        while nothing < 2 {
            match source.next(Duration::from_millis(30)).unwrap() {
                Event::Sample(sample, _) => samples.push(sample),
                Event::Note(note) => notes.push(note),
                _ => nothing += 1,
            }
        }
        (samples, notes)
    }

    #[test]
    fn lines_become_samples_and_one_sender_is_heard() {
        let (mut source, sender) = pair();
        assert!(source.local().unwrap().ip().is_loopback());
        sender.send(b"{\"t\": 1.0, \"x\": 1.5, \"y\": -2}\n{\"t\": 1.01, \"x\": 1.6, \"y\": -2}").unwrap();
        let second = UdpSocket::bind("127.0.0.1:0").unwrap();
        second.send_to(b"{\"x\": 9, \"y\": 9}", source.local().unwrap()).unwrap();
        let (samples, notes) = samples(&mut source);
        assert_eq!(samples.len(), 2);
        assert_eq!(samples[0].combined.unwrap().position, [1.5e-3, -2e-3]);
        assert_eq!(samples[0].tracker_ns, Some(1_000_000_000));
        assert!(samples.iter().all(|s| s.time_ns <= s.received_ns));
        assert!(notes.len() >= 2, "one that hears, and a second sender: {notes:?}");
        assert!(UdpSource::bind("127.0.0.1", source.local().unwrap().port(), 0).is_err(), "the port is taken");
        assert!(UdpSource::bind("203.0.113.1", 9123, 0).is_err(), "an address of somebody else");
    }

    #[test]
    fn ten_thousand_datagrams_of_nonsense_are_survived() {
        let (mut source, sender) = pair();
        let mut rng = fastrand::Rng::with_seed(5);
        let mut notes = 0;
        let start = Instant::now();
        for i in 0..10_000u32 {
            let datagram: Vec<u8> = match i % 5 {
                0 => (0..rng.usize(0..200)).map(|_| rng.u8(..)).collect(),
                1 => vec![b'['; rng.usize(1..2048)],
                2 => vec![b'x'; rng.usize(2049..9000)],
                3 => b"{\"x\": 1, \"y\": nul}".to_vec(),
                _ => format!("{{\"left\": {{\"x\": {}}}", "9".repeat(rng.usize(1..500))).into_bytes(),
            };
            sender.send(&datagram).unwrap();
            match source.next(Duration::from_millis(100)).unwrap() {
                Event::Note(_) => notes += 1,
                Event::Nothing => {}
                other => panic!("{other:?}"),
            }
        }
        assert!(source.wrong.count >= 9_990, "{}", source.wrong.count);
        assert!(notes <= 2 + start.elapsed().as_secs(), "one line a second: {notes}");
        sender.send(b"{\"x\": 1, \"y\": 2}").unwrap();
        assert_eq!(samples(&mut source).0.len(), 1);
    }

    /// The placed times of lines at 120 per second from a clock with this unit and first time. Returns the largest
    /// error after half a second, nanoseconds, the number of placed lines, and the notes.
    fn placed(unit: f64, origin_s: f64, more: &str) -> (u64, usize, Vec<String>) {
        let (mut source, _) = pair();
        let (mut worst, mut count) = (0, 0);
        for i in 0..600u64 {
            let since_ns = i * 8_333_333;
            let time = (origin_s + since_ns as f64 * 1e-9) * unit;
            let text = format!("{{\"t\": {time}, \"x\": 1.5, \"y\": -2, \"diameter\": 4{more}}}");
            let received = 9_000_000_000 + since_ns + 2_000_000 + (i * 7919 % 10) * 1_000_000;
            source.line(line::parse(text.as_bytes()).unwrap(), received);
            let sample = source.waiting.pop_back().unwrap();
            count += usize::from(sample.valid());
            if since_ns > 500_000_000 {
                worst = worst.max(sample.time_ns.abs_diff(9_000_000_000 + since_ns + 2_000_000));
            }
        }
        (worst, count, source.notes.into())
    }

    /// Times of every origin, sign and unit are placed to a fraction of the jitter of 9 ms. A note names each unit
    /// other than seconds.
    #[test]
    fn clocks_of_senders_are_followed() {
        for (unit, name) in [(1.0, "s"), (1e3, "ms"), (1e6, "us"), (1e9, "ns")] {
            for origin_s in [0.0, -323_801.0, -1.0, 98.4, 1.69e9] {
                for stated in [String::new(), format!(", \"t_unit\": \"{name}\"")] {
                    let (worst, count, notes) = placed(unit, origin_s, &stated);
                    assert!(worst < 100_000, "{name} from {origin_s} s{stated}: {worst} ns");
                    let said = usize::from(name != "s" && stated.is_empty());
                    assert_eq!((count, notes.len()), (600, said), "{name} from {origin_s} s{stated}: {notes:?}");
                }
            }
        }
    }

    /// Times without a unit are placed at their arrival, with a note. Positions that no eye has end the source.
    #[test]
    fn what_has_no_unit_is_said() {
        let (_, count, notes) = placed(120.0, 0.0, "");
        assert_eq!((count, notes.len()), (600, 1), "{notes:?}");
        let (mut source, _) = pair();
        for i in 0..200u64 {
            let x = 0.003 * (i as f64).sin();
            let text = format!("{{\"t\": {}, \"x\": {x}, \"y\": 0}}", i as f64 / 120.0);
            source.line(line::parse(text.as_bytes()).unwrap(), 9_000_000_000 + i * 8_333_333);
        }
        (source.waiting, source.notes) = Default::default();
        assert!(matches!(source.next(Duration::ZERO), Err(TrackerError::PositionUnit { .. })));
    }
}
