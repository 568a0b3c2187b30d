//! What stands between phases and field where the display is more than its phases: pairs of sub-frames, all at once.

use super::buffers::SPLIT;
use crate::engine::Shape;
use eyebox_kernels::{
    Complex32,
    crosstalk::crosstalk,
    drive::{Args, drive},
    drive_back::drive_back,
    fft::{Columns, Direction, Plans, Store},
    lag::lag,
    modulate_wave::modulate_wave,
    turn::turn,
};
use rayon::prelude::*;

/// Points of the grid that a thread settles at once.
const PART: usize = 1 << 13;

/// What these kernels see.
pub(super) struct Waves<'a> {
    pub(super) shape: &'a Shape,
    pub(super) plans: &'a Plans,
    pub(super) store: Store,
    /// The phases that are shown.
    pub(super) shown: &'a [f32],
    /// The tables of the pixels,
    pub(super) pixels: &'a [f32],
    /// and those of crosstalk.
    pub(super) crosstalk: &'a [Complex32],
    pub(super) wave: &'a mut [Complex32],
}

/// Sub-frame `index` of `frames`, each of `length` values; empty if there is none.
fn frame<T>(frames: &[T], index: usize, length: usize) -> &[T] {
    frames.get(index * length..(index + 1) * length).unwrap_or_default()
}

impl Waves<'_> {
    fn points(&self) -> usize {
        self.shape.points().max(1)
    }

    pub(super) fn drive(&mut self, args: &Args) {
        let points = self.points();
        let Waves { shape, shown, pixels, wave, .. } = self;
        let count = shape.pixels();
        wave.par_chunks_exact_mut(points).enumerate().for_each(|(i, wave)| {
            drive(args, pixels, [2 * i, 2 * i + 1].map(|f| frame(shown, f, count)), wave);
        });
    }

    pub(super) fn lag(&mut self, args: &Args, back: bool) {
        let (frames, points) = (self.shape.frames, self.points());
        let mut parts: Vec<_> = self.wave.chunks_exact_mut(points).map(|pair| pair.chunks_mut(PART)).collect();
        let mut together: Vec<Vec<&mut [Complex32]>> =
            (0..points.div_ceil(PART)).map(|_| parts.iter_mut().filter_map(Iterator::next).collect()).collect();
        together.par_iter_mut().for_each(|pairs| lag(args, frames, back, pairs));
    }

    pub(super) fn transform(&mut self, direction: Direction) {
        let points = self.points();
        let Waves { shape, plans, wave, .. } = self;
        let [rows, columns] = [shape.place.grid_height as usize, shape.place.grid_width as usize];
        let (all, exact): (_, Store) = (Columns::all(columns), |_| {});
        if wave.len() / points < rayon::current_num_threads() && points >= SPLIT {
            let mut scratch = Vec::new();
            for pair in wave.chunks_exact_mut(points) {
                plans.fft_wide(pair, rows, columns, direction, all, &mut scratch, exact);
            }
        } else {
            wave.par_chunks_exact_mut(points).for_each(|pair| plans.fft(pair, rows, columns, direction, all, exact));
        }
    }

    pub(super) fn crosstalk(&mut self) {
        let (height, points) = (self.shape.place.grid_height as usize, self.points());
        let Waves { crosstalk: transfer, wave, .. } = self;
        wave.par_chunks_exact_mut(points).for_each(|pair| crosstalk(height, transfer, pair));
    }

    pub(super) fn modulate(&self, field: &mut [Complex32]) {
        let Waves { shape, store, pixels, wave, .. } = self;
        let (points, scale) = (self.points(), shape.field_scale());
        field.par_chunks_exact_mut(points).enumerate().for_each(|(f, field)| {
            modulate_wave(&shape.place, scale, pixels, f % 2 == 1, frame(wave, f / 2, points), field);
            store(field);
        });
    }

    pub(super) fn turn(&mut self, change: &[Complex32]) {
        let points = self.points();
        let Waves { shape, pixels, wave, .. } = self;
        wave.par_chunks_exact_mut(points).enumerate().for_each(|(i, wave)| {
            turn(&shape.place, pixels, [2 * i, 2 * i + 1].map(|f| frame(change, f, points)), wave);
        });
    }

    pub(super) fn drive_back(&self, args: &Args, change: &mut [Complex32]) {
        let Waves { shape, store, shown, pixels, wave, .. } = self;
        let (points, count) = (self.points(), shape.pixels());
        change.par_chunks_exact_mut(points).enumerate().for_each(|(f, change)| {
            drive_back(args, pixels, f % 2 == 1, frame(shown, f, count), frame(wave, f / 2, points), change);
            store(change);
        });
    }
}
