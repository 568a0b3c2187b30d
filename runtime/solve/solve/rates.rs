//! Measures and stores the seconds per unit of work of an engine on this machine.

use super::levels::{Levels, even_levels};
use super::optimizer::Optimizer;
use super::problem::Problem;
use super::sampling::random_phases;
use super::settings::Settings;
use super::step::{Steps, take};
use crate::engine::{Buffer, Engine, EngineError};
use crate::files::{cache_folder, write_file};
use crate::optics::Display;
use crate::plan::{self, Group, Step, Storage};
use crate::scene::{Pyramid, ViewGrid};
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::path::Path;
use std::slice;
use std::sync::Arc;
use std::time::Instant;

/// Seconds per unit of work at one size of the grid.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Rate {
    /// Number of points of the grid.
    points: f64,
    /// Seconds per group of kernels, in the order of [`Group::ALL`].
    seconds: [f64; Group::ALL.len()],
}

/// Rates of an engine on a machine, as measured by [`Rates::of`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Rates {
    /// Rates of the projection, smallest grid first.
    project: Vec<Rate>,
    /// Rates of Adam, smallest grid first.
    adam: Vec<Rate>,
}

/// Sides of the square grids that are timed.
const SIDES: [usize; 4] = [128, 256, 512, 1024];
/// Timed steps of each grid, in groups and whole. Long steps are timed less often because they vary little.
const ROUNDS: [usize; 2] = [4, 2];
/// A step that takes longer than this is long, in seconds.
const LONG: f64 = 0.15;
/// Memory for the timing in bytes per point, for views, fields and windows.
const BYTES: u64 = 800;
/// A step that takes longer than this is the last one to be timed, in seconds.
const LONGEST: f64 = 0.6;

/// The content of a file of the user's cache.
#[derive(Serialize, Deserialize)]
struct StoredRates {
    engine: String,
    version: String,
    rates: Rates,
}

/// Larger files are not read as rates, in bytes.
const LARGEST: u64 = 1 << 20;

impl StoredRates {
    /// Returns the rates of this engine from a file. A file that is unreadable, damaged or of another engine has none.
    fn load(file: &Path, engine: &str) -> Option<Rates> {
        let kept: Self = serde_json::from_slice(&crate::files::read::bytes(file, LARGEST).ok()?).ok()?;
        let ours = kept.engine == engine && kept.version == env!("CARGO_PKG_VERSION") && kept.rates.is_sound();
        ours.then_some(kept.rates)
    }
}

impl Rates {
    /// Returns the rates of this engine from the user's cache, or measures and stores them.
    ///
    /// With `again` it always measures. `measuring` receives the engine's name before the measurement. If the rates
    /// cannot be stored, the next call measures again.
    ///
    /// # Errors
    /// [`EngineError`] if the engine fails.
    pub fn of(
        engine: &mut dyn Engine,
        storage: Storage,
        again: bool,
        measuring: impl FnOnce(&str),
    ) -> Result<Self, EngineError> {
        let name = format!("{}, {}", engine.describe(), storage.name());
        let file = cache_folder().map(|f| f.join(format!("rates-{:08x}.json", crc32c::crc32c(name.as_bytes()))));
        if let Some(rates) = file.as_ref().filter(|_| !again).and_then(|f| StoredRates::load(f, &name)) {
            return Ok(rates);
        }
        measuring(&name);
        if file.is_none() {
            tracing::warn!("no cache folder: the rates are measured each time. Set XDG_CACHE_HOME");
        }
        let rates = Self::measure(engine, storage)?;
        let kept = StoredRates { engine: name, version: env!("CARGO_PKG_VERSION").into(), rates };
        if let Some(file) = file {
            // The cache is a convenience, so failures to store are ignored.
            let _ = file.parent().map(std::fs::create_dir_all);
            let _ = write_file(&file, |out| Ok(serde_json::to_writer(out, &kept)?));
        }
        Ok(kept.rates)
    }

    /// Times steps of an ordinary solve (8 sub-frames, 16 pupils of 2 to 20 mm, 9 x 9 views) on `engine` with this
    /// storage of fields. This takes one to three seconds on a CPU.
    ///
    /// # Errors
    /// [`EngineError`] if the engine fails.
    fn measure(engine: &mut dyn Engine, storage: Storage) -> Result<Self, EngineError> {
        let mut rates = Self { project: Vec::new(), adam: Vec::new() };
        let room = crate::memory::available().unwrap_or(u64::MAX);
        // The smallest grid is timed regardless of the memory.
        let sides = SIDES.into_iter().enumerate().filter(|(i, side)| *i == 0 || (side * side) as u64 * BYTES < room);
        for (_, side) in sides {
            let views = noise(side);
            let mut longest = 0.0f64;
            for (optimizer, rates) in
                [(Optimizer::projection(), &mut rates.project), (Optimizer::adam(), &mut rates.adam)]
            {
                let (rate, seconds) =
                    measure(engine, side, &views, Settings { optimizer, storage, ..Settings::default() })?;
                rates.push(rate);
                longest = longest.max(seconds);
            }
            if longest > LONGEST {
                break;
            }
        }
        Ok(rates)
    }

    /// Returns true if these values can be rates. A file might contain anything.
    fn is_sound(&self) -> bool {
        let sound = |rates: &Vec<Rate>| {
            !rates.is_empty()
                && rates.windows(2).all(|r| r[0].points < r[1].points)
                && rates.iter().all(|r| r.points >= 1.0 && r.seconds.iter().all(|s| s.is_finite() && *s >= 0.0))
        };
        sound(&self.project) && sound(&self.adam)
    }

    /// Returns the seconds per unit of work on a grid of `points` points, interpolated between measured sizes by their
    /// logarithm.
    pub(super) fn at(&self, adam: bool, points: f64) -> [f64; Group::ALL.len()] {
        let rates = if adam { &self.adam } else { &self.project };
        let above = rates.iter().position(|r| r.points >= points);
        let (low, high) = match above {
            Some(0) => (rates[0], rates[0]),
            Some(i) => (rates[i - 1], rates[i]),
            None => (rates[rates.len() - 1], rates[rates.len() - 1]),
        };
        let span = (high.points / low.points).ln();
        let share = if span > 0.0 { (points / low.points).ln() / span } else { 0.0 };
        std::array::from_fn(|i| low.seconds[i] + share * (high.seconds[i] - low.seconds[i]))
    }
}

/// Makes views of noise on the timed grid.
fn noise(side: usize) -> Arc<Pyramid> {
    let phases = random_phases(side * side, 1);
    let view: Vec<f32> = phases.iter().map(|p| p.abs()).collect();
    Arc::new(Pyramid::new(&[&view[..]; 81], side, side))
}

/// Measures one size with one optimizer. It also returns the seconds of a whole step.
fn measure(
    engine: &mut dyn Engine,
    side: usize,
    views: &Arc<Pyramid>,
    settings: Settings,
) -> Result<(Rate, f64), EngineError> {
    let display = Display { height: side, width: side, ..Display::preset("paper").expect("a preset") };
    let color = display.wavelengths[1].color;
    let grid = ViewGrid { rows: 9, columns: 9, cell: display.eyebox_min() / 9.0 };
    let outline = Problem::outline(&display, color, Default::default(), grid).expect("a color of the display");
    let problem = Problem { pyramid: Arc::clone(views), ..outline };
    let levels = Levels::Given(even_levels(16));
    let settings = Settings { seed: 3, levels, ..settings };
    let planner = problem.planner_of(&settings);
    let shape = planner.shape(settings.optimizer.purpose());
    engine.load(&shape, Some(Arc::clone(views)))?;
    engine.write(Buffer::Phases, &random_phases(settings.frames * side * side, 2))?;
    if let Some(levels) = settings.levels.table() {
        engine.write(Buffer::Levels, &levels)?;
    }
    let mut steps = Steps::new(&problem, &planner, &settings, 1.0, engine.memory());
    let mut best = [f64::INFINITY; Group::ALL.len()];
    let (mut round, mut rounds) = (0, ROUNDS[0]);
    while round <= rounds {
        let step = steps.next(0.0);
        let work = plan::work(&step, &shape);
        let mut seconds = [0.0; Group::ALL.len()];
        for (group, part) in parts(&step) {
            let start = Instant::now();
            engine.run_part(&step, part)?;
            seconds[group as usize] += start.elapsed().as_secs_f64();
        }
        // The first round warms up, because it makes buffers, plans and pipelines.
        if round > 0 {
            for ((best, seconds), work) in best.iter_mut().zip(seconds).zip(work) {
                *best = best.min(seconds / work.max(1.0));
            }
            if seconds.iter().sum::<f64>() > LONG {
                rounds = ROUNDS[1];
            }
        }
        round += 1;
    }
    // Groups that run alone each wait for their slowest pupil, but in a step only the last group does. The rate also
    // belongs to an average step, not to the best one.
    let (mut expected, mut taken) = (0.0, 0.0);
    for _ in 0..rounds {
        let step = steps.next(0.0);
        expected += plan::work(&step, &shape).iter().zip(best).map(|(w, s)| w * s).sum::<f64>();
        let start = Instant::now();
        take(engine, &step, slice::from_ref(&(0..step.list.len())))?;
        taken += start.elapsed().as_secs_f64();
    }
    let seconds = best.map(|s| s * taken / expected.max(1e-12));
    Ok((Rate { points: (side * side) as f64, seconds }, taken / rounds as f64))
}

/// Returns runs of neighboring kernels of one group.
fn parts(step: &Step) -> Vec<(Group, Range<usize>)> {
    let mut parts: Vec<(Group, Range<usize>)> = Vec::new();
    for (i, dispatch) in step.list.iter().enumerate() {
        let group = dispatch.kernel.group();
        match parts.last_mut() {
            Some((last, range)) if *last == group => range.end = i + 1,
            _ => parts.push((group, i..i + 1)),
        }
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file is not used if it is cut off, holds impossible rates, or is from another engine.
    #[test]
    fn damaged_rates_are_none() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("rates.json");
        let rate = |points| Rate { points, seconds: [1e-9; Group::ALL.len()] };
        let rates = Rates { project: vec![rate(64.0), rate(256.0)], adam: vec![rate(64.0)] };
        let kept = StoredRates { engine: "an engine".into(), version: env!("CARGO_PKG_VERSION").into(), rates };
        let whole = serde_json::to_string(&kept).unwrap();
        let load = |text: &str, engine| {
            std::fs::write(&file, text).unwrap();
            StoredRates::load(&file, engine)
        };
        assert_eq!(load(&whole, "an engine"), Some(kept.rates));
        assert_eq!(load(&whole, "another"), None);
        for end in 0..whole.len() {
            assert_eq!(load(&whole[..end], "an engine"), None, "{end}");
        }
        let damages = [
            ("[1e-9", "[-1e-9"),
            ("64.0", "512.0"),
            ("\"adam\":[", "\"adam\":[],\"other\":["),
            (env!("CARGO_PKG_VERSION"), "0.0"),
        ];
        for (what, with) in damages {
            assert!(whole.contains(what), "{what}");
            assert_eq!(load(&whole.replace(what, with), "an engine"), None, "{with}");
        }
    }
}
