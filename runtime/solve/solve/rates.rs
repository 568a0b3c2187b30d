//! Seconds per unit of work, as they were measured on this machine.

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
    /// Points of the grid.
    points: f64,
    /// Per group of kernels, in the order of [`Group::ALL`].
    seconds: [f64; Group::ALL.len()],
}

/// Rates of an engine on a machine, measured ([`Rates::of`]).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Rates {
    /// With the projection, smallest grid first.
    project: Vec<Rate>,
    /// With Adam.
    adam: Vec<Rate>,
}

/// Sides of the square grids that are timed.
const SIDES: [usize; 4] = [128, 256, 512, 1024];
/// Timed steps of each, in groups and whole: the fewer where they are long, and vary little.
const ROUNDS: [usize; 2] = [4, 2];
/// A step that takes longer than this is long, seconds.
const LONG: f64 = 0.15;
/// What timing takes, bytes a point: views, fields and windows.
const BYTES: u64 = 800;
/// A step that takes longer than this is the last to be timed, seconds.
const LONGEST: f64 = 0.6;

/// As a file of the user's cache holds them.
#[derive(Serialize, Deserialize)]
struct StoredRates {
    engine: String,
    version: String,
    rates: Rates,
}

/// Files larger than this are not ours, bytes.
const LARGEST: u64 = 1 << 20;

impl StoredRates {
    /// What a file keeps of this engine, if it does: a file that cannot be read, is damaged or is another's is none.
    fn load(file: &Path, engine: &str) -> Option<Rates> {
        let kept: Self = serde_json::from_slice(&crate::files::read::bytes(file, LARGEST).ok()?).ok()?;
        let ours = kept.engine == engine && kept.version == env!("CARGO_PKG_VERSION") && kept.rates.is_sound();
        ours.then_some(kept.rates)
    }
}

impl Rates {
    /// Those of this engine that the user's cache keeps, or else, or `again`, measured and kept. `measuring` is told the
    /// engine's name before it is timed. Where nothing can be kept, the next call measures again.
    ///
    /// # Errors
    /// Those of the engine.
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
            tracing::warn!("there is no folder for caches, so that this is measured each time: set XDG_CACHE_HOME");
        }
        let rates = Self::measure(engine, storage)?;
        let kept = StoredRates { engine: name, version: env!("CARGO_PKG_VERSION").into(), rates };
        if let Some(file) = file {
            // A convenience: what keeps it from being kept is no one's concern.
            let _ = file.parent().map(std::fs::create_dir_all);
            let _ = write_file(&file, |out| Ok(serde_json::to_writer(out, &kept)?));
        }
        Ok(kept.rates)
    }

    /// Times steps of an ordinary solve (8 sub-frames, 16 pupils of 2 to 20 mm, 9 x 9 views) on `engine`, with fields
    /// stored so: one to three seconds on a CPU.
    ///
    /// # Errors
    /// Those of the engine.
    fn measure(engine: &mut dyn Engine, storage: Storage) -> Result<Self, EngineError> {
        let mut rates = Self { project: Vec::new(), adam: Vec::new() };
        let room = crate::memory::available().unwrap_or(u64::MAX);
        // The smallest is timed whatever there is.
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

    /// Whether these can be rates: read from a file, they might be anything.
    fn is_sound(&self) -> bool {
        let sound = |rates: &Vec<Rate>| {
            !rates.is_empty()
                && rates.windows(2).all(|r| r[0].points < r[1].points)
                && rates.iter().all(|r| r.points >= 1.0 && r.seconds.iter().all(|s| s.is_finite() && *s >= 0.0))
        };
        sound(&self.project) && sound(&self.adam)
    }

    /// Seconds per unit of work on a grid of so many points: between measured sizes by their logarithm.
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

/// Views of noise on the timed grid.
fn noise(side: usize) -> Arc<Pyramid> {
    let phases = random_phases(side * side, 1);
    let view: Vec<f32> = phases.iter().map(|p| p.abs()).collect();
    Arc::new(Pyramid::new(&[&view[..]; 81], side, side))
}

/// One size, one optimiser; also the seconds of a whole step.
fn measure(
    engine: &mut dyn Engine,
    side: usize,
    views: &Arc<Pyramid>,
    settings: Settings,
) -> Result<(Rate, f64), EngineError> {
    let display = Display { height: side, width: side, ..Display::preset("paper").expect("a preset") };
    let color = display.wavelengths[1].color;
    let grid = ViewGrid { rows: 9, columns: 9, cell: display.eyebox_min() / 9.0 };
    let outline = Problem::outline(&display, color, Default::default(), grid).expect("a colour of the display");
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
        // The first warms up: it makes buffers, plans and pipelines.
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
    // Groups that run by themselves wait for their slowest pupil each; in a step only the last one does. And a step is
    // what it is on average, not at its best.
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

/// Runs of neighbouring kernels of one group.
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

    /// A file that is cut off, holds what no rate is, or is of another engine is none.
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
