//! Fits the zero order (light that the SLM does not modulate) in closed form from even drives.
//!
//! Even drives excite no crosstalk, no lag and no fly-back. The result therefore depends on no number that is still
//! unknown, and a tilt of any size is found.

use super::classified::Sorted;
use super::error::CalibrateError;
use super::fit::Effort;
use super::parameters::{Parameter, Parameters};
use super::pattern::transposed;
use eyebox_kernels::{Complex64, fft};
use eyebox_optics::linear::inverse;
use std::f64::consts::PI;

/// Largest number of waves of unmodulated light.
const PEAKS: usize = 3;
/// Waves with less than this share of the strongest amplitude start no fit.
const WEAK: f64 = 0.3;
/// After a first fit, waves with less than this share of the fitted amplitude start no fit.
const WEAKER: f64 = 0.2;
/// A fit that leaves less than this share of the even drives is in the right minimum.
const EXPLAINED: f64 = 0.01;
/// A further wave stays if it reduces the share that is left to this fraction.
const GAINS: f64 = 0.8;
/// A picture is excluded if all pictures leave more than `CONTRADICT`, and the others alone leave less than `ALONE` of
/// that.
const CONTRADICT: f64 = 0.05;
const ALONE: f64 = 0.2;
/// Largest number of places along a side at which the pictures are compared.
const PLACES: usize = 512;
/// Curvatures that are tried, in quarters of a radian: -2 to 2 rad.
const CURVATURES: std::ops::RangeInclusive<i32> = -8..=8;
/// One sub-pixel is enough, because an even drive shows no crosstalk.
const EVEN: Effort = Effort { subpixels: 1, slopes: 1, rounds: 20, enough: 0.01 };

#[derive(Clone)]
struct Image {
    rows: usize,
    columns: usize,
    values: Vec<Complex64>,
}

/// A wave of light that is not modulated, as the real and imaginary part of its amplitude, its tilts along x and y, and
/// its curvature, radians.
type Wave = [f64; 5];

/// The result of the fit to even drives.
pub(super) struct Even {
    pub(super) at: Parameters,
    /// A picture that contradicts the others, and the share of it that their fit leaves.
    pub(super) strange: Option<(usize, f64)>,
}

/// Fits source, table and zero order to the even drives. Without even drives all numbers stay as they are. Four even
/// drives are one more than the closed form needs. If all four contradict each other and three do not, the fourth is
/// excluded.
pub(super) fn fit(sorted: &Sorted, start: &Parameters) -> Result<Even, CalibrateError> {
    let even = &sorted.even;
    let Some((left, at)) = fit_to(sorted, start, even)? else {
        return Ok(Even { at: start.clone(), strange: None });
    };
    let mut best = Even { at, strange: None };
    if left < CONTRADICT || even.len() < 4 {
        return Ok(best);
    }
    // The strongest wave alone is enough to find the picture, if there is one.
    let mut least: Option<(f64, usize, Vec<usize>)> = None;
    for strange in even {
        let others: Vec<usize> = even.iter().copied().filter(|v| v != strange).collect();
        let Some(waves) = starts(sorted, start, &others)?.0.into_iter().next() else { continue };
        let (now, _) = from_waves(sorted, start, waves, &others)?;
        tracing::debug!("{now:.4} is left without {}", sorted.pictures.views[*strange].file.display());
        if now < least.as_ref().map_or(left, |(least, ..)| *least) {
            least = Some((now, *strange, others));
        }
    }
    if let Some((_, strange, others)) = least
        && let Some((now, at)) = fit_to(sorted, start, &others)?
        && now < ALONE * left
    {
        let of_strange = sorted.mean_left(&at, &[strange]);
        best = Even { at, strange: Some((strange, of_strange)) };
    }
    Ok(best)
}

/// Waves from which a fit to some even drives starts, the strongest first. The second member is the image in which they
/// were found, with the limits of their tilts.
type Starts = (Vec<Vec<Wave>>, Option<(Image, [f64; 2])>);

fn starts(sorted: &Sorted, start: &Parameters, which: &[usize]) -> Result<Starts, CalibrateError> {
    let unmodulated = ratios(sorted, start, which)?;
    let single = unmodulated.as_ref().map_or_else(Vec::new, |(image, limit)| strongest(image.clone(), *limit, &[]));
    let mut starts: Vec<Vec<Wave>> = single.into_iter().map(|wave| vec![wave]).collect();
    if !start.model.undiffracted.is_empty() || starts.is_empty() {
        starts.insert(0, start.model.undiffracted.clone());
    }
    Ok((starts, unmodulated))
}

/// Fits to some even drives from the start that leaves least. Returns the share that is left, and the fit.
fn fit_to(sorted: &Sorted, start: &Parameters, which: &[usize]) -> Result<Option<(f64, Parameters)>, CalibrateError> {
    if which.is_empty() {
        return Ok(None);
    }
    let (starts, unmodulated) = starts(sorted, start, which)?;
    let mut best: Option<(f64, Parameters)> = None;
    for waves in starts {
        let (left, at) = from_waves(sorted, start, waves, which)?;
        if best.as_ref().is_none_or(|(least, _)| left < *least) {
            best = Some((left, at));
        }
        if left < EXPLAINED {
            break;
        }
    }
    // A second reflection, from a window or a lens, is found in the rest of the first fit.
    let Some((image, limit)) = unmodulated else { return Ok(best) };
    let Some((mut left, mut at)) = best else { return Ok(None) };
    'further: while at.model.undiffracted.len() < PEAKS {
        for wave in strongest(image.clone(), limit, &at.model.undiffracted) {
            let mut waves = at.model.undiffracted.clone();
            waves.push(wave);
            let (now, with) = from_waves(sorted, &at, waves, which)?;
            if now < GAINS * left {
                (left, at) = (now, with);
                continue 'further;
            }
        }
        break;
    }
    // The brightest comes first, regardless of the order in which they were found.
    let light = |wave: &Wave| wave[0].hypot(wave[1]);
    at.model.undiffracted.sort_by(|a, b| light(b).total_cmp(&light(a)));
    Ok(Some((left, at)))
}

/// Fits to some even drives from these waves. Returns the share that is left, and the fit.
fn from_waves(
    sorted: &Sorted,
    start: &Parameters,
    waves: Vec<Wave>,
    which: &[usize],
) -> Result<(f64, Parameters), CalibrateError> {
    let mut free: Vec<Parameter> = (0..waves.len().max(1)).flat_map(Parameter::of_wave).collect();
    free.extend((0..5).map(Parameter::Source));
    let light = free.len();
    free.extend((0..9).map(Parameter::Level));
    free.extend((0..2).map(Parameter::Bend));
    let mut at = start.clone();
    at.model.undiffracted = waves;
    // Three turns determine three numbers, so a table far from its file can pass for other light. The light is fitted
    // first.
    let near = sorted.pictures.fit(&at, &at, &free[..light], which, EVEN, &mut |_| {})?;
    let fit = sorted.pictures.fit(&at, &near.at, &free, which, EVEN, &mut |_| {})?;
    let left = sorted.mean_left(&fit.at, which);
    let from = &at.model.undiffracted;
    tracing::debug!("{left:.4} of the even drives is left with the zero order from {from:.3?}");
    Ok((left, fit.at))
}

/// The amplitude of the unmodulated light over the amplitude of all light, and the limits of its tilts, if the drives
/// determine them.
fn ratios(sorted: &Sorted, at: &Parameters, which: &[usize]) -> Result<Option<(Image, [f64; 2])>, CalibrateError> {
    let pictures = &sorted.pictures;
    let [height, width] = at.map.slm;
    let [rows, columns] = [height, width].map(|n| n.min(PLACES));
    let (mut drives, mut images) = (Vec::new(), Vec::new());
    for v in which {
        let view = &pictures.views[*v];
        let Some(drive) = pictures.sets[view.set].pattern.even_drive() else { continue };
        let picture = view.picture(sorted.camera)?;
        let at_place = |i: usize| {
            let [x, y] = [(i % columns, width, columns), (i / columns, height, rows)]
                .map(|(i, pixels, places)| (i as f64 + 0.5) * pixels as f64 / places as f64 - 0.5);
            (picture.between(at.map.to_camera([x, y])) - pictures.dark) / view.exposure_ms
        };
        drives.push(drive);
        images.push((0..rows * columns).map(at_place).collect::<Vec<f64>>());
    }
    let Some(values) = unmodulated(&drives, &images) else { return Ok(None) };
    // The pictures do not contain light beyond the iris.
    let widest = |v: &usize| pictures.views[*v].pupil().diameter / pictures.optics.eyebox();
    let reach = PI * which.iter().map(widest).fold(0.0, f64::max) / 2.0;
    let limit = [reach * width as f64, reach * height as f64];
    Ok(Some((Image { rows, columns, values }, limit)))
}

/// The amplitude of the unmodulated light over the amplitude of all light, place by place, if the drives determine it.
fn unmodulated(drives: &[f64], images: &[Vec<f64>]) -> Option<Vec<Complex64>> {
    // Each place sees an offset and one turn of a wave, a + b cos w + c sin w.
    let waves: Vec<[f64; 3]> = drives.iter().map(|w| [1.0, w.cos(), w.sin()]).collect();
    let sum = |i: usize, j: usize| waves.iter().map(|wave| wave[i] * wave[j]).sum::<f64>();
    let normal: Vec<Vec<f64>> = (0..3).map(|i| (0..3).map(|j| sum(i, j)).collect()).collect();
    let back = inverse(&normal)?;
    if (0..3).any(|i| back[i][i] > 10.0) {
        return None;
    }
    let value = |place: usize| {
        let right =
            [0, 1, 2].map(|i| waves.iter().zip(images).map(|(wave, image)| wave[i] * image[place]).sum::<f64>());
        let [a, b, c] = [0, 1, 2].map(|i| (0..3).map(|j| back[i][j] * right[j]).sum::<f64>());
        if a > 0.0 { Complex64::new(b, c) / (2.0 * a) } else { Complex64::default() }
    };
    Some((0..images.first()?.len()).map(value).collect())
}

/// The strongest plane or curved waves of an image. Each is searched for in the image after the known waves and the
/// earlier ones are subtracted. `limit` is the largest tilt along x and y, radians.
fn strongest(mut image: Image, limit: [f64; 2], known: &[Wave]) -> Vec<Wave> {
    for [.., x, y, curvature] in known {
        let numbers = [*x, *y, *curvature];
        image.subtract(image.amplitude(numbers), numbers);
    }
    let brightest = known.iter().map(|wave| WEAKER * wave[0].hypot(wave[1])).fold(0.0, f64::max);
    let mut found: Vec<Wave> = Vec::new();
    for _ in 0..PEAKS {
        let Some(start) = peak(&image, limit) else { break };
        let (amplitude, [x, y, curvature]) = refined(&image, start);
        let first = found.first().map_or(0.0, |first| WEAK * first[0].hypot(first[1]));
        if amplitude.norm() < brightest.max(first).max(1e-3) {
            break;
        }
        image.subtract(amplitude, [x, y, curvature]);
        // The ratio to all light is half the sine of twice the angle whose sine is the amplitude.
        let size = ((2.0 * amplitude.norm()).min(1.0).asin() / 2.0).sin();
        let eta = amplitude / amplitude.norm() * size;
        found.push([eta.re, eta.im, x, y, curvature]);
    }
    found
}

impl Image {
    /// The amplitude of a wave with these tilts and this curvature.
    fn amplitude(&self, numbers: [f64; 3]) -> Complex64 {
        let term = |(i, v): (usize, &Complex64)| v * wave(place(i, self.rows, self.columns), numbers).conj();
        self.values.iter().enumerate().map(term).sum::<Complex64>() / self.values.len() as f64
    }

    fn subtract(&mut self, amplitude: Complex64, numbers: [f64; 3]) {
        for (i, value) in self.values.iter_mut().enumerate() {
            *value -= amplitude * wave(place(i, self.rows, self.columns), numbers);
        }
    }
}

/// Coordinates of a place of the image, from -1 to 1.
fn place(i: usize, rows: usize, columns: usize) -> [f64; 2] {
    [((2 * (i % columns) + 1) as f64 / columns as f64) - 1.0, ((2 * (i / columns) + 1) as f64 / rows as f64) - 1.0]
}

fn wave([x, y]: [f64; 2], [tilt_x, tilt_y, curvature]: [f64; 3]) -> Complex64 {
    Complex64::cis(tilt_x * x + tilt_y * y + curvature * (x * x + y * y))
}

/// Tilts and curvature of the strongest wave, to half a cell of the search.
fn peak(image: &Image, limit: [f64; 2]) -> Option<[f64; 3]> {
    let Image { rows, columns, values } = image;
    let finer = if rows.max(columns) > &256 { 2 } else { 4 };
    let (tall, wide) = (finer * rows, finer * columns);
    let mut best: Option<(f64, [f64; 3])> = None;
    for curvature in CURVATURES.map(|c| f64::from(c) / 4.0) {
        let mut lines = vec![Complex64::default(); rows * wide];
        for (i, value) in values.iter().enumerate() {
            lines[i / columns * wide + i % columns] =
                value * wave(place(i, *rows, *columns), [0.0, 0.0, curvature]).conj();
        }
        fft::transform_f64(&mut lines, wide, fft::Direction::Forward);
        let turned = transposed(&lines, wide);
        let mut all = vec![Complex64::default(); tall * wide];
        for (to, from) in all.chunks_exact_mut(tall).zip(turned.chunks_exact(*rows)) {
            to[..*rows].copy_from_slice(from);
        }
        fft::transform_f64(&mut all, tall, fft::Direction::Forward);
        for (i, value) in all.iter().enumerate() {
            let tilt = |k: usize, n: usize| {
                let k = if 2 * k < n { k as f64 } else { k as f64 - n as f64 };
                PI * k / finer as f64
            };
            let tilts = [tilt(i / tall, wide), tilt(i % tall, tall)];
            let inside = tilts[0].abs() <= limit[0] && tilts[1].abs() <= limit[1];
            if inside && best.is_none_or(|(most, _)| value.norm_sqr() > most) {
                best = Some((value.norm_sqr(), [tilts[0], tilts[1], curvature]));
            }
        }
    }
    best.map(|(_, at)| at)
}

/// The wave's amplitude, with the tilts and the curvature at which it is highest.
fn refined(image: &Image, start: [f64; 3]) -> (Complex64, [f64; 3]) {
    let (mut at, mut step) = (start, [0.4, 0.4, 0.12]);
    let mut amplitude = image.amplitude(at);
    for _ in 0..6 {
        for i in 0..3 {
            for sign in [1.0, -1.0] {
                let mut trial = at;
                trial[i] += sign * step[i];
                let there = image.amplitude(trial);
                if there.norm() > amplitude.norm() {
                    (at, amplitude) = (trial, there);
                }
            }
        }
        step = step.map(|s| s / 2.0);
    }
    (amplitude, at)
}

#[cfg(test)]
mod tests {
    use super::*;
    use eyebox_solve::solve::SplitMix;
    use std::f64::consts::TAU;

    /// Pictures of even drives with unmodulated light, a source that falls off, and a wrong table.
    fn pictures(eta: Complex64, numbers: [f64; 3], [rows, columns]: [usize; 2]) -> (Vec<f64>, Vec<Vec<f64>>) {
        let mut random = SplitMix(7);
        let drives: Vec<f64> = (0..4).map(|i| TAU * f64::from(i) / 4.0).collect();
        let image = |drive: &f64| {
            let light = |i: usize| {
                let [x, y] = place(i, rows, columns);
                let modulated = Complex64::cis(1.05 * drive) * (1.0 - eta.norm_sqr()).sqrt();
                let source = (-0.3 * x * x - 0.2 * y).exp();
                source * (modulated + eta * wave([x, y], numbers)).norm_sqr() * (1.0 + 0.02 * (random.unit() - 0.5))
            };
            (0..rows * columns).map(light).collect()
        };
        let images = drives.iter().map(image).collect();
        (drives, images)
    }

    #[test]
    fn a_tilt_of_30_radians_is_found_to_a_tenth() {
        let (rows, columns) = (48, 64);
        for numbers in [[30.0, -12.3, 0.6], [0.4, 1.1, -0.5]] {
            let eta = Complex64::new(0.12, -0.1);
            let (drives, images) = pictures(eta, numbers, [rows, columns]);
            let values = unmodulated(&drives, &images).expect("four drives tell it");
            let found = strongest(Image { rows, columns, values }, [40.0, 40.0], &[])[0];
            for i in 0..3 {
                assert!((found[i + 2] - numbers[i]).abs() < 0.1, "{found:?} instead of {numbers:?}");
            }
            assert!((found[0] - eta.re).hypot(found[1] - eta.im) < 0.03, "{found:?} instead of {eta}");
        }
    }

    #[test]
    fn a_second_reflection_is_found_in_what_the_first_leaves() {
        let (rows, columns) = (48, 64);
        let (first, second) = ([0.12, -0.1, 14.0, -6.0, 0.6], [-0.03, 0.05, -9.0, 11.0, -0.4]);
        let value = |i: usize| {
            let of = |[re, im, x, y, c]: [f64; 5]| Complex64::new(re, im) * wave(place(i, rows, columns), [x, y, c]);
            of(first) + of(second)
        };
        let image = Image { rows, columns, values: (0..rows * columns).map(value).collect() };
        let found = strongest(image.clone(), [40.0, 40.0], &[first])[0];
        for (i, (got, want)) in found.iter().zip(second).enumerate() {
            assert!((got - want).abs() < if i < 2 { 0.01 } else { 0.1 }, "{found:?} instead of {second:?}");
        }
        // After both waves are subtracted, no wave is left.
        assert_eq!(strongest(image, [40.0, 40.0], &[first, second]), Vec::<Wave>::new());
    }

    #[test]
    fn two_drives_do_not_tell_it() {
        let images = vec![vec![1.0; 4]; 3];
        assert!(unmodulated(&[0.0, PI, 0.0], &images).is_none());
        assert!(unmodulated(&[0.0, 2.0, 4.0], &images).is_some());
    }
}
