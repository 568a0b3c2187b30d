//! Reads and writes video frames on the disk, in folders with their display or as pictures of any origin.

use crate::encode::{AsShown, Decoder, EncodeError, Encoder, Packed, VideoFrames};
use crate::files::{FileError, Folder, FolderDraft, encode_png8, read, read_png8, write_file};
use crate::hologram::{ColorHologram, Hologram, Metadata};
use crate::optics::{Color, Display, Place};
use eyebox_base::{Reason, reason};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// The file that describes the frames.
const DOCUMENT: &str = "frames.json";
/// The display, as a file that `--display` accepts.
const DISPLAY: &str = "display.toml";
/// The first letters of the names of calibration files that are stored in the folder.
const CALIBRATION: [&str; 2] = ["look-up-", "correction-"];
/// The powers of the lasers in each sub-frame, for simultaneous color.
const POWERS: &str = "powers.csv";
/// The powers of the switchable sources in each sub-frame.
const SOURCES: &str = "sources.csv";
const FORMAT: u32 = 1;

/// Returns true if there is a folder of video frames with their display and description.
pub fn is_encoded(path: &Path) -> bool {
    path.join(DOCUMENT).is_file()
}

/// The file of a video frame, and the sub-frames in it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FrameContents {
    /// The name of the file.
    pub file: String,
    /// The sub-frames, in the form of a display file's map.
    pub holds: Vec<Place>,
}

#[derive(Serialize, Deserialize)]
struct Document {
    format: u32,
    colors: Vec<Color>,
    sub_frames: usize,
    frames: Vec<FrameContents>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    hologram: Option<Origin>,
}

/// The encoded hologram without its phases.
#[derive(Serialize, Deserialize)]
struct Origin {
    scene: String,
    seed: u64,
    version: String,
    exposures: BTreeMap<Color, f64>,
    efficiencies: BTreeMap<Color, f64>,
    settings: Metadata,
}

/// Writes the powers of a hologram's lasers into the existing folder of its video frames, if its colors share their
/// sub-frames. Returns true if it has such lasers.
///
/// # Errors
/// Returns [`FileError`] if the file cannot be written.
pub fn write_powers(hologram: &Hologram, folder: &Path) -> Result<bool, FileError> {
    let Some(joint) = &hologram.metadata.joint_color else { return Ok(false) };
    write_file(&folder.join(POWERS), |out| out.write_all(joint.table().as_bytes()))?;
    Ok(true)
}

impl Encoder {
    /// Returns the contents of each video frame.
    pub fn contents(&self) -> Vec<FrameContents> {
        let holds = |index| self.packed().places(self.colors(), index);
        let one = |index| FrameContents { file: VideoFrames::file_name(index), holds: holds(index) };
        (0..self.packed().video_frames).map(one).collect()
    }

    /// Writes video frames as PNGs into `folder`, which appears only when complete. It also has the display, its
    /// calibration and the contents of the frames, which is all that [`Encoded`] needs. For simultaneous color it has
    /// the powers of the lasers (`powers.csv`), and for switchable sources their powers (`sources.csv`). `of` is the
    /// hologram that the frames show, if any. A folder of such frames is replaced. Any other folder must be
    /// empty.
    ///
    /// # Errors
    /// Returns [`EncodeError::File`] if a file cannot be written.
    pub fn save(&self, frames: &VideoFrames, of: Option<&Hologram>, folder: &Path) -> Result<(), EncodeError> {
        let draft = FolderDraft::new(folder, holds_only_frames)?;
        // Controller and triggers belong to a bench and not to the frames.
        let mut display = self.display().without_apparatus();
        let encoding = &mut display.encoding;
        for (color, file) in &mut encoding.look_up {
            *file = keep(&draft, file, &format!("{}{color}", CALIBRATION[0]))?;
        }
        for (i, correction) in encoding.correction.iter_mut().enumerate() {
            correction.file = keep(&draft, &correction.file, &format!("{}{i}", CALIBRATION[1]))?;
        }
        draft.write(DISPLAY, |out| out.write_all(display.to_toml().as_bytes()))?;
        if let Some(joint) = of.and_then(|hologram| hologram.metadata.joint_color.as_ref()) {
            draft.write(POWERS, |out| out.write_all(joint.table().as_bytes()))?;
        }
        if let Some(table) = of.and_then(Hologram::sources_table) {
            draft.write(SOURCES, |out| out.write_all(table.as_bytes()))?;
        }
        let document = Document {
            format: FORMAT,
            colors: self.colors().to_vec(),
            sub_frames: self.packed().sub_frames,
            frames: self.contents(),
            hologram: of.map(|hologram| Origin::of(hologram, folder)),
        };
        draft.write(DOCUMENT, |out| Ok(serde_json::to_writer_pretty(out, &document)?))?;
        (0..frames.count()).into_par_iter().try_for_each(|i| {
            draft.write(&VideoFrames::file_name(i), |out| {
                encode_png8(out, frames.height, frames.width, frames.channels, frames.frame(i))
            })
        })?;
        Ok(draft.put()?)
    }
}

/// Returns true if a folder holds only files of [`Encoder::save`]. Its document lists the frames. If the document is
/// damaged, the names of the frames decide.
fn holds_only_frames(folder: &Path) -> bool {
    let Ok(document) = read::bytes(&folder.join(DOCUMENT), read::TABLE) else { return false };
    let document = serde_json::from_slice::<Document>(&document).ok();
    let frame = |name: &str| match &document {
        Some(document) => document.frames.iter().any(|f| f.file == name),
        None => name.starts_with("frame-") && name.ends_with(".png"),
    };
    let ours = |name: &str| {
        frame(name)
            || [DOCUMENT, DISPLAY, POWERS, SOURCES].contains(&name)
            || CALIBRATION.iter().any(|begins| name.starts_with(begins))
    };
    fs::read_dir(folder).is_ok_and(|mut all| all.all(|e| e.is_ok_and(|e| e.file_name().to_str().is_some_and(ours))))
}

/// Copies a calibration file into the folder, and returns its name there.
fn keep(draft: &FolderDraft, file: &Path, stem: &str) -> Result<PathBuf, EncodeError> {
    let bytes = read::bytes(file, read::PICTURE).map_err(|e| FileError::read(file, e))?;
    let ending = file.extension().map_or(String::new(), |e| format!(".{}", e.to_string_lossy()));
    let name = format!("{stem}{ending}");
    draft.write(&name, |out| out.write_all(&bytes))?;
    Ok(name.into())
}

impl Origin {
    /// Describes a hologram for the document in `folder`.
    fn of(hologram: &Hologram, folder: &Path) -> Self {
        let each = |value: fn(&ColorHologram) -> f64| {
            hologram.colors.iter().filter_map(|c| Some((c.color?, value(c)))).collect()
        };
        Self {
            scene: hologram.scene.clone(),
            seed: hologram.seed,
            version: hologram.version.clone(),
            exposures: each(|c| c.exposure),
            efficiencies: each(|c| c.efficiency),
            settings: hologram.metadata.written_at(&folder.join(DOCUMENT)),
        }
    }
}

/// Video frames on the disk, with their display.
pub struct Encoded {
    display: Display,
    colors: Vec<Color>,
    sub_frames: usize,
    files: Vec<PathBuf>,
    hologram: Option<Origin>,
    /// The folder of the frames, to detect its replacement.
    folder: Option<Folder>,
}

impl Encoded {
    /// Opens the video frames at `path`. It may be a folder of this program, a folder of PNGs of any origin, or one
    /// PNG. PNGs are in the order of the numbers in their names. `display` is their display. If it is none, the
    /// folder's own is used. `color` is the color of frames of any origin, by default all colors of the display.
    ///
    /// # Errors
    /// Returns [`EncodeError::File`] for files that cannot be read. Returns [`EncodeError::Frame`] if there are no
    /// frames, if their display is not given, and if they are not whole sets.
    pub fn open(path: &Path, display: Option<&Display>, color: Option<Color>) -> Result<Self, EncodeError> {
        let wrong = |reason: Reason| EncodeError::Frame { frame: path.display().to_string(), reason };
        let folder = Folder::open(path).ok();
        if is_encoded(path) {
            let file = path.join(DOCUMENT);
            let bytes = read::bytes(&file, read::TABLE).map_err(|e| FileError::read(&file, e))?;
            let content = |reason: Reason| EncodeError::from(FileError::content(&file, reason));
            let damaged = |e: serde_json::Error| content(reason!("damaged", "is damaged: {e}"));
            let Document { format, colors, sub_frames, frames, mut hologram } =
                serde_json::from_slice(&bytes).map_err(damaged)?;
            if format != FORMAT {
                return Err(content(reason!("format", "has the format {format}, but only {FORMAT} is supported")));
            }
            if let Some(asked) = color.filter(|c| colors != [*c]) {
                let has: Vec<_> = colors.iter().map(Color::to_string).collect();
                return Err(wrong(reason!(
                    "other-color",
                    "it holds {}, not {asked} alone. Leave out `color`",
                    has.join(", ")
                )));
            }
            if let Some(outside) = frames.iter().find(|f| Path::new(&f.file).components().count() != 1) {
                return Err(content(reason!("missing-frame", "names {}, which is not in its folder", outside.file)));
            }
            let own = || {
                let own = path.join(DISPLAY);
                let text = read::text(&own, read::TEXT).map_err(|e| FileError::read(&own, e))?;
                let display = Display::from_toml(&text, &own.display().to_string());
                display.map_err(|e| EncodeError::from(FileError::content(&own, e.to_string())))
            };
            let display = display.map_or_else(own, |d| Ok(d.clone()))?;
            hologram.iter_mut().for_each(|origin| origin.settings.read_at(&file));
            let files = frames.iter().map(|f| path.join(&f.file)).collect();
            return Ok(Self { display, colors, sub_frames, files, hologram, folder });
        }
        let files = pictures(path)?;
        if files.is_empty() {
            return Err(wrong(reason!("no-png", "it holds no PNG, but video frames are needed")));
        }
        let display = display.ok_or_else(|| {
            wrong(reason!("no-display", "the display of its frames is not known (it has no {DOCUMENT}). Set `display`"))
        })?;
        let colors = color.map_or_else(|| display.wavelengths.iter().map(|w| w.color).collect(), |c| vec![c]);
        let packed = Packed::of_video_frames(&display.encoding, &colors, files.len()).map_err(wrong)?;
        Ok(Self { display: display.clone(), colors, sub_frames: packed.sub_frames, files, hologram: None, folder })
    }

    /// Returns a description of the frames in a sentence.
    pub fn describe(&self) -> String {
        let (files, sub_frames, name) = (self.files.len(), self.sub_frames, &self.display.name);
        let colors: Vec<_> = self.colors.iter().map(Color::to_string).collect();
        let s = |n: usize| if n == 1 { "" } else { "s" };
        format!(
            "{files} video frame{} for the display '{name}' with {sub_frames} sub-frame{} of {}",
            s(files),
            s(sub_frames),
            colors.join(", ")
        )
    }

    /// Returns the hologram that the frames show, with its phases in the SLM's levels. It is the encoded hologram,
    /// except for the steps in `left`, which stay as the SLM shows them.
    ///
    /// # Errors
    /// Returns the errors of [`Decoder::new`] and [`Decoder::decode`], [`EncodeError::File`] for pictures that cannot
    /// be read, and [`EncodeError::Frame`] for pictures of another size or kind than the display's.
    pub fn decode(&self, left: AsShown) -> Result<Hologram, EncodeError> {
        let decoder = Decoder::new(&self.display, &self.colors, self.sub_frames, left)?;
        let mut frames = decoder.encoder().frames();
        if frames.count() != self.files.len() {
            let (display, n) = (self.display.name.clone(), self.files.len());
            let reason =
                reason!("frames-count", "there are {n} video frames, but its packing takes {}", frames.count());
            return Err(EncodeError::Mismatch { display, reason });
        }
        let (size, channels, bytes) = ([frames.height, frames.width], frames.channels, frames.frame_bytes());
        let read = |(file, out): (&PathBuf, &mut [u8])| self.read(file, size, channels, out);
        self.files.par_iter().zip(frames.bytes_mut().par_chunks_exact_mut(bytes)).try_for_each(read)?;
        if let Some(folder) = self.folder.as_ref().filter(|folder| folder.is_replaced()) {
            let reason = reason!("replaced", "another program replaced it while it was read. Try again");
            return Err(EncodeError::Frame { frame: folder.path().display().to_string(), reason });
        }
        let phases = decoder.decode(&frames, |i| self.files[i].display().to_string())?;
        let [height, width] = decoder.size();
        let display = Display { height, width, ..self.display.clone() };
        let known = |of: fn(&Origin) -> &BTreeMap<Color, f64>, color: Color| {
            self.hologram.as_ref().and_then(|o| of(o).get(&color)).copied().unwrap_or(1.0)
        };
        let wavelength = |color| display.wavelengths.iter().find(|w| w.color == color).map_or(0.0, |w| w.wavelength);
        let color = |(color, phases): (Color, Vec<f32>)| ColorHologram {
            color: Some(color),
            wavelength: wavelength(color),
            exposure: known(|o| &o.exposures, color),
            efficiency: known(|o| &o.efficiencies, color),
            phases,
        };
        let colors = self.all_colors(phases).into_iter().map(color).collect();
        let mut hologram = Hologram::on(&display, self.sub_frames, colors);
        hologram.metadata.exposure_assumed = self.hologram.is_none();
        if let Some(origin) = &self.hologram {
            (hologram.scene, hologram.version) = (origin.scene.clone(), origin.version.clone());
            (hologram.seed, hologram.metadata) = (origin.seed, origin.settings.clone());
            if left.turns && self.display.encoding.rotation_deg % 180 == 90 {
                hologram.metadata.padded = hologram.metadata.padded.map(|[rows, columns]| [columns, rows]);
            }
        }
        let mismatch = |reason| EncodeError::Mismatch { display: display.name.clone(), reason };
        hologram.check().map_err(|e| mismatch(Reason::of(&e)))?;
        Ok(hologram)
    }

    /// Returns its colors with their phases. For simultaneous color the frames hold the drive, which gives the phases
    /// of all colors.
    fn all_colors(&self, mut phases: Vec<Vec<f32>>) -> Vec<(Color, Vec<f32>)> {
        let joint = self.hologram.as_ref().and_then(|origin| origin.settings.joint_color.as_ref());
        match joint.filter(|joint| joint.reference().is_some_and(|color| self.colors == [color])) {
            Some(joint) => {
                let drives = phases.pop().unwrap_or_default();
                joint.lasers.iter().map(|(color, laser)| (*color, laser.phases(&drives))).collect()
            }
            None => self.colors.iter().copied().zip(phases).collect(),
        }
    }

    /// Reads one frame. On a display of three channels a gray picture counts as three equal channels, and the other way
    /// round.
    fn read(
        &self,
        file: &Path,
        [height, width]: [usize; 2],
        channels: usize,
        out: &mut [u8],
    ) -> Result<(), EncodeError> {
        let (h, w, has, bytes) = read_png8(read::open(file).map_err(|e| FileError::read(file, e))?, file)?;
        let wrong = |reason: Reason| Err(FileError::content(file, reason).into());
        if [h, w] != [height, width] {
            let [cell_rows, cell_columns] = [height / self.display.height, width / self.display.width];
            let (name, [sh, sw]) = (&self.display.name, [h / cell_rows.max(1), w / cell_columns.max(1)]);
            return wrong(reason!(
                "frame-size",
                "it has {h}x{w} pixels, but a video frame of the display '{name}' has {height}x{width}. \
                 Set `size` {sh}x{sw}, or `display` to the display of the frames"
            ));
        }
        match (has, channels) {
            (1, 3) => out.iter_mut().zip(bytes.iter().flat_map(|b| [b; 3])).for_each(|(to, from)| *to = *from),
            (3, 1) => {
                if let Some(at) = bytes.chunks_exact(3).position(|p| p[0] != p[1] || p[1] != p[2]) {
                    let (row, column, name) = (at / w, at % w, &self.display.name);
                    return wrong(reason!(
                        "frame-colored",
                        "it has color at row {row}, column {column}, but the display '{name}' takes gray video frames"
                    ));
                }
                out.iter_mut().zip(bytes.iter().step_by(3)).for_each(|(to, from)| *to = *from);
            }
            _ => out.copy_from_slice(&bytes),
        }
        Ok(())
    }
}

/// Returns the PNGs of a folder in the order of the numbers in their names, or a single PNG.
fn pictures(path: &Path) -> Result<Vec<PathBuf>, EncodeError> {
    let is_png = |file: &Path| file.extension().is_some_and(|e| e.eq_ignore_ascii_case("png"));
    if !fs::metadata(path).map_err(|e| FileError::read(path, e))?.is_dir() {
        return Ok(if is_png(path) { vec![path.into()] } else { Vec::new() });
    }
    let entries = fs::read_dir(path).and_then(|all| all.map(|e| Ok(e?.path())).collect::<Result<Vec<_>, _>>());
    let mut files: Vec<_> = entries.map_err(|e| FileError::read(path, e))?.into_iter().filter(|f| is_png(f)).collect();
    files.sort_by_cached_key(|file| numbers_in(&file.file_name().unwrap_or_default().to_string_lossy()));
    Ok(files)
}

/// Returns a key that sorts files in the order of their numbers. Digits get leading zeros to the same length.
fn numbers_in(name: &str) -> String {
    let (mut out, mut digits) = (String::new(), String::new());
    for c in name.chars().chain(['\0']) {
        if c.is_ascii_digit() {
            digits.push(c);
        } else {
            if !digits.is_empty() {
                out += &format!("{digits:0>20}");
                digits.clear();
            }
            out.push(c);
        }
    }
    out
}
