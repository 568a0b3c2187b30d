//! The built-in displays by name: models, and SLMs of makers as files with their sources.

use super::{Color, Display, Encoding, Geometry, OpticsError, Wavelength};
use crate::files::read;
use std::path::Path;

/// The built-in displays, by name; the first is the default.
pub const PRESETS: [&str; 16] = [
    "paper",
    "plm",
    "small",
    "grey8",
    "fields",
    "planes8",
    "planes24",
    "far-field",
    "far-field-16k",
    "holoeye-pluto-2.1",
    "holoeye-leto-3",
    "holoeye-gaea-2",
    "thorlabs-exulus-hd1",
    "thorlabs-exulus-hd2",
    "thorlabs-exulus-4k1",
    "hamamatsu-x15213",
];

/// What the file of an SLM says.
fn device(name: &str) -> Option<&'static str> {
    Some(match name {
        "holoeye-pluto-2.1" => include_str!("presets/holoeye-pluto-2.1.toml"),
        "holoeye-leto-3" => include_str!("presets/holoeye-leto-3.toml"),
        "holoeye-gaea-2" => include_str!("presets/holoeye-gaea-2.toml"),
        "thorlabs-exulus-hd1" => include_str!("presets/thorlabs-exulus-hd1.toml"),
        "thorlabs-exulus-hd2" => include_str!("presets/thorlabs-exulus-hd2.toml"),
        "thorlabs-exulus-4k1" => include_str!("presets/thorlabs-exulus-4k1.toml"),
        "hamamatsu-x15213" => include_str!("presets/hamamatsu-x15213.toml"),
        _ => return None,
    })
}

/// What a model is, in a line.
fn model(name: &str) -> Option<&'static str> {
    Some(match name {
        "paper" => "Schiffers et al. 2023: an 8-bit LCoS behind a 4f relay",
        "plm" => "TI 0.67 in PLM (DLP6750Q1EVM): mirrors of 16 heights, 24 bit-planes a video frame",
        "small" => "a small 8-bit SLM, for trying things out",
        "grey8" => "an 8-bit LCoS, one grey image a video frame",
        "fields" => "an 8-bit LCoS that shows R, G and B of a video frame in turn",
        "planes8" => "a one-bit SLM, 8 bit-planes a video frame",
        "planes24" => "a one-bit SLM, 24 bit-planes a video frame",
        "far-field" => "a small SLM in the pupil plane, for development",
        "far-field-16k" => "Schiffers et al. 2023: the largest SLM in the pupil plane",
        _ => return None,
    })
}

/// What may be added to a display file: every line without its `#` is one.
const MORE: &str = r#"
# What may be added; docs/displays.md explains every key.
#two_pi_level = { red = 256, green = 256, blue = 256 }    # grey level of 2 pi, measured
#flip = "horizontal"           # vertical, both
#rotation_deg = 180            # 90, 180, 270
#offset_px = [0, 0]            # down, right
#[[encoding.grating]]          # moves the image off the zero order
#period_px = 8.0
#direction_deg = 0
#[[encoding.correction]]       # the flatness correction of the SLM
#file = "flatness.png"
#sign = 1                      # -1 takes it away
"#;

/// A preset as the text of a display file, with comments.
pub fn preset_text(name: &str) -> Option<String> {
    if let Some(text) = device(name) {
        return Some(text.to_owned());
    }
    Some(format!("# {}\n{}", model(name)?, Display::preset(name)?.to_toml()))
}

/// What a preset is, in a line.
pub fn preset_about(name: &str) -> Option<&'static str> {
    model(name).or_else(|| device(name)?.lines().next()?.strip_prefix("# "))
}

/// The beginning of a display file of one's own: a preset without its name, with what may be added as comments.
pub fn display_template(name: &str) -> Option<String> {
    let text = preset_text(name)?;
    let lines = text.lines().filter(|line| !line.starts_with("name = "));
    Some(lines.flat_map(|line| [line, "\n"]).collect::<String>() + MORE)
}

impl Display {
    /// A preset or a TOML file.
    ///
    /// # Errors
    /// [`OpticsError::UnknownDisplay`], [`OpticsError::DisplayFile`] and those of [`Optics::new`](super::Optics::new).
    pub fn load(name: &str) -> Result<Self, OpticsError> {
        if let Some(display) = Self::preset(name) {
            return Ok(display);
        }
        let text = read::text(Path::new(name), read::TEXT).map_err(|e| OpticsError::UnknownDisplay {
            name: name.into(),
            presets: PRESETS.join(", "),
            reason: e.to_string(),
        })?;
        Self::from_toml(&text, name)
    }

    /// A preset by name.
    pub fn preset(name: &str) -> Option<Self> {
        let (height, width, pitch, levels) = match name {
            // Schiffers et al. 2023: 8 um, 660/520/440 nm, 400 mm.
            "paper" => (1080, 1920, 8e-6, 256),
            // TI PLM, 0.67 in: 1358 x 800 mirrors of 10.8 um, 16 levels.
            "plm" => (800, 1358, 10.8e-6, 16),
            "small" => (256, 256, 8e-6, 256),
            // An LCoS of 8 bits, one image or three fields a video frame; a ferroelectric one of one bit.
            "grey8" | "fields" => (1080, 1920, 8e-6, 256),
            "planes8" | "planes24" => (1080, 1920, 8e-6, 2),
            // The SLM in the pupil plane: one for development, whose eyebox is 4 mm, and Schiffers et al.'s largest.
            "far-field" => (512, 512, 8e-6, 256),
            "far-field-16k" => (16384, 16384, 1e-6, 256),
            _ => return device(name).map(|text| Self::from_toml(text, name).expect("a test reads every preset")),
        };
        let geometry = if name.starts_with("far-field") { Geometry::FarField } else { Geometry::Relay };
        let wavelengths = [(Color::Red, 660e-9), (Color::Green, 520e-9), (Color::Blue, 440e-9)];
        let wavelengths = wavelengths.map(|(color, wavelength)| Wavelength { color, wavelength }).to_vec();
        let encoding = Encoding::preset(name);
        let name = name.to_owned();
        Some(Self {
            name,
            height,
            width,
            pitch,
            focal_length: 0.4,
            geometry,
            wavelengths,
            levels,
            rate_hz: None,
            portrait: false,
            encoding,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn every_preset_is_a_display_file_and_begins_one() {
        assert_eq!(PRESETS.iter().collect::<BTreeSet<_>>().len(), PRESETS.len());
        for name in PRESETS {
            let preset = Display::preset(name).unwrap_or_else(|| panic!("{name}"));
            assert_eq!(preset.name, name);
            assert!(preset_about(name).is_some_and(|about| about.len() > 10));
            let read = Display::from_toml(&preset_text(name).unwrap(), "x.toml").unwrap();
            assert_eq!((&read.encoding, read.rate_hz, &read.name), (&preset.encoding, preset.rate_hz, &preset.name));
            let template = display_template(name).unwrap();
            // With every line that may be added, too.
            let added =
                |line: &'_ str| line.strip_prefix('#').filter(|key| !key.starts_with(' ')).unwrap_or(line).to_owned();
            let all: Vec<String> = template.lines().map(added).collect();
            for text in [template, all.join("\n")] {
                let begun = Display::from_toml(&text, "bench.toml").unwrap_or_else(|e| panic!("{e}\n{text}"));
                assert_eq!((begun.name.as_str(), begun.height, begun.width), ("bench", preset.height, preset.width));
            }
        }
    }

    #[test]
    fn presets_exist_and_survive_their_own_file() {
        for name in PRESETS {
            let display = Display::preset(name).unwrap();
            let again = Display::from_toml(&display.to_toml(), "x.toml").unwrap();
            assert_eq!((again.height, again.width, again.levels), (display.height, display.width, display.levels));
            assert_eq!(again.encoding, display.encoding);
            assert!((again.eyebox_min() - display.eyebox_min()).abs() < 1e-12);
        }
    }

    #[test]
    fn a_display_that_is_none_is_told_the_presets() {
        assert!(Display::load("no-such-display").unwrap_err().to_string().contains("paper"));
    }

    #[test]
    fn every_device_says_its_source() {
        for text in PRESETS.iter().filter_map(|name| device(name)) {
            assert!(text.lines().nth(1).is_some_and(|line| line.starts_with("# Source: https://")), "{text}");
        }
    }
}
