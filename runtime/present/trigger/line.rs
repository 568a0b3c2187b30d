//! Defines a line that gives pulses and a line that takes them.

use super::error::TriggerError;
use std::time::Duration;

/// The result of a pulse.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Given {
    /// The pulse left this program.
    Sent,
    /// The line had no room for it, because its reader has stopped. The pulse is lost.
    Full,
}

/// A line that gives pulses.
pub trait TriggerOutput: Send {
    /// Gives a pulse. `number` counts the pulses that should have been given. A line is active for its time when this
    /// returns.
    ///
    /// # Errors
    /// [`TriggerError::Failed`] if the line is gone.
    fn pulse(&mut self, number: u64) -> Result<Given, TriggerError>;
}

/// A pulse that arrived.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pulse {
    /// The time at which it arrived (ns on the steady clock of the system).
    pub at_ns: u64,
    /// The pulses before it that were lost, as far as the line shows them.
    pub lost_before: u64,
}

/// A line that takes pulses.
pub trait TriggerInput: Send {
    /// Waits up to `patience` for pulses, and adds all that have arrived to `pulses`.
    ///
    /// # Errors
    /// [`TriggerError::Failed`] if the line is gone.
    fn wait(&mut self, patience: Duration, pulses: &mut Vec<Pulse>) -> Result<(), TriggerError>;
}

/// Finds lost pulses by numbers that count modulo 256.
#[derive(Debug, Default)]
pub(super) struct Counter {
    last: Option<u8>,
}

impl Counter {
    /// Returns the numbers between the last one and this one.
    pub fn lost_before(&mut self, number: u8) -> u64 {
        let lost = self.last.map_or(0, |last| number.wrapping_sub(last).wrapping_sub(1));
        self.last = Some(number);
        u64::from(lost)
    }
}
