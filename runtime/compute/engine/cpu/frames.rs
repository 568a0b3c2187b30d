//! Defines the data of kernels over sub-frames, and of kernels that run once for all sub-frames.

use super::buffers::{ModelView, Slot, complex};
use crate::engine::{PupilPass, Shape, Step};
use eyebox_kernels::{
    Complex32, ZERO,
    check_finite::check_finite,
    crosstalk,
    fft::{Columns, Direction, Plans, Store},
    pupil_adjoint::pupil_adjoint,
};
use rayon::prelude::*;

/// Values that a thread takes at once.
const PART: usize = 1 << 16;

/// One sub-frame. Buffers that the purpose does not need are empty.
pub(super) struct Frame<'a> {
    pub(super) index: usize,
    pub(super) step: &'a Step,
    pub(super) shape: &'a Shape,
    /// The pupil passes of the current dispatch.
    pub(super) passes: &'a [PupilPass],
    pub(super) slots: &'a [Slot],
    pub(super) phases: &'a mut [f32],
    pub(super) shown: &'a mut [f32],
    pub(super) momentum: &'a mut [f32],
    pub(super) second: &'a mut [f32],
    pub(super) field: &'a mut [Complex32],
    pub(super) change: &'a mut [Complex32],
    pub(super) wave: &'a mut [f32],
    pub(super) blurred: &'a mut [f32],
    pub(super) subpixels: &'a mut [Complex32],
    pub(super) tables: ModelView<'a>,
    pub(super) crosstalk: crosstalk::Args,
    pub(super) levels: &'a [f32],
    pub(super) hits: &'a [f32],
    pub(super) energy: &'a [f32],
    pub(super) fft: FrameFft<'a>,
    pub(super) store: Store,
    /// Rounds drives when they are stored.
    pub(super) store_drives: fn(&mut [f32]),
}

impl Frame<'_> {
    /// Adds each pupil to the stored change, one after the other.
    pub(super) fn pupil_adjoints(&mut self) {
        for (pass, slot) in self.passes.iter().zip(self.slots) {
            let (count, frames) = (pass.count(), self.shape.frames);
            for (i, mode) in pass.each_mode().enumerate() {
                let [window, transfer] = [&slot.window, &slot.transfer].map(|values| complex(values));
                let window = &window[(i * frames + self.index) * count..][..count];
                let transfer = &transfer[i * count..][..count];
                pupil_adjoint(&mode.back, window, transfer, &mode.spans, self.change);
                mode.back.pieces(&mode.spans, |at, _, length| (self.store)(&mut self.change[at..at + length]));
            }
        }
    }
}

/// Transforms over the grid.
pub(super) struct FrameFft<'a> {
    pub(super) plans: &'a Plans,
    /// Rows and columns of the grid.
    pub(super) size: [usize; 2],
    pub(super) columns: Columns,
    /// True if one frame is spread over all threads. The scratch is for that.
    pub(super) wide: bool,
    pub(super) scratch: Vec<Complex32>,
    pub(super) store: Store,
}

impl FrameFft<'_> {
    /// Transforms all columns, not only the ones that a step's pupils pass.
    pub(super) fn whole(&mut self, frame: &mut [Complex32], direction: Direction) {
        let used = std::mem::replace(&mut self.columns, Columns::all(self.size[1]));
        self.run(frame, direction);
        self.columns = used;
    }

    pub(super) fn run(&mut self, frame: &mut [Complex32], direction: Direction) {
        let [rows, columns] = self.size;
        if self.wide {
            self.plans.fft_wide(frame, rows, columns, direction, self.columns, &mut self.scratch, self.store);
        } else {
            self.plans.fft(frame, rows, columns, direction, self.columns, self.store);
        }
    }
}

/// All sub-frames at once.
pub(super) struct Whole<'a> {
    pub(super) step: &'a Step,
    pub(super) shape: &'a Shape,
    pub(super) passes: &'a [PupilPass],
    pub(super) field: &'a mut [Complex32],
    pub(super) change: &'a mut [Complex32],
    pub(super) wave: &'a mut [f32],
    pub(super) hits: &'a mut [f32],
    pub(super) energy: &'a mut [f32],
    /// False if `check_finite` found a value that is not finite.
    pub(super) finite: bool,
}

impl Whole<'_> {
    pub(super) fn clear(&mut self) {
        self.hits.fill(0.0);
        self.change.par_chunks_mut(PART).for_each(|part| part.fill(ZERO));
    }

    pub(super) fn check_finite(&mut self) {
        self.finite = self.change.par_chunks(PART).all(check_finite);
    }
}
