//! Describes the controller of a display that eyebox sets up and starts.

use super::triggers::Edge;
use serde::{Deserialize, Serialize};

/// `[device]` of a display file, the controller that eyebox sets up and starts when it shows on the display. It changes
/// no hologram, and therefore no digest of a display file and no copy of it has this table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct Device {
    /// Kind of the controller, `"dlpc900"`.
    pub kind: DeviceKind,
    /// Input that the video cable is connected to, `"hdmi"` or `"displayport"`. The default is displayport.
    #[serde(default)]
    pub link: VideoLink,
    /// Number of the controller in the order of its path in the system, from 0, if several are connected. The default is
    /// 0.
    #[serde(default, skip_serializing_if = "super::is_default")]
    pub unit: u8,
    /// Pulses of the output TRIG_OUT_2, `"plane"` at the beginning of each plane, `"frame"` at the first plane of each
    /// video frame, or `"off"`. The default is plane.
    #[serde(default, skip_serializing_if = "PlaneTrigger::is_usual")]
    pub trigger_out: PlaneTrigger,
    /// Edge of the input TRIG_IN_2 that starts the planes. The other edge stops them. The default is no edge.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trigger_in: Option<Edge>,
    /// True for a simulated controller, to try commands without hardware. The default is false.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub simulated: bool,
}

/// The kind of a controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum DeviceKind {
    /// Texas Instruments' DLPC900, over USB.
    Dlpc900,
}

/// The planes that the controller's output TRIG_OUT_2 marks.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum PlaneTrigger {
    /// The beginning of each plane is marked.
    #[default]
    Plane,
    /// The first plane of each video frame is marked.
    Frame,
    /// No plane is marked.
    Off,
}

impl PlaneTrigger {
    fn is_usual(&self) -> bool {
        *self == Self::default()
    }
}

/// The input of a controller that the video cable is connected to.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum VideoLink {
    /// HDMI, one pixel per clock.
    Hdmi,
    /// DisplayPort, two pixels per clock.
    #[default]
    DisplayPort,
}

impl VideoLink {
    /// Returns the video frames per second that a PLM has on this input, if no monitor states them.
    pub fn usual_rate_hz(self) -> f64 {
        match self {
            Self::Hdmi => 30.0,
            Self::DisplayPort => 60.0,
        }
    }
}

impl Device {
    /// Makes the device of this kind and input.
    pub fn new(kind: DeviceKind, link: VideoLink) -> Self {
        Self { kind, link, unit: 0, trigger_out: PlaneTrigger::default(), trigger_in: None, simulated: false }
    }
}

/// The tables of a display file that describe apparatus and change no hologram.
const APPARATUS: [&str; 3] = ["[device]", "[trigger_out]", "[trigger_in]"];

/// Returns the text of a display file without the tables of apparatus and the empty lines before them. The digest of
/// the file is made from this text.
pub(crate) fn without_apparatus(text: &str) -> String {
    let mut kept = String::new();
    let mut is_left_out = false;
    for line in text.split_inclusive('\n') {
        let head = line.trim();
        if head.starts_with('[') {
            let name = head.split('#').next().unwrap_or_default();
            let name = name.split_whitespace().collect::<String>();
            is_left_out = APPARATUS.contains(&name.as_str());
            if is_left_out {
                let length = kept.trim_end_matches(['\n', '\r', ' ', '\t']).len();
                // The end of the last line that has content stays.
                let end = kept[length..].find('\n').map_or(kept.len(), |at| length + at + 1);
                kept.truncate(end);
            }
        }
        if !is_left_out {
            kept.push_str(line);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Display;
    use eyebox_base::error::ErrorData;

    const BENCH: &str =
        "resolution = [8, 8]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = { green = 520 }\n";

    #[test]
    fn a_display_file_names_its_controller() {
        let read = |table: &str| Display::from_toml(&format!("{BENCH}{table}"), "b");
        let display = read("[device]\nkind = \"dlpc900\"\nlink = \"hdmi\"\n").unwrap();
        assert_eq!(display.device, Some(Device::new(DeviceKind::Dlpc900, VideoLink::Hdmi)));
        assert_eq!(Display::from_toml(&display.to_toml(), "b").unwrap(), display);
        let usual = read("[device]\nkind = \"dlpc900\"\nsimulated = true\n").unwrap();
        assert!(usual.device.is_some_and(|d| d.simulated && d.link == VideoLink::DisplayPort));
        let none = read("").unwrap();
        assert!(none.device.is_none() && !none.to_toml().contains("device"));
        let lines = read("[device]\nkind = \"dlpc900\"\ntrigger_out = \"frame\"\ntrigger_in = \"falling\"\n").unwrap();
        let device = lines.device.unwrap();
        assert_eq!((device.trigger_out, device.trigger_in), (PlaneTrigger::Frame, Some(Edge::Falling)));
        assert_eq!(Display::from_toml(&lines.to_toml(), "b").unwrap(), lines);
        for wrong in
            ["kind = \"dlpc350\"", "link = \"hdmi\"", "kind = \"dlpc900\"\nlink = \"vga\"", "kind = \"dlpc900\"\nx = 1"]
        {
            let error = read(&format!("[device]\n{wrong}\n")).unwrap_err();
            assert_eq!(ErrorData::of(&error).code, "display-file/toml", "{wrong}");
        }
    }

    /// Holograms store the digest of the file that they were made for.
    #[test]
    fn the_digest_of_a_file_does_not_depend_on_its_controller() {
        let table = "[device]  # wired\nkind = \"dlpc900\"\n\n[trigger_out]\nserial = \"/dev/ttyUSB0\"\n";
        let model = "[model.all]\nlag = 0.1\n";
        for before in [BENCH.to_owned(), format!("{BENCH}\n{model}")] {
            assert_eq!(without_apparatus(&before), before);
            assert_eq!(without_apparatus(&format!("{before}{table}")), before);
            assert_eq!(without_apparatus(&format!("{before}\n\n{table}")), before);
        }
        assert_eq!(without_apparatus(&format!("{BENCH}{table}\n{model}")), format!("{BENCH}{model}"));
        let folder = tempfile::tempdir().unwrap();
        let digest = |name: &str, text: String| {
            let path = folder.path().join(name);
            std::fs::write(&path, text).unwrap();
            Display::load(path.to_str().unwrap()).unwrap().file.unwrap().digest
        };
        let plain = digest("a.toml", BENCH.to_owned());
        assert_eq!(plain, digest("b.toml", format!("{BENCH}\n{table}")));
        assert_ne!(plain, digest("c.toml", format!("{BENCH}\n{model}")));
    }
}
