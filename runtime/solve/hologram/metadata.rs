//! How a hologram was made: what its file keeps beside the optics, typed.

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

/// How a hologram was made (`attributes.eyebox.settings`), the same in formats 1 to 3. What a file does not say is `None`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Metadata {
    /// The settings of the solve.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub solve: Option<Settings>,
    /// Zeros around the SLM in the computation: rows, columns. See [`padding`](Self::padding).
    #[serde(rename = "padding", skip_serializing_if = "Option::is_none")]
    pub padded: Option<[usize; 2]>,
    /// Passes over the SLM of a solve in tiles.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub passes: Option<usize>,
    /// Rows and columns of the scene's views.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub views: Option<[usize; 2]>,
    /// Distance of neighbouring views in the pupil plane, millimetres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub view_pitch_mm: Option<f64>,
    /// Side of the eyebox that pupils were drawn in, millimetres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub eyebox_mm: Option<f64>,
    /// What the smallest and the largest value of the scene's depth map mean, millimetres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_map_mm: Option<[f64; 2]>,
    /// How the views of its scene really stand, where it was said.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub order: Option<Order>,
    /// Of which views of its scene photographs were made, where it was said.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub photographs: Option<ViewSynthesis>,
    /// Which values of the scene's depth map were said to be near.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub near: Option<Near>,
    /// What identifies its scene, and where that was; of a sequence, of each of its holograms. Empty for built-in scenes, whose
    /// names say all, and in files of older versions, which kept the name alone.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub scenes: Vec<SceneRecord>,
    /// The file of the display that it was solved for; none for a preset.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub display_file: Option<FileRecord>,
    /// Where each hologram of a sequence began but the first.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub warm_start: Option<Start>,
    /// What asked for it, where a later run is to know its own work again.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub made_by: Option<String>,
    /// Seconds that the solve took.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f64>,
    /// Whether its exposures are made up, for phases of which nothing else is known.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub exposure_assumed: bool,
    /// What its display does to the light beside showing phases, as it was solved for and is looked at.
    #[serde(skip_serializing_if = "ModelSections::is_empty")]
    pub model: ModelSections,
    /// Its display's light, where that is no laser on the axis, as it was solved for and is looked at in.
    #[serde(skip_serializing_if = "SourceSections::is_empty")]
    pub source: SourceSections,
    /// The static phase mask in front of its display's SLM, through which it was solved and is looked at.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mask: Option<Mask>,
    /// Its display's switchable sources, and which of them are lit in its sub-frames.
    #[serde(skip_serializing_if = "Sources::is_empty")]
    pub sources: Sources,
    /// Where its display's picture is seen, which it was solved for.
    #[serde(skip_serializing_if = "Picture::is_empty")]
    pub picture: Picture,
    /// What is wrong with the eye that it was solved for, and is looked at with.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub prescription: Option<Prescription>,
    /// What is in the pupil of the eye that looks. No file keeps it, because it is of a look and not of the hologram.
    #[serde(skip)]
    pub obstruction: Option<Obstruction>,
    /// How bright and how fine its display's picture is seen.
    #[serde(skip_serializing_if = "Viewing::is_default")]
    pub viewing: Viewing,
    /// How one drive and all lasers show its colours at once, in sub-frames that they share; none for one colour after another.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub joint_color: Option<JointColor>,
    /// Where it was refined for afterwards.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub refined: Option<Refined>,
    /// Steps that were taken with a camera's pictures afterwards, by colour.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub camera: Vec<TakenWithCamera>,
    /// What other versions and programs wrote: kept, so that a copy loses nothing.
    #[serde(flatten)]
    pub other: Map<String, Value>,
}

/// Steps of a colour with a camera's pictures.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TakenWithCamera {
    /// The colour.
    pub color: Color,
    /// Steps behind its phases; 0 where none made them better.
    pub steps: usize,
    /// Pictures that were taken.
    pub pictures: usize,
    /// Mean PSNR of pictures that no step used, before and after, dB; none where they were not taken.
    pub psnr_db: Option<[f64; 2]>,
}

/// A refinement for where the eye was.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Refined {
    /// Where the pupil was believed to be.
    #[serde(with = "aim")]
    pub aim: PupilDistribution,
    /// How the phases followed.
    pub steering: RefineSettings,
    /// Steps a colour.
    pub steps: usize,
}

/// Where the solve of a sequence's next hologram begins: `"cold"`, or a number from 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Start {
    /// At random phases.
    Cold,
    /// At the phases of the hologram before, so far along the schedule.
    Warm(f64),
}

/// The largest padding that a file may state along an axis, pixels.
const MOST_PADDING: usize = 65536;

impl Metadata {
    /// The padding that the hologram was solved with, and is looked at with. By the definition of formats 1 to 3, and of bare
    /// phases, there is none where none is stated: propagation is circular.
    pub fn padding(&self) -> Padding {
        let [rows, columns] = self.padded.unwrap_or_default();
        Padding { rows, columns }
    }

    /// Refuses what no computation can follow.
    pub(super) fn check(&self) -> Result<(), HologramError> {
        if let Some(Err(reason)) = self.mask.as_ref().map(Mask::check) {
            return Err(HologramError::Inconsistent(reason.within("its mask")));
        }
        match self.padded {
            Some([rows, columns]) if rows.max(columns) > MOST_PADDING => Err(HologramError::Inconsistent(reason!(
                "padding",
                "its padding is {rows} rows and {columns} columns: at most {MOST_PADDING} each"
            ))),
            _ => Ok(()),
        }
    }

    /// A key under which two descriptions differ.
    pub(super) fn difference(&self, wanted: &Self) -> Option<String> {
        let keys = |m: &Self| match serde_json::to_value(m) {
            Ok(Value::Object(keys)) => keys,
            _ => Map::new(),
        };
        let (is, wanted) = (keys(self), keys(wanted));
        wanted.into_iter().find(|(key, value)| is.get(key) != Some(value)).map(|(key, _)| key)
    }
}

/// Files that a hologram's metadata names, which are looked for beside its folder.
fn folder_of(hologram: &Path) -> PathBuf {
    let parent = hologram.parent().filter(|parent| !parent.as_os_str().is_empty());
    parent.unwrap_or(Path::new(".")).into()
}

impl Metadata {
    fn files_mut(&mut self) -> impl Iterator<Item = &mut FileRecord> {
        self.scenes.iter_mut().flat_map(SceneRecord::files_mut).chain(&mut self.display_file)
    }

    /// It was read from the hologram at `path`.
    pub(crate) fn read_at(&mut self, path: &Path) {
        self.files_mut().for_each(|file| file.read_in(&folder_of(path)));
    }

    /// The same as it is written to a hologram at `path`.
    pub(crate) fn written_at(&self, path: &Path) -> Self {
        let mut written = self.clone();
        written.files_mut().for_each(|file| file.written_in(&folder_of(path)));
        written
    }

    /// The same without the places of files: what two holograms that were made alike have in common.
    #[must_use]
    pub fn without_places(&self) -> Self {
        let mut anywhere = self.clone();
        anywhere.files_mut().for_each(FileRecord::forget_places);
        anywhere
    }
}

/// A distribution of pupils as files have it.
mod aim {
    use super::{Deserialize, Deserializer, PupilDistribution, Serialize, Serializer};

    /// Metres.
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

    /// A value of the wrong kind is refused, never taken for another.
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
