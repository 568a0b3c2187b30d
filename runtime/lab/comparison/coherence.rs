//! Measures the effect of a source's size on the quality (OPTICS 12).
//!
//! An extended source lowers speckle but also resolution and depth of field. Each hologram is solved for the source
//! that lights it.

use super::picture;
use super::results::CoherenceFigures;
use super::speckle::{self, GREY, plane, seen_of};
use eyebox::low_level::engine::Engine;
use eyebox::low_level::evaluate::{self, Summary};
use eyebox::low_level::hologram::Hologram;
use eyebox::low_level::optics::{
    Color, Display, Padding, Pupil, SourceKind, SourceShape, SourceTerms, dioptres, fewer_modes,
};
use eyebox::low_level::quality::QualityError;
use eyebox::low_level::reconstruction::SceneSource;
use eyebox::low_level::scene::LightField;
use eyebox::low_level::solve::{self, Flow, Problem, PupilRange, Settings};
use std::f64::consts::TAU;

/// The approximate time that one source takes, in units of a solve.
pub(super) const EFFORT: f64 = 8.0;
/// The samples of the judging source, along an axis and over its line. It has the largest number of samples along an
/// axis, whatever the solve assumed.
const JUDGING: [usize; 2] = [5, 1];
/// The swing of the bars around their gray, in linear light.
const SWING: f64 = 0.4;
/// The number of focus positions that are measured on either side.
const PLACES: usize = 16;
/// The distance of the last focus position, in depths of focus. One depth of focus is wavelength times the square of
/// focal length over diameter.
const FARTHEST: f64 = 2.0;
/// Rows and columns of views of the bars out of focus. A pupil of the eye covers several views.
const VIEWS: [usize; 2] = [9, 9];
/// The number of holograms of an even plane whose contrast is averaged.
const REPEATS: usize = 2;

/// A scene on a display, in one color, for which sources are compared.
pub(crate) struct Sources<'a> {
    pub(crate) field: &'a LightField,
    pub(crate) display: &'a Display,
    pub(crate) color: Color,
    pub(crate) settings: &'a Settings,
    /// The pupils through which the hologram is scored.
    pub(crate) pupils: &'a [Pupil],
    /// The longest side of the picture, in pixels.
    pub(crate) longest: usize,
}

/// A display in the light of a source. One copy has the few modes of the solve, the other has the modes that judge.
struct Lit {
    solved: Display,
    judging: Display,
}

impl Lit {
    /// Returns the problem to solve and the same problem as it is judged.
    fn problems(&self, field: &LightField, color: Color) -> Result<[Problem; 2], QualityError> {
        let of = |display| Problem::new(field, color, display, Padding::default());
        Ok([of(&self.solved)?, of(&self.judging)?])
    }

    /// Returns the same displays with an SLM of `side` pixels along both axes.
    fn of_side(&self, side: usize) -> Self {
        let small = |display: &Display| Display { height: side, width: side, prescription: None, ..display.clone() };
        Self { solved: small(&self.solved), judging: small(&self.judging) }
    }
}

impl Sources<'_> {
    /// Measures a square source of this size, in millimeters of its image in the eyebox (0 for a point). Returns `None`
    /// once `went` returns false. It is called within each solve.
    pub(crate) fn measure(
        &self,
        image_mm: f64,
        engine: &mut dyn Engine,
        went: &mut dyn FnMut() -> bool,
    ) -> Result<Option<CoherenceFigures>, QualityError> {
        let lit = self.lit(image_mm);
        let [solved, judging] = lit.problems(self.field, self.color)?;
        let mut stopped = false;
        let mut observe = |_: &solve::Progress| {
            stopped |= !went();
            if stopped { Flow::Stop } else { Flow::Continue }
        };
        let solution = solve::solve(&solved, self.settings, engine, &mut observe)?;
        let solutions = [(self.color, solution)];
        let hologram =
            Hologram::from_solutions(self.field, &lit.judging, self.settings, Padding::default(), &solutions)?;
        let scored = hologram.score(&SceneSource::from(vec![judging.clone()]), self.pupils, engine)?;
        let scores: Vec<f64> = scored.pupils.iter().filter_map(|pupil| pupil.psnr).collect();
        let summary = Summary::of(&scores);
        let [contrast, nyquist, half, depth] = match self.of_targets(&lit, engine, &mut observe)? {
            Some(found) if !stopped => found,
            _ => return Ok(None),
        };
        let eye = self.eye();
        let seen = hologram.look(&eye, engine)?.remove(0);
        let shown: Vec<f32> = seen.values.iter().map(|v| v * scored.exposures[0] as f32).collect();
        let (height, width) = self.display.picture_size();
        let psnr = summary.map(|s| s.mean);
        Ok(Some(CoherenceFigures {
            scene: self.field.name.clone(),
            frames: self.settings.frames,
            color: self.color,
            image_mm,
            modes: solved.modes.len().max(1),
            pupil_modes: self.pupil_modes(&solved),
            judged_modes: judging.modes.len().max(1),
            diameter_mm: self.settings.diameter.map(|d| d * 1e3),
            mean_db: summary.map(|s| s.mean),
            worst_db: summary.map(|s| s.worst),
            contrast,
            modulation: [nyquist, half],
            bars_mm: self.farthest() * 1e3,
            widest_mm: self.widest() * 1e3,
            eye_mm: eye.diameter * 1e3,
            depth_of_field_mm: depth * 1e3,
            depth_of_field_dioptres: dioptres(depth, self.display.focal_length),
            picture: Some(picture::light(&[(self.color, &shown)], height, width, self.longest, psnr)),
        }))
    }

    fn lit(&self, image_mm: f64) -> Lit {
        let mut display = self.display.clone();
        let mut terms = SourceTerms::default();
        terms.kind = Some(SourceKind::Laser);
        terms.image_mm = (image_mm > 0.0).then_some(image_mm);
        terms.shape = (image_mm > 0.0).then_some(SourceShape::Square);
        display.source.insert(self.color.into(), terms);
        let [far, near] = self.settings.depth;
        let sampling = display.source_sampling(self.color, self.settings.diameter[0], near - far);
        let with = |samples| display.with_source_samples(self.color, samples);
        match sampling {
            Some(sampling) => Lit { solved: with(sampling.samples), judging: with(JUDGING) },
            None => Lit { solved: display.clone(), judging: display },
        }
    }

    /// Returns the numbers of modes that light the narrowest and the widest pupils of a step.
    fn pupil_modes(&self, solved: &Problem) -> [usize; 2] {
        let fewer = fewer_modes(&solved.modes, self.display.eyebox_min() / 2.0, self.display.focal_length);
        self.settings.diameter.map(|diameter| {
            let few = fewer.iter().rev().find(|few| diameter >= few.from);
            few.map_or(solved.modes.len().max(1), |few| few.modes.len())
        })
    }

    /// A pupil in the middle of the eyebox, with the geometric mean of the diameters that are drawn.
    fn eye(&self) -> Pupil {
        let [low, high] = self.settings.diameter;
        Pupil { x: 0.0, y: 0.0, diameter: (low * high).sqrt(), depth: 0.0 }
    }

    /// Returns the depth of the scene's content that is farthest from the SLM, in meters.
    fn farthest(&self) -> f64 {
        let [far, near] = self.settings.depth;
        if far.abs() > near.abs() { far } else { near }
    }

    /// Returns the widest of the usual pupils, in meters. A narrower pupil loses the finest detail of the picture.
    fn widest(&self) -> f64 {
        PupilRange::usual_diameter(self.display.eyebox_min())[1]
    }

    /// Returns the contrast of speckle, the modulation at the picture's Nyquist frequency and at half of it, and the
    /// depth of field in meters.
    fn of_targets(
        &self,
        lit: &Lit,
        engine: &mut dyn Engine,
        observe: &mut dyn FnMut(&solve::Progress) -> Flow,
    ) -> Result<Option<[f64; 4]>, QualityError> {
        // The bars need a whole number of periods.
        let side = speckle::SIDE.min(self.display.height).min(self.display.width) / 4 * 4;
        if side == 0 {
            return Ok(Some([f64::NAN; 4]));
        }
        let lit = lit.of_side(side);
        let contrast = self.contrast(&lit, side, engine, observe)?;
        let widest = Pupil { diameter: self.widest(), depth: self.farthest(), ..self.eye() };
        let usual = Settings {
            diameter: PupilRange::usual_diameter(self.display.eyebox_min()),
            depth: [self.farthest(); 2],
            ..self.for_targets()
        };
        let mut bars = |periods: usize| -> Result<f64, QualityError> {
            let problems = lit.problems(&bars(side, periods, self.color, [1, 1]), self.color)?;
            let image = seen_of(&problems, &usual, &[widest], engine, observe)?.remove(0);
            Ok(modulation(&image, side, periods) / (SWING / f64::from(GREY)))
        };
        let [nyquist, half] = [bars(side / 2)?, bars(side / 4)?];
        let depth = self.depth_of_field(&lit, side, engine, observe)?;
        Ok(depth.map(|depth| [contrast, nyquist, half, depth]))
    }

    /// Returns the scene's settings for targets of middle brightness. The spectral window holds such targets
    /// completely.
    fn for_targets(&self) -> Settings {
        let (efficiency, window) = (Some(speckle::EFFICIENCY), eyebox::low_level::optics::WindowFactor::Two);
        Settings { efficiency, window, ..self.settings.clone() }
    }

    fn contrast(
        &self,
        lit: &Lit,
        side: usize,
        engine: &mut dyn Engine,
        observe: &mut dyn FnMut(&solve::Progress) -> Flow,
    ) -> Result<f64, QualityError> {
        let problems = lit.problems(&plane(side, self.color, self.field.grid), self.color)?;
        let mut sum = 0.0;
        for i in 0..REPEATS {
            let seed = self.settings.seed.wrapping_add(1 + i as u64);
            let settings = Settings { depth: [0.0; 2], seed, ..self.for_targets() };
            let image = seen_of(&problems, &settings, &[self.eye()], engine, observe)?.remove(0);
            sum += evaluate::contrast(&image) / REPEATS as f64;
        }
        Ok(sum)
    }

    /// Returns the range of focus through which bars keep half of their modulation, in meters from the far to the near
    /// limit. The bars have half of the eye's cut-off frequency.
    fn depth_of_field(
        &self,
        lit: &Lit,
        side: usize,
        engine: &mut dyn Engine,
        observe: &mut dyn FnMut(&solve::Progress) -> Flow,
    ) -> Result<Option<f64>, QualityError> {
        let (optics, eye) = (lit.solved.optics(self.color)?, self.eye());
        let passes = eye.diameter / (optics.wavelength * optics.focal_length) * optics.pitch * side as f64;
        let periods = ((0.5 * passes).round() as usize).clamp(1, side / 4);
        let depth = optics.wavelength * (optics.focal_length / eye.diameter).powi(2);
        let step = FARTHEST * depth / PLACES as f64;
        let focused = |i: usize| Pupil { depth: (i as f64 - PLACES as f64) * step, ..eye };
        let pupils: Vec<Pupil> = (0..=2 * PLACES).map(focused).collect();
        // Content out of focus is blurred by the parallax of the views.
        let problems = lit.problems(&bars(side, periods, self.color, VIEWS), self.color)?;
        let settings = Settings { depth: [-FARTHEST * depth, FARTHEST * depth], ..self.for_targets() };
        let images = seen_of(&problems, &settings, &pupils, engine, observe)?;
        let kept: Vec<f64> = images.iter().map(|image| modulation(image, side, periods)).collect();
        let reach = |beyond: &mut dyn Iterator<Item = f64>| half_at(kept[PLACES], beyond) * step;
        let nearer = reach(&mut kept[PLACES + 1..].iter().copied());
        let farther = reach(&mut kept[..PLACES].iter().rev().copied());
        Ok(Some(nearer + farther))
    }
}

/// Returns the number of steps after which values that begin at `first` fall to half of it. The last step is
/// interpolated linearly. If the values stay above, all steps are counted.
fn half_at(first: f64, rest: &mut dyn Iterator<Item = f64>) -> f64 {
    let (mut before, mut taken) = (first, 0.0);
    for value in rest {
        if value <= 0.5 * first {
            return taken + (before - 0.5 * first) / (before - value).max(f64::MIN_POSITIVE);
        }
        (before, taken) = (value, taken + 1.0);
    }
    taken
}

/// A picture of vertical bars with this number of periods over its side, equal from all views. With one view, it looks
/// the same at each depth of focus.
fn bars(side: usize, periods: usize, color: Color, views: [usize; 2]) -> LightField {
    let value = |x: usize| (f64::from(GREY) + SWING * (TAU * (periods * x % side) as f64 / side as f64).cos()) as f32;
    let picture: Vec<f32> = (0..side * side).map(|i| value(i % side)).collect();
    let even = plane(side, color, views);
    LightField { name: "bars".into(), planes: vec![vec![picture; views[0] * views[1]]], ..even }
}

/// Returns the amplitude of `periods` periods over a picture's width, divided by its mean.
fn modulation(image: &[f32], width: usize, periods: usize) -> f64 {
    let mut sums = [0.0f64; 3];
    for (i, value) in image.iter().enumerate() {
        let (sin, cos) = (TAU * ((i % width) * periods % width) as f64 / width as f64).sin_cos();
        [1.0, cos, sin].iter().zip(&mut sums).for_each(|(share, sum)| *sum += share * f64::from(*value));
    }
    // Bars of one pixel each have all of their amplitude in one coefficient.
    let sides = if 2 * periods == width { 1.0 } else { 2.0 };
    sides * sums[1].hypot(sums[2]) / sums[0].max(f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use eyebox::low_level::engine::cpu::CpuEngine;
    use eyebox::low_level::scene::{self, Request};

    #[test]
    fn bars_have_the_modulation_they_are_made_with() {
        for periods in [1, 3, 4, 8] {
            let picture = &bars(16, periods, Color::Green, [1, 1]).planes[0][0];
            for found in [1, 2, 3, 4, 5, 8] {
                let wanted = if found == periods { SWING / f64::from(GREY) } else { 0.0 };
                assert!((modulation(picture, 16, found) - wanted).abs() < 1e-6, "{periods} {found}");
            }
        }
        assert_eq!(half_at(1.0, &mut [0.9, 0.6, 0.4].into_iter()), 2.5);
        assert_eq!(half_at(1.0, &mut [0.9, 0.6].into_iter()), 2.0);
    }

    /// A wide source has less speckle than a point source. Its bars keep less of their modulation, because detail out
    /// of focus is lost.
    #[test]
    fn a_wide_source_averages_and_blurs() {
        let display = Display { height: 64, width: 64, ..Display::preset("small").unwrap() };
        let request = Request { views: 3, ..Request::new(&display, &[Color::Green]) };
        let field = scene::load("builtin:still-life", &request).unwrap();
        let settings = Settings {
            frames: 1,
            steps: 12,
            pupils: 6,
            diameter: [3.5e-3, 4.5e-3],
            depth: [-1.3e-3, 1.3e-3],
            ..Settings::default()
        };
        let pupils = [[1.0, -1.0, 4.0, 0.0], [-4.0, 3.0, 4.0, 1.0]].map(Pupil::from_mm);
        let (display, settings) = (&display, &settings);
        let (color, longest) = (Color::Green, 64);
        let sources = Sources { field: &field, display, color, settings, pupils: &pupils, longest };
        let mut engine = CpuEngine::new();
        let mut measure = |mm: f64| sources.measure(mm, &mut engine, &mut || true).unwrap().unwrap();
        let (point, wide) = (measure(0.0), measure(3.0));
        assert_eq!((point.modes, point.image_mm, wide.image_mm), (1, 0.0, 3.0));
        assert_eq!((point.pupil_modes, point.judged_modes), ([1, 1], 1));
        assert!(wide.pupil_modes[0] <= wide.modes && wide.pupil_modes[1] <= wide.pupil_modes[0], "{wide:?}");
        assert_eq!(wide.judged_modes, 25);
        assert!(wide.modes > 1 && wide.contrast < 0.9 * point.contrast, "{point:?} {wide:?}");
        assert!(wide.mean_db > point.mean_db, "{:?} {:?}", point.mean_db, wide.mean_db);
        assert!(wide.modulation[0] < point.modulation[0], "{:?} {:?}", point.modulation, wide.modulation);
        for found in [&point, &wide] {
            let most = 4e3 * 520e-9 * (0.4 / found.eye_mm * 1e3).powi(2);
            assert!(
                found.depth_of_field_mm > 0.1 * most && found.depth_of_field_mm <= most * (1.0 + 1e-9),
                "{found:?}"
            );
        }
        assert!(sources.measure(1.0, &mut engine, &mut || false).unwrap().is_none());
    }
}
