//! Whether a step fits what was loaded: a shader that is given wrong sizes would read and write anywhere.

use super::super::{EngineError, Kernel, Lane, Purpose, Shape, Step, Storage};
use super::views::Views;
use eyebox_kernels::{energy, quantise};
use std::ops::Range;

/// The dispatches `part` of `step` on buffers of this shape.
pub(super) fn check(step: &Step, part: &Range<usize>, shape: &Shape, views: Option<&Views>) -> Result<(), EngineError> {
    let mismatch = |reason: String| Err(EngineError::Mismatch { reason });
    let Some(list) = step.list.get(part.clone()) else {
        return mismatch(format!("dispatches {part:?} of {} are asked for", step.list.len()));
    };
    for dispatch in list {
        let name = dispatch.kernel.name();
        let Some(lanes) = step.lanes.get(dispatch.lanes.clone()) else {
            return mismatch(format!("{name} runs over lanes {:?} of {}", dispatch.lanes, step.lanes.len()));
        };
        let fits = match dispatch.kernel {
            Kernel::Project => step.project.place == shape.place,
            Kernel::Adam => step.adam.place == shape.place,
            Kernel::Balance => {
                (step.balance.grid_height, step.balance.grid_width) == (shape.place.grid_height, shape.place.grid_width)
            }
            Kernel::Quantise => {
                step.quantise.count as usize == shape.pixels()
                    && (1..=quantise::MOST).contains(&(step.quantise.levels as usize))
            }
            Kernel::Energy | Kernel::Even => {
                let p = &step.even.place;
                (p.grid_height, p.grid_width) == (shape.place.grid_height, shape.place.grid_width)
                    && (1..=energy::MOST).contains(&p.patches)
                    && p.rows <= p.grid_height
                    && p.columns <= p.grid_width
                    && p.y0 < p.grid_height
                    && p.x0 < p.grid_width
            }
            _ => true,
        };
        if !fits {
            return mismatch(format!("{name} is for another size"));
        }
        let has = match dispatch.kernel {
            Kernel::Energy
            | Kernel::Overlap
            | Kernel::ReturnPupil
            | Kernel::Balance
            | Kernel::Even
            | Kernel::ChangeInverse
            | Kernel::Guard
            | Kernel::Project => shape.purpose != Purpose::View,
            Kernel::Adam => shape.purpose == Purpose::Adam,
            Kernel::Quantise => shape.quantised,
            _ => true,
        } && (dispatch.kernel != Kernel::Guard || shape.storage == Storage::F16);
        if !has {
            return mismatch(format!(
                "{name} has no buffers when the purpose is {:?}, in {}",
                shape.purpose,
                shape.storage.name()
            ));
        }
        for lane in lanes {
            if let Err(reason) = check_lane(lane, shape) {
                return mismatch(format!("a lane of {name}: {reason}"));
            }
            if dispatch.kernel == Kernel::Photograph
                && let Err(reason) = check_views(lane, views)
            {
                return mismatch(reason);
            }
        }
    }
    Ok(())
}

fn check_lane(lane: &Lane, shape: &Shape) -> Result<(), String> {
    let (rows, columns) = (lane.window.rows, lane.window.columns);
    let sized = |r: u32, c: u32| (r as usize, c as usize) == (rows, columns);
    let place = &shape.place;
    for pass in [&lane.pass, &lane.back] {
        if (pass.grid_height, pass.grid_width) != (place.grid_height, place.grid_width) {
            return Err(format!("its grid is {} x {}", pass.grid_height, pass.grid_width));
        }
        // The far field's windows are square, even where the SLM is not, and may hang over on all sides.
        let most = 4 * pass.grid_height.max(pass.grid_width).max(16);
        if !sized(pass.rows, pass.columns) || pass.rows > most || pass.columns > most {
            return Err(format!("its window is {} x {}", pass.rows, pass.columns));
        }
        if pass.y0 >= pass.grid_height || pass.x0 >= pass.grid_width {
            return Err(format!("its window starts at {}, {}", pass.y0, pass.x0));
        }
    }
    let far = |first: i32, n: usize| i64::from(first).abs() + n as i64 >= 1 << 16;
    if !sized(lane.transfer.rows, lane.transfer.columns)
        || far(lane.transfer.y0, rows)
        || far(lane.transfer.x0, columns)
    {
        return Err("its transfer is for another window, or for bins beyond 2^16".into());
    }
    if lane.spans.len() != rows || lane.spans.iter().any(|s| s[0] > s[1] || s[1] as usize > columns) {
        return Err("its spans do not fit its window".into());
    }
    if lane.columns.count > columns || (lane.columns.count > 0 && lane.columns.first >= columns) {
        return Err("its columns do not fit its window".into());
    }
    if lane.taper.as_ref().is_some_and(|w| w.len() != rows + columns) {
        return Err("its taper does not fit its window".into());
    }
    let count = lane.count();
    if lane.intensity.count as usize != count || lane.compare.count as usize != count {
        return Err(format!(
            "it has {count} pixels, its arguments say {} and {}",
            lane.intensity.count, lane.compare.count
        ));
    }
    if lane.intensity.frames as usize != shape.frames {
        return Err(format!("{} sub-frames are loaded, its arguments say {}", shape.frames, lane.intensity.frames));
    }
    let Some(shot) = &lane.shot else { return Ok(()) };
    let r = &shot.resample;
    let table = |t: &eyebox_kernels::resample::Table, n: usize, taps: u32, limit: u32| {
        t.first.len() == n
            && t.taps == taps as usize
            && t.weights.len() == n * t.taps
            && t.first.iter().all(|f| *f < limit)
    };
    let fits = sized(r.height, r.width)
        && (r.in_height, r.in_width) == (shot.args.height, shot.args.width)
        && table(&shot.rows, rows, r.row_taps, r.in_height)
        && table(&shot.columns, columns, r.column_taps, r.in_width);
    if fits { Ok(()) } else { Err("its photograph's tables do not fit its window".into()) }
}

fn check_views(lane: &Lane, views: Option<&Views>) -> Result<(), String> {
    let Some(shot) = &lane.shot else { return Ok(()) };
    let Some(views) = views else { return Err("a photograph is asked for and no views were loaded".into()) };
    let Some(level) = views.levels.get(shot.level) else {
        return Err(format!("level {} of {} is asked for", shot.level, views.levels.len()));
    };
    if (level.height, level.width) != (shot.args.height as usize, shot.args.width as usize) {
        return Err(format!("level {} is {} x {}", shot.level, level.height, level.width));
    }
    match shot.taps.iter().find(|t| t.view as usize >= views.count) {
        Some(tap) => Err(format!("view {} of {} is asked for", tap.view, views.count)),
        None => Ok(()),
    }
}
