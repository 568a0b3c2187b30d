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
    /// Returns the code of the command.
    pub fn code(self) -> u16 {
        match self {
            Self::LastError => 0x0100,
            Self::LastErrorText => 0x0101,
            Self::Power => 0x0200,
            Self::Versions => 0x0205,
            Self::Hardware => 0x0206,
            Self::FlipLong => 0x1008,
            Self::FlipShort => 0x1009,
            Self::Source => 0x1A00,
            Self::Receiver => 0x1A01,
            Self::Port => 0x1A03,
            Self::HardwareStatus => 0x1A0A,
            Self::MainStatus => 0x1A0C,
            Self::Mode => 0x1A1B,
            Self::Sequence => 0x1A24,
            Self::Invert => 0x1A30,
            Self::Table => 0x1A31,
            Self::Definition => 0x1A34,
            Self::Swap => 0x1A37,
            Self::Gamma => 0x1A3B,
            Self::LeastExposures => 0x1A42,
        }
    }

    /// All commands in the order of their codes.
    pub const ALL: [Self; 20] = [
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
        Self::Swap,
        Self::Gamma,
        Self::LeastExposures,
    ];

    /// Returns the command with this code.
    pub fn of_code(code: u16) -> Option<Self> {
        Self::ALL.into_iter().find(|command| command.code() == code)
    }

    fn words(self) -> &'static str {
        match self {
            Self::LastError => "last error",
            Self::LastErrorText => "text of the last error",
            Self::Power => "power",
            Self::Versions => "versions",
            Self::Hardware => "hardware",
            Self::FlipLong => "flip of the long axis",
            Self::FlipShort => "flip of the short axis",
            Self::Source => "source",
            Self::Receiver => "receiver",
            Self::Port => "port",
            Self::HardwareStatus => "hardware status",
            Self::MainStatus => "main status",
            Self::Mode => "display mode",
            Self::Sequence => "start and stop",
            Self::Invert => "inversion",
            Self::Table => "number of patterns",
            Self::Definition => "pattern",
            Self::Swap => "channel swap",
            Self::Gamma => "gamma",
            Self::LeastExposures => "least exposures",
        }
    }
}

impl fmt::Display for Command {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "0x{:04X} ({})", self.code(), self.words())
    }
}
