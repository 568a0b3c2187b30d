//! Maps each pixel of the SLM to a pixel of the hologram, which is flipped, rotated and moved.

use crate::optics::Encoding;

/// The position of the hologram on the SLM.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Turning {
    /// Rows and columns of the SLM.
    slm: [usize; 2],
    /// Rows and columns of the hologram.
    pub hologram: [usize; 2],
    /// The row of the hologram from `(yy, xx)`, as a constant, a factor of yy and a factor of xx. `column` is the same
    /// for its column.
    row: [i64; 3],
    column: [i64; 3],
    /// The shift in `yy = (y + shift) mod height`, and the same for x.
    pub shift: [usize; 2],
}

impl Turning {
    /// Creates the map for an SLM of `height` x `width`. The hologram is flipped, rotated clockwise, then moved down
    /// and right, around the edges.
    pub fn new(encoding: &Encoding, height: usize, width: usize) -> Self {
        let [h, w] = if encoding.rotation_deg % 180 == 90 { [width, height] } else { [height, width] };
        let (bottom, right) = (h as i64 - 1, w as i64 - 1);
        let (mut row, mut column) = match encoding.rotation_deg {
            90 => ([bottom, 0, -1], [0, 1, 0]),
            180 => ([bottom, -1, 0], [right, 0, -1]),
            270 => ([0, 0, 1], [right, -1, 0]),
            _ => ([0, 1, 0], [0, 0, 1]),
        };
        if encoding.flip.overturns() {
            row = [bottom - row[0], -row[1], -row[2]];
        }
        if encoding.flip.mirrors() {
            column = [right - column[0], -column[1], -column[2]];
        }
        let shift = |by: i32, n: usize| (-i64::from(by)).rem_euclid(n as i64) as usize;
        let [down, along] = encoding.offset_px;
        Self { slm: [height, width], hologram: [h, w], row, column, shift: [shift(down, height), shift(along, width)] }
    }

    /// Returns the index of the phase at `(yy, xx) = (0, 0)` and the steps to the next, as [first, step_y, step_x],
    /// wrapping.
    pub fn steps(&self) -> [u32; 3] {
        let width = self.hologram[1] as i64;
        // Indices are below 2^32, so a negative step wraps.
        std::array::from_fn(|i| (self.row[i] * width + self.column[i]) as u32)
    }

    /// Returns the row and column of the hologram that pixel (y, x) of the SLM shows.
    pub fn source(&self, y: usize, x: usize) -> [usize; 2] {
        let yy = ((y + self.shift[0]) % self.slm[0]) as i64;
        let xx = ((x + self.shift[1]) % self.slm[1]) as i64;
        [self.row, self.column].map(|[first, per_y, per_x]| (first + per_y * yy + per_x * xx) as usize)
    }
}
