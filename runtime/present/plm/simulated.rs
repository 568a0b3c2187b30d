//! A simulated DLPC900, for tests and to try commands without hardware.
//!
//! It is as strict as the guide. It has one reply, which the next command overwrites. It refuses video patterns
//! without a locked picture, definitions while patterns run, and a start without a table. It changes its mode late, is
//! silent for a second after the table, and aborts video frames that are too short for the patterns.

use super::error::PlmError;
use super::link::{Link, REPORT};
use super::report::received;
use super::simulated_state::{Faults, LitPlane, SimulatedState};
use eyebox_optics::VideoLink;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// The simulated duration of a report on the wire.
const ON_WIRE: Duration = Duration::from_millis(1);

/// A simulated controller on a clock of its own, which passes while a reply is awaited. Clones are the same device, as
/// seen by a program that connects again.
#[derive(Debug, Clone, Default)]
pub struct Simulated(Arc<Mutex<SimulatedState>>);

impl Simulated {
    /// Makes a controller that was just switched on, with a picture of 60 video frames per second at its input.
    pub fn new() -> Self {
        Self::default()
    }

    /// Makes a controller with a picture of the usual rate of this input, 60 Hz or 30 Hz.
    pub fn on(link: VideoLink) -> Self {
        let device = Self::new();
        device.set_faults(|faults| faults.rate_hz = link.usual_rate_hz());
        device
    }

    fn state(&self) -> MutexGuard<'_, SimulatedState> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Changes the faults of the device and the picture at its input.
    pub fn set_faults(&self, change: impl FnOnce(&mut Faults)) {
        change(&mut self.state().faults);
    }

    /// Returns the planes of a pixel in the order in which the device shows them. In `word`, red has bits 0 to 7,
    /// green has bits 8 to 15, and blue has bits 16 to 23. The list is empty while no patterns run.
    pub fn lit_planes(&self, word: u32) -> Vec<LitPlane> {
        self.state().lit_planes(word)
    }

    /// Returns true if patterns run.
    pub fn is_running(&self) -> bool {
        self.state().runs()
    }

    /// Returns the value of the receiver, which is 0 if it is off.
    pub fn receiver(&self) -> u8 {
        self.state().receiver
    }

    /// Returns the number of replies that were overwritten before they were fetched.
    pub fn lost_replies(&self) -> u64 {
        self.state().lost_replies
    }

    /// Returns the time since the controller was switched on.
    pub fn elapsed(&self) -> Duration {
        self.state().now
    }

    /// Lets time pass without a command.
    pub fn pass(&self, time: Duration) {
        self.state().pass(time);
    }
}

fn unplugged() -> PlmError {
    PlmError::Link { reason: "the device is gone".into() }
}

impl Link for Simulated {
    fn write(&mut self, report: &[u8; REPORT]) -> Result<(), PlmError> {
        let mut state = self.state();
        state.pass(ON_WIRE);
        if state.faults.unplugged {
            return Err(unplugged());
        }
        if let Some(command) = received(report) {
            state.take(&command);
        }
        Ok(())
    }

    fn read(&mut self, report: &mut [u8; REPORT], timeout: Duration) -> Result<usize, PlmError> {
        let mut state = self.state();
        if state.faults.unplugged {
            return Err(unplugged());
        }
        let (wait, reply) = state.reply_within(timeout);
        state.pass(wait);
        let Some(reply) = reply else { return Ok(0) };
        report.fill(0);
        report[..reply.len()].copy_from_slice(&reply);
        Ok(reply.len())
    }

    fn close(&mut self) {}

    fn now(&self) -> Duration {
        self.state().now
    }
}
