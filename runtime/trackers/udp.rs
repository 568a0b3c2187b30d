//! [Lines](super::line) of JSON in UDP datagrams: a tracker that anyone can write.
//!
//! The socket listens at the address that it was told, loopback by default, so that nobody else reaches it. One sender
//! is heard at a time: the first, until it has been silent for two seconds. A datagram carries one line or a few, 2048
//! bytes at most; what makes no sense is counted, said once a second at most, and dropped.

use super::line::{self, LONGEST_LINE};
use super::{About, ClockOffset, Event, Sample, Source, TrackerError, now_ns};
use std::collections::VecDeque;
use std::net::{SocketAddr, ToSocketAddrs, UdpSocket};
use std::time::Duration;

const MOST_LINES: usize = 16;
const SILENT_NS: u64 = 2_000_000_000;
const SAY_NS: u64 = 1_000_000_000;

/// Listens for lines of JSON.
#[derive(Debug)]
pub struct UdpSource {
    socket: UdpSocket,
    address: String,
    latency_ns: u64,
    /// Who is heard, and when last.
    sender: Option<(SocketAddr, u64)>,
    offset: ClockOffset,
    waiting: VecDeque<Sample>,
    wrong: u64,
    said_ns: Option<u64>,
    buffer: Box<[u8; LONGEST_LINE + 1]>,
}

impl UdpSource {
    /// Listens at an address of this machine.
    ///
    /// # Errors
    /// [`TrackerError::Network`]: no such address, or the port is taken.
    pub fn bind(host: &str, port: u16, latency_ns: u64) -> Result<Self, TrackerError> {
        let address = format!("udp://{host}:{port}");
        let wrong = |reason: String| TrackerError::Network { address: address.clone(), reason };
        let found = (host, port).to_socket_addrs().map_err(|e| wrong(e.to_string()))?.next();
        let found = found.ok_or_else(|| wrong("no such address".into()))?;
        let socket = UdpSocket::bind(found).map_err(|e| wrong(format!("cannot listen: {e}")))?;
        Ok(Self {
            socket,
            address,
            latency_ns,
            sender: None,
            offset: ClockOffset::default(),
            waiting: VecDeque::new(),
            wrong: 0,
            said_ns: None,
            buffer: Box::new([0; LONGEST_LINE + 1]),
        })
    }

    /// Where it listens.
    ///
    /// # Errors
    /// [`TrackerError::Network`].
    pub fn local(&self) -> Result<SocketAddr, TrackerError> {
        let wrong = |e: std::io::Error| TrackerError::Network { address: self.address.clone(), reason: e.to_string() };
        self.socket.local_addr().map_err(wrong)
    }

    fn complain(&mut self, now: u64, what: String) -> Event {
        self.wrong += 1;
        if self.said_ns.is_some_and(|at| now.saturating_sub(at) < SAY_NS) {
            return Event::Nothing;
        }
        self.said_ns = Some(now);
        Event::Note(format!("{}: {what} ({} dropped so far)", self.address, self.wrong))
    }

    fn datagram(&mut self, length: usize, now: u64) -> Option<String> {
        if length > LONGEST_LINE {
            return Some(format!("a datagram of more than {LONGEST_LINE} bytes"));
        }
        let mut wrong = None;
        let lines = self.buffer[..length].split(|b| *b == b'\n').map(<[u8]>::trim_ascii).filter(|l| !l.is_empty());
        let mut empty = true;
        for (i, text) in lines.enumerate() {
            empty = false;
            if i == MOST_LINES {
                wrong = Some(format!("more than {MOST_LINES} lines in a datagram"));
                break;
            }
            match line::parse(text) {
                Ok(line) => {
                    let tracker_ns = line.seconds.map(|s| (s * 1e9) as u64);
                    let arrival = tracker_ns.map_or(now, |t| self.offset.arrival(t, now));
                    let [left, right, combined] = line.readings;
                    let time_ns = arrival.saturating_sub(self.latency_ns);
                    self.waiting.push_back(Sample { time_ns, received_ns: now, tracker_ns, left, right, combined });
                }
                Err(reason) => wrong = Some(format!("a line that makes no sense: {reason}")),
            }
        }
        if empty { Some("an empty datagram".into()) } else { wrong }
    }
}

impl Source for UdpSource {
    fn about(&self) -> About {
        let from = self.sender.map_or("nobody has sent yet".into(), |(s, _)| format!("hears {s}"));
        About { name: self.address.clone(), kind: "network", rate_hz: None, notes: vec![from] }
    }

    fn next(&mut self, timeout: Duration) -> Result<Event, TrackerError> {
        if let Some(sample) = self.waiting.pop_front() {
            return Ok(Event::Sample(sample, None));
        }
        // A timeout of zero would mean for ever.
        let _ = self.socket.set_read_timeout(Some(timeout.max(Duration::from_micros(100))));
        let Ok((length, from)) = self.socket.recv_from(&mut self.buffer[..]) else {
            // Nothing within the time; an interrupted call or an ICMP answer is nothing too.
            return Ok(Event::Nothing);
        };
        let now = now_ns();
        let fresh = match self.sender {
            Some((sender, at)) if sender != from => {
                if now.saturating_sub(at) < SILENT_NS {
                    return Ok(self.complain(now, format!("a second sender, {from}, beside {sender}")));
                }
                true
            }
            Some(_) => false,
            None => true,
        };
        if fresh {
            self.offset = ClockOffset::default();
        }
        let wrong = self.datagram(length, now);
        if !self.waiting.is_empty() {
            self.sender = Some((from, now));
        }
        if let Some(what) = wrong {
            return Ok(self.complain(now, what));
        }
        if fresh && !self.waiting.is_empty() {
            return Ok(Event::Note(format!("{}: hears {from}", self.address)));
        }
        Ok(self.waiting.pop_front().map_or(Event::Nothing, |s| Event::Sample(s, None)))
    }
}
