//! Views of cameras that stand anywhere: closer views on a grid are made of them.
//!
//! How far content moves per meter is measured by patches of the view in the middle, each found again in the views around it. Fourier
//! disparity layers (OPTICS 14) explain all views at their positions, and show the views of a grid that lies between them.

use crate::depth::neighbors::{Found, Patches};
use crate::light_field::cameras::Positions;
use crate::synthesis::layers::Layers;
use crate::{CamerasFound, LightField, Request, SceneError, ViewGrid};
use eyebox_base::memory;
use eyebox_base::reason;
use std::path::Path;

/// Views along an axis that are made: at least, and at most.
const VIEWS: [usize; 2] = [3, 9];
/// Patches that decide, at least, and those that agree at an end of the depths.
const LEAST: usize = 8;
const ENDS: usize = 2;
/// Views around the one in the middle that patches are sought in, and the nearest of them, by which their movement is measured.
const AROUND: usize = 24;
const NEAREST: usize = 8;
/// The movement of a patch is explained by its camera's position if it leaves no larger share of its squares, or pixels.
const EXPLAINED: f64 = 0.1;
const PIXELS: f64 = 0.75;
/// Positions are right if they explain this share of the patches that move.
const RIGHT: f64 = 0.6;
/// A patch moves as other positions say if these leave no larger share of what the stated ones leave, which is more than as many pixels.
const CLEARLY: [f64; 2] = [0.5, 0.25];
/// A view that is left out should be shown so well, dB.
const ENOUGH: f64 = 25.0;

/// Views on a grid, and how they were made.
pub(crate) struct Resampled {
    pub field: LightField,
    pub how: String,
    /// What the pictures show against the positions.
    pub cameras: Option<CamerasFound>,
}

/// Makes the views of a grid of those that stand at `positions`, whose pictures have `own` rows and columns.
///
/// # Errors
/// [`SceneError::Settings`] if there are more or fewer views; [`SceneError::Depth`] if depths are neither stated nor measured;
/// [`SceneError::Memory`].
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
            "positions_mm has {} positions, but there are {count} views: give one for each",
            all.len()
        );
        return Err(SceneError::Settings { file: place.display().to_string(), reason });
    }
    // Around the middle of all.
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
        let how = format!("; {count} cameras at positions of their own, which the pictures contradict");
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
    // In pixels of the pictures as they are: what an enlarged picture shows is no finer.
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
        "; {count} cameras at positions of their own, of which {} Fourier disparity layers make {} x {} views; a view left out is \
         shown to {shown:.1} dB",
        layers.count(),
        grid.rows,
        grid.columns
    );
    if shown < ENOUGH {
        tracing::warn!(
            "{}: the other views show one that is left out to {shown:.1} dB only: positions_mm or the depths may be wrong, or cameras \
             stand too far apart",
            place.display()
        );
    }
    Ok(Resampled { field: field.with_made(grid, planes, depth), how, cameras })
}

/// What patches show.
struct Rates {
    /// Smallest and largest movement per meter, pixels of the light field.
    range: Option<[f64; 2]>,
    /// Share of the patches that move as the positions say, 1 where nothing moves.
    explained: f64,
    /// Whether mirrored or exchanged axes explain the movements clearly better.
    otherwise: bool,
    /// Per cent of the patches that are found again.
    percent: u8,
}

/// A camera's place beside the one in the middle, meters, and by how many pixels a patch moves there.
type Move = ([f64; 2], [f64; 2]);

/// The movement per meter that fits best, and the squares that it leaves. Content that is near moves against the camera.
fn fitted(moves: &[Move]) -> (f64, f64) {
    let squares: f64 = moves.iter().map(|(q, _)| q[0] * q[0] + q[1] * q[1]).sum();
    let rate = -moves.iter().map(|(q, m)| q[0] * m[0] + q[1] * m[1]).sum::<f64>() / squares.max(1e-18);
    (rate, moves.iter().map(|(q, m)| (m[0] + rate * q[0]).powi(2) + (m[1] + rate * q[1]).powi(2)).sum())
}

/// Positions as they would be if an axis were mirrored, both were exchanged, or both. All of them reversed are the same, near and far
/// exchanged.
const OTHERWISE: [fn([f64; 2]) -> [f64; 2]; 3] = [|[x, y]| [x, -y], |[x, y]| [y, x], |[x, y]| [y, -x]];

/// Patches whose movements these positions explain clearly better than the stated ones do, and the other way round.
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

/// Movements of the patches of the view in the middle.
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
