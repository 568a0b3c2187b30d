//! Stores the drive values that all colors share, and turns them as the colors request (OPTICS 13).

use crate::optics::{drive_of, phase_of};
use crate::solve::step::Turns;
use eyebox_kernels::trig;
use rayon::prelude::*;
use std::f32::consts::TAU;

/// Drive values of all sub-frames with their moments.
pub(super) struct Drives {
    /// Drive values (sub-frame, row, column), 0 to a turn.
    drives: Vec<f32>,
    /// The velocity of the projection, or the first and second moments of Adam.
    moments: [Vec<f32>; 2],
    /// The changes that the colors requested since the last step, as the turns of each color times its slope.
    pub(super) asked: Vec<f32>,
    /// Rows and columns of a sub-frame.
    size: [usize; 2],
}

impl Drives {
    /// Starts at these drive values, given as phases of one turn.
    pub(super) fn new(phases: &[f32], size: [usize; 2]) -> Self {
        let zeros = vec![0.0; phases.len()];
        Self {
            drives: phases.iter().map(|p| drive_of(*p) as f32).collect(),
            moments: [zeros.clone(), zeros.clone()],
            asked: zeros,
            size,
        }
    }

    /// Returns the phases of a color of this slope, in radians from -pi to pi.
    pub(super) fn phases(&self, slope: f64) -> Vec<f32> {
        let mut phases = vec![0.0; self.drives.len()];
        self.phases_into(slope, &mut phases);
        phases
    }

    /// Writes the phases of a color of this slope into existing memory.
    pub(super) fn phases_into(&self, slope: f64, phases: &mut [f32]) {
        // The drive value is rounded as its own phase, so that all colors follow from the stored values.
        let phase = |drive: f32| phase_of(drive_of(phase_of(f64::from(drive), 1.0)), slope);
        self.drives.par_iter().zip(phases).for_each(|(drive, to)| *to = phase(*drive));
    }

    /// Restarts at these phases without moments.
    pub(super) fn restart(&mut self, phases: &[f32]) {
        self.drives.iter_mut().zip(phases).for_each(|(drive, phase)| *drive = drive_of(*phase) as f32);
        self.clear_moments();
        self.forget_asked();
    }

    /// Sets all moments to zero.
    pub(super) fn clear_moments(&mut self) {
        self.moments.iter_mut().for_each(|of| of.fill(0.0));
    }

    /// Discards the changes that colors requested.
    pub(super) fn forget_asked(&mut self) {
        self.asked.fill(0.0);
    }

    /// Replaces each sub-frame, given by its index, and its moments by the output of `carried`.
    pub(super) fn shift_frames(&mut self, carried: impl Fn(&[f32], &mut [f32], usize)) {
        let pixels = self.size[0] * self.size[1];
        let [first, second] = &mut self.moments;
        let mut after = vec![0.0; pixels];
        for values in [&mut self.drives, first, second] {
            for (frame, values) in values.chunks_exact_mut(pixels).enumerate() {
                carried(values, &mut after, frame);
                values.copy_from_slice(&after);
            }
        }
    }

    /// Adds the change `slope Im(conj(u) change)` that one color requests.
    ///
    /// The `change` belongs to its field over the grid (sub-frame, row, column) that holds the SLM. The `phases` are
    /// its current ones. The value `undiffracted` is the share of each sub-frame's undiffracted light, the mean of its
    /// field, that is removed too. Even drive values leave no mean at their own wavelength. At other wavelengths they
    /// leave several hundredths of the light, which one place of the eyebox would receive (OPTICS 13).
    pub(super) fn ask(&mut self, slope: f64, phases: &[f32], change: &[f32], undiffracted: &[f64], turns: &Turns) {
        let place = turns.project.place;
        let [_, width] = self.size;
        let (grid_width, top, left) = (place.grid_width as usize, place.top as usize, place.left as usize);
        let (pixels, points) = (self.size[0] * width, place.grid_height as usize * grid_width);
        let frames =
            self.asked.par_chunks_mut(pixels).zip(phases.par_chunks(pixels)).zip(change.par_chunks(2 * points));
        frames.zip(undiffracted).for_each(|(((asked, phases), change), share)| {
            let field = |phase: &f32| trig::cos_sin(*phase);
            let sum = |[im, re]: [f64; 2], (c, s): (f32, f32)| [im + f64::from(s), re + f64::from(c)];
            let [im, re] = match *share > 0.0 {
                true => phases.iter().map(field).fold([0.0; 2], sum).map(|sum| (share * sum / pixels as f64) as f32),
                false => [0.0; 2],
            };
            let rows = asked.chunks_exact_mut(width).zip(phases.chunks_exact(width)).enumerate();
            for (y, (asked, phases)) in rows {
                let change = &change[2 * ((top + y) * grid_width + left)..];
                for ((asked, phase), du) in asked.iter_mut().zip(phases).zip(change.chunks_exact(2)) {
                    let (c, s) = trig::cos_sin(*phase);
                    *asked += slope as f32 * (c * (du[1] - im) - s * (du[0] - re));
                }
            }
        });
    }

    /// Takes the step that the colors requested, by its optimizer.
    ///
    /// `norm` is, per sub-frame, the sum over the colors of power times slope squared. The projection divides by it,
    /// and Adam divides by the number of colors.
    pub(super) fn turn(&mut self, turns: &Turns, norm: &[f64], colors: usize) {
        let pixels = self.size[0] * self.size[1];
        let Turns { project, adam, projects } = turns;
        let [first, second] = &mut self.moments;
        let frames = self.drives.par_chunks_mut(pixels).zip(self.asked.par_chunks_mut(pixels));
        let frames = frames.zip(first.par_chunks_mut(pixels)).zip(second.par_chunks_mut(pixels)).zip(norm);
        frames.for_each(|((((drives, asked), first), second), norm)| {
            // A sub-frame that no laser lights stays the same.
            let share = if *norm > 0.0 { (1.0 / norm) as f32 } else { 0.0 };
            for (((drive, asked), first), second) in drives.iter_mut().zip(&mut *asked).zip(first).zip(second) {
                let by = if *projects {
                    let turn = project.gain * share * *asked;
                    *first = project.momentum * *first + turn;
                    project.momentum * *first + turn
                } else {
                    let gradient = 2.0 * *asked / colors as f32;
                    *first = adam.beta1 * *first + (1.0 - adam.beta1) * gradient;
                    *second = adam.beta2 * *second + (1.0 - adam.beta2) * (gradient * gradient);
                    -adam.rate * (*first * adam.correct1) / ((*second * adam.correct2).sqrt() + adam.epsilon)
                };
                *drive = within_a_turn(*drive + by);
                *asked = 0.0;
            }
        });
    }
}

/// Wraps a drive value to 0 to a turn. It needs no division for a value within a turn of that range.
fn within_a_turn(drive: f32) -> f32 {
    let turned = match drive {
        0.0..TAU => return drive,
        _ if (TAU..2.0 * TAU).contains(&drive) => drive - TAU,
        _ if (-TAU..0.0).contains(&drive) => drive + TAU,
        _ => drive.rem_euclid(TAU),
    };
    if turned < TAU { turned } else { 0.0 }
}
