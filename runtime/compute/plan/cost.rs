//! Counts the cost of a step before anything runs, as work per group of kernels and as bytes.

use super::{BufferSize, Group, PupilPass, Resource, Shape, Step};
use std::ops::Range;

/// Returns the units of work of each group of kernels in a step. A unit is about a nanosecond of one core.
pub fn work(step: &Step, shape: &Shape) -> [f64; Group::ALL.len()] {
    let mut work = [0.0; Group::ALL.len()];
    for dispatch in &step.list {
        work[dispatch.kernel.group() as usize] += dispatch.work(step, shape);
    }
    work
}

/// Returns the bytes of the buffers that belong to no pupil pass, with `complex` bytes per complex value.
pub fn shared_bytes(shape: &Shape, complex: u64) -> u64 {
    // Levels and energy are left out because they have the same few bytes for every display.
    let counts = |resource: &Resource| !matches!(resource, Resource::Levels | Resource::Energy);
    let bytes = |resource| {
        let BufferSize { frames, values, complex: is_complex } = shape.extent(resource);
        (frames * values) as u64 * if is_complex { complex } else { 4 }
    };
    Resource::OF_SHAPE.into_iter().filter(counts).map(bytes).sum()
}

/// Returns the bytes of the buffers of one pupil pass, with `complex` bytes per complex value of its spectral window.
pub fn pupil_pass_bytes(pupil_pass: &PupilPass, frames: usize, complex: u64) -> u64 {
    let count = pupil_pass.count() as u64;
    let shot = pupil_pass.shot.as_ref().map_or(0, |s| 4 * u64::from(s.args.height) * u64::from(s.args.width));
    // The sum covers the window, the transfer function, image and target, and the target image before it is
    // resampled.
    let modes = pupil_pass.mode_count() as u64;
    modes * (complex * count * frames as u64 + 8 * count) + 8 * count + shot
}

/// Counts the bytes of the pupil passes of each slot over several steps. A slot keeps the size of its largest pupil
/// pass.
#[derive(Debug, Clone, Default)]
pub struct Slots(Vec<u64>);

impl Slots {
    /// Adds a step to the count.
    pub fn see(&mut self, step: &Step, frames: usize, complex: u64) {
        let mut seen: Option<Range<usize>> = None;
        for range in step.list.iter().map(|d| &d.pupil_passes).filter(|l| !l.is_empty()) {
            if seen.as_ref() == Some(range) {
                continue;
            }
            seen = Some(range.clone());
            self.0.resize(self.0.len().max(range.len()), 0);
            for (slot, pupil_pass) in self.0.iter_mut().zip(&step.pupil_passes[range.clone()]) {
                *slot = (*slot).max(pupil_pass_bytes(pupil_pass, frames, complex));
            }
        }
    }

    /// Returns the bytes of all slots, if the first one also holds a pupil pass of `first` bytes.
    pub fn bytes_with(&self, first: u64) -> u64 {
        let [head, tail @ ..] = &self.0[..] else { return first };
        (*head).max(first) + tail.iter().sum::<u64>()
    }
}
