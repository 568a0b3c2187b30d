//! Defines displays, which come from presets and TOML files.

use super::color::Color;
use super::device::Device;
use super::encoding::Encoding;
use super::joint_color::check_dispersion;
use super::model::{self, DisplayModel, ModelSections, ModelTerms};
use super::triggers::{TriggerIn, TriggerOut};
use super::wavefront_map;
use super::{
    Geometry, Mask, Optics, OpticsError, Picture, Prescription, SourceSections, Sources, SourcesLit, SwitchedSource,
    Viewing,
};
use eyebox_base::error::Reason;
use eyebox_base::files::FileRecord;
use eyebox_base::reason;
use serde::{Deserialize, Serialize};
use std::{collections::BTreeMap, path::Path};

/// One laser of a display.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wavelength {
    /// The color of the laser.
    pub color: Color,
    /// The wavelength in meters.
    pub wavelength: f64,
}

/// A display, which is an SLM behind a 4f relay or in the pupil plane, with one to three wavelengths.
///
/// ```toml
/// name = "bench"
/// resolution = [1080, 1920]      # rows, columns
/// pitch_um = 8.0
/// focal_length_mm = 400.0
/// wavelengths_nm = { red = 660, green = 520, blue = 440 }
/// levels = 256                   # gray levels of the SLM
/// rate_hz = 60                   # video frames a second, where it is known
/// geometry = "relay"             # or "far-field": the SLM in the pupil plane
/// portrait = false               # true for one that is higher than wide
/// dispersion = { green = 1.27, blue = 1.5 }   # turns of a color's light for one of red's: docs/displays.md
///
/// [encoding]                     # what the SLM receives: docs/displays.md
/// packing = "grey8"
/// two_pi_level = { red = 218, green = 190.5, blue = 160 }
///
/// [model.green]                  # the display as it is: docs/displays.md
/// fill = 0.96
/// lag = 0.05
///
/// [source.all]                   # light that is no laser on the axis: docs/displays.md
/// kind = "led"
///
/// [mask]                         # a static phase mask of finer pixels at the SLM: docs/displays.md
/// factor = 2
/// seed = 1
///
/// [[sources]]                    # switchable sources, for a larger eyebox: docs/displays.md
/// eyebox_mm = [-22, 0]
///
/// [viewing]                      # how bright and how fine it is seen: docs/displays.md
/// luminance_cd_m2 = 200
///
/// [device]                       # the controller that eyebox starts: docs/plm.md
/// kind = "dlpc900"
///
/// [trigger_out]                  # a pulse with the light of each set: docs/triggers.md
/// serial = "/dev/ttyUSB0"
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Display {
    /// The name of the display.
    pub name: String,
    /// Rows of the SLM's pixels.
    pub height: usize,
    /// Columns of the SLM's pixels.
    pub width: usize,
    /// Pixel pitch in meters.
    pub pitch: f64,
    /// Focal length of the relay in meters. In the far field it converts angles and diopters.
    pub focal_length: f64,
    /// The place of the SLM.
    pub geometry: Geometry,
    /// One to three wavelengths, in the order red, green, blue.
    pub wavelengths: Vec<Wavelength>,
    /// Phase levels of the SLM.
    pub levels: u32,
    /// Video frames per second, or none without a known rate.
    pub rate_hz: Option<f64>,
    /// True if the SLM is intentionally higher than wide ([`check_usual`](Self::check_usual)).
    pub portrait: bool,
    /// Measured turns of a color's light per turn of the longest wavelength's ([`slopes`](Self::slopes)).
    pub dispersion: BTreeMap<Color, f64>,
    /// The encoding of phases into video frames.
    pub encoding: Encoding,
    /// Known deviations from the ideal display.
    pub model: ModelSections,
    /// The light of the display, if it is not a laser on the axis.
    pub source: SourceSections,
    /// The static phase mask in front of the SLM, if there is one.
    pub mask: Option<Mask>,
    /// The switchable sources, if there are any (OPTICS 12).
    pub sources: Sources,
    /// The measured places of the pictures.
    pub picture: Picture,
    /// The errors of the viewer's eye, or none for a perfect eye.
    pub prescription: Option<Prescription>,
    /// The luminance and the angular resolution of the picture.
    pub viewing: Viewing,
    /// The controller that eyebox sets up and starts, if there is one.
    pub device: Option<Device>,
    /// The pulse with the light of each set, if there is one.
    pub trigger_out: Option<TriggerOut>,
    /// The pulses that advance a sequence, if there are any.
    pub trigger_in: Option<TriggerIn>,
    /// The file of the display, or none for a preset.
    pub file: Option<FileRecord>,
}

/// A display file. Its keys match [`Display`], in the units at the ends of their names.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    /// Name of the display. The default is the name of the file.
    #[serde(default)]
    name: Option<String>,
    /// Rows and columns of the SLM.
    resolution: [usize; 2],
    /// Pixel pitch in micrometers.
    pitch_um: f64,
    /// Focal length of the relay in millimeters. In the far field it converts angles and diopters.
    focal_length_mm: f64,
    /// Wavelengths in nanometers of one to three of red, green and blue.
    wavelengths_nm: BTreeMap<Color, f64>,
    /// Phase levels of the SLM, 2 to 65536. The default is 256.
    #[serde(default = "levels_default")]
    levels: u32,
    /// Video frames per second, 1 to 100000. It may be left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    rate_hz: Option<f64>,
    /// Place of the SLM, behind a relay or in the plane of the pupil. The default is relay.
    #[serde(default, skip_serializing_if = "Geometry::is_relay")]
    geometry: Geometry,
    /// True if the SLM is intentionally higher than wide.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    portrait: bool,
    /// Turns of a color's light per turn of the longest wavelength's, above 0 and at most 8. The default is the longest
    /// wavelength over the color's.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    dispersion: BTreeMap<Color, f64>,
    /// The lit switchable sources, `"in-turn"`, `"together"`, `"steered"`, or `{ only = { green = [1, 2] } }`. The
    /// default is in-turn.
    #[serde(default, skip_serializing_if = "super::is_default")]
    sources_lit: SourcesLit,
    /// Encoding of phases into video frames, see the table below.
    #[serde(default)]
    encoding: Encoding,
    /// Known deviations from the ideal display in `[model.red]`, `[model.green]`, `[model.blue]`, `[model.all]`, see
    /// below.
    #[serde(default, skip_serializing_if = "ModelSections::is_empty")]
    model: ModelSections,
    /// Light that is not a laser on the axis, in `[source.red]`, `[source.green]`, `[source.blue]`, `[source.all]`, see
    /// below.
    #[serde(default, skip_serializing_if = "SourceSections::is_empty")]
    source: SourceSections,
    /// Static phase mask in front of the SLM, see below.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    mask: Option<Mask>,
    /// Switchable sources, with one table `[[sources]]` each, see below.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    sources: Vec<SwitchedSource>,
    /// Places of the pictures, measured by `eyebox display calibrate --register`, see below.
    #[serde(default, skip_serializing_if = "Picture::is_empty")]
    picture: Picture,
    /// Errors of the viewer's eye, see below. The default is a perfect eye.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    prescription: Option<Prescription>,
    /// Luminance and angular resolution for JOD, see below.
    #[serde(default, skip_serializing_if = "Viewing::is_default")]
    viewing: Viewing,
    /// Controller that eyebox sets up and starts, see below.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    device: Option<Device>,
    /// Pulse with the light of each set, see below.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    trigger_out: Option<TriggerOut>,
    /// Pulses that advance a sequence, see below.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    trigger_in: Option<TriggerIn>,
}

/// The number with the fewest digits that, times `unit`, gives this length in meters to within rounding.
fn in_unit(metres: f64, unit: f64) -> f64 {
    let plain = metres / unit;
    (0..17)
        .filter_map(|digits| format!("{plain:.digits$e}").parse().ok())
        .find(|v: &f64| (v * unit / metres - 1.0).abs() < 1e-15)
        .unwrap_or(plain)
}

fn levels_default() -> u32 {
    256
}

impl Display {
    /// Reads the text of a display file. `file` is its name for errors.
    ///
    /// # Errors
    /// [`OpticsError::DisplayFile`] and the errors of [`Optics::new`].
    pub fn from_toml(text: &str, file: &str) -> Result<Self, OpticsError> {
        let wrong = |reason: Reason| OpticsError::DisplayFile { file: file.into(), reason };
        let read: File = eyebox_base::files::read::toml(text).map_err(wrong)?;
        if read.wavelengths_nm.is_empty() {
            return Err(wrong(reason!(
                "no-color",
                "wavelengths_nm names no color: give one to three of red, green, blue"
            )));
        }
        if !(2..=65536).contains(&read.levels) {
            return Err(wrong(reason!("levels", "levels is {}: it must be 2 to 65536", read.levels)));
        }
        if let Some(hz) = read.rate_hz.filter(|hz| !(1.0..=100_000.0).contains(hz)) {
            return Err(wrong(reason!("rate", "rate_hz is {hz}: it must be 1 to 100000 video frames per second")));
        }
        read.encoding.check(read.levels).map_err(&wrong)?;
        read.encoding.area(read.resolution).map_err(&wrong)?;
        let wavelengths: Vec<(Color, f64)> = read.wavelengths_nm.iter().map(|(color, nm)| (*color, *nm)).collect();
        check_dispersion(&read.dispersion, &wavelengths).map_err(&wrong)?;
        // Files that the display file names are relative to its folder.
        let mut encoding = read.encoding;
        let beside = Path::new(file).parent().unwrap_or(Path::new(""));
        for file in encoding.look_up.values_mut().chain(encoding.correction.iter_mut().map(|c| &mut c.file)) {
            *file = beside.join(&file);
        }
        let mut mask = read.mask;
        if let Some(mask) = &mut mask {
            mask.resolve(beside, read.resolution).map_err(|reason| wrong(reason.within("[mask]")))?;
        }
        let mut model = read.model;
        wavefront_map::resolve(&mut model, beside, |color| read.wavelengths_nm.get(&color).copied()).map_err(&wrong)?;
        let stem = Path::new(file).file_stem().map_or(file.into(), |s| s.to_string_lossy().into_owned());
        let display = Self {
            name: read.name.unwrap_or(stem),
            height: read.resolution[0],
            width: read.resolution[1],
            pitch: read.pitch_um * 1e-6,
            focal_length: read.focal_length_mm * 1e-3,
            geometry: read.geometry,
            wavelengths: read
                .wavelengths_nm
                .into_iter()
                .map(|(color, nm)| Wavelength { color, wavelength: nm * 1e-9 })
                .collect(),
            levels: read.levels,
            rate_hz: read.rate_hz,
            portrait: read.portrait,
            dispersion: read.dispersion,
            encoding,
            model,
            source: read.source,
            mask,
            sources: Sources { each: read.sources, lit: read.sources_lit, sub_frame_us: None },
            picture: read.picture,
            prescription: read.prescription,
            viewing: read.viewing,
            device: read.device,
            trigger_out: read.trigger_out,
            trigger_in: read.trigger_in,
            file: None,
        };
        display.check_mask().map_err(|reason| wrong(reason.within("[mask]")))?;
        let sources = display.timed_sources();
        let display = Self { mask: display.mask.filter(|mask| !mask.is_clear()), sources, ..display };
        let colors: Vec<Color> = display.wavelengths.iter().map(|w| w.color).collect();
        model::check(&display.model, &colors).map_err(&wrong)?;
        display.picture.check(display.picture_size().into()).map_err(&wrong)?;
        if let Some(Err(reason)) = display.prescription.as_ref().map(Prescription::check) {
            return Err(wrong(reason.within("[prescription]")));
        }
        display.viewing.check().map_err(|reason| wrong(reason.within("[viewing]")))?;
        for (table, checked) in [
            ("[trigger_out]", display.trigger_out.as_ref().map(TriggerOut::check)),
            ("[trigger_in]", display.trigger_in.as_ref().map(TriggerIn::check)),
        ] {
            checked.unwrap_or(Ok(())).map_err(|reason| wrong(reason.within(table)))?;
        }
        if display.geometry == Geometry::FarField && colors.iter().any(|c| display.model(*c).fill > 0.0) {
            let reason = "[model] has a fill, but in the far field it dims the picture's edges and not the eyebox: \
                          leave it out";
            return Err(wrong(Reason::new("model-far-field", reason)));
        }
        if display.geometry == Geometry::FarField && colors.iter().any(|c| display.model(*c).subpixels > 1) {
            let reason = "[model] has subpixels, but the far field supports only 1: leave it out";
            return Err(wrong(Reason::new("model-far-field", reason)));
        }
        for w in &display.wavelengths {
            display.optics(w.color).map_err(|e| wrong(Reason::of(&e)))?;
        }
        display.check_source().map_err(&wrong)?;
        Ok(display)
    }

    /// Returns the display without its controller and its triggers, as results keep it. They change no hologram.
    #[must_use]
    pub fn without_apparatus(&self) -> Self {
        Self { device: None, trigger_out: None, trigger_in: None, ..self.clone() }
    }

    /// The TOML text of this display.
    pub fn to_toml(&self) -> String {
        let file = File {
            name: Some(self.name.clone()),
            resolution: [self.height, self.width],
            pitch_um: in_unit(self.pitch, 1e-6),
            focal_length_mm: in_unit(self.focal_length, 1e-3),
            geometry: self.geometry,
            wavelengths_nm: self.wavelengths.iter().map(|w| (w.color, in_unit(w.wavelength, 1e-9))).collect(),
            levels: self.levels,
            rate_hz: self.rate_hz,
            portrait: self.portrait,
            dispersion: self.dispersion.clone(),
            encoding: self.encoding.clone(),
            model: self.model.clone(),
            source: self.source.clone(),
            mask: self.mask.clone(),
            sources: self.sources.each.clone(),
            sources_lit: self.sources.lit.clone(),
            picture: self.picture,
            prescription: self.prescription.clone(),
            viewing: self.viewing,
            device: self.device,
            trigger_out: self.trigger_out.clone(),
            trigger_in: self.trigger_in.clone(),
        };
        toml::to_string(&file).expect("TOML can express every display")
    }

    /// The optics at one of the display's colors, over the grid of the SLM.
    ///
    /// # Errors
    /// [`OpticsError::NoColor`] and the errors of [`Optics::new`].
    pub fn optics(&self, color: Color) -> Result<Optics, OpticsError> {
        let found = self.wavelengths.iter().find(|w| w.color == color).ok_or_else(|| OpticsError::NoColor {
            display: self.name.clone(),
            color,
            has: self.wavelengths.iter().map(|w| w.color.to_string()).collect::<Vec<_>>().join(", "),
        })?;
        let optics = Optics::new(self.height, self.width, self.pitch, found.wavelength, self.focal_length)?;
        Ok(optics.in_geometry(self.geometry).behind_mask(self.mask_factor()))
    }

    /// The model of the display at one of its colors.
    pub fn model(&self, color: Color) -> DisplayModel {
        model::of_color(&self.model, color)
    }

    /// The same display with a changed model of one color.
    #[must_use]
    pub fn with_model_of(&self, color: Color, change: impl FnOnce(&mut ModelTerms)) -> Self {
        let colors: Vec<Color> = self.wavelengths.iter().map(|w| w.color).collect();
        let mut sections = model::by_color(&self.model, &colors);
        change(sections.entry(color.into()).or_default());
        sections.retain(|_, terms| *terms != ModelTerms::default());
        Self { model: sections, ..self.clone() }
    }

    /// Rows and columns of the pictures that the display shows. They are its pixels behind a relay, or a square that
    /// holds them in the far field.
    pub fn picture_size(&self) -> (usize, usize) {
        self.geometry.picture_size(self.height, self.width)
    }

    /// Size of a picture's pixel in the focal plane in meters. Behind a relay it is the pitch. In the far field it
    /// belongs to the field of view of the shortest wavelength, which all colors share (OPTICS 9).
    pub fn picture_pixel(&self) -> f64 {
        match self.geometry {
            Geometry::Relay => self.pitch,
            Geometry::FarField => self.shortest() * self.focal_length / (self.pitch * self.picture_size().0 as f64),
        }
    }

    /// Pixels per degree of visual angle in the middle of the picture. `[viewing]` overrides the value of the optics,
    /// in which a pixel takes `picture_pixel / focal_length` radians (OPTICS 2 and 9).
    pub fn pixels_per_degree(&self) -> f64 {
        self.viewing.pixels_per_degree.unwrap_or((self.focal_length / self.picture_pixel()).to_radians())
    }

    /// Share of one color's field of view that the picture takes along each axis. In the far field all colors show the
    /// field of view of the shortest wavelength.
    pub fn picture_share(&self, wavelength: f64) -> f64 {
        match self.geometry {
            Geometry::Relay => 1.0,
            Geometry::FarField => (self.shortest() / wavelength).min(1.0),
        }
    }

    pub(super) fn shortest(&self) -> f64 {
        self.wavelengths.iter().map(|w| w.wavelength).fold(f64::INFINITY, f64::min)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use eyebox_base::error::ErrorData;

    #[test]
    fn errors_say_which_line_and_key() {
        let text = "resolution = [8, 8]\npitch_um = 8.0\npich = 1\nfocal_length_mm = 400.0\nwavelengths_nm = { green = 520 }\n";
        let error = Display::from_toml(text, "bench.toml").unwrap_err();
        assert_eq!(ErrorData::of(&error).code, "display-file/toml");
        assert!(["bench.toml", "line 3", "pich"].iter().all(|part| error.to_string().contains(part)), "{error}");
        let zero = text.replace("pich = 1\n", "").replace("520", "0");
        let error = Display::from_toml(&zero, "b").unwrap_err();
        assert_eq!(ErrorData::of(&error).code, "display-file/not-positive", "{error}");
    }

    const BENCH: &str =
        "resolution = [8, 8]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = { green = 520 }\n";

    #[test]
    fn a_colour_s_terms_come_before_those_of_all_and_survive_the_file() {
        let text = format!(
            "{BENCH}[model.all]\nfill = 0.9\nlag = 0.1\nlevel = 1.05\n[model.green]\nlag = 0.05\niris = [0.1, -0.2, 1.01]\n\
             wavefront = {{ 4 = 0.03, 12 = -0.01 }}\nfrom = \"40 pictures\"\ndate = \"2026-11-22\"\n\
             [model.green.errors]\nlag = 0.002\n"
        );
        let display = Display::from_toml(&text, "b").unwrap();
        let model = display.model(Color::Green);
        assert_eq!((model.fill, model.lag, model.level), (0.9, 0.05, [[1.05; 3]; 3]));
        assert_eq!((model.iris.x, model.iris.y, model.iris.scale), (0.1e-3, -0.2e-3, 1.01));
        assert_eq!(model.wavefront, [(4, 0.03), (12, -0.01)].into());
        assert_eq!(Display::from_toml(&display.to_toml(), "b").unwrap().model, display.model);
        assert!(Display::from_toml(BENCH, "b").unwrap().model(Color::Green).is_ideal());
    }

    #[test]
    fn undiffracted_light_is_one_wave_or_several() {
        let of = |waves: &str| {
            let text = format!("{BENCH}[model.green]\nundiffracted = {waves}\n");
            let display = Display::from_toml(&text, "b").unwrap();
            assert_eq!(Display::from_toml(&display.to_toml(), "b").unwrap().model, display.model);
            display.model(Color::Green).undiffracted
        };
        let (one, other) = ([0.2, 0.1, 3.0, -4.0, 0.5], [0.0, -0.1, 20.0, 0.0, 0.0]);
        assert_eq!(of("[0.2, 0.1, 3.0, -4.0, 0.5]"), [one]);
        assert_eq!(of("[[0.2, 0.1, 3.0, -4.0, 0.5], [0.0, -0.1, 20.0, 0.0, 0.0]]"), [one, other]);
        // Waves without light are none.
        assert_eq!(of("[[0.0, 0.0, 1.0, 1.0, 0.0], [0.2, 0.1, 3.0, -4.0, 0.5]]"), [one]);
        assert!(of("[0.0, 0.0, 0.0, 0.0, 0.0]").is_empty() && of("[]").is_empty());
    }

    #[test]
    fn a_model_that_cannot_be_is_refused_with_its_section() {
        let cases = [
            ("[model.red]\nlag = 0.1\n", "display-file/no-such-color"),
            ("[model.all]\nwavefront = { 4 = 0.1 }\n", "display-file/wavefront-of-all-colors"),
            ("[model.green]\nlag = 2\n", "display-file/model-range"),
            ("[model.green]\nlagg = 0.1\n", "display-file/toml"),
            ("[model.green]\nfill = nan\n", "display-file/model-range"),
            ("[model.green]\nwavefront = { tilt = 1 }\n", "display-file/toml"),
            ("[model.green]\nundiffracted = [[0.1, 0, 0, 0, 0], [0.1, 0.8, 0, 0, 0]]\n", "display-file/model-range"),
            ("[model.green]\nundiffracted = [[0.7, 0, 0, 0, 0], [0.7, 0.1, 9, 0, 0]]\n", "display-file/model-range"),
            ("[model.green]\nundiffracted = [[0.1, 0, 0, 0, 0], [0.1, 0, 0, 0]]\n", "display-file/toml"),
            (
                "[model.green]\nundiffracted = [[0.1, 0, 0, 0, 0], [0.1, 0, 1, 0, 0], [0.1, 0, 2, 0, 0], [0.1, 0, 3, 0, 0], \
                 [0.1, 0, 4, 0, 0]]\n",
                "display-file/undiffracted-waves",
            ),
            ("[model.cyan]\nlag = 0.1\n", "display-file/toml"),
        ];
        for (text, says) in cases {
            let error = Display::from_toml(&format!("{BENCH}{text}"), "b").unwrap_err();
            assert_eq!(ErrorData::of(&error).code, says, "{error}");
        }
    }
}
