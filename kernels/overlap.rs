//! Counts, per bin of the spectrum, the pupils that pass it, `hits += scale` inside the spans. `scale` is 1 if all
//! light of a pupil is in one mode, otherwise the mode's share of the light. One pupil, one mode.

pub use crate::pass_pupil::Args;

/// Adds to `hits` (grid_height, grid_width).
pub fn overlap(args: &Args, spans: &[[u32; 2]], hits: &mut [f32]) {
    args.pieces(spans, |grid, _, length| {
        for hit in &mut hits[grid..grid + length] {
            *hit += args.scale;
        }
    });
}
