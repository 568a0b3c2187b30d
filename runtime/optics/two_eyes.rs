//! Defines displays of two panels, one for each eye, which a file describes.

use super::{Display, OpticsError};
use eyebox_base::files::read;
use eyebox_base::reason;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The rule for the sets of the two eyes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Stereo {
    /// A set is shown if both eyes have theirs for the same time. If one eye is late, both wait.
    #[default]
    Together,
    /// Each eye shows its own newest set.
    Independent,
}

/// The places of the two panels.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Panels {
    /// Each panel is a monitor of its own.
    #[default]
    Monitors,
    /// The panels are the left and the right half of one monitor.
    SideBySide,
    /// The panels are the upper (left eye) and the lower half of one monitor.
    TopBottom,
}

impl Panels {
    /// Returns true if both panels are halves of one video frame.
    pub fn are_halves(self) -> bool {
        self != Self::Monitors
    }
}

/// A display of two panels. Both panels have the same video frames, and each has a display file with its own
/// calibration.
///
/// ```toml
/// left = "left.toml"        # a display file beside this one, or a preset
/// right = "right.toml"
/// ipd_mm = 63               # distance of the pupils
/// stereo = "together"       # or "independent"
/// panels = "monitors"       # or "side-by-side", "top-bottom"
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct TwoEyes {
    /// The panels of the left and the right eye.
    pub panels: [Display; 2],
    /// The names by which [`Display::load`] finds the panels.
    pub names: [String; 2],
    /// The distance of the pupils in meters.
    pub ipd: f64,
    /// The rule for the sets of the two eyes.
    pub stereo: Stereo,
    /// The places of the two panels.
    pub places: Panels,
}

/// A file of two panels. Its keys match [`TwoEyes`].
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    left: String,
    right: String,
    #[serde(default = "usual_ipd")]
    ipd_mm: f64,
    #[serde(default)]
    stereo: Stereo,
    #[serde(default)]
    panels: Panels,
}

/// The median distance of the pupils of adults in millimeters (Dodgson 2004).
fn usual_ipd() -> f64 {
    63.0
}

/// The distances of pupils of people in millimeters (Dodgson 2004).
const IPD_MM: std::ops::RangeInclusive<f64> = 40.0..=85.0;

/// Returns the names of the two panels, if a text is a file of two panels.
fn panels_of(text: &str) -> Option<[String; 2]> {
    let table: toml::Table = toml::from_str(text).ok()?;
    let of = |key: &str| Some(table.get(key)?.as_str()?.to_owned());
    Some([of("left")?, of("right")?])
}

/// Returns the error of a command for one panel that received a file of two panels.
pub(crate) fn refuse_two(text: &str, file: &str) -> Result<(), OpticsError> {
    match panels_of(text) {
        None => Ok(()),
        Some([left, right]) => {
            let reason = reason!(
                "two-panels",
                "it describes two panels, and this needs the display file of one. Give {left} or {right}"
            );
            Err(OpticsError::DisplayFile { file: file.into(), reason })
        }
    }
}

impl TwoEyes {
    /// Loads a file of two panels. Returns `None` if `name` is a preset or the file of one panel.
    ///
    /// # Errors
    /// [`OpticsError::UnknownDisplay`], [`OpticsError::DisplayFile`] and the errors of [`Display::load`].
    pub fn load(name: &str) -> Result<Option<Self>, OpticsError> {
        if Display::preset(name).is_some() {
            return Ok(None);
        }
        let Ok(text) = read::text(Path::new(name), read::TEXT) else { return Ok(None) };
        if panels_of(&text).is_none() {
            return Ok(None);
        }
        let wrong = |reason| OpticsError::DisplayFile { file: name.into(), reason };
        let File { left, right, ipd_mm, stereo, panels } = read::toml(&text).map_err(wrong)?;
        if !IPD_MM.contains(&ipd_mm) {
            let (least, most) = (IPD_MM.start(), IPD_MM.end());
            return Err(wrong(reason!("ipd", "ipd_mm is {ipd_mm}, but it must be {least} to {most}")));
        }
        let beside = Path::new(name).parent().unwrap_or(Path::new(""));
        let found = |panel: String| match Display::preset(&panel) {
            Some(_) => panel,
            None => beside.join(panel).to_string_lossy().into_owned(),
        };
        let names = [found(left), found(right)];
        let both = [Display::load(&names[0])?, Display::load(&names[1])?];
        Self { panels: both, names, ipd: ipd_mm * 1e-3, stereo, places: panels }.checked().map(Some).map_err(wrong)
    }

    /// Checks that both panels take the same video frames.
    fn checked(self) -> Result<Self, eyebox_base::error::Reason> {
        let [left, right] = &self.panels;
        let kind = |d: &Display| ([d.height, d.width], d.encoding.packing, d.rate_hz.map(f64::to_bits));
        let words = |d: &Display| {
            let rate = d.rate_hz.map_or("no rate".into(), |hz| format!("{hz} Hz"));
            let packing = toml::Value::try_from(d.encoding.packing);
            let packing = packing.as_ref().ok().and_then(|packing| packing.as_str()).unwrap_or("a packing of its own");
            format!("{}x{}, {packing}, {rate}", d.height, d.width)
        };
        if kind(left) != kind(right) {
            return Err(reason!(
                "panels-differ",
                "the left panel has {} and the right one {}, but both need the same resolution, packing and rate_hz",
                words(left),
                words(right)
            ));
        }
        if let (Some(a), Some(b)) = (left.device, right.device)
            && !a.simulated
            && a.unit == b.unit
        {
            return Err(reason!(
                "panels-device",
                "both panels have [device] with unit {}. Give the right one another unit",
                a.unit
            ));
        }
        let waits = [left, right].iter().any(|panel| panel.trigger_in.is_some());
        if waits {
            return Err(reason!("panels-trigger-in", "[trigger_in] is for a display of one panel. Leave it out"));
        }
        Ok(self)
    }

    /// Returns the places of the two eyes along x from the middle between them in meters.
    pub fn eyes(&self) -> [f64; 2] {
        [-0.5 * self.ipd, 0.5 * self.ipd]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use eyebox_base::error::ErrorData;

    const PANEL: &str =
        "resolution = [8, 16]\npitch_um = 8.0\nfocal_length_mm = 40.0\nwavelengths_nm = { green = 520 }\n";

    fn file(folder: &Path, name: &str, text: &str) -> String {
        let path = folder.join(name);
        std::fs::write(&path, text).unwrap();
        path.display().to_string()
    }

    #[test]
    fn a_file_names_two_panels_beside_it() {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path();
        let left = file(at, "left.toml", &format!("{PANEL}name = \"l\"\n"));
        file(at, "right.toml", &format!("{PANEL}name = \"r\"\n"));
        let both = file(at, "two.toml", "left = \"left.toml\"\nright = \"right.toml\"\n");
        let two = TwoEyes::load(&both).unwrap().unwrap();
        assert_eq!((two.panels[0].name.as_str(), two.panels[1].name.as_str()), ("l", "r"));
        assert_eq!((two.stereo, two.places, two.eyes()), (Stereo::Together, Panels::Monitors, [-0.0315, 0.0315]));
        let more =
            "left = \"paper\"\nright = \"paper\"\nipd_mm = 60\nstereo = \"independent\"\npanels = \"side-by-side\"\n";
        let two = TwoEyes::load(&file(at, "more.toml", more)).unwrap().unwrap();
        assert_eq!((two.stereo, two.places), (Stereo::Independent, Panels::SideBySide));
        assert_eq!(two.panels[0], two.panels[1]);
        // Other displays have one panel.
        for one in ["paper", &left, "no such file"] {
            assert!(TwoEyes::load(one).unwrap().is_none(), "{one}");
        }
        let error = Display::load(&both).unwrap_err();
        assert_eq!(ErrorData::of(&error).code, "display-file/two-panels");
        assert!(error.to_string().contains("left.toml or right.toml"), "{error}");
    }

    #[test]
    fn panels_that_do_not_belong_together_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path();
        file(at, "a.toml", PANEL);
        file(at, "higher.toml", &PANEL.replace("[8, 16]", "[16, 16]"));
        file(at, "fast.toml", &format!("rate_hz = 120\n{PANEL}"));
        let plm = format!("{PANEL}[device]\nkind = \"dlpc900\"\n");
        file(at, "plm.toml", &plm);
        file(at, "waits.toml", &format!("{PANEL}[trigger_in]\nudp = \"127.0.0.1:5005\"\n"));
        for (panels, code) in [
            ("left = \"a.toml\"\nright = \"higher.toml\"\n", "panels-differ"),
            ("left = \"a.toml\"\nright = \"fast.toml\"\n", "panels-differ"),
            ("left = \"waits.toml\"\nright = \"waits.toml\"\n", "panels-trigger-in"),
            ("left = \"plm.toml\"\nright = \"plm.toml\"\n", "panels-device"),
            ("left = \"a.toml\"\nright = \"a.toml\"\nipd_mm = 630\n", "ipd"),
            ("left = \"a.toml\"\nright = \"a.toml\"\nipd = 63\n", "toml"),
        ] {
            let error = TwoEyes::load(&file(at, "two.toml", panels)).unwrap_err();
            assert_eq!(ErrorData::of(&error).code, format!("display-file/{code}"), "{error}");
        }
    }
}
