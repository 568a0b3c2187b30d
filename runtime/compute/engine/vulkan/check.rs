//! Checks if a step fits the loaded shape, because a shader with wrong sizes would read and write anywhere.

use super::super::{EngineError, Kernel, PupilPass, Resource, Shape, Step, other_source};
use super::views::Views;
use std::ops::Range;

/// Checks the dispatches `part` of `step` on buffers of this shape.
pub(super) fn check(step: &Step, part: &Range<usize>, shape: &Shape, views: Option<&Views>) -> Result<(), EngineError> {
    let mismatch = |reason: String| Err(EngineError::Mismatch { reason });
    let Some(list) = step.list.get(part.clone()) else {
        return mismatch(format!("dispatches {part:?} do not fit a list of {}", step.list.len()));
    };
    // Neighbors in the list run over the same pupil passes.
    let mut checked = 0..0;
    for dispatch in list {
        let name = dispatch.kernel.name();
        let Some(pupil_passes) = step.pupil_passes.get(dispatch.pupil_passes.clone()) else {
            return mismatch(format!(
                "{name} runs over pupil passes {:?} of {}",
                dispatch.pupil_passes,
                step.pupil_passes.len()
            ));
        };
        if !dispatch.kernel.binds().iter().all(|(_, resource)| shape.provides(*resource)) {
            return mismatch(format!("{name} needs buffers that the purpose {:?} does not have", shape.purpose));
        }
        if !dispatch.kernel.fits(step, shape) {
            let (h, w) = (shape.place.height, shape.place.width);
            return mismatch(format!("{name} is not for {h} x {w} pixels in {}", shape.storage.name()));
        }
        for pupil_pass in pupil_passes {
            if checked != dispatch.pupil_passes
                && let Err(reason) = check_modes(pupil_pass, shape)
            {
                return mismatch(format!("a pupil pass of {name} does not fit, because {reason}"));
            }
            if dispatch.kernel == Kernel::Relay && pupil_pass.last_source_mode() >= shape.model.relay {
                return Err(other_source(pupil_pass.last_source_mode() + 1, shape.model.relay));
            }
            if dispatch.kernel.binds().iter().any(|(_, resource)| *resource == Resource::Views)
                && let Err(reason) = check_views(pupil_pass, views)
            {
                return mismatch(reason);
            }
        }
        if !pupil_passes.is_empty() {
            checked = dispatch.pupil_passes.clone();
        }
    }
    Ok(())
}

/// Checks a pupil pass and its further modes, whose windows must have one size.
fn check_modes(pupil_pass: &PupilPass, shape: &Shape) -> Result<(), String> {
    let size = |pass: &PupilPass| (pass.window.rows, pass.window.columns);
    for (i, mode) in pupil_pass.modes.iter().enumerate() {
        check_pupil_pass(mode, shape).map_err(|reason| format!("in mode {}: {reason}", i + 2))?;
        if size(mode) != size(pupil_pass) || !mode.modes.is_empty() || mode.shot.is_some() {
            return Err(format!("its mode {} has another window, further modes or a target image", i + 2));
        }
    }
    check_pupil_pass(pupil_pass, shape)
}

fn check_pupil_pass(pupil_pass: &PupilPass, shape: &Shape) -> Result<(), String> {
    let (rows, columns) = (pupil_pass.window.rows, pupil_pass.window.columns);
    let sized = |r: u32, c: u32| (r as usize, c as usize) == (rows, columns);
    let place = &shape.place;
    for pass in [&pupil_pass.pass, &pupil_pass.back] {
        if (pass.grid_height, pass.grid_width) != (place.grid_height, place.grid_width) {
            return Err(format!("its grid is {} x {}", pass.grid_height, pass.grid_width));
        }
        // The far field's windows are square, even if the SLM is not, and may extend over all sides.
        let most = 4 * pass.grid_height.max(pass.grid_width).max(16);
        if !sized(pass.rows, pass.columns) || pass.rows > most || pass.columns > most {
            return Err(format!("its window is {} x {}", pass.rows, pass.columns));
        }
        if pass.y0 >= pass.grid_height || pass.x0 >= pass.grid_width {
            return Err(format!("its window starts at {}, {}", pass.y0, pass.x0));
        }
    }
    let far = |first: i32, n: usize| i64::from(first).abs() + n as i64 >= 1 << 16;
    if !sized(pupil_pass.transfer.rows, pupil_pass.transfer.columns)
        || far(pupil_pass.transfer.y0, rows)
        || far(pupil_pass.transfer.x0, columns)
    {
        return Err("its transfer is for another window, or for bins beyond 2^16".into());
    }
    if pupil_pass.spans.len() != rows || pupil_pass.spans.iter().any(|s| s[0] > s[1] || s[1] as usize > columns) {
        return Err("its spans do not fit its window".into());
    }
    if pupil_pass.columns.count > columns || (pupil_pass.columns.count > 0 && pupil_pass.columns.first >= columns) {
        return Err("its columns do not fit its window".into());
    }
    if pupil_pass.eye.as_ref().is_some_and(|t| t.coefficients.len() != eyebox_kernels::eye::Terms::count(t.degree)) {
        return Err("its eye has another number of coefficients than its degree".into());
    }
    if pupil_pass.taper.as_ref().is_some_and(|w| w.len() != rows + columns) {
        return Err("its taper does not fit its window".into());
    }
    let count = pupil_pass.count();
    if pupil_pass.intensity.count as usize != count || pupil_pass.compare.count as usize != count {
        return Err(format!(
            "it has {count} pixels, but its arguments have {} and {}",
            pupil_pass.intensity.count, pupil_pass.compare.count
        ));
    }
    if pupil_pass.intensity.frames as usize != shape.frames {
        return Err(format!(
            "{} sub-frames are loaded, but its arguments have {}",
            shape.frames, pupil_pass.intensity.frames
        ));
    }
    let Some(shot) = &pupil_pass.shot else { return Ok(()) };
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
    if fits { Ok(()) } else { Err("the tables of its target image do not fit its window".into()) }
}

fn check_views(pupil_pass: &PupilPass, views: Option<&Views>) -> Result<(), String> {
    let Some(shot) = &pupil_pass.shot else { return Ok(()) };
    let Some(views) = views else { return Err("a step needs target images, but no views were loaded".into()) };
    let Some(level) = views.levels.get(shot.level) else {
        return Err(format!("level {} of {} does not exist", shot.level, views.levels.len()));
    };
    if (level.height, level.width) != (shot.args.height as usize, shot.args.width as usize) {
        return Err(format!("level {} is {} x {}", shot.level, level.height, level.width));
    }
    match shot.taps.iter().find(|t| t.view as usize >= views.count) {
        Some(tap) => Err(format!("view {} of {} does not exist", tap.view, views.count)),
        None => Ok(()),
    }
}
