//! Names the things that change or blank the light of an SLM between the swapchain and the panel.
//!
//! Night light and color management load a gamma ramp into the output, which changes every level. Screen savers and
//! power saving (DPMS) blank the output while video frames are presented as before. Properties of the output decide
//! about range, dithering and scaling. X11 reports all of them. Wayland and Windows report none of them to a program.

use std::fmt;

/// An influence outside eyebox that changes or blanks the picture of a monitor. In serialized form it has a `kind`,
/// and the fields of that kind.
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
        /// True if a linear ramp was loaded instead, until the end of the session.
        corrected: bool,
    },
    /// The screen saver covers the screen.
    ScreenSaver,
    /// Power saving has switched the monitor off.
    PowerSaving,
    /// A compositor copies the picture of each window, and may convert it.
    Compositor,
    /// The output multiplies colors with a matrix that is not the identity.
    ColorMatrix {
        /// The name of the output.
        output: String,
    },
    /// The output scales or distorts the picture.
    Transform {
        /// The name of the output.
        output: String,
    },
    /// The output rotates the picture counterclockwise, and then mirrors it.
    Rotation {
        /// The name of the output.
        output: String,
        /// The angle of the rotation (degrees).
        degrees: u16,
        /// True if the picture is mirrored.
        mirrored: bool,
    },
    /// The mode does not have the size of the panel.
    ModeSize {
        /// The name of the output.
        output: String,
        /// Rows and columns of the mode.
        mode: [usize; 2],
        /// Rows and columns of the panel, which is the preferred mode.
        panel: [usize; 2],
    },
    /// The output sends the levels 16 to 235 only, so that 36 pairs of neighboring levels become equal.
    LimitedRange {
        /// The name of the output.
        output: String,
        /// The value of the property `Broadcast RGB`.
        setting: String,
    },
    /// A property of the output has a value that can change levels or pixels.
    Property {
        /// The name of the output.
        output: String,
        /// The name of the property, as the driver spells it.
        name: String,
        /// The value of the property.
        value: String,
        /// The value that leaves the picture unchanged.
        wanted: String,
    },
    /// The kernel reports that the output is off or shows nothing.
    NotLit {
        /// The name of the output.
        output: String,
    },
}

/// Puts a word of a shell command in quotes if it needs them.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_.:/".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

impl Interference {
    /// Returns the shell command that ends the influence, if there is one.
    pub fn remedy(&self) -> Option<String> {
        let xrandr = |output: &str, rest: &str| Some(format!("xrandr --output {} {rest}", quoted(output)));
        match self {
            Self::GammaRamp { output, .. } => xrandr(output, "--gamma 1"),
            Self::ScreenSaver => Some("xset s off".into()),
            Self::PowerSaving => Some("xset -dpms".into()),
            Self::ColorMatrix { output } => {
                // Nine numbers of 64 bits, the low word first: 1 is the high word 1.
                xrandr(output, "--set CTM 0,1,0,0,0,0,0,0,0,1,0,0,0,0,0,0,0,1")
            }
            Self::Transform { output } => xrandr(output, "--transform none"),
            Self::Rotation { output, .. } => xrandr(output, "--rotate normal --reflect normal"),
            Self::ModeSize { output, .. } => xrandr(output, "--preferred"),
            Self::LimitedRange { output, .. } => xrandr(output, "--set 'Broadcast RGB' Full"),
            Self::Property { output, name, wanted, .. } => {
                xrandr(output, &format!("--set {} {}", quoted(name), quoted(wanted)))
            }
            Self::Compositor | Self::NotLit { .. } => None,
        }
    }

    /// Writes the influence without its remedy.
    fn describe(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::GammaRamp { output, levels, corrected } => {
                write!(f, "the gamma ramp of output {output} changes levels by up to {levels} of 255. ")?;
                f.write_str(match corrected {
                    true => "eyebox loads a linear ramp until the end",
                    false => "Switch night light and color profiles off",
                })
            }
            Self::ScreenSaver => f.write_str("the screen saver is on, so the SLM is dark"),
            Self::PowerSaving => f.write_str("power saving has switched the monitor off, so the SLM is dark"),
            Self::Compositor => f.write_str(
                "a compositor runs and may convert the picture. eyebox requests that it leaves the window alone. \
                 Switch it off on the screen of an SLM",
            ),
            Self::ColorMatrix { output } => write!(f, "the color matrix of output {output} changes levels"),
            Self::Transform { output } => write!(f, "output {output} scales or distorts the picture"),
            Self::Rotation { output, degrees, mirrored } => {
                let mirrored = if *mirrored { " and mirrors it" } else { "" };
                write!(f, "output {output} rotates the picture by {degrees} degrees{mirrored}")
            }
            Self::ModeSize { output, mode: [rows, columns], panel: [all, wide] } => write!(
                f,
                "the mode of output {output} has {rows}x{columns} pixels and its panel {all}x{wide}, so the picture is \
                 scaled or has a border"
            ),
            Self::LimitedRange { output, setting } => write!(
                f,
                "with 'Broadcast RGB' = {setting}, output {output} sends the levels 16 to 235, and 36 pairs of \
                 levels become equal"
            ),
            Self::Property { output, name, value, wanted } => {
                write!(f, "'{name}' of output {output} is {value}, and {wanted} leaves the picture unchanged")
            }
            Self::NotLit { output } => write!(f, "the kernel reports that output {output} is off"),
        }
    }
}

impl fmt::Display for Interference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.describe(f)?;
        let corrected = matches!(self, Self::GammaRamp { corrected: true, .. });
        match self.remedy().filter(|_| !corrected) {
            Some(command) => write!(f, ": {command}"),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn remedies_are_commands_that_a_shell_reads() {
        let output = || "HDMI-1".to_owned();
        let property = |name: &str, wanted: &str| Interference::Property {
            output: output(),
            name: name.into(),
            value: "on".into(),
            wanted: wanted.into(),
        };
        for (found, command) in [
            (
                Interference::LimitedRange { output: output(), setting: "Automatic".into() },
                "xrandr --output HDMI-1 --set 'Broadcast RGB' Full",
            ),
            (property("max bpc", "8"), "xrandr --output HDMI-1 --set 'max bpc' 8"),
            (property("it's", "off"), r"xrandr --output HDMI-1 --set 'it'\''s' off"),
            (Interference::PowerSaving, "xset -dpms"),
        ] {
            assert_eq!(found.remedy().as_deref(), Some(command));
            assert!(found.to_string().ends_with(command));
        }
        assert_eq!(Interference::Compositor.remedy(), None);
    }
}
