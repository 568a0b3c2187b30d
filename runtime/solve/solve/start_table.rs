//! First phases of any picture, by a table: for a brightness, a place in a tile and a sub-frame the phase to begin with.
//!
//! A phase-only SLM makes a place dark by sending its light where no pupil looks, and even by choosing the phases of all sub-frames
//! together. Both depend on the display and on how bright the place is, not on the scene: they are solved once, for seventeen
//! brightnesses, on a tile that repeats over the SLM. A picture's phases are then looked up ([`table_start`](eyebox_kernels::table_start)) without a transform, and
//! every pupil in the eyebox sees the picture at once. For one plane and one brightness these are optimized random phases (A.
//! Velez-Zea, J. F. Barrera-Ramirez and R. Torroba, Optics Letters 43, 2018). In the far field they come from the picture's Fourier
//! transform instead ([`transform`]). Colors that share their sub-frames have a table of their drive ([`shared`]).

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

/// Tiles along each side of an SLM from which on it has a table: a smaller one is solved sooner than its table is fitted.
const FEWEST_TILES: usize = 4;
/// Exposure of phases from a table that no step follows, over the one of a solve: light to spare hides their unevenness (measured).
pub(super) const UNSTEPPED: f64 = 1.3;
/// Diameter of the pupil whose picture is looked up, over the eyebox: a wider one blurs what is off the SLM's plane, a narrower one shows
/// all others its own perspective (measured).
const PUPIL: f64 = 0.7;
/// Place in its schedule at which a solve begins from a table: its phases are nearly right and want smaller steps (measured). So do those
/// of a transform where the picture does not fill the image: long steps throw light beside it. Else they want the whole schedule (measured).
const PROGRESS: f64 = 0.4;

/// What first phases of any picture come from, for one color of a display: a table, or in the far field the picture's Fourier transform.
#[derive(Debug, Clone, PartialEq)]
pub struct StartTable(By);

#[derive(Debug, Clone, PartialEq)]
enum By {
    Table(Table),
    /// Of the drive that all colors share, by how bright gray is.
    Drive(Table),
    Transform {
        frames: usize,
    },
}

#[derive(Debug, Clone, PartialEq)]
struct Table {
    frames: usize,
    side: usize,
    /// (sub-frames, side, side, levels), binary angles.
    angles: Arc<[u16]>,
}

impl StartTable {
    /// Whether a display has first phases for any picture. A mask's pixels are not the SLM's, sources that are switched serve a part of
    /// the eyebox each, and a piece of a far field shows no picture of its own.
    fn exists(problem: &Problem) -> bool {
        let is_whole = problem.optics.geometry == Geometry::Relay || transform::exists(problem);
        is_whole && problem.optics.mask_factor <= 1 && problem.choice.is_none() && problem.regions.is_empty()
    }

    /// Whether what is solved for a display begins by a table if nothing else is asked for: it has one, and is not so small that
    /// it needs none.
    pub fn fits(problem: &Problem) -> bool {
        Self::exists(problem) && problem.optics.height.min(problem.optics.width) >= FEWEST_TILES * SIDE
    }

    /// The table of a display's color for so many sub-frames: the one that the user's cache keeps, or else fitted and kept. `observe`
    /// is told the share that is fitted; if it answers false, the fit ends, what it has is kept, and goes on from there the next time.
    /// None if the display has no table, or the fit was ended.
    ///
    /// The same display has the same table, whatever engine uses it.
    ///
    /// # Errors
    /// Those of [`solve`](super::solve).
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

    /// Fits the tables of these colors of a display for so many sub-frames into the user's cache, before there is a scene to solve. Tables
    /// that are there already cost nothing. Returns how many of the colors have one now. `observe` is as in [`of`](Self::of), over all colors.
    ///
    /// # Errors
    /// [`SolveError::Optics`] for a color that the display does not have; those of [`solve`](super::solve).
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

    /// The look-up of the first phases of the scene of `problem` for an exposure, which an [engine](crate::engine::Engine::look_up) makes;
    /// none in the far field, and of drives that colors share.
    pub fn look_up(&self, problem: &Problem, exposure: f64) -> Option<LookUp> {
        match &self.0 {
            By::Table(table) => Some(table.look_up(problem, exposure)),
            By::Drive(_) | By::Transform { .. } => None,
        }
    }

    /// First phases (sub-frames, height, width) of the scene of `problem` for an exposure, radians in -pi .. pi.
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
    /// The one that the user's cache keeps, or else fitted and kept; none if the fit was ended.
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

    /// Of fitted levels, innermost. Levels that are not there are zero.
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
        // Light of all views at full scale, over the 2^32 that the factor is for.
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

/// The pupil whose picture first phases show.
fn pupil(problem: &Problem) -> Pupil {
    let [x, y] = problem.center.map(|at| -at);
    Pupil { x, y, diameter: PUPIL * problem.eyebox, depth: 0.0 }
}

impl Settings {
    /// Whether a solve by these settings begins by a table, which is for pupils anywhere in the eyebox and for phases of one color.
    pub(super) fn may_begin_by_table(&self, problem: &Problem) -> bool {
        self.joint.is_none() && self.wants_table(StartTable::exists(problem), StartTable::fits(problem))
    }

    /// Whether a solve begins by a table that exists, or that is worth its fit if steps follow.
    fn wants_table(&self, exists: bool, fits: bool) -> bool {
        let is_own = self.method == Method::Slfh && self.motion.is_still();
        is_own && self.first_phases == FirstPhases::Table && if self.steps == 0 { exists } else { fits }
    }

    /// These for phases of the table alone ([`Method::Table`]).
    pub(super) fn as_of_table(&self, problem: &Problem) -> Result<Self, SolveError> {
        let of_table = Self { method: Method::Slfh, first_phases: FirstPhases::Table, steps: 0, ..self.clone() };
        let right = "another for colors that share their sub-frames, for switched sources, and behind a mask";
        require(of_table.may_begin_by_table(problem), "the method", self.method.name(), right)?;
        Ok(of_table)
    }
}

/// What a solve begins with that would have this exposure from random phases; none where nothing is for it. `observe` is told how much
/// of the table is fitted.
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
        // Its fit was ended. Steps would go on from random phases; without any those are no hologram.
        return if steps == 0 { Err(EngineError::Stopped.into()) } else { Ok(None) };
    };
    let exposure = if steps == 0 { UNSTEPPED * exposure } else { exposure };
    let progress = match &table.0 {
        By::Transform { .. } if problem.share >= 1.0 => 0.0,
        _ => PROGRESS,
    };
    Ok(Some(Beginning { phases: table.phases(problem, exposure)?, exposure, progress }))
}

/// What is observed while this share of a table is fitted.
fn fitting(share: f64, steps: usize, start: Instant) -> Progress<'static> {
    let seconds = start.elapsed().as_secs_f64();
    Progress { pilot: None, fitting: Some(share), step: 0, steps, seconds, loss: f64::NAN, validation: None }
}

#[cfg(any(test, feature = "test-hooks"))]
impl StartTable {
    /// A table of fewer steps than usual.
    pub fn quick(problem: &Problem, frames: usize) -> Self {
        let made_by = MadeBy::of(problem, frames).sized(SIDE, [48, 8]);
        let mut levels = Levels::default();
        made_by.fit(problem, &mut levels, &mut |_| true).expect("a table");
        Self(By::Table(Table::made(&made_by, &levels)))
    }

    /// The table of a tile whose phases are all zero.
    pub fn even(frames: usize) -> Self {
        Self(By::Table(Table { frames, side: 1, angles: vec![0; frames * LEVELS].into() }))
    }
}
