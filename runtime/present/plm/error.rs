//! Defines the errors of a PLM's controller.

use super::command::Command;
use super::values::HardwareFault;

/// An error of a PLM's controller.
#[derive(Debug, Clone, PartialEq, thiserror::Error, serde::Serialize)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum PlmError {
    /// No controller is connected.
    #[error("no DLPC900 (USB 0451:C900) is connected. Connect its USB cable, switch it on, and close TI's own program")]
    NoController,
    /// This system or this build has no USB access to the controller.
    #[error("{reason}")]
    Unsupported {
        /// The reason and the remedy.
        reason: String,
    },
    /// The USB connection refused or failed.
    #[error("the USB connection of the controller failed ({reason})")]
    Link {
        /// The message of the system, with a remedy if there is one.
        reason: String,
    },
    /// No reply arrived in time.
    #[error("the controller did not reply to {command} within {waited_ms} ms. Switch it off and on")]
    NoReply {
        /// The command that failed.
        command: Command,
        /// The time for which the driver waited, over all attempts (ms).
        waited_ms: u64,
    },
    /// A reply has fewer bytes than the command returns.
    #[error("the controller replied to {command} with {bytes} bytes, but it must be {needed}")]
    ShortReply {
        /// The command that failed.
        command: Command,
        /// The bytes of data in the reply.
        bytes: usize,
        /// The bytes that the command returns.
        needed: usize,
    },
    /// The controller refused a command.
    #[error("the controller refused {command} with error {error}{}", said(text))]
    Refused {
        /// The command that failed.
        command: Command,
        /// The code of the error, or 0 if the controller named none.
        error: u8,
        /// The text of the controller, which may be empty.
        text: String,
    },
    /// The controller reports a hardware fault.
    #[error("the controller reports a fault ({fault}) with hardware status 0x{status:02X}. Switch it off and on")]
    Hardware {
        /// The first fault that the status has.
        fault: HardwareFault,
        /// The byte of the hardware status.
        status: u8,
    },
    /// The controller stays in standby.
    #[error("the controller stays in power mode {power}, although normal operation was requested")]
    Standby {
        /// The power mode that it reports.
        power: u8,
    },
    /// The controller does not receive a video signal that it can lock to.
    #[error(
        "the controller found no video signal within {waited_ms} ms. Connect the video cable, and show a picture of \
         2716 x 1600 pixels on its monitor"
    )]
    NoSource {
        /// The time for which the driver waited (ms).
        waited_ms: u64,
    },
    /// The controller did not change its display mode.
    #[error("the controller stays in display mode {mode} instead of {wanted}, after {waited_ms} ms")]
    Mode {
        /// The mode that was requested.
        wanted: u8,
        /// The mode that it reports.
        mode: u8,
        /// The time for which the driver waited (ms).
        waited_ms: u64,
    },
    /// The patterns did not start.
    #[error("the controller does not run the patterns (main status 0x{status:02X}), after {waited_ms} ms")]
    NotStarted {
        /// The byte of the main status.
        status: u8,
        /// The time for which the driver waited (ms).
        waited_ms: u64,
    },
    /// Video frames are too short for 24 patterns.
    #[error(
        "a pattern lasts {exposure_us} us at {rate_hz} video frames per second, but the controller needs {least_us} us. \
         Choose a slower video mode"
    )]
    Exposure {
        /// The exposure that fits the frame (us).
        exposure_us: u32,
        /// The least exposure of the controller (us).
        least_us: u32,
        /// The video frames per second.
        rate_hz: f64,
    },
    /// The rate of the video mode is impossible.
    #[error("{rate_hz} video frames per second are impossible for the controller. Give 1 to 1000")]
    Rate {
        /// Video frames per second (Hz).
        rate_hz: f64,
    },
    /// A step was called before the step that it needs.
    #[error("the controller is {state}. Prepare it first")]
    Order {
        /// The name of its state.
        state: &'static str,
    },
}

fn said(text: &str) -> String {
    if text.is_empty() { String::new() } else { format!(": {text}") }
}

impl PlmError {
    /// Returns true if the USB connection itself failed, so that further commands fail, too.
    pub fn is_of_link(&self) -> bool {
        matches!(self, Self::NoController | Self::Unsupported { .. } | Self::Link { .. })
    }
}
