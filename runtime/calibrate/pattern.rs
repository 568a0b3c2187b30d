//! Makes the patterns (dots, even drives, smooth and random ones), and plans their irises and their order.

use super::message::Hello;
use eyebox_base::files::{self, FileError, write_file};
use eyebox_kernels::{Complex64, fft};
use eyebox_optics::{Optics, SlmPart};
use eyebox_solve::solve::SplitMix;
use std::f64::consts::{PI, TAU};
use std::path::Path;

/// Requested phases, quantized to the levels of the SLM.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Pattern {
    pub(super) frames: usize,
    pub(super) height: usize,
    pub(super) width: usize,
    /// Number of levels in one turn.
    pub(super) two_pi_level: f64,
    /// (frames, height, width), radians in 0 .. 2 pi.
    pub(super) drive: Vec<f32>,
}

impl Pattern {
    pub(super) fn new([height, width]: [usize; 2], two_pi_level: f64, phases: &[f64]) -> Self {
        let (most, turn) = (two_pi_level.ceil() - 1.0, TAU / two_pi_level);
        let level = |phase: f64| (phase.rem_euclid(TAU) / turn).round().min(most);
        let drive = phases.iter().map(|p| (level(*p) * turn) as f32).collect();
        Self { frames: phases.len() / (height * width), height, width, two_pi_level, drive }
    }

    pub(super) fn frame(&self, t: usize) -> &[f32] {
        let pixels = self.height * self.width;
        &self.drive[t * pixels..][..pixels]
    }

    pub(super) fn part(&self, part: &SlmPart) -> Self {
        let ([row, column], [rows, columns]) = (part.first, part.size);
        let line = |t: usize, y: usize| &self.frame(t)[(row + y) * self.width + column..][..columns];
        let lines = (0..self.frames).flat_map(|t| (0..rows).map(move |y| (t, y)));
        let drive = lines.flat_map(|(t, y)| line(t, y).iter().copied()).collect();
        Self { height: rows, width: columns, drive, ..*self }
    }

    /// True if both patterns are equal up to rounding.
    pub(super) fn is_like(&self, other: &Self) -> bool {
        let close = |(a, b): (&f32, &f32)| (a - b).abs() < 1e-4;
        self.drive.len() == other.drive.len() && self.drive.iter().zip(&other.drive).all(close)
    }

    /// The drive of all pixels, if all have the same.
    pub(super) fn even_drive(&self) -> Option<f64> {
        let first = self.drive.first()?;
        self.drive.iter().all(|w| (w - first).abs() < 1e-4).then_some(f64::from(*first))
    }

    pub(super) fn kind(&self) -> &'static str {
        match self.even_drive() {
            Some(_) => "even",
            None if self.frames > 1 => "set",
            None if self.is_smooth() => "smooth",
            None => "random",
        }
    }

    /// True if neighbors differ so little that the pattern excites no crosstalk.
    pub(super) fn is_smooth(&self) -> bool {
        let rows = self.frame(0).chunks_exact(self.width);
        let steps = rows.flat_map(|row| row.windows(2).map(|w| f64::from((w[1] - w[0]).abs())));
        steps.sum::<f64>() / self.frame(0).len() as f64 <= 0.7
    }

    /// Writes the pattern as a `.npy` of shape (sub-frame, row, column), in levels or in radians.
    pub(super) fn write(&self, file: &Path, levels: bool) -> Result<(), FileError> {
        let shape = [self.frames, self.height, self.width];
        if !levels {
            return files::write_npy(file, &shape, &self.drive);
        }
        let turn = TAU / self.two_pi_level;
        let levels: Vec<u16> = self.drive.iter().map(|w| (f64::from(*w) / turn).round() as u16).collect();
        let wide = self.two_pi_level > 256.0;
        let kind = if wide { "<u2" } else { "|u1" };
        write_file(file, |out| {
            out.write_all(&files::npy_header(kind, &shape))?;
            levels.iter().try_for_each(|v| match wide {
                true => out.write_all(&v.to_le_bytes()),
                false => out.write_all(&[*v as u8]),
            })
        })
    }
}

/// The places of the dots, (x, y) in pixels, and their radius in pixels. The places deviate from a regular grid and
/// some are missing, so that no rotation or reflection looks like another.
pub(super) fn dots([height, width]: [usize; 2]) -> (Vec<[f64; 2]>, f64) {
    let side = height.min(width) as f64;
    let across = if side >= 128.0 { 7.0 } else { 5.0 };
    let step = 0.84 * side / across;
    let mut random = SplitMix(0x646f_7473);
    let count = |n: usize| (0.84 * n as f64 / step).round() as usize;
    let (rows, columns) = (count(height), count(width));
    let mut places = Vec::new();
    for row in 0..rows {
        for column in 0..columns {
            let mut off = || (random.unit() - 0.5) * 0.4 * step;
            let at = |i: usize, n: usize, pixels: usize, off: f64| {
                (pixels as f64 - 1.0) / 2.0 + (i as f64 - (n as f64 - 1.0) / 2.0) * step + off
            };
            let place = [at(column, columns, width, off()), at(row, rows, height, off())];
            if !(row == 0 && column == 1 || row + 1 == rows && column < 2) {
                places.push(place);
            }
        }
    }
    (places, 0.21 * step)
}

/// The distance of neighboring dots, pixels.
pub(super) fn spacing(size: [usize; 2]) -> f64 {
    dots(size).1 / 0.21
}

/// The hologram of the dots. A pixel within a dot sends its light straight on. A grating without light on the axis
/// sends the light of all others past the iris.
pub(super) fn dots_pattern(size @ [height, width]: [usize; 2], two_pi_level: f64) -> Pattern {
    let (places, radius) = dots(size);
    let phase = |i: usize| {
        let (x, y) = ((i % width) as f64, (i / width) as f64);
        let inside = places.iter().any(|[px, py]| (x - px).hypot(y - py) < radius);
        let stripe = (i % width / 2 + i / width / 2).is_multiple_of(2);
        if inside {
            PI / 2.0
        } else if stripe {
            0.0
        } else {
            PI
        }
    };
    Pattern::new(size, two_pi_level, &(0..height * width).map(phase).collect::<Vec<_>>())
}

/// A random pattern with frequencies up to a tenth of a cycle per pixel, whose phases never come near a wrap.
fn smooth(size @ [height, width]: [usize; 2], two_pi_level: f64, seed: u64) -> Pattern {
    let mut random = SplitMix(seed ^ 0x736d_6f6f_7468);
    let mut field: Vec<Complex64> = (0..height * width).map(|_| Complex64::new(random.unit() - 0.5, 0.0)).collect();
    let frequency = |i: usize, n: usize| eyebox_optics::frequency_bin(i as i64, n) as f64 / n as f64;
    field = transformed(field, size, fft::Direction::Forward);
    for (i, v) in field.iter_mut().enumerate() {
        if frequency(i % width, width).hypot(frequency(i / width, height)) > 0.1 {
            *v = Complex64::new(0.0, 0.0);
        }
    }
    field = transformed(field, size, fft::Direction::Inverse);
    let mean = field.iter().map(|v| v.re).sum::<f64>() / field.len() as f64;
    let peak = field.iter().map(|v| (v.re - mean).abs()).fold(f64::MIN_POSITIVE, f64::max);
    let phases: Vec<f64> = field.iter().map(|v| PI + 0.88 * PI * (v.re - mean) / peak).collect();
    Pattern::new(size, two_pi_level, &phases)
}

/// The two-dimensional transform of an image, not normalized.
pub(super) fn transformed(
    mut field: Vec<Complex64>,
    [height, width]: [usize; 2],
    direction: fft::Direction,
) -> Vec<Complex64> {
    fft::transform_f64(&mut field, width, direction);
    let mut turned = transposed(&field, width);
    fft::transform_f64(&mut turned, height, direction);
    transposed(&turned, height)
}

/// Transposes an image of `width` columns.
pub(super) fn transposed<T: Copy + Default>(from: &[T], width: usize) -> Vec<T> {
    let height = from.len() / width;
    let mut out = vec![T::default(); from.len()];
    for (y, row) in from.chunks_exact(width).enumerate() {
        for (x, v) in row.iter().enumerate() {
            out[x * height + y] = *v;
        }
    }
    out
}

/// A pattern of `frames` sub-frames with phases uniform in 0 .. 2 pi.
pub(super) fn random(size: [usize; 2], two_pi_level: f64, frames: usize, seed: u64) -> Pattern {
    let mut random = SplitMix(seed ^ 0x7261_6e64_6f6d);
    let phases: Vec<f64> = (0..frames * size[0] * size[1]).map(|_| TAU * random.unit()).collect();
    Pattern::new(size, two_pi_level, &phases)
}

/// A pattern with a name and the irises through which it is seen. An iris is x, y and diameter in mm, or none if the
/// bench's iris does not move. Each picture is taken `times` times.
#[derive(Debug, Clone)]
pub(super) struct Show {
    pub(super) name: String,
    pub(super) pattern: Pattern,
    pub(super) irises_mm: Vec<Option<[f64; 3]>>,
    pub(super) times: usize,
}

/// Number of random patterns through an iris that does not move.
const FIXED_IRIS_PATTERNS: usize = 12;
/// Irises of the pictures that judge a fit, as shares of the eyebox. No fitted picture uses these places.
const HELD_OUT: [[f64; 3]; 3] = [[0.21, -0.1, 0.26], [-0.09, 0.14, 0.3], [-0.26, -0.22, 0.34]];
/// Number of even drives. With four of them the zero order has a closed form ([`super::even`]).
const EVEN: usize = 4;
/// Diameter of the small irises, share of the eyebox. Speckles are 5 pixels wide then, and a slope of the wavefront
/// shifts them.
const SMALL: f64 = 0.2;
/// The order of the pictures, with small irises (`s`), larger ones (`l`), smooth patterns (`m`), sets (`t`).
const ORDER: &str = "sssslstssmslssltsslssmlsl";

/// The iris of these shares of the eyebox, clamped to the range of the bench, mm.
fn within(hello: &Hello, optics: &Optics, shares: [f64; 3]) -> [f64; 3] {
    let [x, y, d] = shares.map(|v| v * optics.eyebox() * 1e3);
    let range = |v: f64, [low, high]: [f64; 2]| v.clamp(low, high);
    hello.iris.as_ref().map_or([x, y, d], |i| [range(x, i.x_mm), range(y, i.y_mm), range(d, i.diameter_mm)])
}

/// The iris of picture number `turn` of a check for drift. Five places take turns.
pub(super) fn drift_iris(hello: &Hello, optics: &Optics, turn: usize) -> [f64; 3] {
    let [x, y] = [[0.0, 0.0], [0.25, 0.25], [-0.25, -0.25], [0.25, -0.25], [-0.25, 0.25]][turn % 5];
    within(hello, optics, [x, y, 0.3])
}

/// Plans the patterns in their order. They need at most `most` pictures, two of which are the dots and the dark
/// picture.
pub(super) fn plan(hello: &Hello, optics: &Optics, two_pi_level: f64, most: usize, quick: bool) -> Vec<Show> {
    let size = [optics.height, optics.width];
    let iris = |shares: [f64; 3]| within(hello, optics, shares);
    let mut shows = Vec::new();
    let mut left = most.saturating_sub(2);
    let mut add = |name: String, pattern: Pattern, irises_mm: Vec<[f64; 3]>, times: usize| {
        let count = irises_mm.len() * times;
        if count <= left {
            left -= count;
            let irises_mm = irises_mm.into_iter().map(|iris| hello.iris.is_some().then_some(iris)).collect();
            shows.push(Show { name, pattern, irises_mm, times });
        }
    };
    let frames = hello.slm.sub_frames.min(4);
    let held_out = |i: usize| iris(HELD_OUT[i % HELD_OUT.len()]);
    if quick {
        for i in 0..3 {
            let iris = drift_iris(hello, optics, i);
            add(format!("random-{i}"), random(size, two_pi_level, 1, i as u64), vec![iris], 1);
        }
        return shows;
    }
    // Pictures that judge the fit come first. They are taken twice and never fitted.
    let tests = if most >= 30 { 3 } else { 1 };
    for i in 0..tests {
        let pattern = random(size, two_pi_level, if i == 1 { frames } else { 1 }, 1000 + i as u64);
        add(format!("held-out-{i}"), pattern, vec![held_out(i)], 2);
    }
    for i in 0..EVEN {
        let phase = TAU * i as f64 / EVEN as f64;
        let pattern = Pattern::new(size, two_pi_level, &vec![phase; size[0] * size[1]]);
        add(format!("even-{i}"), pattern, vec![iris([0.0, 0.0, SMALL])], 1);
    }
    if hello.iris.is_none() {
        // Without several irises, more patterns have to separate the numbers.
        for i in 0..FIXED_IRIS_PATTERNS {
            add(format!("random-{i}"), random(size, two_pi_level, 1, i as u64), vec![[0.0; 3]], 1);
            if i % 3 == 0 {
                add(format!("smooth-{i}"), smooth(size, two_pi_level, i as u64), vec![[0.0; 3]], 1);
            }
            if i < 2 && frames > 1 {
                add(format!("set-{i}"), random(size, two_pi_level, frames, 500 + i as u64), vec![[0.0; 3]], 1);
            }
        }
        return shows;
    }
    // The kinds alternate, so that a lower limit of pictures shortens all of them alike.
    let (mut small, mut large) = (small_irises().into_iter(), LARGE.into_iter());
    for (i, kind) in ORDER.chars().enumerate() {
        let (name, pattern, place) = match kind {
            's' => {
                let number = i as u64 % 2;
                (format!("random-{number}"), random(size, two_pi_level, 1, number), small.next())
            }
            'l' => {
                let number = 2 + i as u64 % 2;
                (format!("random-{number}"), random(size, two_pi_level, 1, number), large.next())
            }
            'm' => (format!("smooth-{i}"), smooth(size, two_pi_level, i as u64), Some([0.0, 0.0, 0.3])),
            _ if frames > 1 => {
                let place = if i < ORDER.len() / 2 { [0.0, 0.0, 0.3] } else { [0.13, -0.15, 0.3] };
                ("set".into(), random(size, two_pi_level, frames, 500), Some(place))
            }
            _ => continue,
        };
        if let Some(place) = place {
            add(name, pattern, vec![iris(place)], 1);
        }
    }
    shows
}

/// The places of the small irises (x, y, diameter, shares of the eyebox). They are the middle, a ring around it, and
/// the sides and corners, because the wavefront is extrapolated where no iris saw it. Consecutive places lie on
/// different sides.
fn small_irises() -> Vec<[f64; 3]> {
    let inner = |i: usize| {
        let turn = TAU * ((i * 5 % 6) as f64 + 0.25) / 6.0;
        [0.18 * turn.cos(), 0.18 * turn.sin(), SMALL]
    };
    let corner = |i: usize| [0.38 * [1.0, -1.0, 1.0, -1.0][i], 0.38 * [1.0, -1.0, -1.0, 1.0][i], SMALL];
    let side = |i: usize| [0.4 * [1.0, -1.0, 0.0, 0.0][i], 0.4 * [0.0, 0.0, 1.0, -1.0][i], SMALL];
    let mut all = vec![[0.0, 0.0, SMALL]];
    for i in 0..6 {
        all.push(inner(i));
        all.extend((i < 4).then(|| [corner(i), side(i)]).into_iter().flatten());
    }
    all
}

/// The places of the larger irises, shares of the eyebox. They are the corners, the middle and a side.
const LARGE: [[f64; 3]; 6] = [
    [0.27, 0.26, 0.4],
    [-0.27, -0.27, 0.38],
    [0.0, 0.02, 0.45],
    [-0.29, 0.28, 0.36],
    [0.28, -0.29, 0.34],
    [0.05, -0.3, 0.36],
];

/// The iris of the picture of the dots, mm.
pub(super) fn dots_iris(optics: &Optics) -> [f64; 3] {
    [0.0, 0.0, 0.23 * optics.eyebox() * 1e3]
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    /// The plan for a bench with at most `most` pictures.
    fn asked(iris: bool, sub_frames: usize, most: usize) -> Vec<Show> {
        let mut hello = json!({
            "protocol": 1, "colors": {"green": 520.0}, "slm": {"resolution": [32, 32], "sub_frames": sub_frames},
            "camera": {"resolution": [64, 64], "bits": 12},
        });
        if iris {
            hello["iris"] = json!({"x_mm": [-13, 13], "y_mm": [-13, 13], "diameter_mm": [0.5, 26]});
        }
        let optics = Optics::new(32, 32, 8e-6, 520e-9, 0.4).unwrap();
        plan(&Hello::read(&hello).unwrap(), &optics, 256.0, most, false)
    }

    fn count(shows: &[Show], name: &str) -> usize {
        shows.iter().filter(|s| s.name.starts_with(name)).map(|s| s.irises_mm.len() * s.times).sum()
    }

    #[test]
    fn a_bench_that_offers_less_is_asked_for_less() {
        let all = asked(true, 8, 40);
        assert_eq!([count(&all, "held-out"), count(&all, "even"), count(&all, "random")], [6, 4, 21]);
        assert_eq!([count(&all, "smooth"), count(&all, "set")], [2, 2]);
        for iris in [true, false] {
            for frames in [1, 4] {
                for most in [12, 20, 40] {
                    let shows = asked(iris, frames, most);
                    assert!(count(&shows, "") <= most - 2, "{iris} {frames} {most}: {}", count(&shows, ""));
                    assert_eq!(count(&shows, "even"), 4);
                    assert!(count(&shows, "random") >= 2, "{iris} {frames} {most}");
                    assert!(frames > 1 || shows.iter().all(|s| s.pattern.frames == 1));
                    assert!(shows.iter().flat_map(|s| &s.irises_mm).all(|place| place.is_some() == iris));
                }
            }
        }
    }

    #[test]
    fn small_irises_reach_every_corner_of_the_eyebox() {
        let all = small_irises();
        assert_eq!(all.len(), 15);
        for [sx, sy] in [[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]] {
            assert!(all.iter().any(|[x, y, _]| sx * x > 0.3 && sy * y > 0.3), "{sx} {sy}");
        }
        assert!(all.iter().all(|[x, y, d]| x.abs().max(y.abs()) + d / 2.0 <= 0.5));
    }
}
