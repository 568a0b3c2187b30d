//! Computes the rectangles of pictures in a window, and the pupil at a position of the mouse.

use crate::optics::{Optics, Pupil};

/// A rectangle of pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rect {
    /// The first row of the rectangle.
    pub top: usize,
    /// The first column of the rectangle.
    pub left: usize,
    /// The number of rows.
    pub height: usize,
    /// The number of columns.
    pub width: usize,
}

/// The pixels between pictures that are side by side.
const GAP: usize = 4;

/// Places `count` pictures of `picture` rows and columns side by side in the middle of a `window`. They are as large as
/// fits and keep their proportions. Each has at least one pixel, even if the window is too small.
pub fn places(window: [usize; 2], picture: [usize; 2], count: usize) -> Vec<Rect> {
    let [rows, columns] = picture.map(|n| n.max(1));
    let count = count.max(1);
    let room = (window[1].saturating_sub(GAP * (count - 1)) / count).max(1);
    // Whole numbers ensure that a window of the size of the picture shows it pixel by pixel.
    let (height, width) = if room * rows <= window[0].max(1) * columns {
        ((room * rows / columns).max(1), room)
    } else {
        (window[0].max(1), (window[0].max(1) * columns / rows).max(1))
    };
    let all = count * width + (count - 1) * GAP;
    let (top, left) = (window[0].saturating_sub(height) / 2, window[1].saturating_sub(all) / 2);
    (0..count).map(|i| Rect { top, left: left + i * (width + GAP), height, width }).collect()
}

/// Returns the center of the pupil (x, y) in m at this row and column of the mouse. The picture under the mouse
/// represents the eyebox, and its middle is the axis. Beyond the picture the pupil stays at the edge.
pub fn pupil_at(position: [f64; 2], pictures: &[Rect], eyebox: f64) -> [f64; 2] {
    let [row, column] = position;
    let after = |r: &&Rect| column >= r.left as f64;
    let Some(rect) = pictures.iter().rev().find(after).or(pictures.first()) else { return [0.0, 0.0] };
    let along = |at: f64, first: usize, count: usize| {
        let share = (at - first as f64) / count.max(1) as f64 - 0.5;
        if share.is_finite() { share.clamp(-0.5, 0.5) * eyebox } else { 0.0 }
    };
    [along(column, rect.left, rect.width), along(row, rect.top, rect.height)]
}

/// Returns the smallest visible step of focus (m). It moves the image at the edge of the pupil by an eighth of a pixel
/// (OPTICS 2).
pub(crate) fn focus_step(optics: &Optics, pupil: &Pupil) -> f64 {
    optics.pitch / 8.0 * optics.focal_length / (pupil.diameter / 2.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_fit_and_stand_in_the_middle() {
        let rect = |top, left, height, width| Rect { top, left, height, width };
        assert_eq!(places([36, 64], [36, 64], 1), [rect(0, 0, 36, 64)]);
        assert_eq!(places([100, 64], [36, 64], 1), [rect(32, 0, 36, 64)]);
        assert_eq!(places([36, 100], [36, 64], 1), [rect(0, 18, 36, 64)]);
        assert_eq!(places([72, 256], [36, 64], 1), [rect(0, 64, 72, 128)]);
        assert_eq!(places([36, 132], [36, 64], 2), [rect(0, 0, 36, 64), rect(0, 68, 36, 64)]);
        assert_eq!(places([0, 0], [36, 64], 2).len(), 2);
        // No picture extends beyond the window.
        for window in [[1, 1], [7, 500], [500, 7], [33, 47]] {
            for r in places(window, [1080, 1920], 1) {
                assert!(r.top + r.height <= window[0] && r.left + r.width <= window[1], "{window:?} {r:?}");
            }
        }
    }

    #[test]
    fn the_mouse_means_a_pupil() {
        let one = places([100, 200], [100, 100], 1);
        let at = |row, column| pupil_at([row, column], &one, 22e-3).map(|m| (m * 1e6).round() / 1e3);
        assert_eq!(at(50.0, 100.0), [0.0, 0.0]);
        // Right is +x, and down is +y.
        assert_eq!(at(50.0, 125.0), [5.5, 0.0]);
        assert_eq!(at(75.0, 100.0), [0.0, 5.5]);
        assert_eq!(at(0.0, 0.0), [-11.0, -11.0]);
        assert_eq!(at(1e9, 199.0), [11.0, 11.0]);
        assert_eq!(at(f64::NAN, 100.0)[1], 0.0);
        // The same place over the second picture gives the same pupil.
        let two = places([100, 204], [100, 100], 2);
        assert_eq!(pupil_at([30.0, 40.0], &two, 22e-3), pupil_at([30.0, 144.0], &two, 22e-3));
        assert_eq!(pupil_at([30.0, 40.0], &[], 22e-3), [0.0, 0.0]);
    }

    #[test]
    fn a_step_of_focus_is_what_the_rim_sees() {
        let optics = Optics::new(8, 8, 8e-6, 520e-9, 0.4).unwrap();
        let pupil = Pupil { x: 0.0, y: 0.0, diameter: 4e-3, depth: 0.0 };
        let step = focus_step(&optics, &pupil);
        assert!((step * (pupil.diameter / 2.0) / optics.focal_length - 1e-6).abs() < 1e-12);
    }
}
