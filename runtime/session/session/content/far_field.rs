//! Follows the eye with pieces of a tiled far field.
//!
//! A pupil sees only its own piece of the SLM, and only this piece is refined. A thread reads pieces and their views of
//! the scene ahead of the eye. The rest of the SLM stays lit unchanged.

use crate::evaluate::Views;
use crate::hologram::{HologramError, Tiles};
use crate::mailbox::Mailbox;
use crate::optics::PupilDistribution;
use crate::plan::ModelTables;
use crate::present::SECOND_NS;
use crate::session::content::scenes::{Due, FrameFreshness, Newest, SceneFrame, Scenes};
use crate::session::frame_log::error::SessionError;
use crate::session::frame_log::threads::spawn;
use crate::session::refinement::field::{Field, LiveColor};
use crate::tiled::{TileRect, TiledError};
use eyebox_base::error::Reason;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

/// The interval at which the reading thread checks for its end, and the longest single wait for its result.
const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// Pieces are requested for the position of the eye after this time (s), at its present velocity.
const AHEAD: f64 = 0.05;
/// If a pupil comes this close to the end of a piece, in shares of its diameter, the next piece is read.
const MARGIN: f64 = 0.25;

/// The display model of each color, or `None` for an ideal display.
type Models = Vec<Option<Arc<ModelTables>>>;

/// A piece that was read, as its place and its colors.
type Read = Result<(TileRect, Vec<LiveColor>), String>;

/// The successive pieces of a far field around an eye.
pub struct FarField {
    name: String,
    tiles: Arc<Tiles>,
    models: Arc<Models>,
    piece: TileRect,
    number: u64,
    /// The time of the previous light (ns), and the position of the pupil then.
    before: Option<(i64, [f64; 2])>,
    wanted: Mailbox<TileRect>,
    arriving: Mailbox<Read>,
    ahead: Option<(TileRect, Vec<LiveColor>)>,
    /// The piece that was requested last and has not arrived.
    asked: Option<TileRect>,
    thread: Option<JoinHandle<()>>,
}

impl FarField {
    /// Starts with the piece around `first`. `views` holds the views of the scene for each color of the hologram.
    ///
    /// Returns the colors that are refined first, and all phases of the far field, which have to fit in memory to be
    /// shown.
    ///
    /// # Errors
    /// Returns [`SessionError::Hologram`], [`SessionError::Thread`], or [`SessionError::Setting`] if the aim is not on
    /// the SLM.
    pub fn start(
        name: &str,
        tiles: Tiles,
        views: Vec<Views>,
        first: &PupilDistribution,
    ) -> Result<(Self, Vec<LiveColor>, Field), SessionError> {
        let wrong = |reason: Reason| SessionError::Setting(reason.within(name));
        let tiles = Arc::new(tiles);
        let models = (0..views.len()).map(|color| Ok(tiles.model(color)?.map(|model| model.for_steps())));
        let models: Arc<Models> = Arc::new(models.collect::<Result<_, HologramError>>()?);
        let piece = extent(&tiles, &models, &widened(first)).map_err(|e| wrong(Reason::of(&e)))?;
        let reader = Reader { tiles: Arc::clone(&tiles), models: Arc::clone(&models), views };
        let (piece, colors) = reader.read(piece).map_err(|e| wrong(e.into()))?;
        let about = tiles.about();
        let size = [about.height, about.width];
        let phases = (0..about.colors.len()).map(|color| tiles.read(color, [0, 0], size)).collect::<Result<_, _>>()?;
        let (wanted, arriving) = (Mailbox::<TileRect>::new(1), Mailbox::new(1));
        let (asks, reads) = (wanted.clone(), arriving.clone());
        let thread = Some(spawn("reads tiles", move || {
            // When this thread holds the only end of the mailbox, no session waits for pieces.
            while !asks.is_alone() {
                let Some(wanted) = asks.take_within(POLL_INTERVAL) else { continue };
                drop(reads.push(reader.read(wanted)));
            }
        })?);
        let field = Field { phases, size, piece };
        let (before, ahead, asked) = (None, None, None);
        let name = name.to_string();
        let far = Self { name, tiles, models, piece, number: 0, before, wanted, arriving, ahead, asked, thread };
        Ok((far, colors, field))
    }

    /// Predicts the position of the eye after [`AHEAD`] at its present velocity.
    fn later(&mut self, due: &Due) -> PupilDistribution {
        let before = self.before.replace((due.light_ns, due.pupil.centre));
        let Some((light_ns, from)) = before.filter(|before| before.0 < due.light_ns) else { return due.pupil };
        let seconds = (due.light_ns - light_ns) as f64 / SECOND_NS as f64;
        let about = self.tiles.about();
        let half = about.pitch * 0.5;
        let reach = [about.width, about.height].map(|n| n as f64 * half);
        let centre = [0, 1].map(|axis| {
            let velocity = (due.pupil.centre[axis] - from[axis]) / seconds;
            (due.pupil.centre[axis] + AHEAD * velocity).clamp(-reach[axis], reach[axis])
        });
        PupilDistribution { centre, ..due.pupil }
    }

    fn extent(&self, aim: &PupilDistribution) -> Result<TileRect, TiledError> {
        extent(&self.tiles, &self.models, aim)
    }

    /// Requests the piece around an aim, once.
    fn ask(&mut self, aim: &PupilDistribution) {
        let Ok(extent) = self.extent(&widened(aim)) else { return };
        if self.asked != Some(extent) && self.ahead.as_ref().is_none_or(|ahead| ahead.0 != extent) {
            self.asked = Some(extent);
            self.wanted.update(|_| extent);
        }
    }

    /// Takes the pieces that were read. In simulated time it waits for them.
    fn take(&mut self, patient: bool) -> Result<(), String> {
        while self.asked.is_some() {
            let read = if patient { self.arriving.take_within(POLL_INTERVAL) } else { self.arriving.take() };
            match read {
                Some(Ok(read)) => {
                    if self.asked == Some(read.0) {
                        self.asked = None;
                    }
                    self.ahead = Some(read);
                }
                Some(Err(reason)) => {
                    self.asked = None;
                    return Err(reason);
                }
                None if patient && !self.thread.as_ref().is_none_or(JoinHandle::is_finished) => {}
                None => break,
            }
        }
        Ok(())
    }
}

/// Returns the tiles that hold every pupil of an aim in every color.
fn extent(tiles: &Tiles, models: &Models, aim: &PupilDistribution) -> Result<TileRect, TiledError> {
    let mut all: Option<TileRect> = None;
    for (color, model) in models.iter().enumerate() {
        let one = TileRect::around(tiles, color, model.as_deref(), aim)?;
        all = Some(all.map_or(one, |all| all.with(&one)));
    }
    all.ok_or_else(|| TiledError::Unsuitable("it has no colors".into()))
}

/// Widens an aim by a margin, so that a pupil does not reach its end at once.
fn widened(aim: &PupilDistribution) -> PupilDistribution {
    PupilDistribution { diameter: aim.diameter.map(|d| d * (1.0 + 2.0 * MARGIN)), ..*aim }
}

impl Scenes for FarField {
    fn describe(&self) -> String {
        let about = self.tiles.about();
        format!("{}: {}x{} pixels in tiles of {}", self.name, about.height, about.width, self.tiles.side())
    }

    fn next(&mut self, due: &Due) -> Result<Newest, SessionError> {
        // A pupil beyond the SLM needs no refinement and is no error, because eyes look away.
        let Ok(needed) = self.extent(&due.pupil) else { return Ok(Newest::Same) };
        let later = self.later(due);
        let covered = self.piece.covers(&needed);
        if !covered && self.ahead.as_ref().is_none_or(|ahead| !ahead.0.covers(&needed)) {
            self.ask(&due.pupil);
        } else if self.extent(&later).is_ok_and(|extent| !self.piece.covers(&extent)) {
            self.ask(&later);
        }
        if let Err(reason) = self.take(due.patient) {
            return Ok(Newest::Refused(reason));
        }
        if covered {
            return Ok(Newest::Same);
        }
        let Some((extent, colors)) = self.ahead.take_if(|ahead| ahead.0.covers(&needed)) else {
            return Ok(Newest::Late(FrameFreshness::LateContent));
        };
        self.number += 1;
        self.piece = extent;
        // Pieces show the same moment of the scene, wherever they are.
        let frame = SceneFrame::new(self.number, Arc::new(colors));
        Ok(Newest::New(SceneFrame { piece: Some(extent), moment: None, ..frame }))
    }
}

impl Drop for FarField {
    fn drop(&mut self) {
        // The thread ends when it holds the only end of the mailbox.
        self.wanted = Mailbox::new(1);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

struct Reader {
    tiles: Arc<Tiles>,
    models: Arc<Models>,
    views: Vec<Views>,
}

impl Reader {
    fn read(&self, extent: TileRect) -> Read {
        let about = self.tiles.about();
        let one = |((i, views), model): ((usize, &Views), &Option<Arc<ModelTables>>)| -> Result<_, String> {
            let problem = extent.problem(&self.tiles, i, views, model.as_deref()).map_err(|e| e.to_string())?;
            let phases = self.tiles.read(i, extent.at, extent.size).map_err(|e| e.to_string())?;
            Ok(LiveColor { problem, phases, exposure: about.colors[i].exposure, laser: None })
        };
        let colors = self.views.iter().enumerate().zip(self.models.iter()).map(one);
        Ok((extent, colors.collect::<Result<_, _>>()?))
    }
}
