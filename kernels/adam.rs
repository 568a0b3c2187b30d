//! Moves phases by Adam with wrapping (Kingma and Ba 2015), on the gradient `2 Im(G conj(u))` (OPTICS 4). One frame.

use crate::{Complex32, modulate, simd, trig};
use bytemuck::{Pod, Zeroable};

/// Parameters of one step of Adam.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Args {
    /// Position of the SLM in the grid.
    pub place: modulate::Args,
    /// Learning rate in radians per step.
    pub rate: f32,
    /// Decay of the first moment.
    pub beta1: f32,
    /// Decay of the second moment.
    pub beta2: f32,
    /// Bias correction of the first moment, `1 / (1 - beta1^t)`.
    pub correct1: f32,
    /// Bias correction of the second moment, `1 / (1 - beta2^t)`.
    pub correct2: f32,
    /// Added to the root, in units of the gradient.
    pub epsilon: f32,
}

/// Updates `phases`, `first` and `second` (height, width). `change` (grid) is G, transformed back. `shown` holds the
/// phases that made the field, if they are not `phases` themselves.
pub fn adam(
    args: &Args,
    change: &[Complex32],
    shown: Option<&[f32]>,
    phases: &mut [f32],
    first: &mut [f32],
    second: &mut [f32],
) {
    let Args { place, rate, beta1, beta2, correct1, correct2, epsilon } = *args;
    let (w, gw) = (place.width as usize, place.grid_width as usize);
    simd(
        #[inline(always)]
        || {
            let rows = phases.chunks_exact_mut(w).zip(first.chunks_exact_mut(w)).zip(second.chunks_exact_mut(w));
            let one = |shown: f32, phase: &mut f32, first: &mut f32, second: &mut f32, g: &Complex32| {
                let (c, s) = trig::cos_sin(shown);
                let gradient = 2.0 * (g.im * c - g.re * s);
                let m = beta1 * *first + (1.0 - beta1) * gradient;
                let v = beta2 * *second + (1.0 - beta2) * (gradient * gradient);
                *first = m;
                *second = v;
                *phase = trig::wrap(*phase - rate * (m * correct1) / ((v * correct2).sqrt() + epsilon));
            };
            for (y, (((phases, first), second), change)) in
                rows.zip(change.chunks_exact(gw).skip(place.top as usize)).enumerate()
            {
                let change = &change[place.left as usize..place.left as usize + w];
                let values = phases.iter_mut().zip(first).zip(second).zip(change);
                // Loops instead of `for_each`, because a closure given to `for_each` is compiled separately, without
                // these instructions.
                match shown {
                    None => {
                        for (((phase, first), second), g) in values {
                            one(*phase, phase, first, second, g);
                        }
                    }
                    Some(shown) => {
                        for ((((phase, first), second), g), shown) in values.zip(&shown[y * w..][..w]) {
                            one(*shown, phase, first, second, g);
                        }
                    }
                }
            }
        },
    );
}
