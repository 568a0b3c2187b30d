//! Makes views on a grid from cameras at any positions.
//!
//! Patches of the central view are found again in the views around it, which measures how far content moves per meter.
//! Fourier disparity layers (OPTICS 14) explain all views at their positions, and give the views of a grid between
//! them.

use crate::depth::neighbors::{Found, Patches};
use crate::light_field::cameras::Positions;
use crate::synthesis::layers::Layers;
use crate::{CamerasFound, LightField, Request, SceneError, ViewGrid};
use eyebox_base::memory;
use eyebox_base::reason;
use std::path::Path;

/// Smallest and largest number of views along an axis.
const VIEWS: [usize; 2] = [3, 9];
/// Fewest patches that decide, and fewest that must agree at an end of the depths.
const LEAST: usize = 8;
const ENDS: usize = 2;
/// Views around the central one in which patches are searched, and the nearest of them, which measure the movement.
const AROUND: usize = 24;
const NEAREST: usize = 8;
/// The position of a camera explains the movement of a patch if it leaves at most this share of the squared movement,
/// or at most this error in pixels.
const EXPLAINED: f64 = 0.1;
const PIXELS: f64 = 0.75;
/// Positions are right if they explain this share of the patches that move.
const RIGHT: f64 = 0.6;
/// A patch moves as other positions predict if their residual is at most this share of the stated positions' residual.
/// The stated residual must exceed this number of pixels.
const CLEARLY: [f64; 2] = [0.5, 0.25];
/// Lowest accuracy of the layers for a view that is left out, dB.
const ENOUGH: f64 = 25.0;

/// Views on a grid, and how they were made.
pub(crate) struct Resampled {
    pub field: LightField,
    pub how: String,
    /// The contradiction between the pictures and the positions.
    pub cameras: Option<CamerasFound>,
}

/// Makes the views of a grid from views at `positions`, whose pictures have `own` rows and columns.
///
/// # Errors
/// [`SceneError::Settings`] for another number of views. [`SceneError::Depth`] if depths are neither stated nor
/// measured. [`SceneError::Memory`] if there is not enough memory.
pub(crate) fn resampled(
    place: &Path,
    field: LightField,
    positions: &Positions,
    own: [usize; 2],
    request: &Request,
) -> Result<Resampled, SceneError> {
    let count = field.grid[0] * field.grid[1];
    let all = positions.all();
    if all.len() != count {
        let reason = reason!(
            "positions-count",
            "positions_mm has {} positions, but there are {count} views, so give one for each",
            all.len()
        );
        return Err(SceneError::Settings { file: place.display().to_string(), reason });
    }
    // The origin is the center of all positions.
    let ends = |k: usize| all.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], p| [a.min(p[k]), b.max(p[k])]);
    let [x, y] = [0, 1].map(ends);
    let all: Vec<[f64; 2]> = all.iter().map(|p| [p[0] - 0.5 * (x[0] + x[1]), p[1] - 0.5 * (y[0] + y[1])]).collect();
    let spans = [x[1] - x[0], y[1] - y[0]];
    let display = request.display;
    let per_pixel = display.focal_length * display.picture_pixel();
    let measured = rates(&field, &all);
    let misplaced = measured.explained < RIGHT || measured.otherwise;
    let cameras = misplaced.then_some(CamerasFound::Misplaced((100.0 * measured.explained) as u8));
    if cameras.is_some() {
        let how = format!(", {count} cameras at positions of their own, which the pictures contradict");
        return Ok(Resampled { field, how, cameras });
    }
    let depth = match request.depth.or(field.depth) {
        Some([a, b]) => [a.min(b), a.max(b)],
        None => match measured.range {
            Some(range) => range.map(|rate| rate * per_pixel),
            None => return Err(SceneError::doubtful_depth([0.0; 2], measured.percent, display.focal_length)),
        },
    };
    let layers = Layers::at_positions(&field, &all, spans[0].max(spans[1]), display, depth)?;
    let eyebox = display.eyebox_min();
    let spans = spans.map(|span| span.min(eyebox));
    let longer = spans[0].max(spans[1]);
    // The movement is in pixels of the original pictures, because an enlarged picture shows no finer detail.
    let larger = (field.height as f64 / own[0] as f64).min(field.width as f64 / own[1] as f64).max(1.0);
    let moved = longer * (depth[1] - depth[0]) / per_pixel / larger;
    let n = (moved.ceil() as usize).clamp(VIEWS[0], VIEWS[1]);
    let cell = longer / n as f64;
    let along = |span: f64| ((span / cell).round() as usize).max(1);
    let grid = ViewGrid { rows: along(spans[1]), columns: along(spans[0]), cell };
    let places: Vec<(f64, f64)> = (0..grid.rows * grid.columns).map(|view| grid.position(view)).collect();
    let counts = [places.len(), field.colors.len(), field.height, field.width];
    let what = || format!("{} views of {} x {} pixels", places.len(), field.height, field.width);
    memory::check_available(what, memory::bytes_of(&counts, 4), "take a smaller size")?;
    let planes = (0..field.colors.len()).map(|color| layers.views(color, &places)).collect();
    let shown = layers.residual_between();
    let how = format!(
        ", {count} cameras at positions of their own, from which {} Fourier disparity layers make {} x {} views. They \
         predict a view that is left out with {shown:.1} dB",
        layers.count(),
        grid.rows,
        grid.columns
    );
    if shown < ENOUGH {
        tracing::warn!(
            "{}: the other views predict one that is left out with {shown:.1} dB only. Check positions_mm and the \
             depths, or place cameras closer to each other",
            place.display()
        );
    }
    Ok(Resampled { field: field.with_made(grid, planes, depth), how, cameras })
}

/// The result of the comparison of patches.
struct Rates {
    /// Smallest and largest movement per meter, in pixels of the light field.
    range: Option<[f64; 2]>,
    /// Share of the patches that move as the positions predict. It is 1 if nothing moves.
    explained: f64,
    /// True if mirrored or exchanged axes explain the movements clearly better.
    otherwise: bool,
    /// Percentage of the patches that are found again.
    percent: u8,
}

/// The position of a camera relative to the central one in meters, and the movement of a patch there in pixels.
type Move = ([f64; 2], [f64; 2]);

/// Returns the movement per meter that fits best, and the sum of squares of its residual. Near content moves against
/// the camera.
fn fitted(moves: &[Move]) -> (f64, f64) {
    let squares: f64 = moves.iter().map(|(q, _)| q[0] * q[0] + q[1] * q[1]).sum();
    let rate = -moves.iter().map(|(q, m)| q[0] * m[0] + q[1] * m[1]).sum::<f64>() / squares.max(1e-18);
    (rate, moves.iter().map(|(q, m)| (m[0] + rate * q[0]).powi(2) + (m[1] + rate * q[1]).powi(2)).sum())
}

/// Positions with one axis mirrored, with both axes exchanged, or both. If both axes are reversed, only near and far
/// are exchanged.
const OTHERWISE: [fn([f64; 2]) -> [f64; 2]; 3] = [|[x, y]| [x, -y], |[x, y]| [y, x], |[x, y]| [y, -x]];

/// Counts patches whose movements these positions explain clearly better than the stated ones, and the opposite.
fn votes(patches: &[Vec<Move>], otherwise: fn([f64; 2]) -> [f64; 2]) -> [usize; 2] {
    let vote = |moves: &Vec<Move>| {
        let other: Vec<Move> = moves.iter().map(|(q, m)| (otherwise(*q), *m)).collect();
        let [stated, other] = [moves, &other].map(|moves| fitted(moves).1);
        let noise = CLEARLY[1].powi(2) * moves.len() as f64;
        let clearly = |less: f64, more: f64| usize::from(more > noise && less < CLEARLY[0] * more);
        [clearly(other, stated), clearly(stated, other)]
    };
    patches.iter().map(vote).fold([0, 0], |sum, vote| [sum[0] + vote[0], sum[1] + vote[1]])
}

/// Measures the movements of the patches of the central view.
fn rates(field: &LightField, all: &[[f64; 2]]) -> Rates {
    let nothing = Rates { range: None, explained: 1.0, otherwise: false, percent: 0 };
    let far = |p: &[f64; 2], q: &[f64; 2]| (p[0] - q[0]).hypot(p[1] - q[1]);
    let Some(center) = (0..all.len()).min_by(|&a, &b| far(&all[a], &[0.0; 2]).total_cmp(&far(&all[b], &[0.0; 2])))
    else {
        return nothing;
    };
    let Some(patches) = Patches::of(field, center) else { return nothing };
    let mut others: Vec<usize> = (0..all.len()).filter(|v| *v != center).collect();
    others.sort_by(|&a, &b| far(&all[a], &all[center]).total_cmp(&far(&all[b], &all[center])));
    others.truncate(AROUND);
    let found: Vec<Vec<Found>> = others.iter().map(|v| patches.found(&patches.small(field, *v))).collect();
    let moves = |p: usize, views: usize| -> Vec<Move> {
        let moved = |(v, found): (&usize, &Vec<Found>)| match found[p] {
            Found::Moved(by) => Some(([0, 1].map(|k| all[*v][k] - all[center][k]), by)),
            _ => None,
        };
        others.iter().zip(&found).take(views).filter_map(moved).collect()
    };
    let (mut rates, mut moving, mut right, mut seen) = (Vec::new(), 0, 0, 0);
    for moves in (0..patches.count()).map(|p| moves(p, NEAREST)).filter(|moves| moves.len() >= 2) {
        seen += 1;
        let (rate, left) = fitted(&moves);
        let size: f64 = moves.iter().map(|(_, m)| m[0] * m[0] + m[1] * m[1]).sum();
        let is_right = left <= (EXPLAINED * size).max(PIXELS.powi(2) * moves.len() as f64);
        if size > moves.len() as f64 {
            moving += 1;
            right += usize::from(is_right);
        }
        if is_right {
            rates.push(rate * patches.scale);
        }
    }
    rates.sort_by(f64::total_cmp);
    let range = (rates.len() >= LEAST).then(|| [rates[ENDS - 1], rates[rates.len() - ENDS]]);
    let every: Vec<Vec<Move>> = (0..patches.count()).map(|p| moves(p, AROUND)).collect();
    let counts = OTHERWISE.map(|otherwise| votes(&every, otherwise));
    let otherwise = counts.into_iter().any(|[other, stated]| other >= LEAST.max(2 * stated));
    let explained = match moving {
        _ if otherwise => {
            counts.iter().map(|[other, stated]| *stated as f64 / (stated + other).max(1) as f64).fold(1.0, f64::min)
        }
        moving if moving < LEAST => 1.0,
        moving => right as f64 / moving as f64,
    };
    Rates { range, explained, otherwise, percent: (100 * seen / patches.count().max(1)) as u8 }
}
