//! Defines the data of kernels over pupil passes, for all sub-frames or for one of them.

use super::buffers::{SPLIT, Slot, complex, complex_mut};
use crate::engine::{PupilPass, Shape};
use crate::scene::Pyramid;
use eyebox_kernels::{
    Complex32,
    fft::{Direction, Plans, Store},
    intensity::intensity,
    motion::motion,
    photograph::photograph,
    resample::resample,
};
use rayon::prelude::*;

/// One pupil with all its sub-frames.
pub(super) struct Pass<'a> {
    pub(super) pass: &'a PupilPass,
    pub(super) slot: &'a mut Slot,
    pub(super) shape: &'a Shape,
    pub(super) views: Option<&'a Pyramid>,
    /// Factors of the relay for each bin.
    pub(super) relay: &'a [Complex32],
}

impl Pass<'_> {
    /// Runs `work` on each mode of the source, with its index, its pass and its transfer function K.
    pub(super) fn each_mode(&mut self, mut work: impl FnMut(usize, &PupilPass, &mut [Complex32])) {
        let transfers = complex_mut(&mut self.slot.transfer).chunks_exact_mut(self.pass.count().max(1));
        self.pass.each_mode().zip(transfers).enumerate().for_each(|(i, (pass, transfer))| work(i, pass, transfer));
    }

    pub(super) fn photograph(&mut self) {
        let (Some(shot), Some(views)) = (&self.pass.shot, self.views) else { return };
        let (height, width) = (shot.args.height as usize, shot.args.width as usize);
        let views = &views.levels[shot.level].views;
        let band = if height * width < SPLIT { height } else { height.div_ceil(8).max(16) };
        self.slot.accumulator.par_chunks_mut(band * width).enumerate().for_each(|(i, rows)| {
            photograph(&shot.args, views, &shot.taps, i * band, rows);
        });
    }

    pub(super) fn resample(&mut self) {
        let Some(shot) = &self.pass.shot else { return };
        let Slot { target, accumulator, scratch, .. } = &mut *self.slot;
        resample(&shot.resample, accumulator, &shot.rows, &shot.columns, target, scratch);
    }

    pub(super) fn intensity(&mut self) {
        let (count, modes) = (self.pass.count(), self.pass.mode_count());
        let frames = modes * self.shape.frames;
        let Slot { window, image, .. } = &mut *self.slot;
        let window = complex(window);
        if frames * count < SPLIT {
            let mut args = self.pass.intensity;
            args.frames *= modes as u32;
            return intensity(&args, window, image);
        }
        // Each band of pixels runs over all sub-frames, so that the order of the sum does not depend on the threads.
        let band = count.div_ceil(16);
        image.par_chunks_mut(band).enumerate().for_each(|(i, image)| {
            let mut args = self.pass.intensity;
            args.count = image.len() as u32;
            args.frames = 1;
            for f in 0..frames {
                args.accumulate = u32::from(f > 0 || self.pass.intensity.accumulate != 0);
                intensity(&args, &window[f * count + i * band..][..image.len()], image);
            }
        });
    }
}

/// One sub-frame of one pupil.
pub(super) struct WindowFrame<'a> {
    pub(super) index: usize,
    pub(super) pass: &'a PupilPass,
    pub(super) field: &'a [Complex32],
    pub(super) transfer: &'a [Complex32],
    pub(super) image: &'a [f32],
    pub(super) window: &'a mut [Complex32],
    pub(super) plans: &'a Plans,
    pub(super) store: Store,
}

impl WindowFrame<'_> {
    pub(super) fn motion(&mut self, back: bool) {
        let Some(args) = self.pass.motion_args(self.index, back) else { return };
        motion(&args, &self.pass.moments, self.window);
        (self.store)(self.window);
    }

    pub(super) fn fft(&mut self, direction: Direction) {
        let (window, columns) = (&self.pass.window, self.pass.columns);
        self.plans.fft(self.window, window.rows, window.columns, direction, columns, self.store);
    }
}
