//! Exchanges commands and replies with a controller.
//!
//! The controller has one buffer of 512 bytes for all commands, and a reply that nobody has fetched is overwritten. The
//! driver therefore requests a reply to each command and fetches it before it sends the next one. Replies to earlier
//! requests, which arrive late, have other sequence numbers and are dropped.

use super::command::Command;
use super::error::PlmError;
use super::link::{Link, REPORT};
use super::report::{REPLY_DATA, Reply, read_request, reply, write_request};
use super::values::{HardwareStatus, MainStatus, Versions, board, text};
use eyebox_optics::{Edge, PlaneTrigger};
use serde::Serialize;
use std::time::Duration;

/// The longest time for one reply. TI's program waits 10 s, and slmsuite 1 s.
const REPLY_TIME: Duration = Duration::from_secs(1);
/// The number of times that a read is requested. A write is requested once, because the controller may have run it.
const ATTEMPTS: u32 = 3;
/// The time for the further reports of a long reply. Without them the text of the first report is enough.
const CONTINUATION: Duration = Duration::from_millis(50);
/// The most reports that are dropped in a row. A device that sends without end is not a DLPC900.
const MOST_STRAY: usize = 64;

/// The steps that a controller has taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum State {
    /// The connection is open. The controller may do anything.
    Opened,
    /// The receiver is on, and the controller takes video.
    Prepared,
    /// The controller shows the 24 planes of each video frame.
    Running,
    /// The patterns are stopped, and the receiver is off.
    Asleep,
}

impl State {
    /// Returns the name for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Opened => "opened",
            Self::Prepared => "prepared",
            Self::Running => "running",
            Self::Asleep => "asleep",
        }
    }
}

/// The identity of a controller.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct Identity {
    /// The name of the board, or `unknown`, which PLM boards report.
    pub board: &'static str,
    /// The name of the firmware.
    pub firmware: String,
    /// The versions of the firmware.
    pub versions: Versions,
    /// The flips of the mirrors, if the firmware states them. They decide the orientation of the picture.
    pub flips: Option<Flips>,
}

/// The setting of the two flips of the mirrors, which decide the orientation of the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Flips {
    /// True if the picture is flipped along the long axis.
    pub long_axis: bool,
    /// True if the picture is flipped along the short axis.
    pub short_axis: bool,
}

/// A DLPC900 behind a [`Link`].
pub struct Controller {
    link: Box<dyn Link>,
    sequence: u8,
    pub(super) state: State,
    /// True if it may show patterns or receive video, so that it has to be put to sleep.
    pub(super) is_awake: bool,
    pub(super) trigger_out: PlaneTrigger,
    pub(super) trigger_in: Option<Edge>,
}

impl std::fmt::Debug for Controller {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Controller").field("state", &self.state).finish_non_exhaustive()
    }
}

impl Controller {
    /// Takes a connection. Replies to a program that ended before are dropped.
    ///
    /// # Errors
    /// [`PlmError::Link`] if the connection failed.
    pub fn new(link: Box<dyn Link>) -> Result<Self, PlmError> {
        let mut controller = Self {
            link,
            sequence: 0,
            state: State::Opened,
            is_awake: false,
            trigger_out: PlaneTrigger::default(),
            trigger_in: None,
        };
        let mut report = [0; REPORT];
        for _ in 0..MOST_STRAY {
            if controller.link.read(&mut report, Duration::from_millis(5))? == 0 {
                break;
            }
        }
        Ok(controller)
    }

    /// Selects the planes that TRIG_OUT_2 marks, and the edge of TRIG_IN_2 that starts them. The next
    /// [`begin`](Self::begin) uses them.
    pub fn set_triggers(&mut self, trigger_out: PlaneTrigger, trigger_in: Option<Edge>) {
        (self.trigger_out, self.trigger_in) = (trigger_out, trigger_in);
    }

    /// Closes a connection that failed, so that nothing more is sent over it.
    pub fn abandon(&mut self) {
        self.is_awake = false;
        self.close();
    }

    /// Returns the steps that it has taken.
    pub fn state(&self) -> State {
        self.state
    }

    /// Returns the time of the connection's clock.
    pub(super) fn now(&self) -> Duration {
        self.link.now()
    }

    /// Lets time pass. Reports that arrive are replies to earlier requests and are dropped.
    pub(super) fn wait(&mut self, time: Duration) -> Result<(), PlmError> {
        let end = self.link.now() + time;
        let mut report = [0; REPORT];
        for _ in 0..MOST_STRAY {
            let left = end.saturating_sub(self.link.now());
            if left.is_zero() {
                break;
            }
            self.link.read(&mut report, left)?;
        }
        Ok(())
    }

    /// Returns `needed` bytes of a command's data.
    pub(super) fn read<const N: usize>(&mut self, command: Command) -> Result<[u8; N], PlmError> {
        let data = self.read_data(command)?;
        let bytes = data.len();
        data.get(..N).and_then(|data| data.try_into().ok()).ok_or(PlmError::ShortReply { command, bytes, needed: N })
    }

    /// Returns the data of a command, 1 byte or more.
    fn read_data(&mut self, command: Command) -> Result<Vec<u8>, PlmError> {
        for _ in 0..ATTEMPTS {
            let sequence = self.next_sequence();
            self.link.write(&read_request(command.code(), sequence))?;
            let Some(reply) = self.reply(sequence)? else { continue };
            if reply.is_error {
                return Err(self.refused(command));
            }
            return self.whole(reply);
        }
        Err(PlmError::NoReply { command, waited_ms: u64::from(ATTEMPTS) * REPLY_TIME.as_millis() as u64 })
    }

    /// Writes data and waits until the controller has acknowledged it.
    pub(super) fn write(&mut self, command: Command, data: &[u8]) -> Result<(), PlmError> {
        let sequence = self.next_sequence();
        for report in write_request(command.code(), sequence, true, data) {
            self.link.write(&report)?;
        }
        match self.reply(sequence)? {
            Some(reply) if reply.is_error => Err(self.refused(command)),
            Some(_) => Ok(()),
            None => Err(PlmError::NoReply { command, waited_ms: REPLY_TIME.as_millis() as u64 }),
        }
    }

    fn next_sequence(&mut self) -> u8 {
        self.sequence = self.sequence.wrapping_add(1);
        self.sequence
    }

    /// Waits for the reply with this sequence number.
    fn reply(&mut self, sequence: u8) -> Result<Option<Reply>, PlmError> {
        let end = self.link.now() + REPLY_TIME;
        let mut report = [0; REPORT];
        for _ in 0..MOST_STRAY {
            let left = end.saturating_sub(self.link.now());
            let bytes = self.link.read(&mut report, left)?;
            let found = report.get(..bytes).and_then(reply).filter(|reply| reply.sequence == sequence);
            if found.is_some() || left.is_zero() {
                return Ok(found);
            }
        }
        Ok(None)
    }

    /// Returns all data of a reply, whose further reports have no header.
    fn whole(&mut self, reply: Reply) -> Result<Vec<u8>, PlmError> {
        let Reply { length, mut data, .. } = reply;
        let more = length.saturating_sub(REPLY_DATA).div_ceil(REPORT).min(MOST_STRAY);
        let mut report = [0; REPORT];
        for _ in 0..more {
            let bytes = self.link.read(&mut report, CONTINUATION)?;
            if bytes == 0 {
                break;
            }
            data.extend_from_slice(report.get(..bytes).unwrap_or_default());
        }
        data.truncate(length);
        Ok(data)
    }

    /// Returns the error of a command that the controller refused, with its own code and text as far as it has them.
    fn refused(&mut self, command: Command) -> PlmError {
        if matches!(command, Command::LastError | Command::LastErrorText) {
            return PlmError::Refused { command, error: 0, text: String::new() };
        }
        let error = self.read::<1>(Command::LastError).map_or(0, |[code]| code);
        let text = self.read_data(Command::LastErrorText).map_or_else(|_| String::new(), |data| text(&data));
        PlmError::Refused { command, error, text }
    }

    /// Reads board, firmware and flips.
    ///
    /// # Errors
    /// Any [`PlmError`] of a command.
    pub fn identify(&mut self) -> Result<Identity, PlmError> {
        let hardware = self.read_data(Command::Hardware)?;
        let [code, tag @ ..] = &hardware[..] else {
            return Err(PlmError::ShortReply { command: Command::Hardware, bytes: 0, needed: 1 });
        };
        let (board, firmware) = (board(*code), text(tag));
        let versions = Versions::of(&self.read::<{ Versions::BYTES }>(Command::Versions)?);
        let flips = match self.flips() {
            Ok(flips) => Some(flips),
            Err(PlmError::Refused { .. }) => None,
            Err(error) => return Err(error),
        };
        Ok(Identity { board, firmware, versions, flips })
    }

    /// Reads the setting of the two flips.
    ///
    /// # Errors
    /// Any [`PlmError`] of a command.
    pub fn flips(&mut self) -> Result<Flips, PlmError> {
        let [long] = self.read(Command::FlipLong)?;
        let [short] = self.read(Command::FlipShort)?;
        Ok(Flips { long_axis: long & 1 != 0, short_axis: short & 1 != 0 })
    }

    /// Reads the status of the hardware.
    ///
    /// # Errors
    /// Any [`PlmError`] of a command.
    pub fn hardware_status(&mut self) -> Result<HardwareStatus, PlmError> {
        self.read(Command::HardwareStatus).map(|[status]| HardwareStatus(status))
    }

    /// Reads the status of sequencer and video.
    ///
    /// # Errors
    /// Any [`PlmError`] of a command.
    pub fn main_status(&mut self) -> Result<MainStatus, PlmError> {
        self.read(Command::MainStatus).map(|[status]| MainStatus(status))
    }

    pub(super) fn close(&mut self) {
        self.link.close();
    }
}
