//! Counts how often a picture repeats along an axis, as a picture of many views does.

use rayon::prelude::*;

/// Number of parts of a line.
const ACROSS: usize = 64;
/// Number of parts of a view along the axis. They are coarser than the differences from view to view.
const ALONG: usize = 8;
/// A repetition differs from one period to the next by at most this share of the difference over half a period.
const REPEATS: f64 = 0.3;
/// A difference of at most this share may be a repetition, if it is clearly smaller than with one view more or one view
/// fewer.
const MAY_REPEAT: f64 = 0.5;
const CLEARLY: f64 = 0.6;
/// Means with smaller differences than this count as flat. Full scale is 1.
const FLAT: f64 = 1e-3;

/// Cumulative sums of the means of parts of a picture's lines, from its first line on.
pub(crate) struct Lines {
    sums: Vec<f64>,
    across: usize,
}

impl Lines {
    /// Returns the sums of a plane of `height` x `width` values, of its rows for axis 0 and of its columns for axis 1.
    pub(crate) fn of(plane: &[f32], [height, width]: [usize; 2], axis: usize) -> Self {
        let (n, long) = if axis == 0 { (height, width) } else { (width, height) };
        let across = ACROSS.min(long);
        let value =
            |line: usize, at: usize| if axis == 0 { plane[line * width + at] } else { plane[at * width + line] };
        let means = |line: usize| {
            let part = move |i: usize| {
                let part = i * long / across..(i + 1) * long / across;
                let count = part.len() as f64;
                part.map(|at| f64::from(value(line, at))).sum::<f64>() / count
            };
            (0..across).map(part)
        };
        let means: Vec<f64> = (0..n).into_par_iter().flat_map_iter(means).collect();
        let mut sums = vec![0.0; across];
        for (i, mean) in means.iter().enumerate() {
            sums.push(sums[i] + mean);
        }
        Self { sums, across }
    }

    /// Returns the difference of the picture from view to view if it has `count` views, over the difference at half a
    /// view. It is far below 1 if the picture has this number of views, and infinite for a flat or too small picture.
    pub(crate) fn unlike(&self, count: usize) -> f64 {
        let (lines, parts) = (self.sums.len() / self.across - 1, count * ALONG);
        if count < 2 || lines < parts {
            return f64::INFINITY;
        }
        let edge = |part: usize| part * lines / parts;
        let mean = |part: usize, at: usize| {
            let [from, to] = [edge(part), edge(part + 1)];
            (self.sums[to * self.across + at] - self.sums[from * self.across + at]) / (to - from) as f64
        };
        let means: Vec<f64> =
            (0..parts).flat_map(|part| (0..self.across).map(move |at| (part, at))).map(|(p, at)| mean(p, at)).collect();
        let apart = |parts: usize| {
            let there = &means[parts * self.across..];
            means.iter().zip(there).map(|(a, b)| (a - b).abs()).sum::<f64>() / there.len() as f64
        };
        let half = apart(ALONG / 2);
        if half > FLAT { apart(ALONG) / half } else { f64::INFINITY }
    }

    /// Returns how often the picture repeats, at most `most` times. It returns `None` if it does not repeat.
    pub(crate) fn times(&self, most: usize) -> Option<usize> {
        let unlike: Vec<f64> = (0..=most + 1).map(|count| self.unlike(count)).collect();
        // A picture that repeats nine times also repeats three times. At nine it differs less than at eight and at ten.
        (2..=most).rev().find(|&i| unlike[i] < REPEATS && unlike[i] <= unlike[i - 1].min(unlike[i + 1]))
    }

    /// Returns how often the picture may repeat, at most `most` times, if large differences make the repetition
    /// uncertain. It returns `None` if nothing suggests a repetition.
    pub(crate) fn doubtful(&self, most: usize) -> Option<usize> {
        let unlike: Vec<f64> = (0..=most + 1).map(|count| self.unlike(count)).collect();
        let is_clear = |&i: &usize| unlike[i] <= CLEARLY * unlike[i - 1].min(unlike[i + 1]);
        (2..=most).rev().filter(|&i| unlike[i] < MAY_REPEAT).find(is_clear)
    }
}
