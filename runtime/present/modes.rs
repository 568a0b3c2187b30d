//! Lists displays that no desktop drives, and selects a display and a mode.

use super::Rate;
use eyebox_base::error::Reason;
use eyebox_base::reason;
use std::fmt;

/// A mode of a display.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DirectMode {
    /// Rows and columns of the mode.
    pub size: [usize; 2],
    /// Video frames per 1000 seconds.
    pub millihertz: u32,
}

/// A display that can be shown on directly.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DirectDisplay {
    /// The index that selects the display.
    pub index: usize,
    /// The name of the connector, or the driver's name of the display.
    pub name: String,
    /// The name that the monitor reports, if there is one.
    pub monitor: Option<String>,
    /// The device of the driver.
    pub device: String,
    /// Rows and columns of the display.
    pub size: [usize; 2],
    /// The modes in the order of the driver.
    pub modes: Vec<DirectMode>,
}

impl fmt::Display for DirectDisplay {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { index, name, monitor, size: [height, width], .. } = self;
        let monitor = monitor.as_ref().map(|m| format!(" ({m})")).unwrap_or_default();
        write!(f, "{index} '{name}'{monitor} {height}x{width}")
    }
}

/// Selects a display and its mode, by their indices.
pub(super) fn choose(
    list: &[DirectDisplay],
    wanted: Option<&str>,
    size: [usize; 2],
    rate: Option<Rate>,
) -> Result<(usize, usize), Reason> {
    let [height, width] = size;
    let has = || list.iter().map(DirectDisplay::to_string).collect::<Vec<_>>().join(", ");
    if list.is_empty() {
        return Err(Reason::new(
            "no-displays",
            "no driver here shows on a display directly: use a graphics card with a plugged display that \
                    no desktop drives, or `output` window",
        ));
    }
    let Some(text) = wanted else {
        let first = list.iter().find_map(|c| mode(&c.modes, size, rate).map(|m| (c.index, m)));
        return first.ok_or_else(|| {
            let at = rate.map(|r| format!(" at {r} Hz")).unwrap_or_default();
            reason!(
                "no-display-fits",
                "no display has the {height}x{width} pixels{at} of the video frames: there are {}",
                has()
            )
        });
    };
    let found = (text.parse::<usize>().ok().and_then(|i| list.get(i)))
        .or_else(|| list.iter().find(|c| c.name == text))
        .or_else(|| list.iter().find(|c| c.monitor.as_deref() == Some(text)))
        .ok_or_else(|| reason!("no-such-display", "no display is named '{text}': there are {}", has()))?;
    mode(&found.modes, size, rate).map(|m| (found.index, m)).ok_or_else(|| {
        let modes = |m: &DirectMode| format!("{}x{} at {:.3} Hz", m.size[0], m.size[1], f64::from(m.millihertz) / 1e3);
        let modes = found.modes.iter().map(modes).collect::<Vec<_>>().join(", ");
        let at = rate.map(|r| format!(" at {r} Hz")).unwrap_or_default();
        reason!(
            "no-such-mode",
            "display {found} has no mode of {height}x{width}{at}, and pictures are not scaled: it has {modes}"
        )
    })
}

/// The mode of exactly this size whose rate is nearest, with a difference of at most half a hertz. Without a rate, it
/// is the fastest mode.
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

    fn list() -> Vec<DirectDisplay> {
        let display = |index, name: &str, monitor: Option<&str>, modes: Vec<DirectMode>| DirectDisplay {
            index,
            name: name.into(),
            monitor: monitor.map(Into::into),
            device: "a card".into(),
            size: modes[0].size,
            modes,
        };
        let hd = [1080, 1920];
        vec![
            display(
                0,
                "HDMI-A-1",
                Some("PLUTO-2"),
                vec![mode_of(hd, 59_940), mode_of(hd, 60_000), mode_of([720, 1280], 60_000)],
            ),
            display(1, "DP-2", None, vec![mode_of([1600, 2716], 30_000), mode_of(hd, 119_880), mode_of(hd, 60_000)]),
        ]
    }

    #[test]
    fn a_mode_has_exactly_the_size_and_the_nearest_rate() {
        let hz = |text| Some(Rate::parse(text).unwrap());
        let modes = &list()[0].modes;
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
        for (wanted, size, rate, code, parts) in [
            (None, [7, 7], None, "no-display-fits", &["7x7", "0 'HDMI-A-1' (PLUTO-2)"][..]),
            (None, hd, Some("144"), "no-display-fits", &["144 Hz"]),
            (Some("VGA-1"), hd, None, "no-such-display", &["'VGA-1'"]),
            (Some("HDMI-A-1"), [1600, 2716], None, "no-such-mode", &["1600x2716", "1080x1920", "59.940"]),
        ] {
            let refused = of(wanted, size, rate).unwrap_err();
            let text = refused.text();
            assert_eq!(refused.code(), code, "{text}");
            assert!(parts.iter().all(|part| text.contains(part)) && !text.contains('\n'), "{text}");
        }
        assert_eq!(choose(&[], None, hd, None).unwrap_err().code(), "no-displays");
    }
}
