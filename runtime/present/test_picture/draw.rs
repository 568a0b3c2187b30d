//! Draws the test picture.

use std::ops::Range;

/// The fewest rows and columns of a test picture. Each level needs a column.
const FEWEST: [usize; 2] = [96, 258];
/// The rows of the picture are divided into this number of bands.
const BANDS: usize = 16;

/// The error of a test picture or of a capture.
#[derive(Debug, Clone, PartialEq, thiserror::Error, serde::Serialize)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum TestPictureError {
    /// The display is too small for all levels.
    #[error(
        "a test picture of {}x{} pixels is too small. It needs {}x{} or more",
        size[0], size[1], fewest[0], fewest[1]
    )]
    TooSmall {
        /// The rows and columns that were requested.
        size: [usize; 2],
        /// The fewest rows and columns.
        fewest: [usize; 2],
    },
    /// The number of bytes does not fit the size.
    #[error("a capture of {}x{} pixels has {bytes} bytes instead of three for each pixel", size[0], size[1])]
    Bytes {
        /// The rows and columns of the capture.
        size: [usize; 2],
        /// The bytes that were given.
        bytes: usize,
    },
    /// The picture does not show the test picture, or a camera took it.
    #[error(
        "this is no capture of the test picture (likeness {likeness:.2}, noise {noise:.1} levels). Take the digital \
         picture by a capture card that replaces the SLM. A camera does not show single pixels and levels"
    )]
    NotACapture {
        /// The correlation with the test picture, from 0 to 1.
        likeness: f64,
        /// The standard deviation within areas of one level.
        noise: f64,
    },
}

/// The areas of the test picture.
pub(super) struct Layout {
    pub(super) size: [usize; 2],
}

impl Layout {
    pub(super) fn new(size: [usize; 2]) -> Result<Self, TestPictureError> {
        if size[0] < FEWEST[0] || size[1] < FEWEST[1] {
            return Err(TestPictureError::TooSmall { size, fewest: FEWEST });
        }
        Ok(Self { size })
    }

    fn bands(&self, bands: Range<usize>) -> Range<usize> {
        bands.start * self.size[0] / BANDS..bands.end * self.size[0] / BANDS
    }

    /// The rows of the levels of gray (0), red (1), green (2) or blue (3).
    pub(super) fn levels(&self, strip: usize) -> Range<usize> {
        self.bands(1 + strip..2 + strip)
    }

    /// The columns of a level.
    pub(super) fn level(&self, level: usize) -> Range<usize> {
        let inside = self.size[1] - 2;
        1 + (level * inside).div_ceil(256)..1 + ((level + 1) * inside).div_ceil(256)
    }

    /// The level of a column inside the frame.
    fn level_at(&self, column: usize) -> u8 {
        ((column - 1) * 256 / (self.size[1] - 2)) as u8
    }

    /// The rows and columns of the checkerboard of 0 and 255. The other one is to the right of it.
    pub(super) fn checkerboard(&self) -> (Range<usize>, Range<usize>) {
        (self.bands(6..9), 1..self.size[1] / 2)
    }

    /// The rows in which red and blue alternate from column to column.
    pub(super) fn columns(&self) -> Range<usize> {
        self.bands(9..11)
    }

    /// The rows in which red and blue alternate from row to row.
    pub(super) fn rows(&self) -> Range<usize> {
        self.bands(11..13)
    }

    fn pixel(&self, row: usize, column: usize) -> [u8; 3] {
        let [height, width] = self.size;
        if row == 0 || column == 0 || row == height - 1 || column == width - 1 {
            return [255; 3];
        }
        let by_turns = |even: bool| if even { [255, 0, 0] } else { [0, 0, 255] };
        for strip in 0..4 {
            if self.levels(strip).contains(&row) {
                let level = self.level_at(column);
                return match strip {
                    0 => [level; 3],
                    channel => std::array::from_fn(|c| if c + 1 == channel { level } else { 0 }),
                };
            }
        }
        let (rows, left) = self.checkerboard();
        if rows.contains(&row) {
            let even = (row + column).is_multiple_of(2);
            return match (left.contains(&column), even) {
                (true, even) => [if even { 0 } else { 255 }; 3],
                (false, even) => [if even { 127 } else { 128 }; 3],
            };
        }
        if self.columns().contains(&row) {
            return by_turns(column.is_multiple_of(2));
        }
        if self.rows().contains(&row) {
            return by_turns(row.is_multiple_of(2));
        }
        self.mark(row, column)
    }

    /// The letter F, then a red, a green and a blue square, on black.
    fn mark(&self, row: usize, column: usize) -> [u8; 3] {
        let rows = self.bands(13..15);
        if !rows.contains(&row) {
            return [0; 3];
        }
        let side = rows.len();
        let (y, place) = (row - rows.start, column / side);
        let x = column % side;
        let is_stroke = x < side / 4 || y < side / 5 || (y * 5 / side == 2 && x < 2 * side / 3);
        match place {
            0 if is_stroke => [255; 3],
            2 => [255, 0, 0],
            3 => [0, 255, 0],
            4 => [0, 0, 255],
            _ => [0; 3],
        }
    }
}

/// Draws the test picture of these rows and columns, (row, column, channel) with red first.
///
/// It has all levels of gray, red, green and blue at the top. Below are checkerboards of single pixels of the levels 0
/// and 255 and of 127 and 128, columns and rows that alternate between red and blue, and marks without symmetry. A
/// frame of one white pixel is around it.
///
/// # Errors
/// [`TestPictureError::TooSmall`] for a size without room for all levels.
pub fn test_picture(size: [usize; 2]) -> Result<Vec<u8>, TestPictureError> {
    let layout = Layout::new(size)?;
    let [height, width] = size;
    Ok((0..height * width).flat_map(|i| layout.pixel(i / width, i % width)).collect())
}
