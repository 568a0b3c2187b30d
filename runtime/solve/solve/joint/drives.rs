//! The drives that all colours share, and how they are turned by what each colour lacks (OPTICS 13).

use crate::optics::{drive_of, phase_of};
use crate::solve::step::Turns;
use eyebox_kernels::trig;
use rayon::prelude::*;
use std::f32::consts::TAU;

/// Drives of all sub-frames, in motion.
pub(super) struct Drives {
    /// (sub-frame, row, column), 0 to a turn.
    drives: Vec<f32>,
    /// What moves them: the projection's velocity, or Adam's first moment, and its second.
    moments: [Vec<f32>; 2],
    /// What the colours asked for since the last step: their turns, each times its slope.
    pub(super) asked: Vec<f32>,
    /// Rows and columns of a sub-frame.
    size: [usize; 2],
}

impl Drives {
    /// At these, given as phases of one turn.
    pub(super) fn new(phases: &[f32], size: [usize; 2]) -> Self {
        let zeros = vec![0.0; phases.len()];
        Self {
            drives: phases.iter().map(|p| drive_of(*p) as f32).collect(),
            moments: [zeros.clone(), zeros.clone()],
            asked: zeros,
            size,
        }
    }

    /// The phases that a colour of this slope has of them, -pi to pi radians.
    pub(super) fn phases(&self, slope: f64) -> Vec<f32> {
        let mut phases = vec![0.0; self.drives.len()];
        self.phases_into(slope, &mut phases);
        phases
    }

    /// The same, into memory that is there already.
    pub(super) fn phases_into(&self, slope: f64, phases: &mut [f32]) {
        // The drive as its own phase says it, so that all colours follow from what is kept.
        let phase = |drive: f32| phase_of(drive_of(phase_of(f64::from(drive), 1.0)), slope);
        self.drives.par_iter().zip(phases).for_each(|(drive, to)| *to = phase(*drive));
    }

    /// Begins again at these phases, with nothing that moves them.
    pub(super) fn restart(&mut self, phases: &[f32]) {
        self.drives.iter_mut().zip(phases).for_each(|(drive, phase)| *drive = drive_of(*phase) as f32);
        self.clear_moments();
        self.forget_asked();
    }

    /// What moved them is of no use any more.
    pub(super) fn clear_moments(&mut self) {
        self.moments.iter_mut().for_each(|of| of.fill(0.0));
    }

    /// What colours asked for is not to be taken.
    pub(super) fn forget_asked(&mut self) {
        self.asked.fill(0.0);
    }

    /// Has each sub-frame, by its place, and what moves it, go from what they are to what `carried` makes of it.
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

    /// Adds what one colour asks for: `slope Im(conj(u) change)`, of the change of its field over the grid (sub-frame, row,
    /// column) that holds the SLM, and the phases that it has now. Of each sub-frame's undiffracted light, the mean of its field, that
    /// share is to go, too: even drives leave no mean at the wavelength that they are meant at, but several hundredths of the light
    /// at others, which one place of the eyebox would receive (OPTICS 13).
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

    /// Takes the step that colours asked for, by its optimiser; `norm` is, per sub-frame, the sum over the colours of
    /// power times slope squared, by which the projection divides, and Adam the number of colours.
    pub(super) fn turn(&mut self, turns: &Turns, norm: &[f64], colors: usize) {
        let pixels = self.size[0] * self.size[1];
        let Turns { project, adam, projects } = turns;
        let [first, second] = &mut self.moments;
        let frames = self.drives.par_chunks_mut(pixels).zip(self.asked.par_chunks_mut(pixels));
        let frames = frames.zip(first.par_chunks_mut(pixels)).zip(second.par_chunks_mut(pixels)).zip(norm);
        frames.for_each(|((((drives, asked), first), second), norm)| {
            // A sub-frame that no laser lights stays as it is.
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

/// A drive, 0 to a turn; without a division where it is within a turn of that.
fn within_a_turn(drive: f32) -> f32 {
    let turned = match drive {
        0.0..TAU => return drive,
        _ if (TAU..2.0 * TAU).contains(&drive) => drive - TAU,
        _ if (-TAU..0.0).contains(&drive) => drive + TAU,
        _ => drive.rem_euclid(TAU),
    };
    if turned < TAU { turned } else { 0.0 }
}
