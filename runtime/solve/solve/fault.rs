//! Which kernel first gave NaN or an infinity.

use crate::engine::{Buffer, Engine, EngineError, Kernel, Step};

/// Runs the step again, kernel by kernel, up to where phases would change, and names the first whose output is not
/// finite. None if the phases are to blame themselves, or if nothing is found.
///
/// # Errors
/// Those of the engine.
pub(super) fn first_fault(engine: &mut dyn Engine, step: &Step) -> Result<Option<Kernel>, EngineError> {
    if !finite(&engine.read(Buffer::Phases)?) {
        return Ok(None);
    }
    for i in 0..step.before_update() {
        let dispatch = &step.list[i];
        let losses = engine.run_part(step, i..i + 1)?;
        if !losses.iter().all(|l| l.is_finite()) {
            return Ok(Some(dispatch.kernel));
        }
        for resource in dispatch.kernel.writes() {
            let slots = if resource.is_shared() { 1 } else { dispatch.pupil_passes.len() };
            for buffer in (0..slots).filter_map(|slot| resource.buffer(slot)) {
                if !finite(&engine.read(buffer)?) {
                    return Ok(Some(dispatch.kernel));
                }
            }
        }
    }
    Ok(None)
}

fn finite(values: &[f32]) -> bool {
    values.iter().all(|v| v.is_finite())
}
