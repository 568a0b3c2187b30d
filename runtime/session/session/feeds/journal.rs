//! Keeps the decisions of a session in a journal, so that the same engine replays the same sets byte for byte.
//!
//! The journal holds the scenes as they arrived, the predicted pupils, the numbers of steps, and the set of each light.
//! A replay does not depend on the timing of the machine.

use crate::files::{FileError, GrowingFile, read, read_npy, write_npy};
use crate::mailbox::Mailbox;
use crate::optics::PupilDistribution;
use crate::scene::{Pyramid, ViewGrid};
use crate::session::content::scenes::SceneFrame;
use crate::session::frame_log::error::SessionError;
use crate::session::frame_log::threads::{EntryWriter, Moment};
use crate::session::refinement::field::LiveColor;
use crate::solve::{Motion, Problem};
use eyebox_base::reason;
use serde::{Deserialize, Serialize};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// The number of decisions that can wait for the disk.
const WAITING: usize = 1 << 12;
const DECISIONS: &str = "decisions.jsonl";

/// A decision of a session. Numbers that have to be exact are stored as the bits of float64.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", tag = "do")]
pub(crate) enum Decision {
    /// A scene was followed. Its views are in a file for each color.
    Scene {
        number: u64,
        /// True if the earlier phases were of no use for the scene.
        anew: bool,
        colors: Vec<Views>,
    },
    /// Steps were taken for this predicted pupil and motion. With rolling updates, the sets roll from this turn on.
    Steps {
        pupil: [u64; 8],
        #[serde(default, skip_serializing_if = "Option::is_none")]
        motion: Option<[u64; 9]>,
        #[serde(default, skip_serializing_if = "is_first")]
        turn: usize,
        steps: u32,
    },
    /// The phases were shifted by these pixels, or the losses were compared to decide on the shift.
    Carry {
        pixels: Shifts,
        look: bool,
    },
    /// The start phases for a different picture were selected.
    Fit {},
    /// Refinement started again with the hologram for the whole eyebox.
    Whole {},
    Set {
        number: u64,
    },
    Lit {
        number: u64,
    },
}

/// The pixels (x, y) by which phases were shifted.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub(crate) enum Shifts {
    /// All phases were shifted alike.
    Whole([i64; 2]),
    /// The sub-frames of each turn of a rolling set were shifted by their own pixels.
    Turns(Vec<[i64; 2]>),
}

impl Shifts {
    /// Creates the shifts from one entry for each turn.
    pub(crate) fn of(turns: &[[i64; 2]]) -> Self {
        if let [whole] = turns { Self::Whole(*whole) } else { Self::Turns(turns.to_vec()) }
    }

    /// Returns the shift of each turn.
    pub(crate) fn turns(&self) -> &[[i64; 2]] {
        match self {
            Self::Whole(shift) => std::slice::from_ref(shift),
            Self::Turns(turns) => turns,
        }
    }
}

/// The motion during the light of a set, and the turn from which a rolling set is lit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Moves {
    pub motion: Motion,
    pub turn: usize,
}

fn is_first(turn: &usize) -> bool {
    *turn == 0
}

/// The positions of the views of a scene before one color.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Views {
    grid: [usize; 2],
    cell: u64,
    center: [u64; 2],
    mean: u64,
    exposure: u64,
    phases: bool,
}

fn bits_of(pupil: &PupilDistribution) -> [u64; 8] {
    let PupilDistribution { centre: [x, y], spread, diameter: [low, high], focus: [near, far], elsewhere } = *pupil;
    [x, y, spread, low, high, near, far, elsewhere].map(f64::to_bits)
}

pub(crate) fn pupil_of(bits: [u64; 8]) -> PupilDistribution {
    let [x, y, spread, low, high, near, far, elsewhere] = bits.map(f64::from_bits);
    PupilDistribution { centre: [x, y], spread, diameter: [low, high], focus: [near, far], elsewhere }
}

/// Returns the bits of a motion. The times of the sub-frames are left out because the display gives them.
fn bits_of_motion(motion: &Motion) -> [u64; 9] {
    let Motion { content: [x, y], at, eye, spread, drift: [dx, dy], .. } = *motion;
    let [ex, ey] = eye.unwrap_or_default();
    [x, y, at, f64::from(u8::from(eye.is_some())), ex, ey, spread, dx, dy].map(f64::to_bits)
}

pub(crate) fn motion_of(bits: [u64; 9]) -> Motion {
    let [x, y, at, known, ex, ey, spread, dx, dy] = bits.map(f64::from_bits);
    let eye = (known > 0.0).then_some([ex, ey]);
    Motion { content: [x, y], at, eye, spread, drift: [dx, dy], ..Motion::default() }
}

impl Views {
    fn of(color: &LiveColor) -> Self {
        let LiveColor { problem, phases, exposure, .. } = color;
        Self {
            grid: [problem.views.rows, problem.views.columns],
            cell: problem.views.cell.to_bits(),
            center: problem.center.map(f64::to_bits),
            mean: problem.mean.to_bits(),
            exposure: exposure.to_bits(),
            phases: !phases.is_empty(),
        }
    }

    /// Reads the color back, before the same display as `like`.
    fn color(self, like: &LiveColor, files: [&Path; 2]) -> Result<LiveColor, SessionError> {
        let wrong = |file: &Path| {
            SessionError::Setting(reason!("not-as-recorded", "{}: it differs from the recorded scene", file.display()))
        };
        let level = like.problem.pyramid.levels.first().map_or([0, 0], |level| [level.height, level.width]);
        let [rows, columns] = self.grid;
        let count = rows.saturating_mul(columns);
        let views = read_npy(files[0])?;
        if views.values.len() != count.saturating_mul(level[0] * level[1]) || count == 0 {
            return Err(wrong(files[0]));
        }
        let parts: Vec<&[f32]> = views.values.chunks_exact(level[0] * level[1]).collect();
        let phases = if self.phases { read_npy(files[1])?.values } else { Vec::new() };
        let problem = Problem {
            views: ViewGrid { rows, columns, cell: f64::from_bits(self.cell) },
            center: self.center.map(f64::from_bits),
            mean: f64::from_bits(self.mean),
            pyramid: Arc::new(Pyramid::new(&parts, level[0], level[1])),
            ..like.problem.clone()
        };
        let laser = like.laser.clone();
        Ok(LiveColor { problem, phases, exposure: f64::from_bits(self.exposure), laser })
    }
}

fn files_of(folder: &Path, scene: u64, color: usize) -> [PathBuf; 2] {
    [format!("scene-{scene:06}-{color}.npy"), format!("scene-{scene:06}-{color}-phases.npy")].map(|n| folder.join(n))
}

enum Entry {
    Decision(Decision),
    Scene { scene: SceneFrame, anew: bool },
}

#[derive(Clone)]
pub(crate) struct Journal {
    out: Mailbox<Option<Entry>>,
    /// True if an entry found no room. The entries after it are of no use.
    gap: Arc<AtomicBool>,
}

pub(crate) struct JournalWriter {
    gap: Arc<AtomicBool>,
    writer: EntryWriter<Entry>,
}

impl Journal {
    /// Starts a journal in a new or empty folder.
    pub(crate) fn start(folder: &Path) -> Result<JournalWriter, SessionError> {
        fs::create_dir_all(folder).map_err(|e| FileError::write(folder, e))?;
        if fs::read_dir(folder).map_err(|e| FileError::read(folder, e))?.next().is_some() {
            let reason = reason!("not-empty", "is not empty, but a session journal needs a new or an empty folder");
            return Err(FileError::Taken { path: folder.display().to_string(), reason }.into());
        }
        let (file, folder) = (GrowingFile::new(&folder.join(DECISIONS))?, folder.to_path_buf());
        let writer = EntryWriter::start("keeps", WAITING, file, move |out, moment| match moment {
            Moment::Entry(entry) => write(out, &folder, entry),
            Moment::Begin | Moment::End => Ok(()),
        })?;
        Ok(JournalWriter { gap: Arc::default(), writer })
    }

    pub(crate) fn keep(&self, decision: Decision) {
        self.put(Entry::Decision(decision));
    }

    /// Records steps for a pupil and a motion.
    pub(crate) fn steps(&self, pupil: &PupilDistribution, Moves { motion, turn }: &Moves, steps: u32) {
        let motion = Some(bits_of_motion(motion)).filter(|_| *motion != Motion::default());
        self.keep(Decision::Steps { pupil: bits_of(pupil), motion, turn: *turn, steps });
    }

    /// Records that a scene is followed. `anew` is true if the earlier phases were of no use for it.
    pub(crate) fn scene(&self, scene: &SceneFrame, anew: bool) {
        self.put(Entry::Scene { scene: scene.clone(), anew });
    }

    /// Marks the rest of the session as not repeatable.
    pub(crate) fn break_off(&self) {
        self.gap.store(true, Ordering::Release);
    }

    fn put(&self, entry: Entry) {
        if !self.gap.load(Ordering::Acquire) && self.out.put(Some(entry)).is_err() {
            self.break_off();
        }
    }
}

impl JournalWriter {
    pub(crate) fn journal(&self) -> Journal {
        Journal { out: self.writer.entries.clone(), gap: Arc::clone(&self.gap) }
    }

    /// Writes everything to the disk. Returns [`SessionError::Setting`] if there is a gap.
    pub(crate) fn finish(self) -> Result<(), SessionError> {
        self.writer.finish()?;
        match self.gap.load(Ordering::Acquire) {
            true => Err(reason!(
                "not-kept",
                "the session journal is incomplete: the disk was too slow, or an engine was lost"
            )
            .into()),
            false => Ok(()),
        }
    }
}

fn write(out: &mut GrowingFile, folder: &Path, entry: Entry) -> Result<(), FileError> {
    let decision = match entry {
        Entry::Decision(decision) => decision,
        Entry::Scene { scene, anew } => {
            for (i, color) in scene.colors.iter().enumerate() {
                write_color(files_of(folder, scene.number, i), color)?;
            }
            Decision::Scene { number: scene.number, anew, colors: scene.colors.iter().map(Views::of).collect() }
        }
    };
    let line = serde_json::to_string(&decision).unwrap_or_default();
    out.add(|out| writeln!(out, "{line}"))
}

/// Writes the views as they are compared. They are whole numbers of the brightest value, so reading restores them
/// exactly.
fn write_color([views, phases]: [PathBuf; 2], color: &LiveColor) -> Result<(), FileError> {
    let pyramid = color.problem.pyramid.on_host().map_err(|e| FileError::write(&views, std::io::Error::other(e)))?;
    let Some(level) = pyramid.levels.first() else { return Ok(()) };
    let light: Vec<f32> = level.views.iter().map(|v| f32::from(*v) / 65535.0 * pyramid.scale).collect();
    write_npy(&views, &[pyramid.count, level.height, level.width], &light)?;
    if color.phases.is_empty() { Ok(()) } else { write_npy(&phases, &[color.phases.len()], &color.phases) }
}

/// A recorded session, decision by decision.
pub(crate) struct RecordedSession {
    folder: PathBuf,
    pub(crate) decisions: std::vec::IntoIter<Decision>,
    /// The sets that were lit, in order.
    pub(crate) lit: std::vec::IntoIter<u64>,
}

impl RecordedSession {
    /// Opens a recorded session. Returns [`SessionError::Setting`] for a line that is no decision.
    pub(crate) fn open(folder: &Path) -> Result<Self, SessionError> {
        let file = folder.join(DECISIONS);
        let text = read::text(&file, read::RESULTS).map_err(|e| FileError::read(&file, e))?;
        let (mut decisions, mut lit) = (Vec::new(), Vec::new());
        for (i, line) in text.lines().enumerate() {
            match serde_json::from_str(line) {
                Ok(Decision::Lit { number }) => lit.push(number),
                Ok(decision) => decisions.push(decision),
                Err(error) => {
                    let wrong = reason!(
                        "not-a-session",
                        "{}: line {} is not a decision of a session journal: {error}",
                        file.display(),
                        i + 1
                    );
                    return Err(SessionError::Setting(wrong));
                }
            }
        }
        if lit.is_empty() {
            return Err(reason!("no-set", "{}: the recorded session lit no set", file.display()).into());
        }
        Ok(Self { folder: folder.to_path_buf(), decisions: decisions.into_iter(), lit: lit.into_iter() })
    }

    /// Returns a recorded scene before the refined colors.
    pub(crate) fn scene(
        &self,
        number: u64,
        views: &[Views],
        like: &[LiveColor],
    ) -> Result<Vec<LiveColor>, SessionError> {
        let one = |(i, (views, like)): (usize, (&Views, &LiveColor))| {
            let files = files_of(&self.folder, number, i);
            views.color(like, [&files[0], &files[1]])
        };
        views.iter().zip(like).enumerate().map(one).collect()
    }
}
