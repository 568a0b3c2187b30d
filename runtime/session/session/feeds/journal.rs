//! What a session decided, kept: the scenes as they came, where the eye was expected, how many steps were taken, which set was lit
//! when. With it the same sets are made again, to the byte, on the same engine, whatever the machine's time does.

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

/// Decisions that wait for the disk.
const WAITING: usize = 1 << 12;
const DECISIONS: &str = "decisions.jsonl";

/// A decision. Numbers that have to be exact are the bits of float64.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", tag = "do")]
pub(crate) enum Decision {
    /// A scene was followed; its views are in a file for each colour.
    Scene {
        number: u64,
        /// Whether what was refined before was of no use for it.
        anew: bool,
        colors: Vec<Views>,
    },
    /// So many steps for a pupil expected there, while this moves, of sets that roll from this turn on.
    Steps {
        pupil: [u64; 8],
        #[serde(default, skip_serializing_if = "Option::is_none")]
        motion: Option<[u64; 9]>,
        #[serde(default, skip_serializing_if = "is_first")]
        turn: usize,
        steps: u32,
    },
    /// Phases were moved by so many pixels, or looked at whether to.
    Carry {
        pixels: Shifts,
        look: bool,
    },
    /// It was looked what to begin another picture with.
    Fit {},
    /// It began again with the hologram for the whole eyebox.
    Whole {},
    Set {
        number: u64,
    },
    Lit {
        number: u64,
    },
}

/// By how many pixels (x, y) phases were moved.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub(crate) enum Shifts {
    /// All alike.
    Whole([i64; 2]),
    /// Those that are lit with each turn, of sets that roll.
    Turns(Vec<[i64; 2]>),
}

impl Shifts {
    /// By turn.
    pub(crate) fn of(turns: &[[i64; 2]]) -> Self {
        if let [whole] = turns { Self::Whole(*whole) } else { Self::Turns(turns.to_vec()) }
    }

    /// By turn.
    pub(crate) fn turns(&self) -> &[[i64; 2]] {
        match self {
            Self::Whole(shift) => std::slice::from_ref(shift),
            Self::Turns(turns) => turns,
        }
    }
}

/// What moves while a set is refined, and, of sets that roll, from which turn on it is lit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Moves {
    pub motion: Motion,
    pub turn: usize,
}

fn is_first(turn: &usize) -> bool {
    *turn == 0
}

/// Where the views of a scene stand before one colour.
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

/// A session's motion has no more than this: when sub-frames are lit, the display says.
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

    /// Before the same display as `like`.
    fn color(self, like: &LiveColor, files: [&Path; 2]) -> Result<LiveColor, SessionError> {
        let wrong = |file: &Path| {
            SessionError::Setting(reason!("not-as-recorded", "{}: it is not what was recorded", file.display()))
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
    /// There was no room for one: what follows is of no use.
    gap: Arc<AtomicBool>,
}

pub(crate) struct JournalWriter {
    gap: Arc<AtomicBool>,
    writer: EntryWriter<Entry>,
}

impl Journal {
    /// Into a new or an empty folder.
    pub(crate) fn start(folder: &Path) -> Result<JournalWriter, SessionError> {
        fs::create_dir_all(folder).map_err(|e| FileError::write(folder, e))?;
        if fs::read_dir(folder).map_err(|e| FileError::read(folder, e))?.next().is_some() {
            let reason = reason!("not-empty", "holds something: a session is kept in a new or an empty folder");
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

    /// Steps were taken for a pupil, while this moves.
    pub(crate) fn steps(&self, pupil: &PupilDistribution, Moves { motion, turn }: &Moves, steps: u32) {
        let motion = Some(bits_of_motion(motion)).filter(|_| *motion != Motion::default());
        self.keep(Decision::Steps { pupil: bits_of(pupil), motion, turn: *turn, steps });
    }

    /// A scene is followed; `anew`: what was refined before is of no use for it.
    pub(crate) fn scene(&self, scene: &SceneFrame, anew: bool) {
        self.put(Entry::Scene { scene: scene.clone(), anew });
    }

    /// What follows cannot be done again.
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

    /// Brings all to the disk. Fails with [`SessionError::Setting`] if there is a gap.
    pub(crate) fn finish(self) -> Result<(), SessionError> {
        self.writer.finish()?;
        match self.gap.load(Ordering::Acquire) {
            true => Err(reason!(
                "not-kept",
                "the session was not kept to its end: the disk was too slow, or an engine was lost"
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

/// The views as they are compared, which are whole numbers of the brightest: they become the same again.
fn write_color([views, phases]: [PathBuf; 2], color: &LiveColor) -> Result<(), FileError> {
    let pyramid = color.problem.pyramid.on_host().map_err(|e| FileError::write(&views, std::io::Error::other(e)))?;
    let Some(level) = pyramid.levels.first() else { return Ok(()) };
    let light: Vec<f32> = level.views.iter().map(|v| f32::from(*v) / 65535.0 * pyramid.scale).collect();
    write_npy(&views, &[pyramid.count, level.height, level.width], &light)?;
    if color.phases.is_empty() { Ok(()) } else { write_npy(&phases, &[color.phases.len()], &color.phases) }
}

/// A session that was kept, decision by decision.
pub(crate) struct RecordedSession {
    folder: PathBuf,
    pub(crate) decisions: std::vec::IntoIter<Decision>,
    /// The sets that were lit, in order.
    pub(crate) lit: std::vec::IntoIter<u64>,
}

impl RecordedSession {
    /// Opens it. Fails with [`SessionError::Setting`] at a line that is no decision.
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
                        "{}: line {}: {error}: no session is kept there",
                        file.display(),
                        i + 1
                    );
                    return Err(SessionError::Setting(wrong));
                }
            }
        }
        if lit.is_empty() {
            return Err(reason!("no-set", "{}: no set was lit in it", file.display()).into());
        }
        Ok(Self { folder: folder.to_path_buf(), decisions: decisions.into_iter(), lit: lit.into_iter() })
    }

    /// A scene before the colours that are refined.
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
