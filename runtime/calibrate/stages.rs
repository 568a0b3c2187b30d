//! The fit in its order (OPTICS 10): where the camera looks, what smooth patterns tell, what random ones tell, all of it.

use super::acquire::{TAKING, Taken};
use super::captures::{Shot, shown};
use super::device::Set;
use super::error::CalibrateError;
use super::fit::{Exposure, Fit, Pictures, View};
use super::map::CameraMap;
use super::noise::Noise;
use super::parameters::{Parameter, Parameters};
use super::picture::Picture;
use super::report::{Report, Unseen};
use super::seen::Look;
use super::{Event, dots, pattern, terms};
use crate::optics::{Color, Display, Optics, Pupil, Spread};
use crate::solve::SplitMix;
use std::path::PathBuf;

/// Camera pixels of a picture that are fitted, and of one that is held out.
const FITTED: usize = 1500;
const HELD_OUT: usize = 6000;
/// Sub-pixels along an axis while the fit is sought, and at its end.
const COARSE: usize = 2;
const FINE: usize = 3;
/// Crosstalk of a real device, where a fit begins (Schroff et al. 2024).
const CROSSTALK: Spread = Spread { q: 1.2, sigma: 2.03 };
/// A camera pixel's sensitive share, where a fit begins.
const CAMERA_PIXEL: f64 = 0.9;

/// The pictures, sorted by what they are for.
pub(super) struct Sorted {
    pub(super) pictures: Pictures,
    pub(super) smooth: Vec<usize>,
    pub(super) fitted: Vec<usize>,
    /// Pictures of the same, taken twice.
    pub(super) pairs: Vec<[usize; 2]>,
    pub(super) map: CameraMap,
    pub(super) map_rms: f64,
    radius: f64,
    camera: [usize; 2],
}

/// A shot of a pattern, by the number of its set.
struct Sight<'a> {
    shot: &'a Shot,
    set: usize,
}

/// Fits, and says what came of it.
pub(super) fn run(
    display: &Display,
    color: Color,
    taken: Taken,
    quick: bool,
    tell: &dyn Fn(Event),
) -> Result<(Display, Report), CalibrateError> {
    let share = |from: f64, to: f64, part: f64| TAKING + (1.0 - TAKING) * (from + (to - from) * part);
    tell(Event::At("looking for the dots", TAKING));
    let model = display.model(color);
    let sorted = sort(display, color, &taken)?;
    let mut warnings = taken.warnings.clone();
    if sorted.pairs.is_empty() {
        warnings.push("no picture was taken twice: how large the camera's noise is was not measured".into());
    }
    let pictures = &sorted.pictures;
    let start = Parameters { model: model.clone(), map: sorted.map, camera_pixel: CAMERA_PIXEL };
    let map: Vec<Parameter> = (0..9).map(Parameter::Map).collect();
    let mut at = start.clone();
    if !quick && !sorted.smooth.is_empty() {
        at = smooth(&sorted, &at, &map, &mut |part| tell(Event::At("fitting smooth patterns", share(0.0, 0.25, part))))?;
    }
    if !quick && at.model.crosstalk.is_none() {
        at.model.crosstalk = Some([CROSSTALK; 4]);
    }
    if !quick && at.model.fill == 0.0 {
        at.model.fill = 0.95;
    }
    let has_sets = sorted.fitted.iter().any(|v| pictures.sets[pictures.views[*v].set].pattern.frames > 1);
    let mut free = Parameter::all();
    if quick {
        free.retain(|p| p.drifts());
    }
    free.retain(|p| has_sets || *p != Parameter::Lag);
    let mut fitting = |part| tell(Event::At("fitting all pictures", share(0.25, 0.6, part)));
    let fit = pictures.fit(&at, &free, &sorted.fitted, (COARSE, 10), &mut fitting)?;
    let mut fitting = |part| tell(Event::At("fitting all pictures finely", share(0.6, 0.9, part)));
    let fit = pictures.fit(&fit.at, &free, &sorted.fitted, (FINE, 4), &mut fitting)?;
    tell(Event::At("leaving out what does not show", share(0.0, 1.0, 0.9)));
    let fit = terms::settle(pictures, &sorted.fitted, &start, fit, FINE)?;
    tell(Event::At("looking at pictures that were not fitted", share(0.0, 1.0, 0.95)));
    let report = Report::new(&sorted, &start, &fit, taken.shots.len(), warnings, FINE)?;
    let display = terms::written(display, color, &start, &fit, taken.shots.len());
    Ok((display, report))
}

impl Parameter {
    /// Whether it changes from day to day.
    fn drifts(self) -> bool {
        matches!(self, Self::Map(_) | Self::Iris(_) | Self::Source(0 | 1) | Self::Level(_) | Self::Wavefront(3..=5))
    }
}

/// What smooth patterns tell: the map, source, table, undiffracted light.
fn smooth(
    sorted: &Sorted,
    start: &Parameters,
    map: &[Parameter],
    observe: &mut dyn FnMut(f64),
) -> Result<Parameters, CalibrateError> {
    let pictures = &sorted.pictures;
    // A model from a file knows the crosstalk; an unknown one is not to be seen in smooth patterns.
    let near = |p: &Parameter| !matches!(p, Parameter::Crosstalk(_) | Parameter::Fill | Parameter::Lag | Parameter::Map(_));
    let rest = |p: &Parameter| matches!(p, Parameter::Undiffracted(_));
    let mut free: Vec<Parameter> = Parameter::all().into_iter().filter(|p| near(p) && !rest(p)).collect();
    free.extend(map);
    let fit = pictures.fit(start, &free, &sorted.smooth, (1, 6), &mut |part| observe(0.5 * part))?;
    let mut at = fit.at.clone();
    if at.model.undiffracted == [0.0; 5] {
        at.model.undiffracted = undiffracted(sorted, &fit);
    }
    free.extend((0..5).map(Parameter::Undiffracted));
    Ok(pictures.fit(&at, &free, &sorted.smooth, (1, 8), &mut |part| observe(0.5 + 0.5 * part))?.at)
}

/// The phase of undiffracted light that explains most of what a fit left: nothing of it shows while its amplitude is 0.
fn undiffracted(sorted: &Sorted, fit: &Fit) -> [f64; 5] {
    let pictures = &sorted.pictures;
    let which: Vec<usize> = sorted.smooth.iter().copied().take(4).collect();
    let free = [Parameter::Undiffracted(0), Parameter::Undiffracted(1)];
    let now = pictures.see(&fit.at, 1, &which, &[]);
    let residuals: Vec<Vec<f64>> =
        which.iter().zip(&now).map(|(v, seen)| pictures.residuals(*v, seen, fit.exposure)).collect();
    let mut best = (0.0, [0.0; 5]);
    for i in 0..9 * 9 * 3 {
        let phase = [f64::from(i % 9 - 4), f64::from(i / 9 % 9 - 4), f64::from(i / 81 - 1)];
        let mut at = fit.at.clone();
        at.model.undiffracted[2..].copy_from_slice(&phase);
        let seen = pictures.see(&at, 1, &which, &free);
        let mut sums = [0.0; 5];
        for ((v, seen), residuals) in which.iter().zip(&seen).zip(&residuals) {
            let gain = fit.exposure.gain * pictures.views[*v].exposure_ms;
            for (i, r) in residuals.iter().enumerate() {
                let (re, im, w) = (seen.slopes[0][i] * gain, seen.slopes[1][i] * gain, 1.0 / pictures.views[*v].variance[i]);
                for (sum, term) in sums.iter_mut().zip([re * re, re * im, im * im, -re * r, -im * r]) {
                    *sum += term * w;
                }
            }
        }
        let [rr, ri, ii, r, m] = sums;
        let det = rr * ii - ri * ri;
        let (re, im) = ((ii * r - ri * m) / det, (rr * m - ri * r) / det);
        let gained = re * r + im * m;
        if gained.is_finite() && gained > best.0 && re.hypot(im) < 0.5 {
            best = (gained, [re, im, phase[0], phase[1], phase[2]]);
        }
    }
    best.1
}

/// Sorts the pictures: dots, darkness, what was taken twice, the rest.
fn sort(display: &Display, color: Color, taken: &Taken) -> Result<Sorted, CalibrateError> {
    let optics = display.optics(color)?;
    let slm = [display.height, display.width];
    let camera = taken.hello.camera.resolution;
    let wanted = pattern::dots_pattern(slm, taken.two_pi_level);
    let (mut sets, mut names): (Vec<Set>, Vec<(PathBuf, String)>) = (Vec::new(), Vec::new());
    let (mut sights, mut dark, mut found) = (Vec::new(), None, None);
    for shot in &taken.shots {
        let Some(show) = &shot.show else {
            dark = Some(shot.picture(camera)?.median());
            continue;
        };
        let set = match names.iter().position(|n| n == show) {
            Some(set) => set,
            None => {
                let pattern = shown(&show.0, &show.1, slm, taken.two_pi_level)?;
                names.push(show.clone());
                sets.push(Set { pattern, windows: Vec::new() });
                sets.len() - 1
            }
        };
        let close = |(a, b): (&f32, &f32)| (a - b).abs() < 1e-4;
        if sets[set].pattern.drive.len() == wanted.drive.len()
            && sets[set].pattern.drive.iter().zip(&wanted.drive).all(close)
        {
            let picture = shot.picture(camera)?;
            found = Some(dots::find(&picture, slm).map_err(|reason| {
                CalibrateError::Pictures(format!(
                    "{}: in the picture of the dots {reason}: is the SLM lit, and in focus on the camera?",
                    shot.file.display()
                ))
            })?);
        } else {
            sights.push(Sight { shot, set });
        }
    }
    let Some((map, map_rms)) = found else {
        return Err(CalibrateError::Pictures("there is no picture of the dots, which say where the camera looks".into()));
    };
    if sights.len() < 4 {
        return Err(CalibrateError::Pictures(format!("{} pictures of patterns are too few to fit a model to", sights.len())));
    }
    let radius = display.eyebox_min() / 2.0;
    let pictures = Pictures { optics, sets, views: Vec::new() };
    let (smooth, fitted, pairs) = (Vec::new(), Vec::new(), Vec::new());
    let mut sorted = Sorted { pictures, smooth, fitted, pairs, map, map_rms, radius, camera };
    sorted.add(display, color, &sights, dark)?;
    Ok(sorted)
}

impl Sorted {
    fn add(
        &mut self,
        display: &Display,
        color: Color,
        sights: &[Sight],
        dark: Option<f64>,
    ) -> Result<(), CalibrateError> {
        let at = Parameters { model: display.model(color), map: self.map, camera_pixel: CAMERA_PIXEL };
        let twin = |i: usize| {
            let same = |a: &Sight, b: &Sight| {
                a.set == b.set && a.shot.iris_mm == b.shot.iris_mm && a.shot.focus_mm == b.shot.focus_mm
            };
            (0..sights.len()).find(|j| *j != i && same(&sights[i], &sights[*j]))
        };
        for (i, sight) in sights.iter().enumerate() {
            let twin = twin(i);
            if twin.is_some_and(|first| first < i) {
                continue;
            }
            let picture = sight.shot.picture(self.camera)?;
            let count = if twin.is_some() { HELD_OUT } else { FITTED };
            let mut pixels = self.pixels(&picture, count, i as u64);
            let other = twin.map(|other| sights[other].shot.picture(self.camera)).transpose()?;
            if let Some(other) = &other {
                pixels.retain(|p| !other.is_full(*p));
            }
            let view = self.view(sight, &picture, &pixels, &at)?;
            match (twin, other) {
                (Some(other_index), Some(other)) => {
                    let second = self.view(&sights[other_index], &other, &pixels, &at)?;
                    self.pairs.push([view, second]);
                }
                _ => {
                    self.fitted.push(view);
                    let pattern = &self.pictures.sets[sight.set].pattern;
                    if pattern.frames == 1 && pattern.is_smooth() {
                        self.smooth.push(view);
                    }
                }
            }
        }
        let noise = self.noise(dark);
        for view in &mut self.pictures.views {
            view.variance = view.counts.iter().map(|c| noise.variance(*c)).collect();
        }
        Ok(())
    }

    /// Some of the camera's pixels that look well inside the SLM's image and are not saturated.
    fn pixels(&self, picture: &Picture, count: usize, seed: u64) -> Vec<usize> {
        let [rows, columns] = self.map.slm.map(|n| n as f64);
        let mut random = SplitMix(seed ^ 0x7069_7865_6c73);
        let mut found = Vec::new();
        // A camera that sees little of the SLM has few of them.
        for _ in 0..40 * count {
            if found.len() == count {
                break;
            }
            let at = (random.unit() * picture.values.len() as f64) as usize;
            let [x, y] = self.map.to_slm([(at % picture.width) as f64, (at / picture.width) as f64]);
            let inside = (2.0..columns - 3.0).contains(&x) && (2.0..rows - 3.0).contains(&y);
            if inside && !picture.is_full(at) {
                found.push(at);
            }
        }
        found.sort_unstable();
        found.dedup();
        found
    }

    /// Adds a picture at these pixels: its number.
    fn view(
        &mut self,
        sight: &Sight,
        picture: &Picture,
        pixels: &[usize],
        at: &Parameters,
    ) -> Result<usize, CalibrateError> {
        let optics: Optics = self.pictures.optics;
        let Some([x, y, d]) = sight.shot.iris_mm else {
            let reason = "has no iris_mm: the model's numbers are told apart by what an iris passes".into();
            return Err(CalibrateError::Captures { file: sight.shot.file.display().to_string(), reason });
        };
        let pupil = Pupil::from_mm([x, y, d, sight.shot.focus_mm]).check()?;
        let place = |p: &usize| [(p % picture.width) as f64, (p / picture.width) as f64];
        let look = Look::new(optics, pupil, self.radius, at, pixels.iter().map(place).collect());
        let windows = &mut self.pictures.sets[sight.set].windows;
        let window = windows.iter().position(|w| *w == look.window).unwrap_or_else(|| {
            windows.push(look.window.clone());
            windows.len() - 1
        });
        let counts: Vec<f64> = pixels.iter().map(|p| f64::from(picture.values[*p])).collect();
        if counts.is_empty() {
            return Err(CalibrateError::Captures {
                file: sight.shot.file.display().to_string(),
                reason: "has no pixel that looks at the SLM and is not saturated".into(),
            });
        }
        let exposure_ms = sight.shot.exposure_ms;
        self.pictures.views.push(View { set: sight.set, window, look, counts, variance: Vec::new(), exposure_ms });
        Ok(self.pictures.views.len() - 1)
    }

    /// The camera's noise, from the pictures that were taken twice.
    fn noise(&self, dark: Option<f64>) -> Noise {
        let views = &self.pictures.views;
        let least = || views.iter().flat_map(|v| v.counts.iter().copied()).fold(1.0, f64::min);
        let dark = dark.unwrap_or_else(least);
        let pairs = self.pairs.iter().flat_map(|[a, b]| {
            let scale = views[*a].exposure_ms / views[*b].exposure_ms;
            views[*a].counts.iter().zip(&views[*b].counts).map(move |(a, b)| [*a, dark + (b - dark) * scale])
        });
        let pairs: Vec<[f64; 2]> = pairs.collect();
        if pairs.len() < 200 { Noise::usual(dark) } else { Noise::of_pairs(&pairs, dark) }
    }
}

/// Gain and dark level for a model that was not fitted to these pictures.
pub(super) fn exposed(pictures: &Pictures, at: &Parameters, which: &[usize], subpixels: usize) -> Exposure {
    pictures.exposure(which, &pictures.see(at, subpixels, which, &[]))
}

/// Squares that a model leaves of pictures that were taken twice, as shares of their variance about each picture's mean.
pub(super) fn unseen(sorted: &Sorted, at: &Parameters, exposure: Exposure, subpixels: usize) -> Unseen {
    let pictures = &sorted.pictures;
    let which: Vec<usize> = sorted.pairs.iter().flatten().copied().collect();
    let seen = pictures.see(at, subpixels, &which, &[]);
    let mut sums = [0.0; 3];
    let mut by_picture = Vec::new();
    for (pair, seen) in sorted.pairs.iter().zip(seen.chunks_exact(2)) {
        let counts = pair.map(|v| &pictures.views[v].counts);
        let scale = pictures.views[pair[0]].exposure_ms / pictures.views[pair[1]].exposure_ms;
        let noise: f64 = counts[0]
            .iter()
            .zip(counts[1])
            .map(|(a, b)| (a - exposure.dark - (b - exposure.dark) * scale).powi(2) / 2.0)
            .sum();
        let mean = counts[0].iter().sum::<f64>() / counts[0].len() as f64;
        let variance: f64 = counts[0].iter().map(|c| (c - mean).powi(2)).sum();
        let left: f64 = pictures.residuals(pair[0], &seen[0], exposure).iter().map(|r| r * r).sum();
        sums = [sums[0] + left, sums[1] + noise, sums[2] + variance];
        by_picture.push([left / variance, noise / variance]);
    }
    Unseen { left: sums[0] / sums[2], noise: sums[1] / sums[2], by_picture }
}
