//! Draws marks by which cameras and photodiodes find sub-frames.
//!
//! A phase has no intensity by itself, but a grating sends its light to one side. The first sub-frame of a set carries
//! a grating along x. A detector at one side of the optical axis records it as one flash per set. The other sub-frames
//! carry a grating along y.

/// The period of the gratings (pixels).
const PERIOD: usize = 8;

/// Returns the phase of a grating, in radians in [-pi, pi).
fn grating(at: usize) -> f32 {
    (at % PERIOD) as f32 * (std::f32::consts::TAU / PERIOD as f32) - std::f32::consts::PI
}

/// Returns the phases of the sync picture (color, sub-frame, row, column), whose sub-frames are whole gratings.
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

/// Puts a mark of `side` pixels into the upper left corner of the phases of a hologram (color, sub-frame, row, column).
///
/// In content frames with an odd number the gratings are exchanged, so that a detector can distinguish a new frame from
/// a repeat.
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
