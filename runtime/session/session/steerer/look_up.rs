//! What a scene begins with that brings no phases and that the phases before do not fit: those that a table has for it
//! ([`StartTable`]).

use super::{SteeredColor, Steerer};
use crate::engine::EngineError;
use crate::session::error::SessionError;
use crate::solve::StartTable;
use std::sync::Arc;

/// The table of each color, from the user's cache or fitted, of which `observe` is told: the share of all that is fitted. None for colors
/// that have none.
///
/// # Errors
/// Those of the fit.
pub fn start_tables(
    colors: &[SteeredColor],
    observe: &mut dyn FnMut(f64) -> bool,
) -> Result<Vec<Option<Arc<StartTable>>>, SessionError> {
    let count = colors.len() as f64;
    let one = |(at, color): (usize, &SteeredColor)| {
        if !StartTable::fits(&color.problem) {
            return Ok(None);
        }
        let mut observe = |share: f64| observe((at as f64 + share) / count);
        Ok(StartTable::of(&color.problem, color.frames(), &mut observe)?.map(Arc::new))
    };
    colors.iter().enumerate().map(one).collect()
}

impl Steerer {
    /// With the table of each color; none where there is none. Colors that share their sub-frames have no use for them: phases of one
    /// color are not those of another.
    #[must_use]
    pub fn with_start_tables(mut self, tables: Vec<Option<Arc<StartTable>>>) -> Self {
        if self.shared.is_some() {
            return self;
        }
        for (color, table) in self.colors.iter_mut().zip(tables) {
            color.table = table;
        }
        self
    }

    /// Whether [`fit`](Self::fit) has something to look at: a scene came that is another picture altogether, and brought no phases.
    pub fn wants_fit(&self) -> bool {
        self.colors.iter().any(|color| color.unfit)
    }

    /// Colors whose scene is another picture altogether go on with the phases of the table: how many that are. The phases before are not
    /// compared with them, because two losses take longer than the one step that is worth more (measured).
    ///
    /// # Errors
    /// Those of the engines.
    pub fn fit(&mut self) -> Result<u32, EngineError> {
        let mut looked_up = 0;
        for color in self.colors.iter_mut().filter(|color| color.unfit) {
            color.unfit = false;
            let Some(table) = &color.table else { continue };
            color.refiner.look_up(table)?;
            looked_up += 1;
        }
        Ok(looked_up)
    }

    /// Begins with phases that are given, color by color, whatever is lost.
    ///
    /// # Errors
    /// Those of the engines.
    pub fn begin_with(&mut self, phases: &[Vec<f32>]) -> Result<(), EngineError> {
        for (color, phases) in self.colors.iter_mut().zip(phases) {
            color.unfit = false;
            color.refiner.restart(phases)?;
        }
        Ok(())
    }
}
