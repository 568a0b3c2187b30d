//! Runs the kernels between phases and field, for displays whose model goes beyond phases.

use super::buffers::storing_drives;
use super::frames::{Frame, Whole};
use eyebox_kernels::{
    Complex32, crosstalk,
    drive::drive,
    drive_adjoint::drive_adjoint,
    fft::Direction,
    lag::lag,
    modulate_mask::modulate_mask,
    modulate_wave::modulate_wave,
    multiply::{self, multiply},
    phase_gradient::phase_gradient,
    phase_gradient_mask::phase_gradient_mask,
    subpixels::{add_columns, add_rows, spread_columns, spread_rows},
};
use rayon::prelude::*;

/// Pixels that a thread takes at once.
const PART: usize = 1 << 13;

impl Frame<'_> {
    /// Returns true if a pixel is one sub-pixel.
    fn is_whole(&self) -> bool {
        self.shape.subpixels() == 1
    }

    pub(super) fn drive(&mut self) {
        let shown = if self.shape.quantised { &*self.shown } else { &*self.phases };
        let pixels = self.shape.pixels();
        let drives = &mut self.wave[..pixels];
        drive(&self.step.drive, self.tables.pixels, shown, drives);
        (self.store_drives)(drives);
    }

    pub(super) fn modulate_wave(&mut self) {
        let (points, pixels) = (self.shape.points(), self.shape.pixels());
        let fields = if self.is_whole() { &mut *self.field } else { &mut *self.subpixels };
        let (shape, tables, store) = (self.shape, self.tables.pixels, self.store);
        let each = fields.par_chunks_exact_mut(points).zip(self.wave.par_chunks_exact(pixels));
        each.for_each(|(field, wave)| {
            modulate_wave(&shape.place, shape.field_scale(), tables, wave, field);
            store(field);
        });
    }

    pub(super) fn modulate_mask(&mut self) {
        let (args, scale) = (&self.step.modulate_mask, self.shape.field_scale());
        let [mask, _] = self.tables.mask;
        modulate_mask(args, scale, self.tables.pixels, &self.wave[..self.shape.pixels()], mask, self.field);
        (self.store)(self.field);
    }

    pub(super) fn phase_gradient_mask(&mut self) {
        let (args, [mask, _], pixels) = (&self.step.modulate_mask, self.tables.mask, self.shape.pixels());
        phase_gradient_mask(args, self.tables.pixels, mask, self.change, &mut self.wave[..pixels]);
        (self.store_drives)(self.wave);
    }

    /// Propagates from the SLM to a mask at a distance and through it, or back.
    pub(super) fn through_mask(&mut self, back: bool) {
        let ([mask, transfer], store) = (self.tables.mask, self.store);
        let [through, reach] = self.shape.mask_factors(back);
        let frame = if back { &mut *self.change } else { &mut *self.field };
        let times = |args: &multiply::Args, factors: &[Complex32], frame: &mut [Complex32]| {
            multiply(args, factors, frame);
            store(frame);
        };
        if back {
            times(&through, mask, frame);
        }
        self.fft.whole(frame, Direction::Forward);
        times(&reach, transfer, frame);
        self.fft.whole(frame, Direction::Inverse);
        if !back {
            times(&through, mask, frame);
        }
    }

    pub(super) fn phase_gradient(&mut self) {
        let (points, pixels) = (self.shape.points(), self.shape.pixels());
        let changes = if self.is_whole() { &*self.change } else { &*self.subpixels };
        let (shape, tables, store) = (self.shape, self.tables.pixels, self.store_drives);
        let each = changes.par_chunks_exact(points).zip(self.wave.par_chunks_exact_mut(pixels));
        each.for_each(|(change, wave)| {
            phase_gradient(&shape.place, tables, change, wave);
            store(wave);
        });
    }

    /// Applies crosstalk along columns or rows.
    pub(super) fn crosstalk(&mut self, columns: bool) {
        let (args, [down, along]) = (&self.crosstalk, self.tables.weights);
        if columns {
            crosstalk::columns(args, down, self.blurred, self.wave);
            (self.store_drives)(self.wave);
        } else {
            crosstalk::rows(args, along, self.wave, self.blurred);
            (self.store_drives)(self.blurred);
        }
    }

    /// Applies the transposed crosstalk along columns or rows.
    pub(super) fn crosstalk_back(&mut self, columns: bool) {
        let (args, [down, along]) = (&self.crosstalk, self.tables.weights);
        if columns {
            crosstalk::columns_back(args, down, self.wave, self.blurred);
            (self.store_drives)(self.blurred);
        } else {
            crosstalk::rows_back(args, along, self.blurred, self.wave);
            (self.store_drives)(&mut self.wave[..self.shape.pixels()]);
        }
    }

    pub(super) fn drive_adjoint(&mut self) {
        let shown = if self.shape.quantised { &*self.shown } else { &*self.phases };
        drive_adjoint(&self.step.drive, self.tables.pixels, shown, self.wave, self.change);
        (self.store)(self.change);
    }

    /// Transforms the rows of all sub-pixels, and the columns of the first of each row of sub-pixels.
    pub(super) fn subpixels_forward(&mut self) {
        let [height, width] = self.fft.size;
        let (plans, columns, store, [down, along]) =
            (self.fft.plans, self.fft.columns, self.store, self.tables.offsets);
        let a_row = self.shape.subpixels() * height * width;
        self.subpixels.par_chunks_exact_mut(a_row).for_each(|planes| {
            planes.par_chunks_exact_mut(height * width).for_each(|plane| {
                plans.rows(plane, width, Direction::Forward, store);
            });
            add_rows(width, along, planes);
            let first = &mut planes[..height * width];
            store(first);
            plans.columns(first, height, width, Direction::Forward, columns, store);
        });
        add_columns(width, down, self.subpixels, self.field);
        store(self.field);
    }

    /// Applies the transposed operation.
    pub(super) fn subpixels_inverse(&mut self) {
        let [height, width] = self.fft.size;
        let (plans, columns, store, [down, along]) =
            (self.fft.plans, self.fft.columns, self.store, self.tables.offsets);
        let a_row = self.shape.subpixels() * height * width;
        spread_columns(width, down, self.change, self.subpixels);
        self.subpixels.par_chunks_exact_mut(a_row).for_each(|planes| {
            let first = &mut planes[..height * width];
            store(first);
            plans.columns(first, height, width, Direction::Inverse, columns, store);
            spread_rows(width, along, planes);
            planes.par_chunks_exact_mut(height * width).for_each(|plane| {
                store(plane);
                plans.rows(plane, width, Direction::Inverse, store);
            });
        });
    }
}

impl Whole<'_> {
    pub(super) fn lag(&mut self, back: bool) {
        let pixels = self.shape.pixels().max(1);
        let planes = self.shape.subpixels().pow(2);
        let frames = self.wave.chunks_exact_mut(pixels).step_by(planes);
        let mut parts: Vec<_> = frames.map(|frame| frame.chunks_mut(PART)).collect();
        let mut together: Vec<Vec<&mut [f32]>> =
            (0..pixels.div_ceil(PART)).map(|_| parts.iter_mut().filter_map(Iterator::next).collect()).collect();
        let store = storing_drives(self.shape.storage);
        together.par_iter_mut().for_each(|frames| {
            lag(&self.step.drive, back, frames);
            frames.iter_mut().for_each(|part| store(part));
        });
    }
}
