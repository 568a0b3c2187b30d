//! What was drawn for the last step of a refinement, and the lists that the next one fills again.

use crate::plan::{PupilPass, Step, StepLists, Viewpoint};
use std::ops::Range;

/// What was drawn last, and lists that the next step fills: none is made anew for it.
#[derive(Default)]
pub(super) struct Drawing {
    /// The pupil passes of the last step, and room for its kernels.
    pub(super) lists: StepLists,
    /// Steps that look through them are due, but none has been; or so many have.
    pub(super) drawn: bool,
    pub(super) used: usize,
    /// Pupil passes that the last step had no use for.
    pub(super) spare: Vec<PupilPass>,
    pub(super) viewpoints: Vec<Viewpoint>,
    /// The parts of the step's list that have to run.
    pub(super) parts: Vec<Range<usize>>,
    /// Room for the sizes of its windows.
    pub(super) pixels: Vec<usize>,
}

impl Drawing {
    /// What was drawn is of no use any more; what it was drawn into is.
    pub(super) fn forget(&mut self) {
        self.drawn = false;
    }

    pub(super) fn take_lists(&mut self) -> StepLists {
        std::mem::take(&mut self.lists)
    }

    /// Takes back the lists of a step that was begun; pixels of the windows of its pupil passes.
    pub(super) fn take_back(&mut self, step: Step) -> Vec<usize> {
        let mut pixels = std::mem::take(&mut self.pixels);
        pixels.clear();
        pixels.extend(step.pupil_passes.iter().map(PupilPass::count));
        self.lists = step.into();
        pixels
    }
}
