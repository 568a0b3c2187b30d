//! Judges the properties of an output by the names that the drivers of Linux give them.

use super::range::{Timing, is_dvi};
use super::report::{LinkCheck, LinkPart, LinkState};
use crate::interference::Interference;

/// The value of a property.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Value {
    Text(String),
    Numbers(Vec<u32>),
    Bytes(Vec<u8>),
}

/// The properties of an output.
pub(super) struct Properties<'a> {
    pub(super) output: &'a str,
    pub(super) all: Vec<(String, Value)>,
}

impl Properties<'_> {
    fn text(&self, name: &str) -> Option<&str> {
        self.all.iter().find(|(n, _)| n == name).and_then(|(_, value)| match value {
            Value::Text(text) => Some(&**text),
            _ => None,
        })
    }

    pub(super) fn numbers(&self, name: &str) -> Option<&[u32]> {
        self.all.iter().find(|(n, _)| n == name).and_then(|(_, value)| match value {
            Value::Numbers(numbers) => Some(&**numbers),
            _ => None,
        })
    }

    fn edid(&self) -> &[u8] {
        self.all
            .iter()
            .find_map(|(name, value)| match value {
                Value::Bytes(bytes) if name == "EDID" => Some(&**bytes),
                _ => None,
            })
            .unwrap_or_default()
    }

    fn wrong(&self, name: &str, value: &str, wanted: &str) -> Interference {
        let (output, name) = (self.output.to_owned(), name.to_owned());
        Interference::Property { output, name, value: value.into(), wanted: wanted.into() }
    }

    /// Checks properties of names by their text. The first value of a list is the one to set. Without any of these
    /// properties, the state is unknown.
    fn one_of(&self, part: LinkPart, list: &[(&str, &[&str])]) -> LinkCheck {
        let present: Vec<_> = list.iter().filter_map(|(name, good)| Some((name, good, self.text(name)?))).collect();
        if present.is_empty() {
            return LinkCheck::new(part, LinkState::Unknown);
        }
        let bad = |(_, good, value): &&(&&str, &&[&str], &str)| !good.iter().any(|g| g.eq_ignore_ascii_case(value));
        let found = present.iter().find(bad);
        LinkCheck::judged(part, found.map(|(name, good, value)| self.wrong(name, value, good[0])))
    }

    /// Judges all properties for a mode. `is_scaled` is true if the mode does not have the size of the panel.
    pub(super) fn judge(&self, timing: Option<Timing>, is_scaled: bool) -> Vec<LinkCheck> {
        let scaling: &[&str] = if is_scaled { &["None", "Center"] } else { &["None", "Full", "Center", "Full aspect"] };
        vec![
            self.matrix(),
            self.range(timing),
            self.depth(),
            self.one_of(LinkPart::Dithering, &[("dither", &["off"]), ("dithering mode", &["off"])]),
            self.one_of(LinkPart::ScalingMode, &[("scaling mode", scaling)]),
            self.one_of(LinkPart::Underscan, &[("underscan", &["off"])]),
            self.one_of(
                LinkPart::Colorspace,
                &[("Colorspace", &["Default"]), ("color format", &["RGB", "AUTO", "RGB444"])],
            ),
            self.one_of(LinkPart::LinkStatus, &[("link-status", &["Good"])]),
        ]
    }

    fn matrix(&self) -> LinkCheck {
        // Each of nine numbers has a low and a high word, and the high word 1 is the number 1.
        let identity = |words: &[u32]| {
            words.len() == 18 && (0..9).all(|i| words[2 * i..2 * i + 2] == if i % 4 == 0 { [0, 1] } else { [0, 0] })
        };
        match self.numbers("CTM") {
            None => LinkCheck::new(LinkPart::ColorMatrix, LinkState::Unknown),
            Some(words) => {
                let changes = words.iter().any(|w| *w != 0) && !identity(words);
                let found = changes.then(|| Interference::ColorMatrix { output: self.output.into() });
                LinkCheck::judged(LinkPart::ColorMatrix, found)
            }
        }
    }

    fn range(&self, timing: Option<Timing>) -> LinkCheck {
        let Some(setting) = self.text("Broadcast RGB") else {
            return LinkCheck::new(LinkPart::Range, LinkState::Unknown);
        };
        let is_limited = match setting {
            "Full" => false,
            "Automatic" => timing.is_some_and(|t| t.is_limited_by_default()) && is_dvi(self.edid()) != Some(true),
            _ => true,
        };
        let limited = || Interference::LimitedRange { output: self.output.into(), setting: setting.into() };
        LinkCheck::judged(LinkPart::Range, is_limited.then(limited))
    }

    fn depth(&self) -> LinkCheck {
        match self.numbers("max bpc") {
            // With more than 8 bits, some drivers dither or send fewer colors.
            Some([bits]) if *bits > 8 => {
                LinkCheck::judged(LinkPart::BitDepth, Some(self.wrong("max bpc", &bits.to_string(), "8")))
            }
            Some(_) => LinkCheck::new(LinkPart::BitDepth, LinkState::Right),
            None => LinkCheck::new(LinkPart::BitDepth, LinkState::Unknown),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::range::tests::edid;
    use super::*;

    const HD: Timing = Timing { size: [1080, 1920], total: [1125, 2200] };

    fn judged(all: Vec<(&str, Value)>, part: LinkPart, is_scaled: bool) -> LinkCheck {
        let all = all.into_iter().map(|(name, value)| (name.to_owned(), value)).collect();
        let checks = Properties { output: "HDMI-1", all }.judge(Some(HD), is_scaled);
        checks.into_iter().find(|c| c.part == part).expect("the part")
    }

    fn text(value: &str) -> Value {
        Value::Text(value.into())
    }

    #[test]
    fn automatic_range_is_limited_for_hdmi_and_full_for_dvi() {
        let of = |setting, hdmi| {
            judged(vec![("Broadcast RGB", text(setting)), ("EDID", Value::Bytes(edid(hdmi)))], LinkPart::Range, false)
        };
        let limited =
            |setting: &str| Some(Interference::LimitedRange { output: "HDMI-1".into(), setting: setting.into() });
        assert_eq!(of("Automatic", true).found, limited("Automatic"));
        assert_eq!(of("Limited 16:235", false).found, limited("Limited 16:235"));
        assert_eq!(of("Automatic", false).state, LinkState::Right);
        assert_eq!(of("Full", true).state, LinkState::Right);
        assert_eq!(judged(Vec::new(), LinkPart::Range, false).state, LinkState::Unknown);
    }

    #[test]
    fn each_driver_has_its_names() {
        use LinkPart::{BitDepth, ColorMatrix, Colorspace, Dithering, LinkStatus, ScalingMode, Underscan};
        let number = |n| Value::Numbers(vec![n]);
        let mut matrix = vec![0; 18];
        [1, 9, 17].into_iter().for_each(|i| matrix[i] = 1);
        let mut tinted = matrix.clone();
        tinted[17] = 0;
        for (part, name, good, bad, wanted) in [
            (BitDepth, "max bpc", number(8), number(12), "8"),
            (Dithering, "dither", text("off"), text("on"), "off"),
            (Dithering, "dithering mode", text("off"), text("auto"), "off"),
            (ScalingMode, "scaling mode", text("Center"), text("Full aspect"), "None"),
            (Underscan, "underscan", text("off"), text("auto"), "off"),
            (Colorspace, "Colorspace", text("Default"), text("BT2020_RGB"), "Default"),
            (Colorspace, "color format", text("RGB"), text("YCbCr420"), "RGB"),
            (LinkStatus, "link-status", text("Good"), text("Bad"), "Good"),
            (ColorMatrix, "CTM", Value::Numbers(matrix), Value::Numbers(tinted), ""),
        ] {
            assert_eq!(judged(vec![(name, good)], part, true).state, LinkState::Right, "{name}");
            let check = judged(vec![(name, bad)], part, true);
            assert_eq!(check.state, LinkState::Wrong, "{name}");
            match check.found {
                Some(Interference::Property { name: n, wanted: w, .. }) => assert_eq!((&*n, &*w), (name, wanted)),
                found => assert_eq!(found, Some(Interference::ColorMatrix { output: "HDMI-1".into() })),
            }
        }
        let full = judged(vec![("scaling mode", text("Full"))], ScalingMode, false);
        assert_eq!(full.state, LinkState::Right, "nothing is scaled in the mode of the panel");
    }
}
