//! Counts the bytes and the operations of dispatches. A benchmark compares them with the limits of the processor.

use crate::plan::{Dispatch, Shape, Step, moved};

/// Returns the bytes that a dispatch reads and writes at least once, and the operations of its transforms.
pub(super) fn account(dispatch: &Dispatch, step: &Step, shape: &Shape) -> (u64, u64) {
    let (kernel, frames) = (dispatch.kernel, shape.frames);
    let passes = &step.pupil_passes[dispatch.pupil_passes.clone()];
    let sum = |moved: Option<[u64; 2]>| moved.map_or(0, |[read, written]| read + written);
    let bytes = |&bind: &_| -> u64 {
        let (_, resource): (_, crate::plan::Resource) = bind;
        if kernel.scope().is_per_pupil() || !resource.is_shared() {
            passes.iter().map(|pass| sum(moved(kernel, bind, step, shape, Some(pass), frames))).sum()
        } else {
            sum(moved(kernel, bind, step, shape, None, frames))
        }
    };
    (kernel.binds().iter().map(bytes).sum(), dispatch.operations(step, shape))
}
