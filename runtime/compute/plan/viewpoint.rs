//! Plans a comparison through an eye's pupil or through a window of the short-time Fourier transform.

use super::{Comparison, Moving, Planner, PupilPass, Shot};
use crate::optics::{Pupil, WindowFactor};
use std::f64::consts::PI;

/// The aperture of one comparison.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Viewpoint {
    /// An eye's pupil, with the exact disc on the wave, and the target image that the light field gives through the
    /// same disc.
    Pupil(Pupil),
    /// The same for an eye that moves while the sub-frames are shown, or sees some of them (OPTICS 15).
    Moving(Moving),
    /// One coefficient of the short-time Fourier transform of the SLM's field, at every pixel (Choi et al. 2022). It
    /// compares a window of `samples` x `samples` pixels (Hann), at the frequency of one view, with that unchanged
    /// view.
    Stft {
        /// Index of the view, row-major.
        view: usize,
        /// Pixels of the window along each axis.
        samples: usize,
        /// Diameter in the pupil plane of the circular filter behind the SLM, meters, or infinite without a filter.
        filter: f64,
    },
}

impl Planner {
    /// Plans the pass of `viewpoint`.
    pub fn viewpoint(&self, viewpoint: &Viewpoint, comparison: &Comparison) -> PupilPass {
        let mut pass = PupilPass::empty();
        self.look_through(&mut pass, viewpoint, comparison);
        pass
    }

    /// Refills a finished pupil pass for `viewpoint`, in the lists that it has.
    pub fn look_through(&self, pass: &mut PupilPass, viewpoint: &Viewpoint, comparison: &Comparison) {
        let diameter = match viewpoint {
            Viewpoint::Pupil(pupil) | Viewpoint::Moving(Moving { pupil, .. }) => pupil.diameter,
            Viewpoint::Stft { .. } => 0.0,
        };
        if let Some(planner) = self.of_fewer_modes(diameter) {
            return planner.look_through(pass, viewpoint, comparison);
        }
        match *viewpoint {
            Viewpoint::Pupil(pupil) => self.refill(pass, &pupil, comparison),
            Viewpoint::Moving(moving) if moving.is_resting(self.frames) => self.refill(pass, &moving.pupil, comparison),
            Viewpoint::Moving(moving) => self.refill_moving(pass, moving.each_moment(self.frames), comparison),
            Viewpoint::Stft { view, samples, filter } => *pass = self.stft(view, samples, filter, comparison),
        }
    }

    fn stft(&self, view: usize, samples: usize, filter: f64, comparison: &Comparison) -> PupilPass {
        // A filter wider than the square's diagonal passes all of it.
        let diameter = filter.min(4.0 * self.grid.eyebox());
        let pupil = Pupil { x: 0.0, y: 0.0, diameter, depth: 0.0 };
        // Sources apply to pupils only.
        let full = Self { factor: WindowFactor::Full, modes: [].into(), ..self.clone() };
        let window = hann(samples);
        // The window's spectrum is 1 at its middle. Its power, by Parseval, is the light that an even field sends
        // through.
        let axis = window.iter().map(|w| w * w).sum::<f64>() / window.iter().sum::<f64>().powi(2);
        let mut pupil_pass = PupilPass::empty();
        full.refill_wave(&mut pupil_pass, &pupil, axis * axis, self.frames, comparison);
        let (x, y) = self.views.as_ref().map_or((0.0, 0.0), |v| v.grid.position(view));
        let (bin_y, bin_x) = self.grid.bin_size();
        let weights = |first: i64, count: usize, n: usize, s: f64, bin: f64| {
            (0..count).map(move |j| ((first + j as i64) as f64 - s / bin) / n as f64).collect::<Vec<f64>>()
        };
        let rows = weights(pupil_pass.window.y0, pupil_pass.window.rows, self.grid.height, y, bin_y);
        let columns = weights(pupil_pass.window.x0, pupil_pass.window.columns, self.grid.width, x, bin_x);
        pupil_pass.taper = Some(rows.into_iter().chain(columns).map(|nu| spectrum(&window, nu) as f32).collect());
        pupil_pass.shot = full.shot_over(std::iter::once((pupil, [0.0; 2])), pupil_pass.window, None);
        if let Some(shot) = &mut pupil_pass.shot {
            let (height, width) = (shot.args.height as usize, shot.args.width as usize);
            let only = self.views.as_ref().map(|v| v.grid.only(&self.grid, view, height, width));
            *shot = Shot { taps: only.into_iter().collect(), ..shot.clone() };
            shot.args.taps = 1;
        }
        pupil_pass
    }
}

/// Returns Hann's window over `n` samples, none of them zero, symmetric about its middle.
fn hann(n: usize) -> Vec<f64> {
    (0..n).map(|j| (PI * (j + 1) as f64 / (n + 1) as f64).sin().powi(2)).collect()
}

/// Returns the spectrum of a symmetric window about its middle, at `nu` turns per sample. It is 1 at zero.
fn spectrum(window: &[f64], nu: f64) -> f64 {
    let middle = (window.len() as f64 - 1.0) / 2.0;
    let at = |(j, w): (usize, &f64)| w * (2.0 * PI * nu * (j as f64 - middle)).cos();
    window.iter().enumerate().map(at).sum::<f64>() / window.iter().sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_windows_of_all_views_share_the_light_evenly() {
        // Shifted by 1/n the windows tile the spectrum, so the sum of their powers is the same at every frequency.
        for n in [1, 3, 9, 10] {
            let window = hann(n);
            let total = |nu: f64| (0..n).map(|k| spectrum(&window, nu - k as f64 / n as f64).powi(2)).sum::<f64>();
            let want = n as f64 * window.iter().map(|w| w * w).sum::<f64>() / window.iter().sum::<f64>().powi(2);
            for nu in [0.0, 0.03, 0.2, 0.41] {
                assert!((total(nu) - want).abs() < 1e-12, "{n} at {nu}: {}, not {want}", total(nu));
            }
        }
        assert!((spectrum(&hann(9), 0.0) - 1.0).abs() < 1e-15);
    }
}
