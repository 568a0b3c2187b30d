//! Converts linear light to an sRGB picture of any size.

use crate::evaluate::Plane;
use crate::files::linear_to_srgb;
use crate::optics::Color;
use rayon::prelude::*;
use std::sync::OnceLock;

/// The resolution of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Detail {
    /// The picture has only as many pixels as the intensity behind a small pupil needs (OPTICS 5). It is exact at its
    /// samples. For a hologram in tiles, it uses the middle of the pupil alone.
    Coarse,
    /// The picture has the pixels of the SLM.
    Whole,
}

/// An sRGB picture with 8 bits per channel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// The rows and the columns.
    pub size: [usize; 2],
    /// The values (row, column, channel), with the channels red, green and blue.
    pub rgb: Vec<u8>,
}

impl Picture {
    /// Returns a black picture.
    pub fn black(size: [usize; 2]) -> Self {
        Self { size, rgb: vec![0; 3 * size[0] * size[1]] }
    }
}

/// The number of steps in the table of guesses, one for each 4096th of full scale.
const GUESSES: usize = 4096;

/// The least light of each of the 256 levels, and a guess that is at most the level.
struct Levels {
    least: [f32; 256],
    guess: [u8; GUESSES + 1],
}

fn levels() -> &'static Levels {
    static LEVELS: OnceLock<Levels> = OnceLock::new();
    LEVELS.get_or_init(|| {
        let level = |v: f32| (linear_to_srgb(f64::from(v)) * 255.0).round() as usize;
        let mut least = [f32::INFINITY; 256];
        least[0] = f32::NEG_INFINITY;
        for (l, least) in least.iter_mut().enumerate().skip(1) {
            // Positive floats have the same order as their bits.
            let (mut below, mut from) = (0, 1f32.to_bits());
            while below + 1 < from {
                let middle = (below + from) / 2;
                if level(f32::from_bits(middle)) >= l { from = middle } else { below = middle }
            }
            *least = f32::from_bits(from);
        }
        let guess = |i: usize| level(i as f32 / GUESSES as f32) as u8;
        let mut guesses = [0; GUESSES + 1];
        guesses.iter_mut().enumerate().for_each(|(i, g)| *g = guess(i));
        Levels { least, guess: guesses }
    })
}

/// Returns the level of this light in a PNG, which is the nearest of 256 on the sRGB curve. NaN is black.
fn level(levels: &Levels, v: f32) -> u8 {
    if v.is_nan() {
        return 0;
    }
    let mut level = usize::from(levels.guess[(v.clamp(0.0, 1.0) * GUESSES as f32) as usize]);
    while level < 255 && v >= levels.least[level + 1] {
        level += 1;
    }
    level as u8
}

/// The first sample and the weights of the samples for each pixel of the result, along one axis.
type Taps = Vec<(usize, Vec<f32>)>;

/// Computes the weights of a triangle as wide as the wider of both pixels. This is linear interpolation for a larger
/// result, a mean for a smaller one, and the identity for equal sizes.
///
/// Sample j of `from` is at pixel `j * whole / from` of an axis of `whole` pixels.
fn taps(from: usize, whole: usize, to: usize) -> Taps {
    let scale = whole as f64 / to as f64;
    let ratio = from as f64 / whole as f64;
    let reach = (scale * ratio).max(1.0);
    let one = |i: usize| {
        let at = ((i as f64 + 0.5) * scale - 0.5) * ratio;
        let first = (at - reach).ceil().max(0.0) as usize;
        let last = ((at + reach).floor().max(0.0) as usize).min(from - 1);
        let weight = |j: usize| (1.0 - (j as f64 - at).abs() / reach).max(0.0);
        let first = first.min(last);
        let sum: f64 = (first..=last).map(weight).sum();
        let weights: Vec<f32> = (first..=last).map(|j| (weight(j) / sum.max(1e-9)) as f32).collect();
        // Samples of weight 0 at the ends may be NaN.
        let skip = weights.iter().take_while(|w| **w == 0.0).count().min(weights.len() - 1);
        let keep = weights.iter().rposition(|w| *w != 0.0).map_or(1, |i| i + 1 - skip);
        (first + skip, weights[skip..skip + keep].to_vec())
    };
    (0..to).map(one).collect()
}

/// Resizes a plane, which samples a picture of `whole` pixels, to `to` pixels.
fn resized(plane: &Plane, whole: [usize; 2], to: [usize; 2]) -> Vec<f32> {
    if [plane.rows, plane.columns] == to && whole == to {
        return plane.values.clone();
    }
    let (rows, columns) = (taps(plane.rows, whole[0], to[0]), taps(plane.columns, whole[1], to[1]));
    let mut out = vec![0.0; to[0] * to[1]];
    let line = |(out, (first, weights)): (&mut [f32], &(usize, Vec<f32>))| {
        let mut sum = vec![0.0; plane.columns];
        for (row, weight) in plane.values[first * plane.columns..].chunks_exact(plane.columns).zip(weights) {
            sum.iter_mut().zip(row).for_each(|(s, v)| *s += weight * v);
        }
        for (out, (first, weights)) in out.iter_mut().zip(&columns) {
            *out = sum[*first..].iter().zip(weights).map(|(v, w)| v * w).sum();
        }
    };
    out.par_chunks_exact_mut(to[1]).zip(&rows).for_each(line);
    out
}

/// Makes the picture of `to` pixels from planes that sample a picture of `whole` pixels, each times its exposure. Each
/// plane fills the channel of its color. A single plane gives a gray picture, as `eyebox render` writes it.
///
/// Light is resized before it is encoded, so that speckle keeps its brightness.
pub fn develop(
    planes: &[Plane],
    colors: &[Option<Color>],
    exposures: &[f64],
    whole: [usize; 2],
    to: [usize; 2],
) -> Picture {
    let mut picture = Picture::black(to);
    let levels = levels();
    for (i, (plane, exposure)) in planes.iter().zip(exposures).enumerate() {
        let grey = planes.len() == 1;
        let channel = colors.get(i).copied().flatten().map_or(i.min(2), Color::channel);
        let light = resized(plane, whole, to);
        picture.rgb.par_chunks_mut(3 * to[1].max(1)).zip(light.par_chunks(to[1].max(1))).for_each(|(out, light)| {
            for (pixel, v) in out.chunks_exact_mut(3).zip(light) {
                let level = level(levels, v * *exposure as f32);
                if grey { pixel.fill(level) } else { pixel[channel] = level }
            }
        });
    }
    picture
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane(rows: usize, columns: usize, value: impl Fn(usize, usize) -> f32) -> Plane {
        Plane { rows, columns, values: (0..rows * columns).map(|i| value(i / columns, i % columns)).collect() }
    }

    #[test]
    fn levels_are_those_of_a_png() {
        let table = levels();
        let ends = [0.0, -1.0, 1.0, 2.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e-30, 0.003_130_8];
        let edges = table.least[1..256].iter().flat_map(|v| [*v, v.next_down(), v.next_up()]);
        for v in ends.into_iter().chain(edges).chain((0..100_000).map(|i| i as f32 / 99_000.0)) {
            assert_eq!(level(table, v), (linear_to_srgb(f64::from(v)) * 255.0).round() as u8, "{v}");
        }
    }

    #[test]
    fn equal_sizes_change_nothing() {
        let light = plane(5, 7, |y, x| (y * 7 + x) as f32 / 35.0);
        let one = develop(std::slice::from_ref(&light), &[None], &[1.0], [5, 7], [5, 7]);
        let expected: Vec<u8> = light.values.iter().flat_map(|v| [level(levels(), *v); 3]).collect();
        assert_eq!(one.rgb, expected);
        let through_taps = taps(7, 7, 7);
        assert!(through_taps.iter().enumerate().all(|(i, (first, w))| (*first, &w[..]) == (i, &[1.0][..])));
    }

    #[test]
    fn light_keeps_its_mean_and_its_place() {
        // Stripes of one pixel become an even gray of half the light, not of half the level.
        let stripes = plane(64, 64, |_, x| (x % 2) as f32);
        let half = develop(std::slice::from_ref(&stripes), &[None], &[1.0], [64, 64], [16, 16]);
        assert!(
            half.rgb.chunks_exact(48).all(|row| row[9..39].iter().all(|v| v.abs_diff(188) < 3)),
            "{:?}",
            &half.rgb[..48]
        );
        // A ramp stays a ramp at the same places for a larger result, a smaller one and fewer samples. A triangle whose
        // width is no whole number of samples is off by a tenth of a sample.
        let ramp =
            |n: usize, whole: usize| plane(n, n, move |y, x| (x as f32 + 3.0 * y as f32) / n as f32 * whole as f32);
        let off = |samples: usize| 0.1 * (1.0 + 3.0) * 60.0 / samples as f32;
        for (samples, to) in [(60, 120), (60, 20), (20, 60), (30, 25)] {
            let out = resized(&ramp(samples, 60), [60, 60], [to, to]);
            for y in to / 4..3 * to / 4 {
                for x in to / 4..3 * to / 4 {
                    let at = |i: usize| (i as f32 + 0.5) * 60.0 / to as f32 - 0.5;
                    let expected = at(x) + 3.0 * at(y);
                    assert!(
                        (out[y * to + x] - expected).abs() < off(samples),
                        "{samples} {to}: {} {expected}",
                        out[y * to + x]
                    );
                }
            }
        }
    }

    #[test]
    fn colors_go_to_their_channels() {
        let planes = [plane(1, 2, |_, _| 1.0), plane(1, 2, |_, x| x as f32)];
        let colors = [Some(Color::Blue), Some(Color::Red)];
        assert_eq!(develop(&planes, &colors, &[1.0, 1.0], [1, 2], [1, 2]).rgb, [0, 0, 255, 255, 0, 255]);
        assert_eq!(develop(&planes, &[None, None], &[1.0, 0.0], [1, 2], [1, 2]).rgb, [255, 0, 0, 255, 0, 0]);
    }
}
