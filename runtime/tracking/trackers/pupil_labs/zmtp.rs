//! Implements the part of ZeroMQ's wire protocol that two client sockets need.
//!
//! It is ZMTP 3.0 (rfc.zeromq.org/spec/23), mechanism NULL, over TCP. Received data is bounded. A peer that breaks the
//! protocol is an error, after which the connection is closed.

use crate::trackers::resolve::resolve;
use std::io::{self, ErrorKind, Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

/// Longest message with all its parts, bytes.
pub const LONGEST_MESSAGE: usize = 256 << 10;
/// Largest number of parts of a message.
pub const MOST_PARTS: usize = 16;
const GREETING: usize = 64;
const MORE: u8 = 1;
const LONG: u8 = 2;
const COMMAND: u8 = 4;

/// Makes the error of a peer that breaks the protocol.
pub fn invalid(what: impl Into<String>) -> io::Error {
    io::Error::new(ErrorKind::InvalidData, what.into())
}

/// Received data, which is a message with its parts or a command.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Arrival {
    /// A message with its parts.
    Message(Vec<Vec<u8>>),
    /// A command with its body.
    Command(Vec<u8>),
}

/// Assembles frames from a stream of bytes.
#[derive(Debug, Clone, Default)]
pub struct Frames {
    bytes: Vec<u8>,
    parts: Vec<Vec<u8>>,
}

impl Frames {
    /// Adds bytes that were received.
    pub fn push(&mut self, bytes: &[u8]) {
        self.bytes.extend_from_slice(bytes);
    }

    /// The next message or command, if it is complete.
    ///
    /// # Errors
    /// `InvalidData` for reserved flags, too many bytes or too many parts.
    pub fn next(&mut self) -> io::Result<Option<Arrival>> {
        loop {
            let Some(&flags) = self.bytes.first() else { return Ok(None) };
            if flags & !(MORE | LONG | COMMAND) != 0 || (flags & COMMAND != 0 && flags & MORE != 0) {
                return Err(invalid(format!("a frame with flags 0x{flags:02x}, which is not ZMTP 3.0")));
            }
            let (head, length) = if flags & LONG != 0 {
                let Some(size) = self.bytes.get(1..9).and_then(|b| <[u8; 8]>::try_from(b).ok()) else {
                    return Ok(None);
                };
                (9, usize::try_from(u64::from_be_bytes(size)).unwrap_or(usize::MAX))
            } else {
                let Some(&size) = self.bytes.get(1) else { return Ok(None) };
                (2, usize::from(size))
            };
            let before: usize = self.parts.iter().map(Vec::len).sum();
            if length > LONGEST_MESSAGE - before.min(LONGEST_MESSAGE) || self.parts.len() == MOST_PARTS {
                return Err(invalid(format!("a message of more than {LONGEST_MESSAGE} bytes or {MOST_PARTS} parts")));
            }
            let Some(body) = self.bytes.get(head..head + length) else { return Ok(None) };
            let body = body.to_vec();
            self.bytes.drain(..head + length);
            if flags & COMMAND != 0 {
                return Ok(Some(Arrival::Command(body)));
            }
            self.parts.push(body);
            if flags & MORE == 0 {
                return Ok(Some(Arrival::Message(std::mem::take(&mut self.parts))));
            }
        }
    }
}

/// A frame in its wire format.
pub fn frame(body: &[u8], flags: u8) -> Vec<u8> {
    let mut out = Vec::with_capacity(body.len() + 9);
    match u8::try_from(body.len()) {
        Ok(short) => out.extend([flags, short]),
        Err(_) => {
            out.push(flags | LONG);
            out.extend((body.len() as u64).to_be_bytes());
        }
    }
    out.extend_from_slice(body);
    out
}

/// The 64 bytes that open a connection.
pub fn greeting() -> [u8; GREETING] {
    let mut bytes = [0; GREETING];
    bytes[0] = 0xff;
    bytes[9] = 0x7f;
    bytes[10] = 3; // version 3.0
    bytes[12..16].copy_from_slice(b"NULL");
    bytes
}

/// The READY command that states the type of this socket.
pub fn ready(socket: &str) -> Vec<u8> {
    let mut body = b"\x05READY\x0bSocket-Type".to_vec();
    body.extend((socket.len() as u32).to_be_bytes());
    body.extend(socket.as_bytes());
    frame(&body, COMMAND)
}

/// A connected socket of ZeroMQ.
#[derive(Debug)]
pub struct Socket {
    stream: TcpStream,
    frames: Frames,
}

impl Socket {
    /// Connects as a socket of a type (`REQ`, `SUB`) and performs the handshake.
    ///
    /// # Errors
    /// The errors of the network, and `InvalidData` if the peer does not use ZMTP 3.
    pub fn connect(host: &str, port: u16, socket: &str, timeout: Duration) -> io::Result<Self> {
        let until = Instant::now() + timeout;
        let mut last = io::Error::new(ErrorKind::NotFound, "no such address");
        let connect = |address| TcpStream::connect_timeout(&address, timeout).map_err(|e| last = e).ok();
        let connected = resolve(host, port, timeout)?.into_iter().take(4).find_map(connect);
        let stream = connected.ok_or(last)?;
        stream.set_nodelay(true)?;
        stream.set_write_timeout(Some(timeout))?;
        let mut this = Self { stream, frames: Frames::default() };
        this.stream.write_all(&greeting())?;
        let mut theirs = [0; GREETING];
        this.read_exact(&mut theirs, until)?;
        if theirs[0] != 0xff || theirs[9] & 1 == 0 || theirs[10] < 3 {
            return Err(invalid("the peer does not use ZMTP 3"));
        }
        if &theirs[12..17] != b"NULL\0" {
            return Err(invalid("the peer requires a security mechanism other than NULL"));
        }
        this.stream.write_all(&ready(socket))?;
        match this.receive(until)? {
            Some(Arrival::Command(body)) if body.starts_with(b"\x05READY") => Ok(this),
            Some(_) => Err(invalid("the peer sent no READY command")),
            None => Err(ErrorKind::TimedOut.into()),
        }
    }

    fn read_exact(&mut self, bytes: &mut [u8], until: Instant) -> io::Result<()> {
        let mut done = 0;
        while done < bytes.len() {
            match self.read(&mut bytes[done..], until)? {
                Some(n) => done += n,
                None => return Err(ErrorKind::TimedOut.into()),
            }
        }
        Ok(())
    }

    /// Reads some bytes, or none within the time limit.
    fn read(&mut self, bytes: &mut [u8], until: Instant) -> io::Result<Option<usize>> {
        let left = until.saturating_duration_since(Instant::now()).max(Duration::from_micros(100));
        self.stream.set_read_timeout(Some(left))?;
        match self.stream.read(bytes) {
            Ok(0) => Err(ErrorKind::ConnectionAborted.into()),
            Ok(n) => Ok(Some(n)),
            Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted) => {
                Ok(None)
            }
            Err(e) => Err(e),
        }
    }

    fn receive(&mut self, until: Instant) -> io::Result<Option<Arrival>> {
        let mut bytes = [0; 8192];
        loop {
            if let Some(arrival) = self.frames.next()? {
                return Ok(Some(arrival));
            }
            match self.read(&mut bytes, until)? {
                Some(n) => self.frames.push(&bytes[..n]),
                None => return Ok(None),
            }
        }
    }

    /// Waits at most `timeout` for the next message. It answers a PING on the way.
    ///
    /// # Errors
    /// The errors of the network and of [`Frames::next`].
    pub fn message(&mut self, timeout: Duration) -> io::Result<Option<Vec<Vec<u8>>>> {
        let until = Instant::now() + timeout;
        loop {
            match self.receive(until)? {
                Some(Arrival::Message(parts)) => return Ok(Some(parts)),
                Some(Arrival::Command(body)) => {
                    // PING has two bytes of time-to-live and a context that PONG returns.
                    if let Some(context) = body.strip_prefix(b"\x04PING").and_then(|rest| rest.get(2..)) {
                        let pong = [b"\x04PONG", &context[..context.len().min(16)]].concat();
                        self.stream.write_all(&frame(&pong, COMMAND))?;
                    }
                }
                None => return Ok(None),
            }
            // A peer that only sends commands does not hold up the caller.
            if Instant::now() >= until {
                return Ok(None);
            }
        }
    }

    /// Sends a message of one or more parts.
    ///
    /// # Errors
    /// The errors of the network.
    pub fn send(&mut self, parts: &[&[u8]]) -> io::Result<()> {
        let last = parts.len().saturating_sub(1);
        let bytes: Vec<u8> =
            parts.iter().enumerate().flat_map(|(i, p)| frame(p, if i < last { MORE } else { 0 })).collect();
        self.stream.write_all(&bytes)
    }

    /// Subscribes a SUB socket to all topics that start with `prefix`.
    ///
    /// # Errors
    /// The errors of the network.
    pub fn subscribe(&mut self, prefix: &str) -> io::Result<()> {
        let message = [&[1], prefix.as_bytes()].concat();
        self.send(&[&message])
    }

    /// Sends the request of a REQ socket and returns the first part of its answer. It is `None` if there is none within
    /// the time limit.
    ///
    /// # Errors
    /// The errors of the network.
    pub fn ask(&mut self, question: &str, timeout: Duration) -> io::Result<Option<Vec<u8>>> {
        self.send(&[b"", question.as_bytes()])?;
        let answer = self.message(timeout)?;
        Ok(answer.and_then(|parts| parts.into_iter().find(|p| !p.is_empty())))
    }
}
