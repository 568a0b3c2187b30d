//! Which kernel first gave NaN or an infinity.

use super::step::before_update;
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
    for i in 0..before_update(step) {
        let dispatch = &step.list[i];
        let losses = engine.run_part(step, i..i + 1)?;
        if !losses.iter().all(|l| l.is_finite()) {
            return Ok(Some(dispatch.kernel));
        }
        let slots = 0..dispatch.pupil_passes.len();
        let written: Vec<Buffer> = match dispatch.kernel {
            Kernel::Quantise => vec![Buffer::Shown],
            Kernel::Modulate | Kernel::FieldForward => vec![Buffer::Field],
            Kernel::Energy => vec![Buffer::Energy],
            Kernel::ReturnPupil | Kernel::DivideByOverlap | Kernel::EqualiseEyebox | Kernel::ChangeInverse => {
                vec![Buffer::Change]
            }
            Kernel::Transfer | Kernel::Taper => slots.map(Buffer::Transfer).collect(),
            Kernel::Photograph => slots.map(Buffer::Accumulator).collect(),
            Kernel::Resample => slots.map(Buffer::Target).collect(),
            Kernel::PassPupil | Kernel::WindowInverse | Kernel::ApplyFactor | Kernel::WindowForward => {
                slots.map(Buffer::Window).collect()
            }
            Kernel::Intensity | Kernel::Compare => slots.map(Buffer::Image).collect(),
            _ => Vec::new(),
        };
        for buffer in written {
            if !finite(&engine.read(buffer)?) {
                return Ok(Some(dispatch.kernel));
            }
        }
    }
    Ok(None)
}

fn finite(values: &[f32]) -> bool {
    values.iter().all(|v| v.is_finite())
}
