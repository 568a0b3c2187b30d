//! Solves the built-in scene for the tests of a device.

use crate::common;
use crate::{Failure, progress};
use eyebox::low_level::engine::{Engine, Storage};
use eyebox::low_level::optics::{Color, Display};
use eyebox::low_level::produce::solve_colors;
use eyebox::low_level::quality::ColorJob;
use eyebox::low_level::reason;
use eyebox::low_level::scene::{self, Request};
use eyebox::low_level::solve::{Flow, Levels, Settings, Solution};

/// The scene of the test.
const SCENE: &str = "builtin:still-life";

/// The size of a solve.
#[derive(Clone, Copy)]
pub struct Solve {
    /// Rows and columns of the display.
    pub size: [usize; 2],
    pub pupils: usize,
    pub steps: usize,
}

/// Solves the scene of the test in green.
pub fn solve(engine: &mut dyn Engine, of: Solve, storage: Storage) -> Result<Solution, Failure> {
    let mut display = Display::load("paper")?;
    [display.height, display.width] = of.size;
    let field = scene::load(SCENE, &Request::new(&display, &[Color::Green]))?;
    let depth = field.depths(&display, None)?;
    let diameter = common::diameters(None, &display, false)?;
    let (steps, pupils) = (of.steps, of.pupils);
    let settings = Settings { steps, pupils, storage, depth, diameter, ..Settings::default() };
    let levels = Levels::of(&display);
    let job = ColorJob { field: &field, color: Color::Green, display: &display, base: settings.clone(), levels };
    let solved = solve_colors(&job, &[Color::Green], &settings, engine, &mut |_| {
        if progress::interrupted() { Flow::Stop } else { Flow::Continue }
    })?;
    let solution = solved.into_iter().next().map(|(_, solution)| solution);
    solution.ok_or_else(|| Failure::Arguments(reason!("nothing-solved", "no color was solved")))
}
