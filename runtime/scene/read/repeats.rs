//! How often a picture repeats along an axis, as one of many views does.

use rayon::prelude::*;

/// Parts of a line.
const ACROSS: usize = 64;
/// Parts of a view along the axis: coarser than what differs from view to view.
const ALONG: usize = 8;
/// What repeats differs from one time to the next by at most this share of what it does half as far apart.
const REPEATS: f64 = 0.3;
/// What differs by at most this share may repeat, if it does so far less than one time more or less does.
const MAY_REPEAT: f64 = 0.5;
const CLEARLY: f64 = 0.6;
/// Means that differ by less show nothing; full scale is 1.
const FLAT: f64 = 1e-3;

/// Means of parts of a picture's lines, added up from its first line on.
pub(crate) struct Lines {
    sums: Vec<f64>,
    across: usize,
}

impl Lines {
    /// Those of a plane of `height` x `width` values: its rows for axis 0, its columns for 1.
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

    /// How much the picture differs from view to view if it is `count` of them, over how much it does half a view apart: far below 1 where
    /// it is. Nothing is told by one that is flat, or too small.
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

    /// How often the picture repeats, at most `most` times; none where it does not.
    pub(crate) fn times(&self, most: usize) -> Option<usize> {
        let unlike: Vec<f64> = (0..=most + 1).map(|count| self.unlike(count)).collect();
        // What repeats nine times does so three times as well; ten times it does less than nine and more than eleven.
        (2..=most).rev().find(|&i| unlike[i] < REPEATS && unlike[i] <= unlike[i - 1].min(unlike[i + 1]))
    }

    /// How often the picture may repeat, at most `most` times, though too much differs to be sure; none if nothing suggests it.
    pub(crate) fn doubtful(&self, most: usize) -> Option<usize> {
        let unlike: Vec<f64> = (0..=most + 1).map(|count| self.unlike(count)).collect();
        let is_clear = |&i: &usize| unlike[i] <= CLEARLY * unlike[i - 1].min(unlike[i + 1]);
        (2..=most).rev().filter(|&i| unlike[i] < MAY_REPEAT).find(is_clear)
    }
}
