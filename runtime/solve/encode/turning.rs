//! Which pixel of the hologram each pixel of the SLM shows: flipped, rotated, moved.

use crate::optics::Encoding;

/// The hologram's place on the SLM.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Turning {
    /// Rows and columns of the SLM.
    slm: [usize; 2],
    /// Rows and columns of the hologram.
    pub hologram: [usize; 2],
    /// Row of the hologram: from `(yy, xx)` as constant, per yy, per xx; then its column.
    row: [i64; 3],
    column: [i64; 3],
    /// `yy = (y + shift) mod height`, and the same of x.
    pub shift: [usize; 2],
}

impl Turning {
    /// For an SLM of `height` x `width`: the hologram is flipped, rotated clockwise, then moved down and right, round
    /// the edges.
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

    /// Index of the phase at `(yy, xx) = (0, 0)`, and from one to the next: [first, step_y, step_x], wrapping.
    pub fn steps(&self) -> [u32; 3] {
        let width = self.hologram[1] as i64;
        // Indices are below 2^32: what is taken off wraps.
        std::array::from_fn(|i| (self.row[i] * width + self.column[i]) as u32)
    }

    /// Row and column of the hologram that pixel (y, x) of the SLM shows.
    pub fn source(&self, y: usize, x: usize) -> [usize; 2] {
        let yy = ((y + self.shift[0]) % self.slm[0]) as i64;
        let xx = ((x + self.shift[1]) % self.slm[1]) as i64;
        [self.row, self.column].map(|[first, per_y, per_x]| (first + per_y * yy + per_x * xx) as usize)
    }
}
