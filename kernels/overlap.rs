//! Counts, per bin of the spectrum, the pupils that pass it: `hits += scale` inside the spans, 1 where all of a pupil's light is of
//! one mode, else the mode's share of it. One pupil, one mode.

pub use crate::pass_pupil::Args;

/// `hits` (grid_height, grid_width).
pub fn overlap(args: &Args, spans: &[[u32; 2]], hits: &mut [f32]) {
    args.pieces(spans, |grid, _, length| {
        for hit in &mut hits[grid..grid + length] {
            *hit += args.scale;
        }
    });
}
