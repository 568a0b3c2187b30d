//! Reads what the kernel reports of a connector without a desktop, in `/sys/class/drm`.
//!
//! Properties of the kernel's mode setting, such as ramps, range and dithering, need ioctls of the card, which are not
//! built. The first program that opens a card on a console becomes its master, and Vulkan needs to be the master.

use super::report::{Link, LinkCheck, LinkPart, LinkState, LinkSystem};
use crate::interference::Interference;
use std::fs;
use std::path::Path;

/// The parts that need ioctls.
const UNREAD: [LinkPart; 6] = [
    LinkPart::GammaRamp,
    LinkPart::ColorMatrix,
    LinkPart::Range,
    LinkPart::BitDepth,
    LinkPart::Dithering,
    LinkPart::ScalingMode,
];

/// Checks a connector such as `HDMI-A-1` for a mode of these rows and columns. `classes` is `/sys/class/drm`.
pub(in super::super) fn link(classes: &Path, connector: &str, mode: [usize; 2]) -> Link {
    let entries = fs::read_dir(classes).into_iter().flatten().flatten();
    let is_it =
        |name: &str| name.split_once('-').is_some_and(|(card, rest)| card.starts_with("card") && rest == connector);
    let folder = entries
        .map(|entry| entry.path())
        .find(|path| path.file_name().and_then(|name| name.to_str()).is_some_and(is_it));
    let Some(folder) = folder else { return Link::unknown(LinkSystem::Console, Some(connector.into())) };
    let read = |name: &str| fs::read_to_string(folder.join(name)).unwrap_or_default();
    let mut checks: Vec<_> = UNREAD.into_iter().map(|part| LinkCheck::new(part, LinkState::Unknown)).collect();
    // The first mode is the preferred one.
    checks.push(match read("modes").lines().next().and_then(size) {
        Some(panel) => {
            let wrong = || Interference::ModeSize { output: connector.into(), mode, panel };
            LinkCheck::judged(LinkPart::ModeSize, (panel != mode).then(wrong))
        }
        None => LinkCheck::new(LinkPart::ModeSize, LinkState::Unknown),
    });
    let dark = || Interference::NotLit { output: connector.into() };
    let is_off = read("status").trim() == "disconnected";
    checks.push(LinkCheck::judged(LinkPart::LinkStatus, is_off.then(dark)));
    let dpms = read("dpms");
    // A connector that no program drives is off until the session lights it.
    let sleeps = read("enabled").trim() == "enabled" && !matches!(dpms.trim(), "On" | "");
    checks.push(LinkCheck::judged(LinkPart::PowerSaving, sleeps.then_some(Interference::PowerSaving)));
    // Only a desktop has these.
    checks.extend([LinkPart::Compositor, LinkPart::ScreenSaver].map(|part| LinkCheck::new(part, LinkState::Right)));
    Link { system: LinkSystem::Console, output: Some(connector.into()), checks, recovered: false }
}

/// The rows and columns of a mode such as `1920x1080`, with `i` at the end if it is interlaced.
fn size(mode: &str) -> Option<[usize; 2]> {
    let (columns, rows) = mode.trim().trim_end_matches('i').split_once('x')?;
    Some([rows.parse().ok()?, columns.parse().ok()?])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_kernel_reports_the_panel_and_its_power() {
        let here = tempfile::tempdir().unwrap();
        let folder = here.path().join("card1-HDMI-A-1");
        fs::create_dir(&folder).unwrap();
        fs::create_dir(here.path().join("card0-DP-1")).unwrap();
        let write = |name: &str, text: &str| fs::write(folder.join(name), text).unwrap();
        write("status", "connected\n");
        write("enabled", "enabled\n");
        write("dpms", "On\n");
        write("modes", "1920x1080\n1280x720\n");
        let of = |mode| link(here.path(), "HDMI-A-1", mode);
        let right = of([1080, 1920]);
        assert_eq!((right.wrong().count(), right.system), (0, LinkSystem::Console));
        assert_eq!(right.part(LinkPart::Range).map(|c| c.state), Some(LinkState::Unknown));
        let panel = [1080, 1920];
        let other = Interference::ModeSize { output: "HDMI-A-1".into(), mode: [720, 1280], panel };
        assert_eq!(of([720, 1280]).wrong().collect::<Vec<_>>(), [&other]);
        write("dpms", "Off\n");
        assert_eq!(of(panel).wrong().collect::<Vec<_>>(), [&Interference::PowerSaving]);
        write("enabled", "disabled\n");
        write("status", "disconnected\n");
        let dark = Interference::NotLit { output: "HDMI-A-1".into() };
        assert_eq!(of(panel).wrong().collect::<Vec<_>>(), [&dark]);
        let nowhere = link(here.path(), "DP-9", panel);
        assert!(nowhere.checks.iter().all(|c| c.state == LinkState::Unknown));
    }
}
