//! Looks up first phases of any picture in a table, by brightness, position in a tile, and sub-frame.
//!
//! A phase-only SLM makes a place dark by directing its light to places that no pupil sees. It makes a place even by
//! the joint choice of the phases of all sub-frames. Both depend on the display and on the brightness, not on the
//! scene. They are solved once, for seventeen brightnesses, on a tile that repeats over the SLM. The phases of a
//! picture are then looked up ([`table_start`](eyebox_kernels::table_start)) without a transform, and every pupil in
//! the eyebox sees the picture at once.
//!
//! For one plane and one brightness these are optimized random phases (A. Velez-Zea, J. F. Barrera-Ramirez and R.
//! Torroba, Optics Letters 43, 2018). In the far field the first phases come from the picture's Fourier transform
//! instead ([`transform`]). Colors that share their sub-frames have a table of their drive values ([`shared`]).

mod fit;
mod made_by;
pub(super) mod shared;
#[cfg(test)]
mod shared_tests;
#[cfg(test)]
mod tests;
mod transform;

use super::error::{SolveError, require};
use super::method::Method;
use super::outcome::{Flow, Progress};
use super::problem::Problem;
use super::settings::{FirstPhases, Settings};
use super::solver::Beginning;
use crate::engine::{EngineError, LookUp};
use crate::optics::{Color, Display, Geometry, Padding, Pupil};
use crate::scene::ViewGrid;
use eyebox_kernels::pupil_light;
use eyebox_kernels::table_start::{self, LEVELS};
use made_by::{Levels, MadeBy, SIDE};
use std::sync::Arc;
use std::time::Instant;

/// Tiles along each side of the smallest SLM that has a table. A smaller SLM is solved faster than its table is fitted.
const FEWEST_TILES: usize = 4;
/// Exposure of phases from a table without steps, relative to the exposure of a solve. The excess light hides their
/// unevenness (measured).
pub(super) const UNSTEPPED: f64 = 1.3;
/// Diameter of the pupil whose picture decides the phases, over the eyebox. A wider one blurs content off the SLM's
/// plane. A narrower one shows its own perspective to all others (measured).
const PUPIL: f64 = 0.7;
/// Position in its schedule at which a solve begins from a table. Its phases are nearly right and need smaller steps
/// (measured).
///
/// The same holds for the phases of a transform if the picture does not fill the image, because long steps throw light
/// outside it. Otherwise they need the whole schedule (measured).
const PROGRESS: f64 = 0.4;

/// Source of first phases of any picture for one color of a display. It is a table, or in the far field the picture's
/// Fourier transform.
#[derive(Debug, Clone, PartialEq)]
pub struct StartTable(By);

#[derive(Debug, Clone, PartialEq)]
enum By {
    Table(Table),
    /// A table of the drive values that all colors share, by the brightness of gray.
    Drive(Table),
    Transform {
        frames: usize,
    },
}

#[derive(Debug, Clone, PartialEq)]
struct Table {
    frames: usize,
    side: usize,
    /// Binary angles (sub-frames, side, side, levels).
    angles: Arc<[u16]>,
}

impl StartTable {
    /// Returns true if a display has first phases for any picture.
    ///
    /// The pixels of a mask differ from the SLM's, switched sources each serve a part of the eyebox, and a piece of a
    /// far field shows no picture of its own.
    fn exists(problem: &Problem) -> bool {
        let is_whole = problem.optics.geometry == Geometry::Relay || transform::exists(problem);
        is_whole && problem.optics.mask_factor <= 1 && problem.choice.is_none() && problem.regions.is_empty()
    }

    /// Returns true if solves for a display begin by a table by default. It then has a table, and is not too small to
    /// need one.
    pub fn fits(problem: &Problem) -> bool {
        Self::exists(problem) && problem.optics.height.min(problem.optics.width) >= FEWEST_TILES * SIDE
    }

    /// Returns the table of a display's color for `frames` sub-frames, from the user's cache or fitted and stored
    /// there.
    ///
    /// `observe` receives the fitted share. If it returns false, the fit ends, the partial result is stored, and the
    /// next call continues from there. The result is `None` if the display has no table, or if the fit was ended.
    ///
    /// The same display has the same table with every engine.
    ///
    /// # Errors
    /// The errors of [`solve`](super::solve).
    pub fn of(
        problem: &Problem,
        frames: usize,
        observe: &mut dyn FnMut(f64) -> bool,
    ) -> Result<Option<Self>, SolveError> {
        if !Self::exists(problem) {
            return Ok(None);
        }
        if problem.optics.geometry == Geometry::FarField {
            return Ok(Some(Self(By::Transform { frames })));
        }
        let made_by = MadeBy::of(problem, frames);
        let table = Table::of(&made_by, |levels| made_by.fit(problem, levels, observe))?;
        Ok(table.map(|table| Self(By::Table(table))))
    }

    /// Fits the tables of these colors of a display for `frames` sub-frames into the user's cache, before there is a
    /// scene to solve.
    ///
    /// Existing tables take no time. It returns the number of colors with a table. `observe` works as in
    /// [`of`](Self::of), over all colors.
    ///
    /// # Errors
    /// [`SolveError::Optics`] for a color that the display does not have, and the errors of [`solve`](super::solve).
    pub fn prepare(
        display: &Display,
        colors: &[Color],
        frames: usize,
        observe: &mut dyn FnMut(f64) -> bool,
    ) -> Result<usize, SolveError> {
        let views = ViewGrid { rows: 1, columns: 1, cell: display.eyebox_min() };
        let mut prepared = 0;
        for (at, color) in colors.iter().enumerate() {
            let problem = Problem::outline(display, *color, Padding::default(), views)?;
            if !Self::fits(&problem) || display.geometry == Geometry::FarField {
                continue;
            }
            let mut observe = |share: f64| observe((at as f64 + share) / colors.len() as f64);
            if Self::of(&problem, frames, &mut observe)?.is_none() {
                return Ok(prepared);
            }
            prepared += 1;
        }
        Ok(prepared)
    }

    /// Returns the look-up of the first phases of the scene of `problem` for an exposure, for an
    /// [engine](crate::engine::Engine::look_up).
    ///
    /// It is `None` in the far field and for drive values that colors share.
    pub fn look_up(&self, problem: &Problem, exposure: f64) -> Option<LookUp> {
        match &self.0 {
            By::Table(table) => Some(table.look_up(problem, exposure)),
            By::Drive(_) | By::Transform { .. } => None,
        }
    }

    /// Returns first phases (sub-frames, height, width) of the scene of `problem` for an exposure, radians in -pi ..
    /// pi.
    ///
    /// # Errors
    /// [`EngineError`] if the scene's light is on a device that does not answer.
    pub fn phases(&self, problem: &Problem, exposure: f64) -> Result<Vec<f32>, EngineError> {
        match &self.0 {
            By::Table(table) => table.look_up(problem, exposure).phases(),
            By::Drive(table) => table.drives(&[problem], &[exposure]),
            By::Transform { frames } => transform::phases(problem, &pupil(problem), *frames),
        }
    }
}

impl Table {
    /// Returns the table from the user's cache, or fits and stores it. The result is `None` if the fit was ended.
    fn of(
        made_by: &MadeBy,
        fit: impl FnOnce(&mut Levels) -> Result<(), SolveError>,
    ) -> Result<Option<Self>, SolveError> {
        let mut levels = made_by.load();
        if !levels.are_all() {
            fit(&mut levels)?;
            made_by.save(&levels);
        }
        Ok(levels.are_all().then(|| Self::made(made_by, &levels)))
    }

    /// Packs fitted levels, with the level as the last axis. Missing levels are zero.
    fn made(made_by: &MadeBy, levels: &Levels) -> Self {
        let (frames, side) = (made_by.frames, made_by.side);
        let mut angles = vec![0; frames * side * side * LEVELS];
        for (at, level) in levels.0.iter().enumerate() {
            let of_level = angles.iter_mut().skip(at).step_by(LEVELS);
            of_level.zip(level.iter().flatten()).for_each(|(to, angle)| *to = *angle);
        }
        Self { frames, side, angles: angles.into() }
    }

    fn look_up(&self, problem: &Problem, exposure: f64) -> LookUp {
        let (optics, grid) = (problem.optics, problem.padding.grid(problem.optics));
        let [top, left] = [(grid.height - optics.height) / 2, (grid.width - optics.width) / 2];
        let [height, width, line] = [optics.height, optics.width, grid.width].map(|n| n as u32);
        let seen = problem.views.coverage(&pupil(problem));
        let place = pupil_light::Args {
            height,
            width,
            line,
            first: (top * grid.width + left) as u32,
            stride: (grid.height * grid.width) as u32,
            from: 0,
            begin: 0,
            end: seen.len() as u32,
            adds: 0,
        };
        let args = table_start::Args {
            height,
            width,
            side: self.side as u32,
            first: 0,
            frames: self.frames as u32,
            factor: 0,
            shift: 0,
            evenly_lit: 1,
            stride: height * width,
            angles: 1,
        };
        // This is the light of all views at full scale, relative to the 2^32 that the factor expects.
        let full = f64::from(problem.pyramid.scale) / 65_535.0 * 65_536.0;
        LookUp {
            table: Arc::clone(&self.angles),
            views: Arc::clone(&problem.pyramid),
            shares: pupil_light::shares(&seen),
            place,
            args: args.brightness(full / exposure),
            needs: problem.model.as_ref().and_then(|model| model.needs()),
        }
    }
}

/// Returns the pupil whose picture the first phases show.
fn pupil(problem: &Problem) -> Pupil {
    let [x, y] = problem.center.map(|at| -at);
    Pupil { x, y, diameter: PUPIL * problem.eyebox, depth: 0.0 }
}

impl Settings {
    /// Returns true if a solve with these settings begins by a table. A table serves pupils anywhere in the eyebox and
    /// phases of one color.
    pub(super) fn may_begin_by_table(&self, problem: &Problem) -> bool {
        self.joint.is_none() && self.wants_table(StartTable::exists(problem), StartTable::fits(problem))
    }

    /// Returns true if a solve begins by a table. Without steps it must exist, and with steps it must be worth its fit.
    fn wants_table(&self, exists: bool, fits: bool) -> bool {
        let is_own = self.method == Method::Slfh && self.motion.is_still();
        is_own && self.first_phases == FirstPhases::Table && if self.steps == 0 { exists } else { fits }
    }

    /// Returns these settings for phases of the table alone ([`Method::Table`]).
    pub(super) fn as_of_table(&self, problem: &Problem) -> Result<Self, SolveError> {
        let of_table = Self { method: Method::Slfh, first_phases: FirstPhases::Table, steps: 0, ..self.clone() };
        let right = "another for colors that share their sub-frames, for switched sources, and behind a mask";
        require(of_table.may_begin_by_table(problem), "the method", self.method.name(), right)?;
        Ok(of_table)
    }
}

/// Returns the first phases of a solve that would have this exposure from random phases, or `None` without a table.
/// `observe` receives the fitted share of the table.
pub(super) fn beginning(
    problem: &Problem,
    settings: &Settings,
    exposure: f64,
    start: Instant,
    observe: &mut dyn FnMut(&Progress) -> Flow,
) -> Result<Option<Beginning>, SolveError> {
    if !settings.may_begin_by_table(problem) {
        return Ok(None);
    }
    let steps = settings.steps;
    let table = StartTable::of(problem, settings.frames, &mut |share| {
        observe(&fitting(share, steps, start)) == Flow::Continue
    })?;
    let Some(table) = table else {
        // The fit was ended. Steps can start from random phases, but without steps those are not a hologram.
        return if steps == 0 { Err(EngineError::Stopped.into()) } else { Ok(None) };
    };
    let exposure = if steps == 0 { UNSTEPPED * exposure } else { exposure };
    let progress = match &table.0 {
        By::Transform { .. } if problem.share >= 1.0 => 0.0,
        _ => PROGRESS,
    };
    Ok(Some(Beginning { phases: table.phases(problem, exposure)?, exposure, progress }))
}

/// Returns the progress while this share of a table is fitted.
fn fitting(share: f64, steps: usize, start: Instant) -> Progress<'static> {
    let seconds = start.elapsed().as_secs_f64();
    Progress { pilot: None, fitting: Some(share), step: 0, steps, seconds, loss: f64::NAN, validation: None }
}

#[cfg(any(test, feature = "test-hooks"))]
impl StartTable {
    /// Fits a table with fewer steps than usual.
    pub fn quick(problem: &Problem, frames: usize) -> Self {
        let made_by = MadeBy::of(problem, frames).sized(SIDE, [48, 8]);
        let mut levels = Levels::default();
        made_by.fit(problem, &mut levels, &mut |_| true).expect("a table");
        Self(By::Table(Table::made(&made_by, &levels)))
    }

    /// Returns the table of a tile whose phases are all zero.
    pub fn even(frames: usize) -> Self {
        Self(By::Table(Table { frames, side: 1, angles: vec![0; frames * LEVELS].into() }))
    }
}
