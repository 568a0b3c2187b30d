//! Names what a link changed, from a capture of the test picture.

use super::draw::{Layout, TestPictureError, test_picture};
use super::orient::{ORDERS, Orientation, Picture, orient};

/// The least correlation of a capture with the test picture.
const LIKENESS: f64 = 0.9;
/// The largest standard deviation within a level, in levels. Dither stays below it, and cameras are above it.
const NOISE: f64 = 3.0;
/// A level may change by this amount, because a conversion to YCbCr and back rounds twice.
const ROUNDING: f64 = 1.5;
/// A channel may appear in another one by this amount, because the conversion rounds.
const MIXED: f64 = 8.0;
/// Levels from this one on may share their colors with the frame.
const MOST_MIXED: usize = 251;
/// Below this share of its contrast, a pattern of single pixels is lost.
const LOST: f64 = 0.5;
/// Above this share of pixels off the level of their column, the link dithers.
const DITHERED: f64 = 0.02;

/// A change by the link. In serialized form it has a `kind`.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
#[non_exhaustive]
pub enum LinkFault {
    /// The link sends the levels 16 to 235 only.
    LimitedRange,
    /// Levels are shifted, as by a gamma ramp.
    Levels {
        /// The largest shift of red, green and blue (levels).
        shift: [f64; 3],
    },
    /// Light of one channel appears in another one, as by a color matrix.
    ColorsMixed {
        /// The largest level of a channel that should be dark.
        levels: f64,
    },
    /// Colors have a lower resolution than gray.
    ChromaSubsampled {
        /// True if rows share their colors, too (4:2:0 instead of 4:2:2).
        rows: bool,
    },
    /// Pixels of one level differ.
    Dither {
        /// The share of pixels that are off.
        share: f64,
        /// The largest difference (levels).
        levels: f64,
    },
    /// The picture was scaled, moved or cropped.
    Scaled {
        /// Rows and columns of the capture.
        size: [usize; 2],
        /// The part of the capture that the picture fills, as top, left, bottom and right (pixels), if its frame is
        /// visible.
        inside: Option<[usize; 4]>,
    },
    /// The picture was turned clockwise, and then mirrored left to right.
    Turned {
        /// The clockwise angle (degrees).
        degrees: usize,
        /// True if it was mirrored.
        mirrored: bool,
    },
    /// Channels of the picture are exchanged.
    ChannelsSwapped {
        /// The channels that receive red, green and blue, such as "bgr".
        order: String,
    },
}

/// The result of a capture.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
#[non_exhaustive]
pub struct CaptureReport {
    /// The changes by the link. It is empty if the link changes nothing.
    pub faults: Vec<LinkFault>,
    /// Pairs of neighboring levels that became equal, of 255. It is `None` if the capture's levels could not be read.
    pub merged_levels: Option<usize>,
}

/// Compares a capture, (row, column, channel) with red first, with the test picture of `size` rows and columns.
///
/// # Errors
/// [`TestPictureError`], and [`TestPictureError::NotACapture`] for a picture of a camera.
pub fn judge_capture(
    size: [usize; 2],
    captured: &[u8],
    captured_size: [usize; 2],
) -> Result<CaptureReport, TestPictureError> {
    let layout = Layout::new(size)?;
    let picture = Picture { size, rgb: test_picture(size)? };
    let bytes = captured.len();
    if bytes == 0 || captured_size[0].checked_mul(captured_size[1]).and_then(|n| n.checked_mul(3)) != Some(bytes) {
        return Err(TestPictureError::Bytes { size: captured_size, bytes });
    }
    let captured = Picture { size: captured_size, rgb: captured.to_vec() };
    let filled = frame(&captured).unwrap_or(captured.whole());
    let (orientation, capture) = orient(&picture, &captured, filled);
    let likeness = orientation.likeness;
    if likeness < LIKENESS {
        return Err(TestPictureError::NotACapture { likeness, noise: 0.0 });
    }
    let mut faults = of_orientation(orientation);
    let inside = frame(&capture);
    let reader = inside.map(|inside| Reader { layout: &layout, capture: &capture, inside });
    let tables = reader.as_ref().map(Reader::levels);
    let swing = tables.as_ref().map_or(255.0, |t| (t[1][255] - t[1][0]).abs().max(1.0));
    let is_exact = capture.size == size && inside == Some(picture.whole());
    if !is_exact || contrast(&layout, &capture, Pattern::Checkerboard) < LOST * swing {
        faults.push(LinkFault::Scaled { size: captured_size, inside });
    } else {
        let (share, levels, noise) = spread(&layout, &capture);
        if noise > NOISE {
            return Err(TestPictureError::NotACapture { likeness, noise });
        }
        if share > DITHERED {
            faults.push(LinkFault::Dither { share, levels });
        }
        let [columns, rows] = [Pattern::Columns, Pattern::Rows].map(|p| contrast(&layout, &capture, p) < LOST * swing);
        if columns || rows {
            faults.push(LinkFault::ChromaSubsampled { rows });
        }
    }
    if let (Some(reader), Some(tables)) = (&reader, &tables) {
        faults.extend(of_levels(tables));
        let levels = reader.mixed(tables);
        if levels > MIXED {
            faults.push(LinkFault::ColorsMixed { levels });
        }
    }
    let merged = |t: &[Vec<f64>; 3]| t[1].windows(2).filter(|pair| pair[0].round() >= pair[1].round()).count();
    Ok(CaptureReport { faults, merged_levels: tables.as_ref().map(merged) })
}

fn of_orientation(found: Orientation) -> Vec<LinkFault> {
    let mut faults = Vec::new();
    if found.quarters != 0 || found.mirrored {
        faults.push(LinkFault::Turned { degrees: 90 * found.quarters, mirrored: found.mirrored });
    }
    if found.order != ORDERS[0] {
        let order = found.order.iter().map(|c| ['r', 'g', 'b'][*c]).collect();
        faults.push(LinkFault::ChannelsSwapped { order });
    }
    faults
}

/// Judges the levels of red, green and blue in the strip of gray.
fn of_levels(tables: &[Vec<f64>; 3]) -> Option<LinkFault> {
    let off = |table: &Vec<f64>, line: fn(f64) -> f64| {
        table.iter().enumerate().map(|(level, is)| (is - line(level as f64)).abs()).fold(0.0, f64::max)
    };
    let shift = [0, 1, 2].map(|c| off(&tables[c], |level| level));
    if shift.iter().all(|shift| *shift <= ROUNDING) {
        return None;
    }
    let is_limited = tables.iter().all(|table| off(table, |level| 16.0 + 219.0 * level / 255.0) <= ROUNDING);
    Some(if is_limited { LinkFault::LimitedRange } else { LinkFault::Levels { shift } })
}

/// Finds the frame of one white pixel, as top, left, bottom and right.
fn frame(capture: &Picture) -> Option<[usize; 4]> {
    let [height, width] = capture.size;
    let gray = |row: usize, column: usize| (0..3).map(|c| capture.at(row, column, c)).fold(f64::INFINITY, f64::min);
    let row = |row: usize| (0..width).map(|column| gray(row, column)).sum::<f64>() / width as f64;
    let column = |column: usize| (0..height).map(|row| gray(row, column)).sum::<f64>() / height as f64;
    // Scaling spreads a line over two, each of which has half of its light.
    let line = |mean: f64| mean > 60.0;
    Some([
        (0..height / 4).find(|i| line(row(*i)))?,
        (0..width / 4).find(|i| line(column(*i)))?,
        (height - height / 4..height).rev().find(|i| line(row(*i)))?,
        (width - width / 4..width).rev().find(|i| line(column(*i)))?,
    ])
}

/// Reads levels of a capture that may be scaled.
struct Reader<'a> {
    layout: &'a Layout,
    capture: &'a Picture,
    inside: [usize; 4],
}

impl Reader<'_> {
    /// The mean of a channel in the middle of the area of a level.
    fn mean(&self, strip: usize, level: usize, channel: usize) -> f64 {
        let [top, left, bottom, right] = self.inside;
        let scale = [
            (bottom - top) as f64 / (self.layout.size[0] - 1) as f64,
            (right - left) as f64 / (self.layout.size[1] - 1) as f64,
        ];
        let (rows, columns) = (self.layout.levels(strip), self.layout.level(level));
        let place = |offset: usize, at: f64, scale: f64| offset + (at * scale).round() as usize;
        let column = place(left, (columns.start + columns.end - 1) as f64 / 2.0, scale[1]);
        let third = rows.len() / 3;
        let rows = (rows.start + third..rows.end - third).map(|row| place(top, row as f64, scale[0]));
        let (sum, count) = rows.fold((0.0, 0.0), |(s, n), row| (s + self.capture.at(row, column, channel), n + 1.0));
        sum / f64::max(count, 1.0)
    }

    /// The levels of red, green and blue in the strip of gray.
    fn levels(&self) -> [Vec<f64>; 3] {
        [0, 1, 2].map(|c| (0..256).map(|level| self.mean(0, level, c)).collect())
    }

    /// The largest level of a channel that is dark in the strip of another one.
    fn mixed(&self, tables: &[Vec<f64>; 3]) -> f64 {
        let pairs = (0..3).flat_map(|own| (0..3).filter(move |c| *c != own).map(move |c| (own, c)));
        let levels = pairs.flat_map(|(own, c)| (0..MOST_MIXED).step_by(5).map(move |level| (own, c, level)));
        levels.map(|(own, c, level)| (self.mean(1 + own, level, c) - tables[c][0]).abs()).fold(0.0, f64::max)
    }
}

/// A pattern of single pixels.
#[derive(Clone, Copy)]
enum Pattern {
    Checkerboard,
    Columns,
    Rows,
}

/// The contrast of a pattern, which is 255 if nothing is lost.
fn contrast(layout: &Layout, capture: &Picture, pattern: Pattern) -> f64 {
    let width = layout.size[1];
    let (rows, columns) = match pattern {
        Pattern::Checkerboard => layout.checkerboard(),
        Pattern::Columns => (layout.columns(), 1..width - 1),
        Pattern::Rows => (layout.rows(), 1..width - 1),
    };
    // A whole number of periods has no mean.
    let (rows, columns) =
        (rows.start..rows.start + rows.len() / 2 * 2, columns.start..columns.start + columns.len() / 2 * 2);
    let mut sum = 0.0;
    for row in rows.clone() {
        for column in columns.clone() {
            let (value, turn) = match pattern {
                Pattern::Checkerboard => (2.0 * capture.at(row, column, 1), row + column),
                Pattern::Columns => (capture.at(row, column, 0) - capture.at(row, column, 2), column),
                Pattern::Rows => (capture.at(row, column, 0) - capture.at(row, column, 2), row),
            };
            sum += if turn.is_multiple_of(2) { value } else { -value };
        }
    }
    (sum / (rows.len() * columns.len()) as f64).abs()
}

/// The share of pixels that are off the level of their column in the strip of gray, the largest difference, and the
/// standard deviation.
fn spread(layout: &Layout, capture: &Picture) -> (f64, f64, f64) {
    let rows = layout.levels(0);
    // Rows at the edge may share their colors with the next area.
    let rows = rows.start + 1..rows.end - 1;
    let (mut count, mut off, mut largest, mut squares) = (0.0, 0.0, 0.0_f64, 0.0);
    for column in 1..layout.size[1] - 1 {
        let mut values: Vec<f64> = rows.clone().map(|row| capture.at(row, column, 1)).collect();
        values.sort_by(f64::total_cmp);
        let middle = values[values.len() / 2];
        for value in values {
            let by = (value - middle).abs();
            count += 1.0;
            squares += by * by;
            largest = largest.max(by);
            off += f64::from(u8::from(by > 0.0));
        }
    }
    (off / count, largest, (squares / count).sqrt())
}
