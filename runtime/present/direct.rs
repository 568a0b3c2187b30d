//! A display that no desktop drives: nothing lies between its video frames and the SLM.

use super::{DisplayPresenter, PresentError, Rate, RealClock};
use crate::engine::vulkan::{self, DirectMode, FoundDisplay};
use std::fmt;

/// A display that could be shown on directly.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Connected {
    /// By which it is chosen.
    pub index: usize,
    /// As the driver lists it.
    pub display: FoundDisplay,
}

impl fmt::Display for Connected {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let FoundDisplay { name, monitor, size, .. } = &self.display;
        let monitor = monitor.as_ref().map(|m| format!(" ({m})")).unwrap_or_default();
        write!(f, "{} '{name}'{monitor} {}x{}", self.index, size[0], size[1])
    }
}

fn refused(reason: impl ToString) -> PresentError {
    PresentError::display("direct display", reason)
}

/// The displays that no desktop drives.
pub struct DirectDisplays {
    displays: vulkan::DirectDisplays,
}

impl DirectDisplays {
    /// Asks the drivers for them.
    ///
    /// # Errors
    /// [`PresentError::Display`] where no driver knows of such displays.
    pub fn open(validation: bool) -> Result<Self, PresentError> {
        vulkan::DirectDisplays::open(validation).map(|displays| Self { displays }).map_err(refused)
    }

    /// All of them.
    pub fn list(&self) -> Vec<Connected> {
        let of = |(index, display): (usize, &FoundDisplay)| Connected { index, display: display.clone() };
        self.displays.found().iter().enumerate().map(of).collect()
    }

    /// Takes the display that `wanted` names, by its index, its connector or its monitor, in a mode of exactly this size;
    /// without a name, the first that has one.
    ///
    /// # Errors
    /// [`PresentError::Display`], in a sentence: there is none, it has no such mode, another program drives it.
    pub fn take(
        self,
        wanted: Option<&str>,
        size: [usize; 2],
        rate: Option<Rate>,
        clock: RealClock,
    ) -> Result<DisplayPresenter, PresentError> {
        let list = self.list();
        let (index, mode) = choose(&list, wanted, size, rate).map_err(refused)?;
        let rate = Rate::from_hz(f64::from(list[index].display.modes[mode].millihertz) / 1000.0).ok();
        let screen = self.displays.screen(index, mode).map_err(refused)?;
        Ok(DisplayPresenter::direct(screen, format!("display {}", list[index]), rate, clock))
    }
}

/// The display and its mode, by their indices.
fn choose(
    list: &[Connected],
    wanted: Option<&str>,
    size: [usize; 2],
    rate: Option<Rate>,
) -> Result<(usize, usize), String> {
    let [height, width] = size;
    let has = || list.iter().map(Connected::to_string).collect::<Vec<_>>().join(", ");
    if list.is_empty() {
        return Err(
            "no driver here shows on a display by itself: it takes a graphics card with a display plugged in that \
                    no desktop drives, or --output window"
                .into(),
        );
    }
    let Some(text) = wanted else {
        let first = list.iter().find_map(|c| mode(&c.display.modes, size, rate).map(|m| (c.index, m)));
        return first.ok_or_else(|| {
            let at = rate.map(|r| format!(" at {r} Hz")).unwrap_or_default();
            format!("no display has {height}x{width} pixels{at}, as the video frames have: there are {}", has())
        });
    };
    let found = (text.parse::<usize>().ok().and_then(|i| list.get(i)))
        .or_else(|| list.iter().find(|c| c.display.name == text))
        .or_else(|| list.iter().find(|c| c.display.monitor.as_deref() == Some(text)))
        .ok_or_else(|| format!("no display is called '{text}': there are {}", has()))?;
    mode(&found.display.modes, size, rate).map(|m| (found.index, m)).ok_or_else(|| {
        let modes = |m: &DirectMode| format!("{}x{} at {:.3} Hz", m.size[0], m.size[1], f64::from(m.millihertz) / 1e3);
        let modes = found.display.modes.iter().map(modes).collect::<Vec<_>>().join(", ");
        let at = rate.map(|r| format!(" at {r} Hz")).unwrap_or_default();
        format!("display {found} has no mode of {height}x{width}{at}: nothing is scaled; it has {modes}")
    })
}

/// The mode of exactly this size whose rate is nearest, and no further off than half a hertz; without a rate, the fastest.
fn mode(modes: &[DirectMode], size: [usize; 2], rate: Option<Rate>) -> Option<usize> {
    let fits = modes.iter().enumerate().filter(|(_, m)| m.size == size);
    let Some(rate) = rate else { return fits.rev().max_by_key(|(_, m)| m.millihertz).map(|(i, _)| i) };
    let off = |m: &DirectMode| (f64::from(m.millihertz) / 1000.0 - rate.hz()).abs();
    fits.filter(|(_, m)| off(m) <= 0.5).min_by(|a, b| off(a.1).total_cmp(&off(b.1))).map(|(i, _)| i)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mode_of(size: [usize; 2], millihertz: u32) -> DirectMode {
        DirectMode { size, millihertz }
    }

    fn list() -> Vec<Connected> {
        let display = |name: &str, monitor: Option<&str>, modes: Vec<DirectMode>| FoundDisplay {
            name: name.into(),
            monitor: monitor.map(Into::into),
            device: "a card".into(),
            size: modes[0].size,
            modes,
        };
        let hd = [1080, 1920];
        let displays = [
            display(
                "HDMI-A-1",
                Some("PLUTO-2"),
                vec![mode_of(hd, 59_940), mode_of(hd, 60_000), mode_of([720, 1280], 60_000)],
            ),
            display("DP-2", None, vec![mode_of([1600, 2716], 30_000), mode_of(hd, 119_880), mode_of(hd, 60_000)]),
        ];
        displays.into_iter().enumerate().map(|(index, display)| Connected { index, display }).collect()
    }

    #[test]
    fn a_mode_has_exactly_the_size_and_the_nearest_rate() {
        let hz = |text| Some(Rate::parse(text).unwrap());
        let modes = &list()[0].display.modes;
        assert_eq!(mode(modes, [1080, 1920], hz("60")), Some(1));
        assert_eq!(mode(modes, [1080, 1920], hz("59.94")), Some(0));
        assert_eq!(mode(modes, [1080, 1920], hz("59.5")), Some(0));
        assert_eq!(mode(modes, [1080, 1920], hz("50")), None);
        assert_eq!(mode(modes, [1080, 1920], None), Some(1));
        assert_eq!(mode(modes, [1920, 1080], None), None);
        let twice = [mode_of([4, 4], 60_000), mode_of([4, 4], 60_000)];
        assert_eq!(
            (mode(&twice, [4, 4], None), mode(&twice, [4, 4], hz("60")), mode(&[], [4, 4], None)),
            (Some(0), Some(0), None)
        );
    }

    #[test]
    fn a_display_is_chosen_by_index_connector_or_monitor_or_refused_in_a_sentence() {
        let list = list();
        let hd = [1080, 1920];
        let of = |wanted, size, rate: Option<&str>| choose(&list, wanted, size, rate.map(|r| Rate::parse(r).unwrap()));
        assert_eq!(of(None, [1600, 2716], None), Ok((1, 0)));
        assert_eq!(of(None, hd, Some("119.88")), Ok((1, 1)));
        assert_eq!(of(Some("PLUTO-2"), hd, Some("60")), Ok((0, 1)));
        assert_eq!(of(Some("DP-2"), hd, None), Ok((1, 1)));
        assert_eq!(of(Some("1"), hd, Some("60")), Ok((1, 2)));
        for (wanted, size, rate, what) in [
            (
                None,
                [7, 7],
                None,
                "no display has 7x7 pixels, as the video frames have: there are 0 'HDMI-A-1' (PLUTO-2)",
            ),
            (None, hd, Some("144"), "at 144 Hz"),
            (Some("VGA-1"), hd, None, "no display is called 'VGA-1'"),
            (
                Some("HDMI-A-1"),
                [1600, 2716],
                None,
                "has no mode of 1600x2716: nothing is scaled; it has 1080x1920 at 59.940",
            ),
        ] {
            let text = of(wanted, size, rate).unwrap_err();
            assert!(text.contains(what) && !text.contains('\n'), "{text}");
        }
        assert!(choose(&[], None, hd, None).unwrap_err().contains("no driver here shows"));
    }
}
