//! Counts, per bin of the spectrum, the pupils that pass it: `hits += 1` inside the spans. One pupil.

pub use crate::pass_pupil::Args;

/// `hits` (grid_height, grid_width).
pub fn overlap(args: &Args, spans: &[[u32; 2]], hits: &mut [f32]) {
    args.pieces(spans, |grid, _, length| {
        for hit in &mut hits[grid..grid + length] {
            *hit += 1.0;
        }
    });
}
