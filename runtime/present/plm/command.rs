//! Names the commands of a DLPC900 that eyebox uses (TI DLPU018J).

use serde::Serialize;
use std::fmt;

/// A command of the controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Command {
    /// Power mode, 1 byte. 0 is normal, 1 is standby.
    Power,
    /// Versions of the firmware, 16 bytes.
    Versions,
    /// Board and name of the firmware, 1 byte and text.
    Hardware,
    /// Code of the last error, 1 byte.
    LastError,
    /// Text of the last error.
    LastErrorText,
    /// Flip along the long axis, 1 byte.
    FlipLong,
    /// Flip along the short axis, 1 byte.
    FlipShort,
    /// Source of the video and its width, 1 byte.
    Source,
    /// Receiver of the video, 1 byte. It is not among the pages of the guide. TI's own program uses it.
    Receiver,
    /// Data port and pixels per clock, 1 byte.
    Port,
    /// Hardware status, 1 byte.
    HardwareStatus,
    /// Main status, 1 byte.
    MainStatus,
    /// Display mode, 1 byte.
    Mode,
    /// Start, pause and stop of the patterns, 1 byte.
    Sequence,
    /// Inversion of all data, 1 byte.
    Invert,
    /// Polarity of the input TRIG_IN_2, which starts and stops the patterns, 1 byte. 0 starts on the rising edge.
    TriggerIn2,
    /// Number of patterns (2 bytes) and of repeats (4 bytes).
    Table,
    /// Definition of one pattern, 12 bytes.
    Definition,
    /// Swap of the channels of one port, 1 byte.
    Swap,
    /// Gamma correction, 2 bytes. Firmware before version 6 does not have it.
    Gamma,
    /// Least exposures by bit depth, 32 bytes. Older firmware does not have it.
    LeastExposures,
}

impl Command {
    /// All commands in the order of their codes.
    pub const ALL: [Self; 21] = [
        Self::LastError,
        Self::LastErrorText,
        Self::Power,
        Self::Versions,
        Self::Hardware,
        Self::FlipLong,
        Self::FlipShort,
        Self::Source,
        Self::Receiver,
        Self::Port,
        Self::HardwareStatus,
        Self::MainStatus,
        Self::Mode,
        Self::Sequence,
        Self::Invert,
        Self::Table,
        Self::Definition,
        Self::TriggerIn2,
        Self::Swap,
        Self::Gamma,
        Self::LeastExposures,
    ];

    /// Returns the code and the name.
    fn row(self) -> (u16, &'static str) {
        match self {
            Self::LastError => (0x0100, "last error"),
            Self::LastErrorText => (0x0101, "text of the last error"),
            Self::Power => (0x0200, "power"),
            Self::Versions => (0x0205, "versions"),
            Self::Hardware => (0x0206, "hardware"),
            Self::FlipLong => (0x1008, "flip of the long axis"),
            Self::FlipShort => (0x1009, "flip of the short axis"),
            Self::Source => (0x1A00, "source"),
            Self::Receiver => (0x1A01, "receiver"),
            Self::Port => (0x1A03, "port"),
            Self::HardwareStatus => (0x1A0A, "hardware status"),
            Self::MainStatus => (0x1A0C, "main status"),
            Self::Mode => (0x1A1B, "display mode"),
            Self::Sequence => (0x1A24, "start and stop"),
            Self::Invert => (0x1A30, "inversion"),
            Self::Table => (0x1A31, "number of patterns"),
            Self::Definition => (0x1A34, "pattern"),
            Self::TriggerIn2 => (0x1A36, "trigger input 2"),
            Self::Swap => (0x1A37, "channel swap"),
            Self::Gamma => (0x1A3B, "gamma"),
            Self::LeastExposures => (0x1A42, "least exposures"),
        }
    }

    /// Returns the code of the command.
    pub fn code(self) -> u16 {
        self.row().0
    }

    /// Returns the command with this code.
    pub fn of_code(code: u16) -> Option<Self> {
        Self::ALL.into_iter().find(|command| command.code() == code)
    }
}

impl fmt::Display for Command {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (code, name) = self.row();
        write!(f, "0x{code:04X} ({name})")
    }
}
