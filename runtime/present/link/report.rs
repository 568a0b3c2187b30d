//! Holds the result of checks of a link as data.

use crate::interference::Interference;
use serde::Serialize;

/// The system that is between the swapchain and the panel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum LinkSystem {
    /// An X server, whose outputs can be read and set.
    X11,
    /// A Wayland compositor. It converts pictures as it likes, and no protocol reads ramps or properties.
    Wayland,
    /// The kernel alone, whose `/sys/class/drm` can be read.
    Console,
    /// A system that reports nothing.
    Other,
}

/// A part of the link that can change levels, pixels or times.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum LinkPart {
    /// The gamma ramp of the output.
    GammaRamp,
    /// The color matrix of the output.
    ColorMatrix,
    /// Scaling and distortion by the output.
    Transform,
    /// Rotation and mirroring by the output.
    Rotation,
    /// The size of the mode and of the panel.
    ModeSize,
    /// The range of levels, full or 16 to 235.
    Range,
    /// Bits per channel on the cable.
    BitDepth,
    /// Dithering to fewer levels.
    Dithering,
    /// Scaling by the driver.
    ScalingMode,
    /// Underscan, which scales the picture to leave a border.
    Underscan,
    /// The color space and the color format on the cable.
    Colorspace,
    /// The state of the cable's connection.
    LinkStatus,
    /// Variable refresh, which changes the times of video frames.
    VariableRefresh,
    /// A compositor between windows and the output.
    Compositor,
    /// The screen saver of the desktop.
    ScreenSaver,
    /// Power saving, which is DPMS on X11.
    PowerSaving,
}

/// The state of a part.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum LinkState {
    /// It leaves the picture unchanged.
    Right,
    /// This session has set it right, and puts it back at its end.
    SetRight,
    /// A session sets it right while it shows.
    SetWhileShown,
    /// It changes or blanks the picture.
    Wrong,
    /// The system does not report it.
    Unknown,
}

/// A checked part of the link.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct LinkCheck {
    /// The checked part of the link.
    pub part: LinkPart,
    /// The state of this part.
    pub state: LinkState,
    /// The influence that was found, also if it was set right.
    pub found: Option<Interference>,
}

impl LinkCheck {
    pub(crate) fn new(part: LinkPart, state: LinkState) -> Self {
        Self { part, state, found: None }
    }

    /// A part that is wrong if something was found, and right otherwise.
    pub(crate) fn judged(part: LinkPart, found: Option<Interference>) -> Self {
        let state = if found.is_some() { LinkState::Wrong } else { LinkState::Right };
        Self { part, state, found }
    }

    /// A part that was, or will be, set right.
    #[cfg(all(unix, not(target_vendor = "apple")))]
    pub(crate) fn set(part: LinkPart, state: LinkState, found: Interference) -> Self {
        Self { part, state, found: Some(found) }
    }

    /// The influence, if it still changes or blanks the picture, or if a ramp did before it was set right.
    pub(crate) fn disturbs(&self) -> Option<&Interference> {
        let ramp = self.part == LinkPart::GammaRamp && self.state == LinkState::SetRight;
        self.found.as_ref().filter(|_| ramp || self.state == LinkState::Wrong)
    }
}

/// The link between the swapchain and a panel.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct Link {
    /// The system between them.
    pub system: LinkSystem,
    /// The name of the output in that system.
    pub output: Option<String>,
    /// The checks of its parts.
    pub checks: Vec<LinkCheck>,
    /// True if a session that was killed had left a ramp or timeouts, and they were put back.
    pub recovered: bool,
}

impl Link {
    /// The link of a system that reports none of its parts.
    pub(crate) fn unknown(system: LinkSystem, output: Option<String>) -> Self {
        let parts = [
            LinkPart::GammaRamp,
            LinkPart::ColorMatrix,
            LinkPart::Transform,
            LinkPart::Range,
            LinkPart::BitDepth,
            LinkPart::Dithering,
            LinkPart::VariableRefresh,
            LinkPart::Compositor,
            LinkPart::ScreenSaver,
            LinkPart::PowerSaving,
        ];
        let checks = parts.into_iter().map(|part| LinkCheck::new(part, LinkState::Unknown)).collect();
        Self { system, output, checks, recovered: false }
    }

    /// The parts that change or blank the picture.
    pub fn wrong(&self) -> impl Iterator<Item = &Interference> {
        self.checks.iter().filter(|c| c.state == LinkState::Wrong).filter_map(|c| c.found.as_ref())
    }

    /// Sentences about parts that are wrong or were set right, and about a system that reports nothing.
    pub fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        if self.recovered {
            notes.push(
                "a session that was killed had changed the gamma ramp or power saving, which are put back".into(),
            );
        }
        if self.system == LinkSystem::Wayland {
            notes.push(
                "Wayland: the compositor may convert the picture, and no protocol reports gamma ramps or the \
                 properties of outputs. Use a direct display or X11 for an SLM"
                    .into(),
            );
        }
        notes.extend(self.checks.iter().filter_map(LinkCheck::disturbs).map(ToString::to_string));
        notes
    }

    /// The part of this kind, if it was checked.
    pub fn part(&self, part: LinkPart) -> Option<&LinkCheck> {
        self.checks.iter().find(|check| check.part == part)
    }
}
