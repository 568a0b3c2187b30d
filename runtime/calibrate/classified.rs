//! Sorts pictures by their purpose, such as dots, darkness and pictures that were taken twice.

use super::acquire::CaptureSet;
use super::captures::{Shot, shown};
use super::device::Set;
use super::error::CalibrateError;
use super::fit::{COARSE, variance_of};
use super::map::CameraMap;
use super::noise::Noise;
use super::parameters::Parameters;
use super::picture::Picture;
use super::pieces;
use super::seen::Look;
use super::views::{PatternSet, Pictures, View};
use super::{dots, pattern};
use eyebox_base::reason;
use eyebox_optics::{Color, Display, Pupil, SlmPart};
use eyebox_solve::solve::SplitMix;
use std::path::PathBuf;

/// Number of camera pixels of a fitted picture, and of a held-out one.
const FITTED: usize = 1500;
const HELD_OUT: usize = 6000;
/// Least contrast of a picture. The errors of an even picture are not measured by its own contrast.
const LEAST_CONTRAST: f64 = 0.1;
/// Sensitive share of a camera pixel, at which a fit starts.
pub(super) const CAMERA_PIXEL: f64 = 0.9;

pub(super) struct Sorted {
    pub(super) pictures: Pictures,
    /// Pictures of even drives. They are fitted, too.
    pub(super) even: Vec<usize>,
    pub(super) fitted: Vec<usize>,
    /// Pictures that contradict the others.
    pub(super) strange: Vec<usize>,
    /// Pairs of pictures of the same pattern, taken twice.
    pub(super) pairs: Vec<[usize; 2]>,
    pub(super) map: CameraMap,
    pub(super) map_rms: f64,
    radius: f64,
    pub(super) camera: [usize; 2],
    bits: u32,
}

/// A shot of a pattern, with the index of its set.
type PatternShot<'a> = (&'a Shot, usize);

/// Sorts the pictures into dots, darkness, pictures that were taken twice, and the rest.
pub(super) fn sort(display: &Display, color: Color, taken: &CaptureSet) -> Result<Sorted, CalibrateError> {
    let optics = display.optics(color)?;
    let slm = [display.height, display.width];
    let camera = taken.hello.camera.resolution;
    let wanted = pattern::dots_pattern(slm, taken.two_pi_level);
    let (mut sets, mut names): (Vec<PatternSet>, Vec<(PathBuf, String)>) = (Vec::new(), Vec::new());
    let (mut pattern_shots, mut dark, mut found) = (Vec::new(), None, None);
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
                sets.push(PatternSet { pattern, parts: Vec::new() });
                sets.len() - 1
            }
        };
        if sets[set].pattern.is_like(&wanted) {
            let picture = shot.picture(camera)?;
            found = Some(dots::find(&picture, slm).map_err(|reason| {
                CalibrateError::Pictures(reason!(
                    "dots",
                    "{}: in the picture of the dots {reason}. Check that the SLM is lit and in focus on the camera",
                    shot.file.display()
                ))
            })?);
        } else {
            pattern_shots.push((shot, set));
        }
    }
    let Some((map, map_rms)) = found else {
        return Err(reason!("no-picture-of-dots", "no picture of the dots, which locate the camera. Take one").into());
    };
    if pattern_shots.len() < 3 {
        return Err(
            reason!("too-few", "{} pictures of patterns are too few, take at least 3", pattern_shots.len()).into()
        );
    }
    let radius = display.source_eyebox_min() / 2.0;
    tracing::debug!("error of the dots {map_rms:.3} camera pixels rms, map {:.6?}", map.numbers);
    let parts = pieces::pieces(&map);
    for set in &mut sets {
        let of_part = |part| Set { pattern: set.pattern.part(part), windows: Vec::new() };
        set.parts = parts.iter().map(of_part).collect();
    }
    let pictures = Pictures { optics, parts, sets, views: Vec::new(), dark: dark.unwrap_or(0.0) };
    let (even, fitted, strange, pairs) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut sorted =
        Sorted { pictures, even, fitted, strange, pairs, map, map_rms, radius, camera, bits: taken.hello.camera.bits };
    sorted.add(display, color, &pattern_shots, dark)?;
    Ok(sorted)
}

impl Sorted {
    /// The mean share that a model leaves of these pictures, with one sub-pixel.
    pub(super) fn mean_left(&self, at: &Parameters, which: &[usize]) -> f64 {
        let left = self.pictures.left(which, &self.pictures.see(at, COARSE.subpixels, which, &[]));
        left.iter().map(|l| l[0]).sum::<f64>() / left.len().max(1) as f64
    }

    pub(super) fn leave_out(&mut self, view: usize) {
        self.even.retain(|v| *v != view);
        self.fitted.retain(|v| *v != view);
        self.strange.push(view);
    }

    fn add(
        &mut self,
        display: &Display,
        color: Color,
        pattern_shots: &[PatternShot],
        dark: Option<f64>,
    ) -> Result<(), CalibrateError> {
        let at =
            Parameters { model: display.model(color), map: self.map, camera_pixel: CAMERA_PIXEL, soft_edge: false };
        let twin = |i: usize| {
            let key = |(shot, set): PatternShot| (set, shot.iris_mm, shot.focus_mm);
            (0..pattern_shots.len()).find(|j| *j != i && key(pattern_shots[i]) == key(pattern_shots[*j]))
        };
        for (i, (shot, set)) in pattern_shots.iter().copied().enumerate() {
            let twin = twin(i);
            if twin.is_some_and(|first| first < i) {
                continue;
            }
            let picture = shot.picture(self.camera)?;
            let count = if twin.is_some() { HELD_OUT } else { FITTED };
            let mut pixels = self.pixels(&picture, count, i as u64);
            let other = twin.map(|other| pattern_shots[other].0.picture(self.camera)).transpose()?;
            if let Some(other) = &other {
                pixels.retain(|p| !other.is_full(*p));
            }
            let view = self.view((shot, set), &picture, &pixels, &at)?;
            match (twin, other) {
                (Some(other_index), Some(other)) => {
                    let second = self.view(pattern_shots[other_index], &other, &pixels, &at)?;
                    self.pairs.push([view, second]);
                }
                _ => {
                    self.fitted.push(view);
                    let pattern = &self.pictures.sets[set].pattern;
                    if pattern.frames == 1 && pattern.even_drive().is_some() {
                        self.even.push(view);
                    }
                }
            }
        }
        let noise = self.noise(dark);
        self.pictures.dark = noise.dark;
        for view in &mut self.pictures.views {
            view.variance = view.counts.iter().map(|c| noise.variance(*c)).collect();
            let mean = view.counts.iter().sum::<f64>() / view.counts.len() as f64 - noise.dark;
            let shot = view.variance.iter().sum::<f64>() / view.variance.len() as f64;
            view.signal =
                (variance_of(&view.counts) - shot).max((LEAST_CONTRAST * mean).powi(2)).max(f64::MIN_POSITIVE);
        }
        Ok(())
    }

    /// Random pixels of the camera that look well inside the SLM's image and are not saturated, part by part.
    fn pixels(&self, picture: &Picture, count: usize, seed: u64) -> Vec<usize> {
        let mut random = SplitMix(seed ^ 0x7069_7865_6c73);
        let mut found = Vec::new();
        // If the camera sees little of the SLM, few pixels qualify, and pieces hold a tenth.
        let tries = if self.pictures.are_whole() { 40 } else { 400 };
        for _ in 0..tries * count {
            if found.len() == count {
                break;
            }
            let at = (random.unit() * picture.values.len() as f64) as usize;
            if self.part_of(picture, at).is_some() && !picture.is_full(at) {
                found.push(at);
            }
        }
        found.sort_unstable();
        found.dedup();
        found.sort_by_cached_key(|at| self.part_of(picture, *at));
        found
    }

    /// Random pixels of the camera that look at a part and are not saturated.
    pub(super) fn pixels_of(&self, picture: &Picture, part: usize, count: usize) -> Vec<usize> {
        let mut random = SplitMix(part as u64 ^ 0x7069_6563_6573);
        let SlmPart { first, size, .. } = self.pictures.parts[part];
        let place = |random: &mut SplitMix| {
            let [y, x] = [0, 1].map(|axis| first[axis] as f64 + size[axis] as f64 * random.unit());
            let [column, row] = self.map.to_camera([x, y]).map(|at| at.round());
            let inside = (0.0..picture.width as f64).contains(&column) && (0.0..picture.height as f64).contains(&row);
            inside.then(|| row as usize * picture.width + column as usize)
        };
        let looks = |at: &usize| self.part_of(picture, *at) == Some(part) && !picture.is_full(*at);
        let mut found: Vec<usize> =
            (0..4 * count).filter_map(|_| place(&mut random)).filter(looks).take(count).collect();
        found.sort_unstable();
        found.dedup();
        found
    }

    /// The part of the SLM that a camera's pixel looks at.
    fn part_of(&self, picture: &Picture, at: usize) -> Option<usize> {
        let place = [(at % picture.width) as f64, (at / picture.width) as f64];
        pieces::holding(&self.pictures.parts, self.map.to_slm(place))
    }

    /// Adds a view of a picture at these pixels and returns its index.
    fn view(
        &mut self,
        (shot, set): PatternShot,
        picture: &Picture,
        pixels: &[usize],
        at: &Parameters,
    ) -> Result<usize, CalibrateError> {
        let Some([x, y, d]) = shot.iris_mm else {
            let reason = reason!("no-iris", "has no iris_mm. Give `iris` X,Y,DIAMETER in mm if the iris does not move");
            return Err(CalibrateError::captures(&shot.file, reason));
        };
        let pupil = Pupil::from_mm([x, y, d, shot.focus_mm]).check()?;
        let place = |p: &usize| [(p % picture.width) as f64, (p / picture.width) as f64];
        let parts: Vec<_> = pixels.iter().map(|p| self.part_of(picture, *p)).collect();
        let mut looks = Vec::new();
        for (i, part) in self.pictures.parts.iter().enumerate() {
            let here = pixels.iter().zip(&parts).filter(|(_, part)| **part == Some(i)).map(|(p, _)| place(p)).collect();
            let look = Look::new((*part, &self.pictures.optics), pupil, self.radius, at, here);
            let windows = &mut self.pictures.sets[set].parts[i].windows;
            let window = windows.iter().position(|w| *w == look.window).unwrap_or_else(|| {
                windows.push(look.window.clone());
                windows.len() - 1
            });
            looks.push((look, window));
        }
        let counts: Vec<f64> = pixels.iter().map(|p| f64::from(picture.values[*p])).collect();
        if counts.is_empty() {
            let reason = reason!("saturated", "has no unsaturated pixel that looks at the SLM");
            return Err(CalibrateError::captures(&shot.file, reason));
        }
        self.pictures.views.push(View {
            set,
            looks,
            counts,
            variance: Vec::new(),
            signal: 0.0,
            exposure_ms: shot.exposure_ms,
            full_scale: shot.full_scale,
            file: shot.file.clone(),
        });
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
        let least = 0.25f64.powi(self.bits as i32) / 12.0;
        if pairs.len() < 200 { Noise::usual(dark, least) } else { Noise::of_pairs(&pairs, dark, least) }
    }
}
