//! Takes a controller from any state to running patterns, and to sleep.
//!
//! TI's guide, plmctrl and slmsuite agree on the order of the steps. On DisplayPort, the monitor of the
//! controller appears on the host only after [`Controller::prepare`].

use super::command::Command;
use super::controller::{Controller, Identity, State};
use super::error::PlmError;
use super::table::{PLANES, count, exposure_us, patterns};
use super::values::{HardwareStatus, Leds, MainStatus};
use eyebox_optics::{Edge, VideoLink};
use std::time::Duration;

const POLL: Duration = Duration::from_millis(100);
/// The longest time until the controller is locked to a picture. slmsuite waits as long for the monitor.
pub const SOURCE_TIME: Duration = Duration::from_secs(10);
/// The time from the lock to the change of mode, after the guide.
const AFTER_LOCK: Duration = Duration::from_millis(300);
/// The longest time until the mode has changed. Examples of plmctrl wait 3 to 5 s.
const MODE_TIME: Duration = Duration::from_secs(5);
/// The time after the definition of patterns in which the controller does not reply, after slmsuite.
const AFTER_TABLE: Duration = Duration::from_secs(1);
/// The longest time from the start to running patterns.
const START_TIME: Duration = Duration::from_secs(2);

/// The display modes that eyebox uses.
const VIDEO: u8 = 0;
const VIDEO_PATTERNS: u8 = 2;
/// 24 bits per pixel from the parallel port.
const PARALLEL_24: u8 = 0x08;
/// Values of the command for the sequence.
const STOP: u8 = 0;
const START: u8 = 2;

/// The result of a check of a running controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Condition {
    /// The status of the hardware.
    pub hardware: HardwareStatus,
    /// The status of sequencer and video.
    pub main: MainStatus,
}

impl Condition {
    /// Returns true if patterns run, locked to the video.
    pub fn is_showing(self) -> bool {
        self.main.is_running() && self.main.is_locked()
    }
}

/// Accepts a refusal of a command that is optional in the present state or firmware.
fn optional(result: Result<(), PlmError>) -> Result<(), PlmError> {
    match result {
        Err(PlmError::Refused { .. }) => Ok(()),
        other => other,
    }
}

impl Controller {
    /// Stops the patterns, checks the hardware, and switches the receiver on. It works from any state, also after a
    /// program that was killed.
    ///
    /// # Errors
    /// [`PlmError::Hardware`], [`PlmError::Standby`], [`PlmError::Mode`], and any error of a command.
    pub fn prepare(&mut self, link: VideoLink) -> Result<Identity, PlmError> {
        (self.state, self.is_awake) = (State::Opened, true);
        self.wake()?;
        // In video mode there is nothing to stop.
        optional(self.write(Command::Sequence, &[STOP]))?;
        let identity = self.identify()?;
        let status = self.hardware_status()?;
        if let Some(fault) = status.fault() {
            return Err(PlmError::Hardware { fault, status: status.0 });
        }
        // A change of the input in a pattern mode is undefined.
        self.set_mode(VIDEO)?;
        let (port, receiver) = match link {
            VideoLink::Hdmi => (0, 1),
            VideoLink::DisplayPort => (2, 2),
        };
        self.write(Command::Port, &[port])?;
        // Bit 0 selects the port, and 0 in the other bits is the order without a swap.
        self.write(Command::Swap, &[0])?;
        self.write(Command::Swap, &[1])?;
        self.write(Command::Source, &[PARALLEL_24])?;
        self.write(Command::Invert, &[0])?;
        // Gamma would change the bit planes. Firmware before version 6 has no command for it.
        optional(self.write(Command::Gamma, &[0, 0]))?;
        self.write(Command::Receiver, &[receiver])?;
        self.set_mode(VIDEO)?;
        self.state = State::Prepared;
        Ok(identity)
    }

    fn wake(&mut self) -> Result<(), PlmError> {
        if self.read::<1>(Command::Power)? == [0] {
            return Ok(());
        }
        self.write(Command::Power, &[0])?;
        self.wait(AFTER_TABLE)?;
        match self.read(Command::Power)? {
            [0] => Ok(()),
            [power] => Err(PlmError::Standby { power }),
        }
    }

    /// Requests a mode, and reads it until the controller has changed to it.
    fn set_mode(&mut self, wanted: u8) -> Result<(), PlmError> {
        self.write(Command::Mode, &[wanted])?;
        let begun = self.now();
        loop {
            let mode = match self.read::<1>(Command::Mode) {
                Ok([mode]) => mode & 3,
                // The controller may be silent while it changes.
                Err(PlmError::NoReply { .. }) => u8::MAX,
                Err(error) => return Err(error),
            };
            let waited = self.now().saturating_sub(begun);
            if mode == wanted {
                return Ok(());
            }
            if waited >= MODE_TIME {
                return Err(PlmError::Mode { wanted, mode, waited_ms: waited.as_millis() as u64 });
            }
            self.wait(POLL)?;
        }
    }

    /// Waits until the controller is locked to a picture of the host, for `patience` at most. `goes_on` is called
    /// between checks, and false ends the wait.
    ///
    /// # Errors
    /// [`PlmError::NoSource`], [`PlmError::Order`], and any error of a command.
    pub fn wait_for_source(&mut self, patience: Duration, goes_on: &mut dyn FnMut() -> bool) -> Result<(), PlmError> {
        if self.state != State::Prepared {
            return Err(PlmError::Order { state: self.state.name() });
        }
        let begun = self.now();
        while !self.main_status()?.is_locked() {
            let waited = self.now().saturating_sub(begun);
            if waited >= patience || !goes_on() {
                return Err(PlmError::NoSource { waited_ms: waited.as_millis() as u64 });
            }
            self.wait(POLL)?;
        }
        Ok(())
    }

    /// Shows the 24 planes of each video frame at the rate of the video mode. `leds` are the outputs for light sources
    /// of each plane. Returns the exposure of a plane (us).
    ///
    /// # Errors
    /// [`PlmError::Order`] before [`prepare`](Self::prepare), [`PlmError::Rate`], [`PlmError::Exposure`],
    /// [`PlmError::Mode`], [`PlmError::NotStarted`], and any error of a command. Without a locked picture it is
    /// [`PlmError::Refused`].
    pub fn begin(&mut self, rate_hz: f64, leds: &[Leds; PLANES]) -> Result<u32, PlmError> {
        if self.state != State::Prepared {
            return Err(PlmError::Order { state: self.state.name() });
        }
        let exposure_us = exposure_us(rate_hz)?;
        self.wait(AFTER_LOCK)?;
        self.set_mode(VIDEO_PATTERNS)?;
        optional(self.write(Command::Sequence, &[STOP]))?;
        if let Some(least_us) = self.least_exposure_us()?
            && exposure_us < least_us
        {
            return Err(PlmError::Exposure { exposure_us, least_us, rate_hz });
        }
        for pattern in patterns(exposure_us, leds, self.trigger_out) {
            self.write(Command::Definition, &pattern.bytes())?;
        }
        self.write(Command::Table, &count(PLANES as u16))?;
        self.wait(AFTER_TABLE)?;
        if let Some(edge) = self.trigger_in {
            self.write(Command::TriggerIn2, &[u8::from(edge == Edge::Falling)])?;
        }
        self.write(Command::Sequence, &[START])?;
        let begun = self.now();
        loop {
            let main = self.main_status()?;
            let waited = self.now().saturating_sub(begun);
            // The line decides when the patterns run.
            if main.is_running() || self.trigger_in.is_some() {
                self.state = State::Running;
                return Ok(exposure_us);
            }
            if waited >= START_TIME {
                return Err(PlmError::NotStarted { status: main.0, waited_ms: waited.as_millis() as u64 });
            }
            self.wait(POLL)?;
        }
    }

    /// Returns the least exposure of a pattern of one bit (us). Older firmware does not state it.
    fn least_exposure_us(&mut self) -> Result<Option<u32>, PlmError> {
        match self.read::<2>(Command::LeastExposures) {
            Ok(bytes) => Ok(Some(u32::from(u16::from_le_bytes(bytes)))),
            Err(PlmError::Refused { .. }) => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Reads both statuses. Call it about once per second while patterns run.
    ///
    /// # Errors
    /// Any error of a command.
    pub fn poll(&mut self) -> Result<Condition, PlmError> {
        Ok(Condition { hardware: self.hardware_status()?, main: self.main_status()? })
    }

    /// Returns to video, after the picture was lost, so that [`begin`](Self::begin) can start the patterns again. The
    /// receiver stays on, because the monitor of the host would go away with it.
    ///
    /// # Errors
    /// Any error of a command.
    pub fn recover(&mut self) -> Result<(), PlmError> {
        if self.state == State::Asleep || self.state == State::Opened {
            return Err(PlmError::Order { state: self.state.name() });
        }
        optional(self.write(Command::Sequence, &[STOP]))?;
        self.set_mode(VIDEO)?;
        self.state = State::Prepared;
        Ok(())
    }

    /// Stops the patterns and switches the receiver off. All steps are tried, and the first error is returned.
    ///
    /// # Errors
    /// Any error of a command.
    pub fn sleep(&mut self) -> Result<(), PlmError> {
        let stopped = optional(self.write(Command::Sequence, &[STOP]));
        let dark = if stopped.as_ref().is_err_and(PlmError::is_of_link) {
            Ok(())
        } else {
            self.write(Command::Receiver, &[0])
        };
        stopped.and(dark)?;
        (self.state, self.is_awake) = (State::Asleep, false);
        Ok(())
    }
}

impl Drop for Controller {
    /// Puts a controller that was started to sleep, at every end of the program but a kill.
    fn drop(&mut self) {
        if self.is_awake {
            let _ = self.sleep();
        }
        self.close();
    }
}
