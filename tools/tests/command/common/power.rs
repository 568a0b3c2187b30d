//! An X server with power saving (the extension DPMS). The virtual servers Xvfb, Xephyr, Xvnc and Xorg's dummy driver
//! lack it, because their monitors have no power to save.
//!
//! This server is a proxy between a program and Xvfb. It handles the two requests that concern DPMS and passes
//! everything else on. The bytes follow the X protocol, version 11, and DPMS 1.2.

use super::xvfb::Server;
use std::collections::HashMap;
use std::io::{self, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::os::unix::net::UnixStream;
use std::sync::atomic::{AtomicU16, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::spawn;

/// An X server listens on this port plus the number of its display.
const FIRST_PORT: u16 = 6000;

/// The major opcode of DPMS in this server. Xvfb gives the numbers from 128 on to its own extensions, which are fewer
/// than 50.
const DPMS: u8 = 200;
const DPMS_GET_TIMEOUTS: u8 = 2;
const DPMS_SET_TIMEOUTS: u8 = 3;
const DPMS_INFO: u8 = 7;
const NO_OPERATION: u8 = 127;
const QUERY_EXTENSION: u8 = 98;
const GET_INPUT_FOCUS: u8 = 43;

/// Functions that write the replies of this server, by the number of their request.
type Answers = Arc<Mutex<HashMap<u16, fn(&mut [u8], &State)>>>;

/// Display whose monitor has power saving.
pub struct PowerSaving {
    /// Name of the display in the form of `DISPLAY`.
    pub name: String,
    state: Arc<State>,
}

#[derive(Default)]
struct State {
    /// Power level in the numbers of DPMS. 0 is on, 1 standby, 2 suspended, 3 off.
    level: AtomicU16,
    /// Number of reads of this level by programs since it was set.
    read: AtomicU16,
    /// Seconds to standby, suspend and off.
    timeouts: Mutex<[u16; 3]>,
}

impl PowerSaving {
    pub fn before(server: &Server) -> Self {
        let (listener, number) = (0..1000)
            .find_map(|number| {
                Some((TcpListener::bind(("127.0.0.1", FIRST_PORT + 1000 + number)).ok()?, 1000 + number))
            })
            .expect("a free port");
        let state = Arc::new(State::default());
        let (socket, shared) = (format!("/tmp/.X11-unix/X{}", server.name.trim_start_matches(':')), state.clone());
        spawn(move || {
            for program in listener.incoming().map_while(Result::ok) {
                let (server, state) = (UnixStream::connect(&socket).expect("the server"), shared.clone());
                spawn(move || serve(program, server, &state));
            }
        });
        Self { name: format!("127.0.0.1:{number}"), state }
    }

    /// Returns the seconds to standby, suspend and off.
    pub fn timeouts(&self) -> [u16; 3] {
        *self.state.timeouts.lock().expect("no panic")
    }

    /// Sets the seconds to standby, suspend and off.
    pub fn set_timeouts(&self, timeouts: [u16; 3]) {
        *self.state.timeouts.lock().expect("no panic") = timeouts;
    }

    /// Changes the level and waits until a program has read it.
    pub fn set(&self, level: u16) {
        self.state.level.store(level, Ordering::SeqCst);
        self.state.read.store(0, Ordering::SeqCst);
        while self.state.read.load(Ordering::SeqCst) == 0 {
            std::thread::sleep(std::time::Duration::from_millis(10));
        }
    }
}

/// Forwards the data of a connection until one side closes it.
fn serve(program: TcpStream, server: UnixStream, state: &Arc<State>) {
    let (answers, shared) = (Answers::default(), Arc::clone(state));
    let (from, to, known) =
        (program.try_clone().expect("a socket"), server.try_clone().expect("a socket"), answers.clone());
    spawn(move || {
        let _ = requests(&from, &to, &known, &shared);
        let _ = to.shutdown(std::net::Shutdown::Both);
    });
    let _ = replies(&server, &program, &answers, state);
    let _ = program.shutdown(std::net::Shutdown::Both);
}

fn number(bytes: &[u8]) -> u16 {
    u16::from_le_bytes([bytes[0], bytes[1]])
}

fn long(bytes: &[u8]) -> usize {
    u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]) as usize
}

/// Appends `count` more bytes to `bytes`.
fn read_on(mut from: impl Read, bytes: &mut Vec<u8>, count: usize) -> io::Result<()> {
    let start = bytes.len();
    bytes.resize(start + count, 0);
    from.read_exact(&mut bytes[start..])
}

fn requests(from: &TcpStream, mut to: &UnixStream, answers: &Answers, state: &State) -> io::Result<()> {
    let mut setup = Vec::new();
    read_on(from, &mut setup, 12)?;
    assert_eq!(setup[0], b'l', "this server understands little endian programs");
    let padded = |length: u16| usize::from(length).next_multiple_of(4);
    let rest = padded(number(&setup[6..])) + padded(number(&setup[8..]));
    read_on(from, &mut setup, rest)?;
    to.write_all(&setup)?;
    for sequence in 1_u16.. {
        let mut request = Vec::new();
        read_on(from, &mut request, 4)?;
        let units = usize::from(number(&request[2..]));
        let length = if units == 0 {
            read_on(from, &mut request, 4)?;
            4 * long(&request[4..])
        } else {
            4 * units
        };
        let rest = length - request.len();
        read_on(from, &mut request, rest)?;
        if request[0] == QUERY_EXTENSION && request[8..].starts_with(b"DPMS") {
            answers.lock().expect("no panic").insert(sequence, present);
        } else if request[0] == DPMS {
            // GetInputFocus has a reply of the same length, which keeps the order of the replies.
            let answer: fn(&mut [u8], &State) = match request[1] {
                DPMS_INFO => info,
                DPMS_GET_TIMEOUTS => get_timeouts,
                DPMS_SET_TIMEOUTS => {
                    let values = [4, 6, 8].map(|at| number(&request[at..]));
                    *state.timeouts.lock().expect("no panic") = values;
                    request[0] = NO_OPERATION;
                    to.write_all(&request)?;
                    continue;
                }
                other => panic!("this server has no request {other} of DPMS"),
            };
            request[..2].copy_from_slice(&[GET_INPUT_FOCUS, 0]);
            answers.lock().expect("no panic").insert(sequence, answer);
        }
        to.write_all(&request)?;
    }
    Ok(())
}

fn replies(from: &UnixStream, mut to: &TcpStream, answers: &Answers, state: &State) -> io::Result<()> {
    let mut setup = Vec::new();
    read_on(from, &mut setup, 8)?;
    let rest = 4 * usize::from(number(&setup[6..]));
    read_on(from, &mut setup, rest)?;
    to.write_all(&setup)?;
    loop {
        let mut message = Vec::new();
        read_on(from, &mut message, 32)?;
        // Replies and generic events can be longer than 32 bytes.
        if matches!(message[0] & 0x7f, 1 | 35) {
            let rest = 4 * long(&message[4..]);
            read_on(from, &mut message, rest)?;
        }
        if message[0] == 1
            && let Some(answer) = answers.lock().expect("no panic").remove(&number(&message[2..]))
        {
            answer(&mut message, state);
        }
        to.write_all(&message)?;
    }
}

/// Changes a reply so that the extension is present.
fn present(reply: &mut [u8], _: &State) {
    reply[8..12].copy_from_slice(&[1, DPMS, 0, 0]);
}

/// Changes a reply so that power saving is enabled and the monitor is at its level.
fn info(reply: &mut [u8], state: &State) {
    reply[8..10].copy_from_slice(&state.level.load(Ordering::SeqCst).to_le_bytes());
    reply[10] = 1;
    state.read.fetch_add(1, Ordering::SeqCst);
}

/// Changes a reply so that it has the timeouts.
fn get_timeouts(reply: &mut [u8], state: &State) {
    let timeouts = *state.timeouts.lock().expect("no panic");
    for (at, value) in [8, 10, 12].into_iter().zip(timeouts) {
        reply[at..at + 2].copy_from_slice(&value.to_le_bytes());
    }
}
