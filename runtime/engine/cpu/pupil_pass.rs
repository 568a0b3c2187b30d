//! The kernels that take a pupil with all its sub-frames at once.

use super::{SPLIT, Slot, grow};
use crate::engine::{Kernel, PupilPass, Shape};
use crate::scene::Pyramid;
use eyebox_kernels::{
    compare::compare,
    exposure::{self, exposure},
    intensity::intensity,
    photograph::photograph,
    resample::resample,
    taper::{self, taper},
    transfer::transfer,
};
use rayon::prelude::*;

/// One kernel over one pupil pass, which lies in `slot`.
pub(super) fn run_pupil_pass(
    kernel: Kernel,
    pupil_pass: &PupilPass,
    slot: &mut Slot,
    shape: &Shape,
    views: Option<&Pyramid>,
) {
    let (count, frames) = (pupil_pass.count(), shape.frames);
    match kernel {
        Kernel::Transfer => {
            grow(&mut slot.transfer, count);
            transfer(&pupil_pass.transfer, &pupil_pass.spans, &mut slot.transfer);
        }
        Kernel::Taper => {
            if let Some(weights) = &pupil_pass.taper {
                let args = taper::Args { rows: pupil_pass.transfer.rows, columns: pupil_pass.transfer.columns };
                taper(&args, weights, &mut slot.transfer);
            }
        }
        Kernel::Photograph => {
            let (Some(shot), Some(views)) = (&pupil_pass.shot, views) else { return };
            let (height, width) = (shot.args.height as usize, shot.args.width as usize);
            grow(&mut slot.accumulator, height * width);
            let views = &views.levels[shot.level].views;
            let band = if height * width < SPLIT { height } else { height.div_ceil(8).max(16) };
            slot.accumulator.par_chunks_mut(band * width).enumerate().for_each(|(i, rows)| {
                photograph(&shot.args, views, &shot.taps, i * band, rows);
            });
        }
        Kernel::Resample => {
            let Some(shot) = &pupil_pass.shot else { return };
            grow(&mut slot.target, count);
            let Slot { target, accumulator, scratch, .. } = slot;
            resample(&shot.resample, accumulator, &shot.rows, &shot.columns, target, scratch);
        }
        Kernel::Intensity => {
            grow(&mut slot.image, count);
            let Slot { window, image, .. } = slot;
            if frames * count < SPLIT {
                return intensity(&pupil_pass.intensity, window, image);
            }
            // Bands of pixels, each over all sub-frames: the sum's order does not depend on the threads.
            let band = count.div_ceil(16);
            let window = &*window;
            image.par_chunks_mut(band).enumerate().for_each(|(i, image)| {
                let mut args = pupil_pass.intensity;
                args.count = image.len() as u32;
                args.frames = 1;
                for f in 0..frames {
                    args.accumulate = u32::from(f > 0 || pupil_pass.intensity.accumulate != 0);
                    intensity(&args, &window[f * count + i * band..][..image.len()], image);
                }
            });
        }
        Kernel::Compare => slot.loss = compare(&pupil_pass.compare, &mut slot.image, &slot.target),
        Kernel::Exposure => {
            let args = pupil_pass.exposure(&shape.place);
            grow(&mut slot.image, count);
            grow(&mut slot.target, count);
            slot.sums.resize(exposure::PART * args.parts(), 0.0);
            exposure(&args, &slot.image, &slot.target, &mut slot.sums);
        }
        other => unreachable!("{} does not run over pupil_passes", other.name()),
    }
}
