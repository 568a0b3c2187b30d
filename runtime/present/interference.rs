//! Names the things on a desktop that change or blank the light of an SLM.
//!
//! Night light and color management load a gamma ramp into the output, which changes every level. Screen savers and
//! power saving (DPMS) blank the output while video frames are presented as before. X11 reports all three. Wayland and
//! Windows report none of them to a program, and neither does a display without a desktop.

use std::fmt;

/// An influence outside eyebox that changes or blanks the picture of a monitor. In serialized form it has a `kind`, and
/// a ramp also has `output` and `levels`.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
#[non_exhaustive]
pub enum Interference {
    /// The gamma ramp of the monitor's output changes gray levels.
    GammaRamp {
        /// The name of the output on the X server.
        output: String,
        /// The largest change, in levels of 8 bits.
        levels: u32,
    },
    /// The screen saver covers the screen.
    ScreenSaver,
    /// Power saving has switched the monitor off.
    PowerSaving,
}

impl fmt::Display for Interference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::GammaRamp { output, levels } => write!(
                f,
                "output {output}: its gamma ramp changes levels by up to {levels} of 255, so the SLM receives other \
                 levels. Switch night light and color profiles off, or set the gamma of this output to 1 (xrandr)"
            ),
            Self::ScreenSaver => f.write_str("the screen saver is on, so the SLM is dark: switch it off (xset s off)"),
            Self::PowerSaving => {
                f.write_str("power saving has switched the monitor off, so the SLM is dark: switch it off (xset -dpms)")
            }
        }
    }
}
