//! The connection to a controller as four calls, so that a simulated controller can take its place.

use super::error::PlmError;
use std::time::Duration;

/// Bytes of a report. Reports have no number.
pub const REPORT: usize = 64;

/// A connection to a controller.
pub trait Link: Send {
    /// Sends one report to the controller.
    ///
    /// # Errors
    /// [`PlmError::Link`] if the connection failed.
    fn write(&mut self, report: &[u8; REPORT]) -> Result<(), PlmError>;

    /// Waits for a report, and returns the number of its bytes. It is 0 if none arrives within `timeout`.
    ///
    /// # Errors
    /// [`PlmError::Link`] if the connection failed.
    fn read(&mut self, report: &mut [u8; REPORT], timeout: Duration) -> Result<usize, PlmError>;

    /// Closes the connection. Further calls fail.
    fn close(&mut self);

    /// Returns the time since some fixed instant. It never decreases, and it passes while `read` waits.
    fn now(&self) -> Duration;
}
