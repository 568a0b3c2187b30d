//! Reads and writes the values of commands.

use serde::Serialize;
use std::fmt;

/// A fault that the hardware status reports, apart from the aborts of a running sequence.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum HardwareFault {
    /// The controller is not initialized.
    NotInitialized,
    /// Controller, modulator and firmware do not match.
    WrongHardware,
    /// The controller of the mirrors' reset has an error.
    ResetController,
    /// The two controllers are swapped.
    ForcedSwap,
    /// The sequencer has an error.
    Sequencer,
}

impl fmt::Display for HardwareFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NotInitialized => "the initialization failed",
            Self::WrongHardware => "controller, modulator and firmware do not match",
            Self::ResetController => "an error of the reset controller",
            Self::ForcedSwap => "the controllers are swapped",
            Self::Sequencer => "an error of the sequencer",
        })
    }
}

/// The status of the hardware, a byte.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct HardwareStatus(pub u8);

impl HardwareStatus {
    const fn has(self, bit: u8) -> bool {
        self.0 >> bit & 1 == 1
    }

    /// Returns the first fault of the hardware.
    pub fn fault(self) -> Option<HardwareFault> {
        let faults = [
            (!self.has(0), HardwareFault::NotInitialized),
            (self.has(1), HardwareFault::WrongHardware),
            (self.has(2), HardwareFault::ResetController),
            (self.has(3), HardwareFault::ForcedSwap),
            (self.has(7), HardwareFault::Sequencer),
        ];
        faults.into_iter().find(|(is, _)| *is).map(|(_, fault)| fault)
    }

    /// Returns true if patterns did not fit a video frame, so that the frame was aborted.
    pub fn has_aborted(self) -> bool {
        self.has(6)
    }
}

/// The status of sequencer and video, a byte.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct MainStatus(pub u8);

impl MainStatus {
    /// Returns true if the sequencer runs.
    pub fn is_running(self) -> bool {
        self.0 & 1 << 1 != 0
    }

    /// Returns true if the controller is locked to the video signal.
    pub fn is_locked(self) -> bool {
        self.0 & 1 << 3 != 0
    }
}

/// A version of a part of the firmware.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[allow(missing_docs)]
pub struct Version {
    pub major: u8,
    pub minor: u8,
    pub patch: u16,
}

impl fmt::Display for Version {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}.{}", self.major, self.minor, self.patch)
    }
}

/// The versions of the firmware.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[allow(missing_docs)]
pub struct Versions {
    pub application: Version,
    pub api: Version,
    pub configuration: Version,
    pub sequence: Version,
}

impl Versions {
    pub(super) const BYTES: usize = 16;

    pub(super) fn of(data: &[u8; Self::BYTES]) -> Self {
        let version = |at: usize| Version {
            patch: u16::from_le_bytes([data[at], data[at + 1]]),
            minor: data[at + 2],
            major: data[at + 3],
        };
        Self { application: version(0), api: version(4), configuration: version(8), sequence: version(12) }
    }
}

/// Returns the name of a board by the first byte of the command for the hardware.
pub(super) fn board(code: u8) -> &'static str {
    match code {
        1 => "DLP6500",
        2 => "DLP9000",
        3 => "DLP670S",
        4 => "DLP500YX",
        5 => "DLP5500",
        _ => "unknown",
    }
}

/// Returns the ASCII text at the beginning of `data`, up to the first zero. Other characters are left out.
pub(super) fn text(data: &[u8]) -> String {
    let bytes = data.iter().take_while(|byte| **byte != 0);
    bytes.filter(|byte| (b' '..=b'~').contains(byte)).map(|byte| char::from(*byte)).collect::<String>().trim().into()
}

/// The light sources of a pattern, as the controller's own outputs for them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[allow(missing_docs)]
pub struct Leds {
    pub red: bool,
    pub green: bool,
    pub blue: bool,
}

impl Leds {
    /// Only the red output is on.
    pub const RED: Self = Self { red: true, green: false, blue: false };
    /// Only the green output is on.
    pub const GREEN: Self = Self { red: false, green: true, blue: false };
    /// Only the blue output is on.
    pub const BLUE: Self = Self { red: false, green: false, blue: true };
    /// All three outputs are on.
    pub const ALL: Self = Self { red: true, green: true, blue: true };

    fn bits(self) -> u8 {
        u8::from(self.red) | u8::from(self.green) << 1 | u8::from(self.blue) << 2
    }
}

/// The definition of a pattern.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Pattern {
    pub index: u16,
    /// Exposure in microseconds, 24 bits.
    pub exposure_us: u32,
    /// Time without light after the exposure in microseconds, 24 bits.
    pub dark_us: u32,
    /// True if mirrors are cleared after the exposure.
    pub clears: bool,
    /// Bits of the pattern, 1 to 16.
    pub depth: u8,
    pub leds: Leds,
    /// True if it waits for the trigger, which is the vertical synchronization of the video.
    pub waits: bool,
    /// True if the output TRIG_OUT_2 marks the pattern. The bit of the guide disables it.
    pub trigger_out_2: bool,
    /// First bit plane of the video frame, 0 to 23.
    pub plane: u8,
}

impl Pattern {
    pub(super) const BYTES: usize = 12;

    pub(super) fn bytes(&self) -> [u8; Self::BYTES] {
        let [i0, i1] = self.index.to_le_bytes();
        let [e0, e1, e2, _] = self.exposure_us.to_le_bytes();
        let [d0, d1, d2, _] = self.dark_us.to_le_bytes();
        let depth = self.depth.clamp(1, 16) - 1;
        let flags = u8::from(self.clears) | (depth & 7) << 1 | self.leds.bits() << 4 | u8::from(self.waits) << 7;
        let outputs = u8::from(!self.trigger_out_2) | (depth >> 3) << 1;
        [i0, i1, e0, e1, e2, flags, d0, d1, d2, outputs, 0, self.plane << 3]
    }

    pub(super) fn of(data: &[u8; Self::BYTES]) -> Self {
        let [i0, i1, e0, e1, e2, flags, d0, d1, d2, outputs, _, place] = *data;
        Self {
            index: u16::from_le_bytes([i0, i1]),
            exposure_us: u32::from_le_bytes([e0, e1, e2, 0]),
            dark_us: u32::from_le_bytes([d0, d1, d2, 0]),
            clears: flags & 1 != 0,
            depth: ((flags >> 1 & 7) | (outputs >> 1 & 1) << 3) + 1,
            leds: Leds { red: flags & 0x10 != 0, green: flags & 0x20 != 0, blue: flags & 0x40 != 0 },
            waits: flags & 0x80 != 0,
            trigger_out_2: outputs & 1 == 0,
            plane: place >> 3,
        }
    }
}
