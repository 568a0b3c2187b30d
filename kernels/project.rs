//! Moves each phase by the share of the change that a phase can follow (OPTICS 6b). One frame.

use crate::{Complex32, binary_angle, modulate, simd, trig};
use bytemuck::{Pod, Zeroable};

/// Gain, momentum and bound of the projection.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Args {
    /// Position of the SLM in the grid.
    pub place: modulate::Args,
    /// Factor on the turn.
    pub gain: f32,
    /// Share of the velocity of the previous step that is kept.
    pub momentum: f32,
    /// Largest drive in radians. Phases then stay within 0 .. `bound` and cross no wrap. If it is 0, phases wrap.
    pub bound: f32,
    /// Number of the step, which determines the rounding of binary angles.
    pub step: u32,
}

/// Returns the phase after a turn by `by` radians.
#[inline(always)]
fn turned(phase: f32, by: f32, bound: f32) -> f32 {
    if bound > 0.0 { trig::wrap((trig::wrapped(phase) + by).max(0.0).min(bound)) } else { trig::wrap(phase + by) }
}

/// Moves `phases` and `velocity` (height, width) towards the change. `change` (grid) is the requested change du of the
/// field. `shown` holds the phases that made the field, if they are not `phases` themselves.
///
/// `turn = gain Im(conj(u) du)`, `velocity = momentum velocity + turn`, `phases += momentum velocity + turn`. Phases
/// are wrapped or bounded.
pub fn project(args: &Args, change: &[Complex32], shown: Option<&[f32]>, phases: &mut [f32], velocity: &mut [f32]) {
    let Args { place, gain, momentum, bound, .. } = *args;
    let (w, gw) = (place.width as usize, place.grid_width as usize);
    simd(
        #[inline(always)]
        || {
            let rows = phases.chunks_exact_mut(w).zip(velocity.chunks_exact_mut(w));
            let one = |shown: f32, phase: &mut f32, velocity: &mut f32, du: &Complex32| {
                let (c, s) = trig::cos_sin(shown);
                let turn = gain * (c * du.im - s * du.re);
                let v = momentum * *velocity + turn;
                *velocity = v;
                *phase = turned(*phase, momentum * v + turn, bound);
            };
            for (y, ((phases, velocity), change)) in
                rows.zip(change.chunks_exact(gw).skip(place.top as usize)).enumerate()
            {
                let change = &change[place.left as usize..place.left as usize + w];
                let values = phases.iter_mut().zip(velocity).zip(change);
                // Loops instead of `for_each`, because a closure given to `for_each` is compiled separately, without
                // these instructions.
                match shown {
                    None => {
                        for ((phase, velocity), du) in values {
                            one(*phase, phase, velocity, du);
                        }
                    }
                    Some(shown) => {
                        for (((phase, velocity), du), shown) in values.zip(&shown[y * w..][..w]) {
                            one(*shown, phase, velocity, du);
                        }
                    }
                }
            }
        },
    );
}

/// Does the same for phases that are [binary angles](binary_angle), with velocities that are halves.
pub fn project_angles(args: &Args, change: &[Complex32], phases: &mut [f32], velocity: &mut [f32]) {
    let Args { place, gain, momentum, bound, step } = *args;
    let (w, gw) = (place.width as usize, place.grid_width as usize);
    let one = |threshold: u32, phase: &mut f32, velocity: &mut f32, du: &Complex32| {
        let (c, s) = trig::cos_sin(*phase);
        let turn = gain * (c * du.im - s * du.re);
        let v = momentum * *velocity + turn;
        *velocity = binary_angle::velocity(v, threshold);
        *phase = binary_angle::turned(*phase, momentum * v + turn, bound, threshold);
    };
    simd(
        #[inline(always)]
        || {
            let rows = phases.chunks_exact_mut(w).zip(velocity.chunks_exact_mut(w));
            let rows = rows.zip(change.chunks_exact(gw).skip(place.top as usize));
            for (y, ((phases, velocity), change)) in rows.enumerate() {
                let values = phases.iter_mut().zip(velocity).zip(&change[place.left as usize..]);
                for (pixel, ((phase, velocity), du)) in ((y * w) as u32..).zip(values) {
                    one(binary_angle::threshold(pixel, step), phase, velocity, du);
                }
            }
        },
    );
}
