//! Identifies a table by everything that decides it, and stores tables on disk.
//!
//! A file is a line of JSON with the decisive values, followed by the angles of the fitted levels.

use crate::files::{cache_folder, read, write_file};
use crate::optics::{Laser, Optics};
use crate::solve::problem::Problem;
use eyebox_kernels::table_start::LEVELS;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Side of the tile in pixels. A smaller tile makes narrow pupils uneven, and a larger one takes more steps for the
/// same noise.
pub(super) const SIDE: usize = 64;
/// Steps of the first level, and of each other level.
const STEPS: [usize; 2] = [800, 100];
/// Number of pupils per step.
const PUPILS: usize = 32;
/// Diameters of the pupils that see an even picture, in meters.
const DIAMETERS: [f64; 2] = [2.2e-3, 12e-3];
/// Depths on which they focus, in meters.
const DEPTH: [f64; 2] = [-2e-3, 2e-3];

/// Everything that decides a table.
#[derive(Debug, Clone, Serialize)]
pub(super) struct MadeBy {
    version: String,
    pub side: usize,
    pub frames: usize,
    wavelength: f64,
    pitch: f64,
    focal_length: f64,
    eyebox: f64,
    pub depth: [f64; 2],
    pub diameters: [f64; 2],
    pub steps: [usize; 2],
    pub pupils: usize,
    /// The faults of the display, its source and the eye, if the table is fitted through them.
    through: String,
    /// The colors that share the drive values, including the first one. It is empty for one color.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    shared_by: Vec<SharedBy>,
}

/// One of the colors that share drive values.
#[derive(Debug, Clone, Serialize)]
struct SharedBy {
    wavelength: f64,
    slope: f64,
    powers: Vec<f64>,
    through: String,
}

impl MadeBy {
    pub(super) fn of(problem: &Problem, frames: usize) -> Self {
        let Optics { wavelength, pitch, focal_length, .. } = problem.optics;
        Self {
            version: env!("CARGO_PKG_VERSION").into(),
            side: SIDE,
            frames,
            wavelength,
            pitch,
            focal_length,
            eyebox: problem.eyebox,
            depth: DEPTH,
            diameters: DIAMETERS.map(|d| d.min(problem.eyebox)),
            steps: STEPS,
            pupils: PUPILS,
            through: through(problem),
            shared_by: Vec::new(),
        }
    }

    /// Identifies the table of drive values that colors share in the light of these lasers, or returns `None` without
    /// colors.
    pub(super) fn of_shared(colors: &[&Problem], lasers: &[Laser]) -> Option<Self> {
        let one = |(problem, laser): (&&Problem, &Laser)| SharedBy {
            wavelength: problem.optics.wavelength,
            slope: laser.slope,
            powers: laser.powers.clone(),
            through: through(problem),
        };
        let shared_by = colors.iter().zip(lasers).map(one).collect();
        Some(Self { shared_by, ..Self::of(colors.first()?, lasers.first()?.powers.len()) })
    }

    /// Returns it for another tile and other steps.
    #[cfg(any(test, feature = "test-hooks"))]
    pub(super) fn sized(self, side: usize, steps: [usize; 2]) -> Self {
        Self { side, steps, ..self }
    }

    pub(super) fn text(&self) -> String {
        serde_json::to_string(self).unwrap_or_default()
    }
}

/// Describes the faults, the source and the eye, with every digit of every number.
fn through(problem: &Problem) -> String {
    let tile = Optics { height: SIDE, width: SIDE, ..problem.optics };
    let model = problem.model.as_ref().and_then(|model| model.tile(tile));
    let model = model.as_ref().map(|model| model.model());
    let eye = problem.eye.as_ref().map(|eye| eye.prescription());
    format!("{model:?} {eye:?} {:?}", problem.modes)
}

/// The angles of each level (sub-frames, side, side), if it is fitted.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Levels(pub [Option<Vec<u16>>; LEVELS]);

impl Levels {
    pub(super) fn are_all(&self) -> bool {
        self.0.iter().all(Option::is_some)
    }
}

/// The header before the angles.
#[derive(Serialize, Deserialize)]
struct Head {
    /// The decisive values as text, because numbers are equal only if every digit is.
    made_by: String,
    /// Levels that follow, in this order.
    levels: Vec<usize>,
    /// CRC-32C of the bytes that follow.
    crc32c: u32,
}

impl MadeBy {
    fn file(&self) -> Option<PathBuf> {
        let name = format!("start-{:08x}.table", crc32c::crc32c(self.text().as_bytes()));
        cache_folder().map(|folder| folder.join(name))
    }

    /// Reads the levels from the cache. A file that is unreadable, damaged, or of another table has none.
    pub(super) fn load(&self) -> Levels {
        self.file().and_then(|file| self.parse(&read::bytes(&file, read::RESULTS).ok()?)).unwrap_or_default()
    }

    pub(super) fn parse(&self, bytes: &[u8]) -> Option<Levels> {
        let (head, angles) = bytes.split_at_checked(bytes.iter().position(|b| *b == b'\n')? + 1)?;
        let Head { made_by, levels, crc32c } = serde_json::from_slice(head).ok()?;
        let of_level = 2 * self.frames * self.side * self.side;
        let ours = made_by == self.text()
            && angles.len() == levels.len() * of_level
            && crc32c::crc32c(angles) == crc32c
            && levels.iter().all(|at| *at < LEVELS);
        let mut found = Levels::default();
        for (at, angles) in levels.iter().zip(angles.chunks_exact(of_level)).filter(|_| ours) {
            found.0[*at] = Some(angles.chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]])).collect());
        }
        ours.then_some(found)
    }

    pub(super) fn bytes(&self, levels: &Levels) -> Vec<u8> {
        let there = levels.0.iter().enumerate().filter_map(|(at, level)| Some((at, level.as_ref()?)));
        let angles: Vec<u8> = there.clone().flat_map(|(_, level)| level.iter().flat_map(|a| a.to_le_bytes())).collect();
        let (made_by, crc32c) = (self.text(), crc32c::crc32c(&angles));
        let head = Head { made_by, levels: there.map(|(at, _)| at).collect(), crc32c };
        let mut bytes = serde_json::to_vec(&head).unwrap_or_default();
        bytes.push(b'\n');
        bytes.extend(angles);
        bytes
    }

    /// Stores the fitted levels. If this fails, they are fitted again the next time.
    pub(super) fn save(&self, levels: &Levels) {
        let Some(file) = self.file().filter(|_| levels.0.iter().any(Option::is_some)) else { return };
        let kept = file
            .parent()
            .map_or(Ok(()), std::fs::create_dir_all)
            .map_err(|e| e.to_string())
            .and_then(|()| write_file(&file, |out| out.write_all(&self.bytes(levels))).map_err(|e| e.to_string()));
        if let Err(reason) = kept {
            tracing::info!("the table of first phases is not stored: {reason}");
        }
    }
}
