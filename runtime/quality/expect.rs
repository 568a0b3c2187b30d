//! What a recipe is expected to cost, before anything runs: memory in bytes, and work in a unit of its own that measured
//! trials give a time.

use super::{QualityError, Recipe, Subject};
use crate::optics::Padding;
use crate::plan::Planner;
use crate::scene::{Pyramid, ViewGrid};
use crate::solve::{Optimizer, PupilRange, Sampler};

/// Steps whose pupils are drawn to see how large windows get.
const DRAWN: usize = 12;
/// Pupils of a solve's own verdicts, and how many verdicts it gives (see `solve`).
const JUDGED: f64 = 8.0;
const VERDICTS: f64 = 3.0;

/// What a recipe is expected to cost.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Expected {
    /// Work: about a nanosecond on a core.
    pub work: f64,
    /// Bytes of all buffers at the peak of the solve: the views' pyramid, the state, the windows in flight.
    pub bytes: u64,
}

impl Expected {
    /// Of a recipe, from its first pupils; nothing is loaded.
    ///
    /// # Errors
    /// A colour that the display does not have.
    pub fn new(subject: &Subject, recipe: &Recipe) -> Result<Self, QualityError> {
        let settings = subject.settings(recipe);
        let pixel = if recipe.fits(subject.display) { recipe.pixel.max(1) } else { 1 };
        let mut display = subject.display.clone();
        display.height /= pixel;
        display.width /= pixel;
        display.pitch *= pixel as f64;
        let optics = display.optics(subject.color)?;
        let padding = match recipe.padding {
            true => Subject { display: &display, ..subject.clone() }.required_padding()?,
            false => Padding::default(),
        };
        let planner = Planner::new(optics, settings.frames, settings.window).with_padding(padding);
        let (grid_height, grid_width) = (planner.grid.height, planner.grid.width);
        let (every, [[_, rows], [_, columns]]) = recipe.thinned(subject.field.grid);
        let views = ViewGrid { rows, columns, cell: every as f64 * subject.field.cell(subject.display) };

        let range = PupilRange {
            eyebox: display.eyebox_min(),
            diameter: settings.diameter,
            depth: settings.depth,
            diameters: settings.diameters,
        };
        let mut sampler = Sampler::new(range, settings.sequence, settings.seed);
        let frames = settings.frames as f64;
        // On the CPU halves are for comparison, and no smaller.
        let complex = settings.storage.bytes();
        let fft = |points: f64| frames * points * (2.0 * points.max(2.0).log2() + 8.0);
        // Each place in a step holds the largest window that it has had.
        let mut places = vec![0u64; settings.pupils];
        let mut windows = 0.0;
        let steps = DRAWN.min(settings.steps).max(1);
        let (mut in_flight, most) = (0, settings.window_bytes / size_of::<eyebox_kernels::Complex32>());
        for _ in 0..steps {
            let (mut held, mut slot) = (0, 0);
            for _ in 0..settings.pupils {
                let pupil = sampler.draw();
                let window = crate::optics::Window::new(&planner.grid, &pupil, planner.factor);
                let (level_height, level_width) = level([grid_height, grid_width], [window.rows, window.columns]);
                let (count, level) = (window.rows * window.columns, level_height * level_width);
                let taps = views.coverage(&pupil).len();
                windows += fft(count as f64) + (taps * level) as f64 + 4.0 * count as f64;
                // As `plan` groups pupil passes: those whose windows fit together.
                if slot > 0 && (held + count) * settings.frames > most {
                    (held, slot) = (0, 0);
                }
                held += count;
                places[slot] = places[slot].max((complex * settings.frames * count + 16 * count + 4 * level) as u64);
                slot += 1;
                in_flight = in_flight.max(slot);
            }
        }
        let points = (grid_height * grid_width) as f64;
        let pixels = (settings.frames * optics.height * optics.width) as u64;
        let grid = (grid_height * grid_width) as u64;
        let looks = JUDGED * ((VERDICTS + 1.0) * (20.0 * points) + VERDICTS * fft(points));
        let prepare = (rows * columns) as f64 * points * 12.0;
        let work = settings.steps as f64 * (1.5 * fft(points) + windows / steps as f64) + looks + prepare;

        // Phases, velocity, and the best state with the copy that it is read into; field and change are complex.
        let moments = if matches!(settings.optimizer, Optimizer::Adam { .. }) { 2 } else { 1 };
        let state = 4 * pixels * (3 + moments + u64::from(settings.levels.is_some()));
        let state = state + 2 * (complex * settings.frames) as u64 * grid + 4 * grid;
        let pyramid = 2 * (rows * columns) as u64 * grid * 4 / 3;
        let whole = (complex * settings.frames) as u64 * grid + 20 * grid;
        places[0] = places[0].max(whole);
        let windows = places.iter().take(in_flight.max(1)).sum::<u64>();
        Ok(Self { work, bytes: state + pyramid + windows })
    }
}

/// The level of the views' pyramid that a window's photograph is taken from.
fn level([height, width]: [usize; 2], [rows, columns]: [usize; 2]) -> (usize, usize) {
    let levels = Pyramid::sizes(height, width);
    levels.into_iter().rfind(|(h, w)| *h >= rows && *w >= columns).unwrap_or((height, width))
}
