//! Looks up first drive values of colors that share their sub-frames, in a table with levels of gray.
//!
//! One drive value turns the light of each color by its own slope. On a tile on which all colors show the same gray,
//! the joint solve finds drive values that are right for all of them. The mean brightness of a picture's colors decides
//! its drive values. The steps correct the differences between the colors.

use super::made_by::MadeBy;
use super::{By, StartTable, Table, fitting};
use crate::engine::{EngineError, LookUp};
use crate::optics::{Geometry, Laser};
use crate::solve::error::SolveError;
use crate::solve::outcome::{Flow, Progress};
use crate::solve::problem::Problem;
use crate::solve::settings::Settings;
use std::time::Instant;

/// Position in its schedule at which a joint solve begins from a table.
///
/// After 60 steps the mean is 0.2 dB above that from random drive values, and the worst pupil 0.3 to 0.4 dB. At the
/// position of one color the mean falls by up to 0.1 dB. At position 0 the worst pupil is 0.2 dB lower after five steps
/// (docs/results/simultaneous-color.json).
pub(in crate::solve) const PROGRESS: f64 = 0.2;

/// Colors, their lasers and their exposures.
pub(in crate::solve) type ColorsInLight<'a> = (&'a [Problem], &'a [Laser], &'a [f64]);

/// Provides the drive values with which a joint solve begins, as [`beginning`] does.
pub(in crate::solve) type BeginJoint<'a> = dyn FnMut(
        ColorsInLight<'_>,
        &Settings,
        Instant,
        &mut dyn FnMut(&Progress) -> Flow,
    ) -> Result<Option<Vec<f32>>, SolveError>
    + 'a;

impl StartTable {
    /// Returns true if colors that share their sub-frames have first phases for any picture. A far field has none,
    /// because its tiles all differ and the transform of a picture has one color.
    fn exists_for_shared(colors: &[&Problem]) -> bool {
        let is_relay = |problem: &&Problem| problem.optics.geometry == Geometry::Relay && Self::exists(problem);
        !colors.is_empty() && colors.iter().all(is_relay)
    }

    /// Returns true if a joint solve of these colors begins by a table by default.
    pub fn fits_shared(colors: &[&Problem]) -> bool {
        Self::exists_for_shared(colors) && colors.iter().all(|problem| Self::fits(problem))
    }

    /// Returns the table of the drive values that these colors share in the light of these lasers, as [`of`](Self::of)
    /// does for one color.
    ///
    /// # Errors
    /// The errors of [`solve_joint`](crate::solve::solve_joint).
    pub fn of_shared(
        colors: &[&Problem],
        lasers: &[Laser],
        observe: &mut dyn FnMut(f64) -> bool,
    ) -> Result<Option<Self>, SolveError> {
        let Some(made_by) = MadeBy::of_shared(colors, lasers).filter(|_| Self::exists_for_shared(colors)) else {
            return Ok(None);
        };
        let table = Table::of(&made_by, |levels| made_by.fit_shared(colors, lasers, levels, observe))?;
        Ok(table.map(|table| Self(By::Drive(table))))
    }

    /// Returns true if it is the table of drive values that colors share.
    pub fn is_of_shared(&self) -> bool {
        matches!(self.0, By::Drive(_))
    }

    /// Returns first drive values (sub-frames, height, width) of a scene of these colors for their exposures, as phases
    /// of one turn in -pi .. pi.
    ///
    /// The result is `None` if this is [not the table](Self::is_of_shared) of drive values.
    ///
    /// # Errors
    /// [`EngineError`] if the scene's light is on a device that does not answer.
    pub fn drives(&self, colors: &[&Problem], exposures: &[f64]) -> Result<Option<Vec<f32>>, EngineError> {
        match &self.0 {
            By::Drive(table) => table.drives(colors, exposures).map(Some),
            By::Table(_) | By::Transform { .. } => Ok(None),
        }
    }
}

impl Table {
    pub(super) fn drives(&self, colors: &[&Problem], exposures: &[f64]) -> Result<Vec<f32>, EngineError> {
        let one = |(problem, exposure): (&&Problem, &f64)| self.look_up(problem, *exposure);
        LookUp::drives(&colors.iter().zip(exposures).map(one).collect::<Vec<_>>())
    }
}

/// Returns the drive values with which a joint solve at these exposures begins, as phases of one turn, or `None` for
/// random ones. `observe` receives the fitted share of the table.
pub(in crate::solve) fn beginning(
    (colors, lasers, exposures): ColorsInLight<'_>,
    settings: &Settings,
    start: Instant,
    observe: &mut dyn FnMut(&Progress) -> Flow,
) -> Result<Option<Vec<f32>>, SolveError> {
    let colors: Vec<&Problem> = colors.iter().collect();
    if !settings.wants_table(StartTable::exists_for_shared(&colors), StartTable::fits_shared(&colors)) {
        return Ok(None);
    }
    let steps = settings.steps;
    let table =
        StartTable::of_shared(&colors, lasers, &mut |share| observe(&fitting(share, steps, start)) == Flow::Continue)?;
    let Some(table) = table else {
        // The fit was ended, as for one color.
        return if steps == 0 { Err(EngineError::Stopped.into()) } else { Ok(None) };
    };
    Ok(table.drives(&colors, exposures)?)
}

#[cfg(any(test, feature = "test-hooks"))]
impl StartTable {
    /// Fits a table with fewer steps than usual.
    pub fn quick_shared(colors: &[&Problem], lasers: &[Laser]) -> Self {
        let made_by = MadeBy::of_shared(colors, lasers).expect("a color").sized(super::SIDE, [32, 6]);
        let mut levels = super::made_by::Levels::default();
        made_by.fit_shared(colors, lasers, &mut levels, &mut |_| true).expect("a table");
        Self(By::Drive(Table::made(&made_by, &levels)))
    }
}
