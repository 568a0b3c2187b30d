//! Joins the video frames of two panels into one picture.

use crate::encode::VideoFrames;
use crate::optics::Panels;

/// Returns rows, columns and channels of the joined picture of two panels of this size. The pictures of two monitors
/// follow each other, as the two halves of one monitor do from top to bottom.
pub(crate) fn joined_size([rows, columns, channels]: [usize; 3], places: Panels) -> [usize; 3] {
    match places {
        Panels::SideBySide => [rows, 2 * columns, channels],
        Panels::TopBottom | Panels::Monitors => [2 * rows, columns, channels],
    }
}

/// Writes one video frame of both eyes into a joined picture.
pub(crate) fn join(joined: &mut [u8], [left, right]: [&[u8]; 2], row_bytes: usize, places: Panels) {
    match places {
        Panels::SideBySide => {
            let rows = joined.chunks_exact_mut(2 * row_bytes);
            for ((row, left), right) in rows.zip(left.chunks_exact(row_bytes)).zip(right.chunks_exact(row_bytes)) {
                let (of_left, of_right) = row.split_at_mut(row_bytes);
                of_left.copy_from_slice(left);
                of_right.copy_from_slice(right);
            }
        }
        Panels::TopBottom | Panels::Monitors => {
            let (above, below) = joined.split_at_mut(left.len());
            above.copy_from_slice(left);
            below.copy_from_slice(right);
        }
    }
}

/// Joins all video frames of a set.
pub(crate) fn join_sets([left, right]: [&VideoFrames; 2], places: Panels) -> VideoFrames {
    let [rows, columns, channels] = joined_size([left.height, left.width, left.channels], places);
    let mut joined = VideoFrames::dark(left.count(), rows, columns, channels);
    let (row_bytes, each) = (left.width * left.channels, joined.frame_bytes());
    for (at, picture) in joined.bytes_mut().chunks_exact_mut(each).enumerate() {
        join(picture, [left.frame(at), right.frame(at)], row_bytes, places);
    }
    joined
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_are_at_their_places() {
        let set = |first: u8| {
            let mut frames = VideoFrames::dark(2, 2, 2, 1);
            frames.bytes_mut().iter_mut().enumerate().for_each(|(i, byte)| *byte = first + i as u8);
            frames
        };
        let (left, right) = (set(0), set(100));
        let beside = join_sets([&left, &right], Panels::SideBySide);
        assert_eq!((beside.height, beside.width), (2, 4));
        assert_eq!(beside.frame(1), [4, 5, 104, 105, 6, 7, 106, 107]);
        for places in [Panels::TopBottom, Panels::Monitors] {
            let stacked = join_sets([&left, &right], places);
            assert_eq!((stacked.height, stacked.width), (4, 2));
            assert_eq!(stacked.frame(0), [0, 1, 2, 3, 100, 101, 102, 103]);
        }
    }
}
