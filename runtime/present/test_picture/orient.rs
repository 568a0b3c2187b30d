//! Finds how a capture is turned, mirrored and how its channels are ordered, from the means of coarse cells.

/// Cells along each side. They are coarse, so that scaling and borders hardly matter.
const CELLS: usize = 32;

/// The orders of channels. Entry `c` is the channel of the capture that shows channel `c`.
pub(super) const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];

/// The means of the cells of red, green and blue.
type Cells = [Vec<f64>; 3];

/// A picture of 8 bits, (row, column, channel).
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Picture {
    pub(super) size: [usize; 2],
    pub(super) rgb: Vec<u8>,
}

impl Picture {
    pub(super) fn at(&self, row: usize, column: usize, channel: usize) -> f64 {
        f64::from(self.rgb[3 * (row * self.size[1] + column) + channel])
    }

    /// Turns the picture clockwise by a number of right angles.
    fn turned(&self, quarters: usize) -> Self {
        let [height, width] = self.size;
        let size = if quarters % 2 == 1 { [width, height] } else { [height, width] };
        let from = |row: usize, column: usize| match quarters % 4 {
            0 => (row, column),
            1 => (height - 1 - column, row),
            2 => (height - 1 - row, width - 1 - column),
            _ => (column, width - 1 - row),
        };
        self.mapped(size, from)
    }

    fn mirrored(&self) -> Self {
        let [_, width] = self.size;
        self.mapped(self.size, |row, column| (row, width - 1 - column))
    }

    fn mapped(&self, size: [usize; 2], from: impl Fn(usize, usize) -> (usize, usize)) -> Self {
        let pixel = |i: usize| {
            let (row, column) = from(i / size[1], i % size[1]);
            let at = 3 * (row * self.size[1] + column);
            [self.rgb[at], self.rgb[at + 1], self.rgb[at + 2]]
        };
        Self { size, rgb: (0..size[0] * size[1]).flat_map(pixel).collect() }
    }

    /// The means of the cells of each channel within top, left, bottom and right.
    fn cells(&self, [top, left, bottom, right]: [usize; 4]) -> Cells {
        let (height, width) = (bottom - top + 1, right - left + 1);
        let mut sums = [(); 3].map(|()| vec![0.0; CELLS * CELLS]);
        let mut counts = vec![0.0; CELLS * CELLS];
        for row in 0..height {
            for column in 0..width {
                // The middle of a pixel decides, so that a turned picture has the same cells.
                let cell = (2 * row + 1) * CELLS / (2 * height) * CELLS + (2 * column + 1) * CELLS / (2 * width);
                counts[cell] += 1.0;
                (0..3).for_each(|c| sums[c][cell] += self.at(top + row, left + column, c));
            }
        }
        sums.map(|sum| sum.iter().zip(&counts).map(|(s, n)| s / f64::max(*n, 1.0)).collect())
    }

    /// The whole picture, as top, left, bottom and right.
    pub(super) fn whole(&self) -> [usize; 4] {
        [0, 0, self.size[0] - 1, self.size[1] - 1]
    }

    pub(super) fn reordered(&mut self, order: [usize; 3]) {
        for pixel in self.rgb.chunks_exact_mut(3) {
            let was = [pixel[0], pixel[1], pixel[2]];
            (0..3).for_each(|c| pixel[c] = was[order[c]]);
        }
    }
}

/// The way in which a capture differs from the test picture as a whole.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Orientation {
    /// Right angles by which the link turned the picture clockwise, before it mirrored it left to right.
    pub(super) quarters: usize,
    pub(super) mirrored: bool,
    pub(super) order: [usize; 3],
    /// The correlation with the test picture.
    pub(super) likeness: f64,
}

/// Returns the most likely orientation of the part `inside` of a capture, and the whole capture with it undone.
pub(super) fn orient(picture: &Picture, captured: &Picture, inside: [usize; 4]) -> (Orientation, Picture) {
    let (wanted, cells) = (picture.cells(picture.whole()), captured.cells(inside));
    let mut best = Orientation { quarters: 0, mirrored: false, order: ORDERS[0], likeness: f64::NEG_INFINITY };
    for mirrored in [false, true] {
        for quarters in 0..4 {
            let undone = undone(&cells, quarters, mirrored);
            for order in ORDERS {
                let likeness = correlation(&wanted, &undone, order);
                if likeness > best.likeness + 1e-6 {
                    best = Orientation { quarters, mirrored, order, likeness };
                }
            }
        }
    }
    let unmirrored = if best.mirrored { captured.mirrored() } else { captured.clone() };
    let mut undone = unmirrored.turned(4 - best.quarters);
    undone.reordered(best.order);
    (best, undone)
}

/// Mirrors the square of cells if it was mirrored, and then turns it back.
fn undone(cells: &Cells, quarters: usize, mirrored: bool) -> Cells {
    let last = CELLS - 1;
    let from = |i: usize| {
        let (row, column) = (i / CELLS, i % CELLS);
        // This is `turned` by the right angles that are left to a whole turn.
        let (row, column) = match (4 - quarters) % 4 {
            0 => (row, column),
            1 => (last - column, row),
            2 => (last - row, last - column),
            _ => (column, last - row),
        };
        row * CELLS + if mirrored { last - column } else { column }
    };
    [0, 1, 2].map(|c| (0..CELLS * CELLS).map(|i| cells[c][from(i)]).collect())
}

fn correlation(a: &Cells, b: &Cells, order: [usize; 3]) -> f64 {
    let pairs = || (0..3).flat_map(|c| a[c].iter().zip(&b[order[c]]));
    let n = (3 * CELLS * CELLS) as f64;
    let (sum_a, sum_b) = pairs().fold((0.0, 0.0), |(x, y), (a, b)| (x + a, y + b));
    let (mean_a, mean_b) = (sum_a / n, sum_b / n);
    let [mut ab, mut aa, mut bb] = [0.0; 3];
    for (a, b) in pairs() {
        let (a, b) = (a - mean_a, b - mean_b);
        (ab, aa, bb) = (ab + a * b, aa + a * a, bb + b * b);
    }
    if aa * bb > 0.0 { ab / (aa * bb).sqrt() } else { 0.0 }
}
