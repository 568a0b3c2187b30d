//! The typed metadata of a hologram, with the settings and circumstances of its solve.

use super::{HologramError, SceneRecord};
use crate::files::FileRecord;
use crate::optics::{
    Color, JointColor, Mask, ModelSections, Obstruction, Padding, Picture, Prescription, PupilDistribution,
    SourceSections, Sources, Viewing,
};
use crate::scene::{Near, Order, ViewSynthesis};
use crate::solve::{RefineSettings, Settings};
use eyebox_base::reason;
use serde::{Deserialize, Deserializer, Serialize, Serializer, de};
use serde_json::{Map, Value};
use std::path::{Path, PathBuf};

/// The settings and circumstances of a solve (`attributes.eyebox.settings`), the same in formats 1 to 3. A value that
/// the file does not state is `None`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Metadata {
    /// The settings of the solve.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub solve: Option<Settings>,
    /// Zeros around the SLM in the computation, as rows and columns. See [`padding`](Self::padding).
    #[serde(rename = "padding", skip_serializing_if = "Option::is_none")]
    pub padded: Option<[usize; 2]>,
    /// Number of passes over the SLM in a solve in tiles.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub passes: Option<usize>,
    /// Rows and columns of the scene's views.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub views: Option<[usize; 2]>,
    /// Distance of neighboring views in the pupil plane, in millimeters.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub view_pitch_mm: Option<f64>,
    /// Side of the eyebox from which pupils were drawn, in millimeters.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub eyebox_mm: Option<f64>,
    /// Depths of the smallest and the largest value of the scene's depth map, in millimeters.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_map_mm: Option<[f64; 2]>,
    /// The actual arrangement of the scene's views, if it was given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub order: Option<Order>,
    /// The views from which other views of the scene were synthesized, if they were given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub photographs: Option<ViewSynthesis>,
    /// The values of the scene's depth map that are near, if they were given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub near: Option<Near>,
    /// Identity and paths of its scene, or of the scene of each hologram of a sequence. It is empty for built-in
    /// scenes, which their name identifies, and in files of older versions, which stored the name alone.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub scenes: Vec<SceneRecord>,
    /// The file of the display for which it was solved. It is none for a preset.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub display_file: Option<FileRecord>,
    /// The start of the solve of each hologram of a sequence but the first.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub warm_start: Option<Start>,
    /// The description of the job that made it, by which a later run recognizes its own work.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub made_by: Option<String>,
    /// Duration of the solve, in seconds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f64>,
    /// True if the exposures are assumed, for phases whose exposure is not known.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub exposure_assumed: bool,
    /// The model of the display for which it was solved and with which it is simulated.
    #[serde(skip_serializing_if = "ModelSections::is_empty")]
    pub model: ModelSections,
    /// The display's light for which it was solved and with which it is simulated, if it is not a laser on the axis.
    #[serde(skip_serializing_if = "SourceSections::is_empty")]
    pub source: SourceSections,
    /// The static phase mask in front of its display's SLM, through which it was solved and is simulated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mask: Option<Mask>,
    /// The display's switchable sources, and the sources that are lit in each sub-frame.
    #[serde(skip_serializing_if = "Sources::is_empty")]
    pub sources: Sources,
    /// The position of the display's picture for which it was solved.
    #[serde(skip_serializing_if = "Picture::is_empty")]
    pub picture: Picture,
    /// The errors of the eye for which it was solved and with which it is simulated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub prescription: Option<Prescription>,
    /// The obstruction in the pupil of the eye. No file stores it, because it belongs to a simulation and not to the
    /// hologram.
    #[serde(skip)]
    pub obstruction: Option<Obstruction>,
    /// The brightness and resolution at which the display's picture is viewed.
    #[serde(skip_serializing_if = "Viewing::is_default")]
    pub viewing: Viewing,
    /// The relation of the drive to all lasers, if the colors are simultaneous and share sub-frames. It is none if the
    /// colors follow each other.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub joint_color: Option<JointColor>,
    /// The later refinement for a pupil, if there was one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub refined: Option<Refined>,
    /// Later steps with pictures of a camera, by color.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub camera: Vec<TakenWithCamera>,
    /// Keys that other versions and programs wrote. They are stored, so that a copy loses nothing.
    #[serde(flatten)]
    pub other: Map<String, Value>,
}

/// The steps of a color with pictures of a camera.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TakenWithCamera {
    /// The color of the steps.
    pub color: Color,
    /// Number of steps behind its phases. It is 0 if no step improved them.
    pub steps: usize,
    /// Number of pictures that the camera took.
    pub pictures: usize,
    /// Mean PSNR of pictures that no step used, before and after, in dB. It is none if no such pictures were taken.
    pub psnr_db: Option<[f64; 2]>,
}

/// A refinement for a position of the eye.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Refined {
    /// The estimated pupil, as a distribution.
    #[serde(with = "aim")]
    pub aim: PupilDistribution,
    /// The settings of the refinement.
    pub steering: RefineSettings,
    /// Number of steps per color.
    pub steps: usize,
}

/// The start of the solve of a sequence's next hologram. In files it is `"cold"`, or a number from 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Start {
    /// The solve starts at random phases.
    Cold,
    /// The solve starts at the phases of the previous hologram, at this fraction of the schedule.
    Warm(f64),
}

/// The largest padding that a file may state along an axis, in pixels.
const MOST_PADDING: usize = 65536;

impl Metadata {
    /// Returns the padding of the solve, which is also used to simulate the hologram. Formats 1 to 3 and bare phases
    /// define that no stated padding means none, and propagation is circular.
    pub fn padding(&self) -> Padding {
        let [rows, columns] = self.padded.unwrap_or_default();
        Padding { rows, columns }
    }

    /// Refuses values that no computation can use.
    pub(super) fn check(&self) -> Result<(), HologramError> {
        if let Some(Err(reason)) = self.mask.as_ref().map(Mask::check) {
            return Err(HologramError::Inconsistent(reason.within("its mask")));
        }
        match self.padded {
            Some([rows, columns]) if rows.max(columns) > MOST_PADDING => Err(HologramError::Inconsistent(reason!(
                "padding",
                "its padding is {rows} rows and {columns} columns, above the limit of {MOST_PADDING} each"
            ))),
            _ => Ok(()),
        }
    }

    /// Returns a key under which two descriptions differ.
    pub(super) fn difference(&self, wanted: &Self) -> Option<String> {
        let keys = |m: &Self| match serde_json::to_value(m) {
            Ok(Value::Object(keys)) => keys,
            _ => Map::new(),
        };
        let (is, wanted) = (keys(self), keys(wanted));
        wanted.into_iter().find(|(key, value)| is.get(key) != Some(value)).map(|(key, _)| key)
    }
}

/// Returns the folder that contains the hologram. The files that its metadata names are searched in it.
fn folder_of(hologram: &Path) -> PathBuf {
    let parent = hologram.parent().filter(|parent| !parent.as_os_str().is_empty());
    parent.unwrap_or(Path::new(".")).into()
}

impl Metadata {
    fn files_mut(&mut self) -> impl Iterator<Item = &mut FileRecord> {
        self.scenes.iter_mut().flat_map(SceneRecord::files_mut).chain(&mut self.display_file)
    }

    /// Resolves the paths of files after reading from the hologram at `path`.
    pub(crate) fn read_at(&mut self, path: &Path) {
        self.files_mut().for_each(|file| file.read_in(&folder_of(path)));
    }

    /// Returns a copy as it is written to a hologram at `path`.
    pub(crate) fn written_at(&self, path: &Path) -> Self {
        let mut written = self.clone();
        written.files_mut().for_each(|file| file.written_in(&folder_of(path)));
        written
    }

    /// Returns a copy without the paths of files. Two holograms that were made alike have equal copies.
    #[must_use]
    pub fn without_places(&self) -> Self {
        let mut anywhere = self.clone();
        anywhere.files_mut().for_each(FileRecord::forget_places);
        anywhere
    }
}

/// Converts a distribution of pupils to and from its form in files.
mod aim {
    use super::{Deserialize, Deserializer, PupilDistribution, Serialize, Serializer};

    /// The form in files, with all lengths in meters.
    #[derive(Serialize, Deserialize)]
    struct Aim {
        x: f64,
        y: f64,
        spread: f64,
        diameter: [f64; 2],
        depth: [f64; 2],
        elsewhere: f64,
    }

    pub(super) fn serialize<S: Serializer>(pupil: &PupilDistribution, to: S) -> Result<S::Ok, S::Error> {
        let PupilDistribution { centre: [x, y], spread, diameter, focus: depth, elsewhere } = *pupil;
        Aim { x, y, spread, diameter, depth, elsewhere }.serialize(to)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<PupilDistribution, D::Error> {
        let Aim { x, y, spread, diameter, depth, elsewhere } = Aim::deserialize(from)?;
        Ok(PupilDistribution { centre: [x, y], spread, diameter, focus: depth, elsewhere })
    }
}

impl Serialize for Start {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Cold => to.serialize_str("cold"),
            Self::Warm(progress) => to.serialize_f64(*progress),
        }
    }
}

impl<'de> Deserialize<'de> for Start {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        let value = Value::deserialize(from)?;
        match (value.as_str(), value.as_f64()) {
            (Some("cold"), _) => Ok(Self::Cold),
            (None, Some(progress)) => Ok(Self::Warm(progress)),
            _ => Err(de::Error::custom(format!("{value}: expected \"cold\", or a number from 0 to 1"))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_said_is_none_and_what_is_not_known_is_kept() {
        let text = r#"{"padding":[4,8],"warm_start":"cold","a key of tomorrow":[1.5],"seconds":2.0}"#;
        let read: Metadata = serde_json::from_str(text).unwrap();
        assert_eq!(
            (read.padding(), read.warm_start, read.seconds),
            (Padding { rows: 4, columns: 8 }, Some(Start::Cold), Some(2.0))
        );
        assert_eq!((read.solve.as_ref(), read.view_pitch_mm, read.other.len()), (None, None, 1));
        assert_eq!(serde_json::from_str::<Metadata>(&serde_json::to_string(&read).unwrap()).unwrap(), read);
        assert_eq!(Metadata::default().padding(), Padding::default());
        let warm: Metadata = serde_json::from_str(r#"{"warm_start":0.25}"#).unwrap();
        assert_eq!(warm.warm_start, Some(Start::Warm(0.25)));
        assert_eq!(read.difference(&warm), Some("warm_start".into()));
    }

    /// A value of the wrong kind is refused and never mistaken for another.
    #[test]
    fn what_cannot_be_is_refused() {
        for wrong in [
            r#"{"padding":8}"#,
            r#"{"padding":[4,-8]}"#,
            r#"{"padding":[4.5,8]}"#,
            r#"{"warm_start":"hot"}"#,
            r#"{"views":[3]}"#,
            r#"{"solve":{"steps":"many"}}"#,
        ] {
            assert!(serde_json::from_str::<Metadata>(wrong).is_err(), "{wrong}");
        }
        let huge: Metadata = serde_json::from_str(r#"{"padding":[4,1000000]}"#).unwrap();
        assert!(huge.check().unwrap_err().to_string().contains("1000000"));
    }
}
