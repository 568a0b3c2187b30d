//! Counts the bytes that kernels read and write.

use super::{Access, Kernel, PupilPass, Resource, Shape, Step};

/// Returns the bytes that a kernel reads and writes of one of its bindings, over `frames` sub-frames. For the
/// spectrum and for bindings with a value per bin, only the bins that the pupil passes count. Resources that only
/// tables hold return `None`.
pub(crate) fn moved(
    kernel: Kernel,
    (access, resource): (Access, Resource),
    step: &Step,
    shape: &Shape,
    pass: Option<&PupilPass>,
    frames: usize,
) -> Option<[u64; 2]> {
    let passing = || pass.map_or(0, PupilPass::passing_itself);
    let by_bin = matches!(kernel, Kernel::PassPupil | Kernel::PupilAdjoint | Kernel::Overlap | Kernel::Relay);
    let extent = match (resource.is_shared(), pass) {
        (true, _) => shape.extent(shape.alias(resource)),
        (false, Some(pass)) => pass.extent(resource, shape),
        (false, None) => return None,
    };
    if extent.values == 0 {
        return None;
    }
    let size = match (extent.complex, resource) {
        (true, resource) => resource.stored(shape.storage).bytes() as u64,
        (false, resource) => shape.real_bytes(resource),
    };
    if (kernel, resource) == (Kernel::DivideByOverlap, Resource::Change) {
        let bytes = size * overlapped(step, shape) * frames as u64;
        return Some([bytes, bytes]);
    }
    let cut = by_bin && !(kernel == Kernel::PassPupil && resource == Resource::Window);
    let values = match (cut, resource) {
        (true, _) => passing(),
        // A kernel reads of each pixel's values the amplitude and the zero order, or one value.
        (_, Resource::Pixels) => {
            let lights = matches!(kernel, Kernel::ModulateWave | Kernel::ModulateSubpixels);
            shape.pixels() as u64 * if lights { 3 } else { 1 }
        }
        _ => extent.values as u64,
    };
    let is_framed = resource.per_frame().is_some() || resource.axes_of_subpixels() > 0;
    let frames = if is_framed { frames as u64 } else { 1 };
    let bytes = size * values * frames;
    Some(match access {
        Access::Read => [bytes, 0],
        Access::Write => [0, bytes],
        Access::Update => [bytes, bytes],
    })
}

/// Returns the bins that two pupils or more pass.
fn overlapped(step: &Step, shape: &Shape) -> u64 {
    let mut counts = vec![0u16; shape.points()];
    for pass in step.pupil_passes.iter().flat_map(PupilPass::each_mode) {
        pass.pass.pieces(&pass.spans, |at, _, length| {
            counts[at..at + length].iter_mut().for_each(|count| *count = count.saturating_add(1));
        });
    }
    counts.iter().filter(|count| **count > 1).count() as u64
}
