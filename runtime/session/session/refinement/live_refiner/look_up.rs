//! Chooses first phases from a table ([`StartTable`]) for a new scene that brings no phases.
//!
//! This is for scenes that the previous phases do not fit.

use super::together::share;
use super::{LiveColor, LiveRefiner};
use crate::engine::EngineError;
use crate::optics::Laser;
use crate::session::frame_log::error::SessionError;
use crate::solve::{Problem, SharedDrives, StartTable};
use std::sync::Arc;

/// Returns the table of each color, from the cache of the user or newly fitted, or `None` for colors without a table.
/// Colors that share their sub-frames have one table of their drive. `observe` receives the share of all fits that is
/// done.
///
/// # Errors
/// Returns the errors of the fit.
pub fn start_tables(
    colors: &[LiveColor],
    observe: &mut dyn FnMut(f64) -> bool,
) -> Result<Vec<Option<Arc<StartTable>>>, SessionError> {
    if share(colors) {
        return Ok(vec![drive_table(colors, observe)?]);
    }
    let count = colors.len() as f64;
    let one = |(at, color): (usize, &LiveColor)| {
        if !StartTable::fits(&color.problem) {
            return Ok(None);
        }
        let mut observe = |share: f64| observe((at as f64 + share) / count);
        Ok(StartTable::of(&color.problem, color.frames(), &mut observe)?.map(Arc::new))
    };
    colors.iter().enumerate().map(one).collect()
}

/// Returns the table of the drive that these colors share, if their display has one.
fn drive_table(
    colors: &[LiveColor],
    observe: &mut dyn FnMut(f64) -> bool,
) -> Result<Option<Arc<StartTable>>, SessionError> {
    let problems: Vec<&Problem> = colors.iter().map(|color| &color.problem).collect();
    let lasers: Vec<Laser> = colors.iter().filter_map(|color| color.laser.clone()).collect();
    if !StartTable::fits_shared(&problems) {
        return Ok(None);
    }
    SharedDrives::check(problems.iter().copied().zip(&lasers))?;
    Ok(StartTable::of_shared(&problems, &lasers, observe)?.map(Arc::new))
}

/// Starts these colors with the phases that their [`start_tables`] hold for their scene. A color without a table is
/// left unchanged.
pub(in crate::session) fn begin_with_tables(
    colors: &mut [LiveColor],
    tables: &[Option<Arc<StartTable>>],
) -> Result<(), SessionError> {
    if share(colors) {
        let problems: Vec<&Problem> = colors.iter().map(|color| &color.problem).collect();
        let exposures: Vec<f64> = colors.iter().map(|color| color.exposure).collect();
        let Some(table) = tables.iter().flatten().next() else { return Ok(()) };
        let Some(drives) = table.drives(&problems, &exposures)? else { return Ok(()) };
        for color in colors {
            color.phases = color.laser.iter().flat_map(|laser| laser.phases(&drives)).collect();
        }
        return Ok(());
    }
    for (color, table) in colors.iter_mut().zip(tables) {
        if let Some(table) = table {
            color.phases = table.phases(&color.problem, color.exposure)?;
        }
    }
    Ok(())
}

impl LiveRefiner {
    /// Sets the tables that [`start_tables`] returns for these colors. A table of phases of one color does not fit a
    /// drive that colors share, so such tables are left out.
    #[must_use]
    pub fn with_start_tables(mut self, tables: Vec<Option<Arc<StartTable>>>) -> Self {
        let shares = self.shared.is_some();
        let fitting = |table: Option<Arc<StartTable>>| table.filter(|table| table.is_of_shared() == shares);
        if shares {
            let table = tables.into_iter().find_map(fitting);
            self.colors.iter_mut().for_each(|color| color.table.clone_from(&table));
        } else {
            self.colors.iter_mut().zip(tables).for_each(|(color, table)| color.table = fitting(table));
        }
        self
    }

    /// Returns true if [`fit`](Self::fit) has work to do, because a scene is a different picture and brought no phases.
    pub fn needs_reinit(&self) -> bool {
        self.colors.iter().any(|color| color.needs_reinit)
    }

    /// Starts colors whose scene is a different picture with the phases of the table, and returns the number of these
    /// colors. The previous phases are not compared, because two losses take longer than one step, and that step is
    /// worth more (measured).
    ///
    /// # Errors
    /// Returns the errors of the engines.
    pub fn fit(&mut self) -> Result<u32, EngineError> {
        if self.shared.is_some() {
            return self.fit_together();
        }
        let mut looked_up = 0;
        for color in self.colors.iter_mut().filter(|color| color.needs_reinit) {
            color.needs_reinit = false;
            let Some(table) = &color.table else { continue };
            color.refiner.look_up(table)?;
            looked_up += 1;
        }
        Ok(looked_up)
    }

    /// Starts with the given phases of each color, regardless of their loss. Colors that share their sub-frames start
    /// with the first entry as their drive, as phases of one turn.
    ///
    /// # Errors
    /// Returns the errors of the engines.
    pub fn begin_with(&mut self, phases: &[Vec<f32>]) -> Result<(), EngineError> {
        self.colors.iter_mut().for_each(|color| color.needs_reinit = false);
        if let Some(shared) = &mut self.shared {
            return phases.first().map_or(Ok(()), |drives| shared.restart(drives, &mut self.colors));
        }
        for (color, phases) in self.colors.iter_mut().zip(phases) {
            color.refiner.restart(phases)?;
        }
        Ok(())
    }
}
