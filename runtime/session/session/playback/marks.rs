//! What cameras and photodiodes find sub-frames by.
//!
//! A phase shows no intensity by itself, but a grating sends its light to one side. So the first sub-frame of a set
//! carries a grating along x, which a detector beside the optical axis sees as one flash a set, and the others one along
//! y.

/// Period of the gratings, pixels.
const PERIOD: usize = 8;

/// A grating's phase, radians in [-pi, pi).
fn grating(at: usize) -> f32 {
    (at % PERIOD) as f32 * (std::f32::consts::TAU / PERIOD as f32) - std::f32::consts::PI
}

/// The sync picture's phases, (colour, sub-frame, row, column): whole sub-frames of gratings.
pub(crate) fn sync_phases([colors, frames, height, width]: [usize; 4]) -> Vec<f32> {
    let mut phases = Vec::with_capacity(colors * frames * height * width);
    for _ in 0..colors {
        for frame in 0..frames {
            for y in 0..height {
                phases.extend((0..width).map(|x| grating(if frame == 0 { x } else { y })));
            }
        }
    }
    phases
}

/// Puts a mark of `side` pixels into the upper left corner of a hologram's phases, (colour, sub-frame, row, column). Of content frames with an odd number the
/// gratings are exchanged, so that a detector tells a new frame from a repeat.
pub(crate) fn mark_corner(phases: &mut [f32], [_, frames, height, width]: [usize; 4], side: usize, position: u64) {
    let (rows, columns) = (side.min(height), side.min(width));
    if rows == 0 || columns == 0 || frames == 0 {
        return;
    }
    for (i, plane) in phases.chunks_exact_mut(height * width).enumerate() {
        let along_x = (i % frames == 0) == position.is_multiple_of(2);
        for (y, row) in plane.chunks_exact_mut(width).take(rows).enumerate() {
            row[..columns].iter_mut().enumerate().for_each(|(x, p)| *p = grating(if along_x { x } else { y }));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_sub_frame_is_told_from_the_others() {
        let phases = sync_phases([2, 3, 4, 16]);
        for (i, plane) in phases.chunks_exact(64).enumerate() {
            let (varies_in_x, varies_in_y) = (plane[0] != plane[1], plane[0] != plane[16]);
            assert_eq!((varies_in_x, varies_in_y), (i % 3 == 0, i % 3 != 0));
        }
    }

    #[test]
    fn a_mark_touches_its_corner_alone_and_tells_new_frames() {
        let shape = [2, 2, 10, 12];
        let mut even = vec![9.0; 480];
        let mut odd = even.clone();
        mark_corner(&mut even, shape, 4, 6);
        mark_corner(&mut odd, shape, 4, 7);
        for (i, (e, o)) in even.iter().zip(&odd).enumerate() {
            let (y, x) = (i / 12 % 10, i % 12);
            assert_eq!(y < 4 && x < 4, *e != 9.0);
            assert!(y >= 4 || x >= 4 || x == y || e != o);
        }
        mark_corner(&mut even, shape, 400, 6);
        assert!(even.iter().all(|p| *p != 9.0));
    }
}
