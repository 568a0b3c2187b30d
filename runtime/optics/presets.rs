//! Provides the built-in displays by name, as models and as files of makers' SLMs with sources.

use super::Packing::{self, Fields, Grey8, Planes8, Planes24};
use super::device::without_apparatus;
use super::two_eyes::refuse_two;
use super::{Color, Display, Encoding, Geometry, OpticsError, Wavelength};
use eyebox_base::files::{FileRecord, read};
use std::path::Path;

/// The names of the built-in displays. The first is the default.
pub const PRESETS: [&str; 25] = [
    "paper",
    "headset",
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
    "hamamatsu-x13138",
    "hamamatsu-x15213",
    "meadowlark-1920x1152",
    "meadowlark-e19x12",
    "meadowlark-hdmi-10bit",
    "santec-slm-200",
    "ti-plm-0.47",
    "ti-plm-0.67-hdmi",
    "ti-plm-0.67-displayport",
];

/// The name and the text of each SLM's file, in which each number has its source.
macro_rules! devices {
    ($($name:literal)*) => { [$(($name, include_str!(concat!("presets/", $name, ".toml")))),*] };
}
const DEVICES: [(&str, &str); 17] = devices! {
    "headset" "plm" "holoeye-pluto-2.1" "holoeye-leto-3" "holoeye-gaea-2" "thorlabs-exulus-hd1" "thorlabs-exulus-hd2"
    "thorlabs-exulus-4k1" "hamamatsu-x13138" "hamamatsu-x15213" "meadowlark-1920x1152" "meadowlark-e19x12"
    "meadowlark-hdmi-10bit" "santec-slm-200" "ti-plm-0.47" "ti-plm-0.67-hdmi" "ti-plm-0.67-displayport"
};

fn device(name: &str) -> Option<&'static str> {
    DEVICES.iter().find(|d| d.0 == name).map(|d| d.1)
}

/// Models with name, rows and columns, pitch (meters), levels, packing, and a description in one line.
type Model = (&'static str, [usize; 2], f64, u32, Packing, &'static str);
const MODELS: [Model; 8] = [
    // All models have 660, 520 and 440 nm, and 400 mm.
    ("paper", HD, 8e-6, 256, Grey8, "Schiffers et al. 2023: an 8-bit LCoS behind a 4f relay"),
    ("small", [256; 2], 8e-6, 256, Grey8, "a small 8-bit SLM, for trying things out"),
    ("grey8", HD, 8e-6, 256, Grey8, "an 8-bit LCoS, one gray image a video frame"),
    ("fields", HD, 8e-6, 256, Fields, "an 8-bit LCoS that shows R, G and B of a video frame in turn"),
    ("planes8", HD, 8e-6, 2, Planes8, "a one-bit SLM, 8 bit-planes a video frame"),
    ("planes24", HD, 8e-6, 2, Planes24, "a one-bit SLM, 24 bit-planes a video frame"),
    // The eyebox of this display is 4 mm.
    ("far-field", [512; 2], 8e-6, 256, Grey8, "a small SLM in the pupil plane, for development"),
    ("far-field-16k", [16384; 2], 1e-6, 256, Grey8, "Schiffers et al. 2023: the largest SLM in the pupil plane"),
];
const HD: [usize; 2] = [1080, 1920];

fn model(name: &str) -> Option<Model> {
    MODELS.into_iter().find(|model| model.0 == name)
}

/// Optional lines of a display file. Every line is one without its `#`.
const MORE: &str = r#"
# Optional lines. docs/displays.md explains every key.
#two_pi_level = { red = 256, green = 256, blue = 256 }    # gray level of 2 pi, measured
#flip = "horizontal"           # vertical, both
#rotation_deg = 180            # 90, 180, 270
#offset_px = [0, 0]            # down, right
#[[encoding.grating]]          # moves the image off the zero order
#period_px = 8.0
#direction_deg = 0
#[[encoding.correction]]       # the flatness correction of the SLM
#file = "flatness.png"
#sign = 1                      # -1 subtracts it
"#;

/// A preset as the text of a display file, with comments.
pub fn preset_text(name: &str) -> Option<String> {
    if let Some(text) = device(name) {
        return Some(text.to_owned());
    }
    Some(format!("# {}\n{}", model(name)?.5, Display::preset(name)?.to_toml()))
}

/// The description of a preset in one line.
pub fn preset_about(name: &str) -> Option<&'static str> {
    model(name).map(|model| model.5).or_else(|| device(name)?.lines().next()?.strip_prefix("# "))
}

/// The beginning of a user's display file. It is a preset without its name, and has optional lines as comments.
pub fn display_template(name: &str) -> Option<String> {
    let text = preset_text(name)?;
    // Keys that the text already has are not offered again.
    fn key(line: &str) -> Option<&str> {
        Some(line.trim_start_matches('#').split_once(" = ")?.0)
    }
    let said: Vec<_> = text.lines().filter(|line| !line.starts_with('#')).filter_map(key).collect();
    let more = MORE.lines().filter(|line| key(line).is_none_or(|key| !said.contains(&key)));
    let lines = text.lines().filter(|line| !line.starts_with("name = "));
    Some(lines.chain(more).flat_map(|line| [line, "\n"]).collect())
}

impl Display {
    /// Loads a preset or a TOML file.
    ///
    /// # Errors
    /// [`OpticsError::UnknownDisplay`], [`OpticsError::DisplayFile`] and the errors of
    /// [`Optics::new`](super::Optics::new).
    pub fn load(name: &str) -> Result<Self, OpticsError> {
        if let Some(display) = Self::preset(name) {
            return Ok(display);
        }
        let text = read::text(Path::new(name), read::TEXT).map_err(|e| OpticsError::UnknownDisplay {
            name: name.into(),
            presets: PRESETS.join(", "),
            reason: e.to_string().into(),
        })?;
        refuse_two(&text, name)?;
        let mut display = Self::from_toml(&text, name)?;
        display.file = Some(FileRecord::of_text(Path::new(name), &without_apparatus(&text)));
        Ok(display)
    }

    /// Loads a preset by name.
    pub fn preset(name: &str) -> Option<Self> {
        let Some((_, [height, width], pitch, levels, packing, _)) = model(name) else {
            return device(name).map(|text| Self::from_toml(text, name).expect("a test reads every preset"));
        };
        let geometry = if name.starts_with("far-field") { Geometry::FarField } else { Geometry::Relay };
        let wavelengths = [(Color::Red, 660e-9), (Color::Green, 520e-9), (Color::Blue, 440e-9)];
        let wavelengths = wavelengths.map(|(color, wavelength)| Wavelength { color, wavelength }).to_vec();
        Some(Self {
            name: name.to_owned(),
            height,
            width,
            pitch,
            focal_length: 0.4,
            geometry,
            wavelengths,
            levels,
            rate_hz: None,
            portrait: false,
            dispersion: Default::default(),
            encoding: Encoding { packing, ..Encoding::default() },
            model: Default::default(),
            source: Default::default(),
            mask: None,
            sources: Default::default(),
            picture: Default::default(),
            prescription: None,
            viewing: Default::default(),
            device: None,
            trigger_out: None,
            trigger_in: None,
            file: None,
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
            // The text is also read with every optional line.
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
        let error = Display::load("no-such-display").unwrap_err();
        assert!(matches!(&error, OpticsError::UnknownDisplay { presets, .. } if presets.contains("paper")), "{error}");
    }

    #[test]
    fn every_number_of_a_device_says_its_source_and_fits_the_active_area() {
        // The headset is a model, with the pixels of another preset.
        for (name, text) in DEVICES.into_iter().filter(|(name, _)| *name != "headset") {
            let says = |key: &str| text.lines().find_map(|line| line.strip_prefix(key));
            let sources = (1..).take_while(|n| says(&format!("# Source {n}: ")).is_some()).count();
            assert!(sources > 0, "{name}");
            for key in ["resolution =", "pitch_um =", "levels =", "rate_hz ="] {
                let Some(line) = says(key) else {
                    assert_eq!(key, "rate_hz =", "{name}");
                    assert!(
                        text.replace("\n# ", " ").contains("s a second."),
                        "{name} does not say that no rate was found"
                    );
                    continue;
                };
                let why = line.split_once("# ").unwrap_or_else(|| panic!("{name}: {key} has no source")).1;
                let known =
                    (1..=sources).any(|n| why == format!("source {n}") || why.starts_with(&format!("source {n}:")));
                assert!(known || why.starts_with("unverified"), "{name}: {key} {why}");
            }
            let area = says("# Active area: ").unwrap_or_else(|| panic!("{name}: no active area"));
            let stated: Vec<f64> =
                area.split(" (").take(1).flat_map(|a| a.split(' ')).filter_map(|word| word.parse().ok()).collect();
            let display = Display::from_toml(text, name).unwrap();
            // The file states width and height, or the height alone.
            let sides = [display.width, display.height].map(|n| n as f64 * display.pitch * 1e3);
            assert!(area.starts_with("not found") || stated.len() == if area.starts_with("height") { 1 } else { 2 });
            for (is, says) in sides[2 - stated.len()..].iter().zip(&stated) {
                assert!((is / says - 1.0).abs() < 0.01, "{name}: {is} mm by its pitch, {says} mm as stated");
            }
        }
    }
}
