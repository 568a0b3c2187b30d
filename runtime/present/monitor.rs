//! Lists the monitors of a desktop, and selects one of them.

use super::{PresentError, Rate, no_desktop};
use eyebox_base::reason;
use std::fmt;
use winit::monitor::MonitorHandle;

/// A monitor of the desktop.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Monitor {
    /// The index that selects the monitor.
    pub index: usize,
    /// The name of the monitor in the system.
    pub name: String,
    /// Rows and columns of the monitor.
    pub size: [usize; 2],
    /// Position of its upper left corner on the desktop, as (down, right).
    pub position: [i32; 2],
    /// Video frames per second, if the system reports them.
    pub rate: Option<Rate>,
    /// All modes, as rows and columns, rate, and bits per pixel.
    pub modes: Vec<([usize; 2], Option<Rate>, u16)>,
}

impl fmt::Display for Monitor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} '{}' {}x{}", self.index, self.name, self.size[0], self.size[1])
    }
}

/// The rate that a system reports. Some servers report 0.
fn rate(millihertz: Option<u32>) -> Option<Rate> {
    millihertz.and_then(|m| Rate::from_hz(f64::from(m) / 1000.0).ok())
}

impl Monitor {
    pub(super) fn new(index: usize, monitor: &MonitorHandle) -> Self {
        let rows_columns = |size: winit::dpi::PhysicalSize<u32>| [size.height as usize, size.width as usize];
        let position = monitor.position();
        let modes = monitor
            .video_modes()
            .map(|m| (rows_columns(m.size()), rate(Some(m.refresh_rate_millihertz())), m.bit_depth()));
        Self {
            index,
            name: monitor.name().unwrap_or_default(),
            size: rows_columns(monitor.size()),
            position: [position.y, position.x],
            rate: rate(monitor.refresh_rate_millihertz()),
            modes: modes.collect(),
        }
    }

    /// The monitor that `wanted` names by its index, its name or its size (rows x columns). Without a name, it is the
    /// first monitor of `size`. The monitor must have `size`.
    ///
    /// # Errors
    /// [`PresentError::Display`] with a sentence.
    pub(super) fn choose(monitors: &[Self], wanted: Option<&str>, size: [usize; 2]) -> Result<Self, PresentError> {
        let has = || monitors.iter().map(Self::to_string).collect::<Vec<_>>().join(", ");
        let [height, width] = size;
        let Some(text) = wanted else {
            return monitors.iter().find(|m| m.size == size).cloned().ok_or_else(|| {
                no_desktop(reason!(
                    "monitor",
                    "no monitor has the {height}x{width} pixels of the video frames: there are {}",
                    has()
                ))
            });
        };
        let by_size = |m: &&Self| format!("{}x{}", m.size[0], m.size[1]) == text;
        let by_index = text.parse::<usize>().ok().and_then(|i| monitors.get(i));
        let found =
            by_index.or_else(|| monitors.iter().find(|m| m.name == text)).or_else(|| monitors.iter().find(by_size));
        match found {
            Some(monitor) if monitor.size == size => Ok(monitor.clone()),
            Some(monitor) => Err(no_desktop(reason!(
                "monitor",
                "monitor {monitor} does not have the {height}x{width} pixels of the video frames, which are not \
                 scaled: choose another monitor, mode or display"
            ))),
            None => Err(no_desktop(reason!("no-such-monitor", "no monitor is named '{text}': there are {}", has()))),
        }
    }

    /// True if a monitor of this name and this size, in rows and columns, is still present.
    pub(super) fn is_among(&self, mut now: impl Iterator<Item = (Option<String>, [u32; 2])>) -> bool {
        now.any(|(name, size)| size.map(|n| n as usize) == self.size && name.unwrap_or_default() == self.name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_monitor_that_is_gone_or_has_another_mode_is_not_among_those_there_are() {
        let (name, size) = ("DP-2".to_owned(), [1080, 1920]);
        let monitor = Monitor { index: 1, name, size, position: [0, 0], rate: None, modes: Vec::new() };
        let among = |list: &[(&str, [u32; 2])]| monitor.is_among(list.iter().map(|(n, s)| (Some((*n).into()), *s)));
        assert!(among(&[("DP-1", [1080, 1920]), ("DP-2", [1080, 1920])]));
        assert!(!among(&[("DP-1", [1080, 1920])]) && !among(&[("DP-2", [720, 1280])]) && !among(&[]));
        let unnamed = Monitor { name: String::new(), ..monitor };
        assert!(unnamed.is_among([(None, [1080, 1920])].into_iter()));
    }
}
