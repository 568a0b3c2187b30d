//! Prints the link between the swapchain and the panel of a display in words.

use crate::Failure;
use crate::show::args::OutputTo;
use eyebox::low_level::optics::Display;
use eyebox::low_level::present::{
    Desktop, DirectDisplay, Interference, Link, LinkPart, LinkState, LinkSystem, direct_displays, direct_link,
};
use eyebox::low_level::reason;
use eyebox::low_level::session::video_frame_size;

/// Checks the link of a display. Without an output, it is the first monitor with the size of the video frames, and
/// there is no link without such a monitor.
pub fn of(display: &Display, to: Option<&OutputTo>) -> Result<Option<Link>, Failure> {
    let size = video_frame_size(display)?;
    let on_monitor = |name: Option<&str>| -> Result<Link, Failure> {
        let desktop = Desktop::open()?;
        let monitor = desktop.choose(name, size)?;
        Ok(desktop.link(&monitor))
    };
    match to {
        None => Ok(on_monitor(None).ok()),
        Some(OutputTo::Window(name)) => on_monitor(name.as_deref()).map(Some),
        Some(OutputTo::Direct(name)) => {
            let all = direct_displays()?;
            let is_it = |d: &&DirectDisplay| match name {
                Some(name) => d.name == *name || d.monitor.as_ref() == Some(name) || d.index.to_string() == *name,
                None => d.modes.iter().any(|mode| mode.size == size),
            };
            match all.iter().find(is_it) {
                Some(found) => Ok(Some(direct_link(found, size))),
                None => Err(Failure::Arguments(reason!(
                    "no-such-direct",
                    "--output: no such display without a desktop. eyebox display monitors lists them"
                ))),
            }
        }
        Some(_) => Err(Failure::Arguments(reason!(
            "no-device",
            "{}: this --output is for a display with a controller. Add [device] to its file, or give --output window",
            display.name
        ))),
    }
}

fn name(part: LinkPart) -> &'static str {
    match part {
        LinkPart::GammaRamp => "gamma ramp",
        LinkPart::ColorMatrix => "color matrix",
        LinkPart::Transform => "transform",
        LinkPart::Rotation => "rotation",
        LinkPart::ModeSize => "size of the mode",
        LinkPart::Range => "range of levels",
        LinkPart::BitDepth => "bits per channel",
        LinkPart::Dithering => "dithering",
        LinkPart::ScalingMode => "scaling mode",
        LinkPart::Underscan => "underscan",
        LinkPart::Colorspace => "color space",
        LinkPart::LinkStatus => "link status",
        LinkPart::VariableRefresh => "variable refresh",
        LinkPart::Compositor => "compositor",
        LinkPart::ScreenSaver => "screen saver",
        LinkPart::PowerSaving => "power saving",
        _ => "other",
    }
}

/// Prints a link, one part per line.
pub fn print(link: &Link) {
    let system = match link.system {
        LinkSystem::X11 => "X11",
        LinkSystem::Wayland => "Wayland, whose compositor may convert the picture. No protocol reads it",
        LinkSystem::Console => "without a desktop",
        _ => "not reported by this system",
    };
    println!("link to output {}: {system}", link.output.as_deref().unwrap_or("unknown"));
    if link.recovered {
        println!("  the gamma ramp or power saving that a killed session had changed was put back");
    }
    for check in &link.checks {
        let found = || check.found.as_ref().map(Interference::to_string).unwrap_or_default();
        let levels = match &check.found {
            Some(Interference::GammaRamp { levels, .. }) => {
                format!(" (now it changes levels by up to {levels} of 255)")
            }
            _ => String::new(),
        };
        let state = match check.state {
            LinkState::Right => "right".into(),
            LinkState::SetRight => "set right".into(),
            LinkState::SetWhileShown => format!("set right while eyebox shows{levels}"),
            LinkState::Wrong => format!("wrong. {}", found()),
            _ => "not reported".into(),
        };
        println!("  {:18} {state}", name(check.part));
    }
}
