//! Scores the positions of an eye across the eyebox of a display's switchable sources (OPTICS 12).
//!
//! If the sources follow the pupil, a hologram is solved for each position, in the light of the sources that serve it
//! there. Other holograms have sources that take turns or are lit together.

use super::results::{Results, SourcesFigures};
use super::{Comparison, LOOK, OfScene, SOLVE, Work, picture};
use eyebox::low_level::engine::Engine;
use eyebox::low_level::evaluate::Summary;
use eyebox::low_level::hologram::{ColorHologram, Hologram};
use eyebox::low_level::optics::{
    Color, Display, EyeboxRegion, Padding, Pupil, PupilDistribution, SourceChoice, SourcesLit,
};
use eyebox::low_level::quality::QualityError;
use eyebox::low_level::reconstruction::SceneSource;
use eyebox::low_level::scene::LightField;
use eyebox::low_level::solve::{self, Flow, Problem, Settings, Solution, Warm, pupils_of};
use serde_json::json;

/// A scene on a display for which the lighting of the sources is compared.
pub(crate) struct Across<'a> {
    pub(crate) field: &'a LightField,
    pub(crate) display: &'a Display,
    pub(crate) colors: &'a [Color],
    pub(crate) settings: &'a Settings,
    /// The longest side of the pictures, in pixels.
    pub(crate) longest: usize,
}

/// The compared ways of lighting the sources, with their names.
const WAYS: [(&str, SourcesLit); 3] =
    [("steered", SourcesLit::Steered), ("in turn", SourcesLit::InTurn), ("together", SourcesLit::Together)];
/// The narrowest and the widest pupil of the eye, in meters.
const EYE: [f64; 2] = [3.5e-3, 4.5e-3];
/// The uncertainty of the position of the eye, in meters.
const SPREAD: f64 = 0.1e-3;
/// The number of pupils that score a position.
const PUPILS: usize = 8;
/// The number of positions from the middle to the rim, both along an axis and along the diagonal.
const ALONG: usize = 7;

/// The solutions of all colors with their problems.
type Solved = (Vec<Solution>, Vec<Problem>);

impl Comparison {
    /// The approximate number of solves and measurements per scene.
    pub(super) fn source_solves(&self) -> usize {
        if self.sources { self.frames.len() * (WAYS.len() + 2 * ALONG) } else { 0 }
    }
}

impl OfScene<'_> {
    /// Measures positions across the eyebox of the display's switchable sources, for each number of sub-frames without
    /// a cached result.
    pub(super) fn across_sources(
        &self,
        work: &mut Work,
        engine: &mut dyn Engine,
        results: &mut Results,
    ) -> Result<(), QualityError> {
        let job = self.job;
        for &frames in job.frames.iter().filter(|_| job.sources) {
            let settings = Settings { frames, depth: self.depth, ..job.settings.clone() };
            let made_by = json!({
                "shown": self.shown(&self.made_by), "settings": settings, "sources": job.display.sources.each,
            });
            let (display, colors, longest) = (&job.display, &job.colors[..], job.longest());
            let across = Across { field: self.field, display, colors, settings: &settings, longest };
            let (name, label) = (format!("{}-sources-{frames}", self.name), self.label());
            let found: Option<Vec<SourcesFigures>> = work.kept_or(&name, &made_by, &mut results.missing, |work| {
                across.compare(engine, &mut |way| work.say(&format!("{label}: {frames} sub-frames, sources {way}")))
            })?;
            let Some(found) = found else { break };
            work.pass((SOLVE + LOOK) * (WAYS.len() + 2 * ALONG) as f64);
            results.sources.extend(found.into_iter().map(|s| SourcesFigures { scene: self.label().into(), ..s }));
        }
        Ok(())
    }
}

impl Across<'_> {
    fn allows(display: &Display, colors: &[Color], frames: usize, lit: &SourcesLit) -> bool {
        let most = colors.iter().map(|color| display.sources.of(*color).len()).max().unwrap_or(0);
        *lit != SourcesLit::InTurn || frames >= most
    }

    /// Returns the positions from the middle to the rim, along x and along the diagonal, in meters.
    fn places(&self) -> Vec<[f64; 2]> {
        let rim = ((self.display.eyebox_min() - EYE[1]) / 2.0 - 2.0 * SPREAD).max(0.0);
        let at = |i: usize| rim * i as f64 / (ALONG - 1) as f64;
        let along = (0..ALONG).map(|i| [at(i), 0.0]);
        along.chain((1..ALONG).map(|i| [at(i); 2])).collect()
    }

    /// Compares the ways of lighting. Returns `None` once `went` returns false. It is called within each solve.
    pub(crate) fn compare(
        &self,
        engine: &mut dyn Engine,
        went: &mut dyn FnMut(&str) -> bool,
    ) -> Result<Option<Vec<SourcesFigures>>, QualityError> {
        let mut all = Vec::new();
        for (way, lit) in WAYS {
            if !Self::allows(self.display, self.colors, self.settings.frames, &lit) {
                continue;
            }
            let mut display = self.display.clone();
            display.sources.lit = lit;
            let Some(base) = self.solved(&display, None, engine, &mut |_| went(way))? else { return Ok(None) };
            for [x, y] in self.places() {
                let eye = Pupil { x, y, diameter: 0.5 * (EYE[0] + EYE[1]), depth: 0.0 };
                let aim = PupilDistribution { focus: self.settings.depth, ..PupilDistribution::around(&eye, SPREAD) };
                let mut there = None;
                if display.sources.lit == SourcesLit::Steered {
                    let label = format!("{way}, the eye at ({:.0}, {:.0}) mm", x * 1e3, y * 1e3);
                    let Some(solved) = self.solved(&display, Some((&aim, &base)), engine, &mut |_| went(&label))?
                    else {
                        return Ok(None);
                    };
                    there = Some(solved);
                }
                all.push(self.figures(way, &display, &aim, there.as_ref().unwrap_or(&base), engine)?);
            }
        }
        Ok(Some(all))
    }

    /// Solves all colors for all pupils that the lit sources serve. With `eye`, it starts from those phases and solves
    /// for the position of the eye.
    fn solved(
        &self,
        display: &Display,
        eye: Option<(&PupilDistribution, &Solved)>,
        engine: &mut dyn Engine,
        went: &mut dyn FnMut(&solve::Progress) -> bool,
    ) -> Result<Option<Solved>, QualityError> {
        let (mut solutions, mut problems, mut stopped) = (Vec::new(), Vec::new(), false);
        for (i, color) in self.colors.iter().enumerate() {
            let mut problem = Problem::new(self.field, *color, display, Padding::default())?;
            let mut settings = Settings { diameter: EYE.map(|d| d.min(problem.eyebox)), ..self.settings.clone() };
            let from = eye.map(|(aim, (solutions, _))| {
                settings.efficiency = Some(solutions[i].efficiency.min(1.0));
                if let Some(choice) = &mut problem.choice {
                    choice.follow(aim);
                    problem.modes = problem.modes.iter().map(|mode| mode.lit_among(choice.lit())).collect();
                }
                let size = [EYE[1] + 4.0 * SPREAD; 2];
                problem.regions = [EyeboxRegion { center: aim.centre, size }].into();
                Warm { phases: &solutions[i].phases, progress: 0.0 }
            });
            let mut observe = |progress: &solve::Progress| {
                stopped |= !went(progress);
                if stopped { Flow::Stop } else { Flow::Continue }
            };
            solutions.push(solve::solve_from(&problem, &settings, from, engine, &mut observe)?);
            problems.push(problem);
            if stopped {
                return Ok(None);
            }
        }
        Ok(Some((solutions, problems)))
    }

    /// Scores each color through pupils around the eye and renders its picture.
    fn figures(
        &self,
        way: &str,
        display: &Display,
        aim: &PupilDistribution,
        (solutions, problems): &Solved,
        engine: &mut dyn Engine,
    ) -> Result<SourcesFigures, QualityError> {
        let pupils = pupils_of(aim, PUPILS, !self.settings.seed);
        let [x, y] = aim.centre;
        let middle = Pupil { x, y, diameter: 0.5 * (EYE[0] + EYE[1]), depth: 0.0 };
        let pixels = display.height * display.width;
        let (mut scores, mut planes, mut lit) = (Vec::new(), Vec::new(), 0);
        for ((color, solution), problem) in self.colors.iter().zip(solutions).zip(problems) {
            let of_color = ColorHologram {
                color: Some(*color),
                wavelength: problem.optics.wavelength,
                exposure: solution.exposure,
                efficiency: solution.efficiency,
                phases: solution.phases.clone(),
            };
            let mut hologram = Hologram::on(display, solution.phases.len() / pixels, vec![of_color]);
            let chosen = problem.choice.as_ref().map_or(&[][..], SourceChoice::lit);
            hologram.metadata.sources.light_only(*color, chosen);
            lit = lit.max(chosen.len());
            let scored = hologram.score(&SceneSource::from(vec![problem.clone()]), &pupils, engine)?;
            scores.extend(scored.pupils.iter().filter_map(|p| p.psnr));
            let seen = hologram.look(&middle, engine)?.remove(0);
            planes.push(seen.values.iter().map(|v| v * scored.exposures[0] as f32).collect::<Vec<f32>>());
        }
        let shown: Vec<(Color, &[f32])> = self.colors.iter().copied().zip(planes.iter().map(|p| &p[..])).collect();
        let (height, width) = display.picture_size();
        let summary = Summary::of(&scores);
        Ok(SourcesFigures {
            scene: self.field.name.clone(),
            frames: self.settings.frames,
            way: way.into(),
            place_mm: aim.centre.map(|v| v * 1e3),
            lit,
            mean_db: summary.map(|s| s.mean),
            worst_db: summary.map(|s| s.worst),
            picture: Some(picture::light(&shown, height, width, self.longest, summary.map(|s| s.mean))),
        })
    }
}
