//! Compares simultaneous color with one color after another (OPTICS 13).
//!
//! Both have the same number of sub-frames in all, lasers of the same peak power, the same steps and pupils, and the
//! same exposure of each color.

use super::picture;
use super::results::JointFigures;
use eyebox::low_level::engine::Engine;
use eyebox::low_level::evaluate::Summary;
use eyebox::low_level::hologram::{ColorHologram, Hologram};
use eyebox::low_level::optics::{Color, Display, JointColor, Laser, Padding, Pupil};
use eyebox::low_level::quality::QualityError;
use eyebox::low_level::reconstruction::SceneSource;
use eyebox::low_level::scene::LightField;
use eyebox::low_level::solve::{self, Flow, Joint, JointProblem, Problem, Settings, Solution};

/// The way in which the lasers light the sub-frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Lighting {
    /// One color after another.
    Sequence,
    /// All colors at once, with white brighter by this factor than in sequence.
    Joint(f64),
    /// All colors at once, as bright as in sequence, by lasers that always have their peak power. The phases send the
    /// excess light elsewhere.
    Undimmed,
}

impl Lighting {
    /// Returns the name of the way for reports.
    pub(crate) fn name(self) -> String {
        match self {
            Self::Sequence => "one color after another".into(),
            Self::Joint(times) => format!("all at once, {times} times as bright"),
            Self::Undimmed => "all at once, as bright, lasers at their peak".into(),
        }
    }
}

/// A scene on a display for which ways of lighting are compared.
pub(crate) struct Colors<'a> {
    pub(crate) field: &'a LightField,
    pub(crate) display: &'a Display,
    pub(crate) colors: &'a [Color],
    pub(crate) settings: &'a Settings,
    /// The pupils through which holograms are scored.
    pub(crate) pupils: &'a [Pupil],
    /// The longest side of the pictures, in pixels.
    pub(crate) longest: usize,
}

/// One hologram as the phases of each color and the lasers that light them.
type Of = (Vec<Solution>, Option<JointColor>);

impl Colors<'_> {
    /// Compares these ways of lighting `frames` sub-frames in all, in their order. The first one must be in sequence,
    /// because it sets the exposures. Returns `None` once `went` returns false. It is called within each solve.
    pub(crate) fn compare(
        &self,
        frames: usize,
        ways: &[Lighting],
        engine: &mut dyn Engine,
        went: &mut dyn FnMut(&str) -> bool,
    ) -> Result<Option<Vec<JointFigures>>, QualityError> {
        let problem = |color: &Color| Problem::new(self.field, *color, self.display, Padding::default());
        let problems = self.colors.iter().map(problem).collect::<Result<Vec<_>, _>>()?;
        let mut exposures = Vec::new();
        let mut all = Vec::with_capacity(ways.len());
        for way in ways {
            let mut stopped = false;
            let mut observe = |_: &solve::Progress| {
                stopped |= !went(&way.name());
                if stopped { Flow::Stop } else { Flow::Continue }
            };
            let (solutions, joint) = match *way {
                Lighting::Sequence => (self.in_sequence(&problems, frames, engine, &mut observe)?, None),
                Lighting::Joint(brightness) => {
                    self.at_once(&problems, frames, brightness, &exposures, engine, &mut observe)?
                }
                Lighting::Undimmed => {
                    let dimmer: Vec<f64> = exposures.iter().map(|e| e * self.colors.len() as f64).collect();
                    self.at_once(&problems, frames, self.colors.len() as f64, &dimmer, engine, &mut observe)?
                }
            };
            if stopped {
                return Ok(None);
            }
            if *way == Lighting::Sequence {
                exposures = solutions.iter().map(|s| s.exposure).collect();
            }
            all.push(self.figures(*way, frames, &solutions, joint, &problems, engine)?);
        }
        Ok(Some(all))
    }

    /// Returns the number of sub-frames of each color in sequence.
    fn shares(&self, frames: usize) -> Vec<usize> {
        let powers = eyebox::low_level::optics::powers_in_sequence(self.colors.len(), frames);
        powers.iter().map(|of_color| of_color.iter().filter(|p| **p > 0.0).count()).collect()
    }

    fn in_sequence(
        &self,
        problems: &[Problem],
        frames: usize,
        engine: &mut dyn Engine,
        observe: &mut dyn FnMut(&solve::Progress) -> Flow,
    ) -> Result<Vec<Solution>, QualityError> {
        let one = |(problem, frames): (&Problem, usize)| {
            let settings = Settings { frames, ..self.settings.clone() };
            Ok(solve::solve(problem, &settings, engine, observe)?)
        };
        problems.iter().zip(self.shares(frames)).map(one).collect()
    }

    fn at_once(
        &self,
        problems: &[Problem],
        frames: usize,
        brightness: f64,
        exposures: &[f64],
        engine: &mut dyn Engine,
        observe: &mut dyn FnMut(&solve::Progress) -> Flow,
    ) -> Result<Of, QualityError> {
        let slopes = self.display.slopes(self.colors);
        let settings = Settings { frames, joint: Some(Joint { brightness }), ..self.settings.clone() };
        let problem = JointProblem { colors: problems, slopes: &slopes, exposures: Some(exposures), powers: None };
        let solved = solve::solve_joint(&problem, &settings, None, engine, observe)?;
        let lasers = self.colors.iter().zip(slopes).zip(solved.powers);
        let lasers = lasers.map(|((color, slope), powers)| (*color, Laser { slope, powers })).collect();
        Ok((solved.colors, Some(JointColor { lasers })))
    }

    /// Scores each color through all pupils and renders its picture.
    fn figures(
        &self,
        way: Lighting,
        frames: usize,
        solutions: &[Solution],
        joint: Option<JointColor>,
        problems: &[Problem],
        engine: &mut dyn Engine,
    ) -> Result<JointFigures, QualityError> {
        let (mut scores, mut planes, mut by_color) = (Vec::new(), Vec::new(), Vec::new());
        let middle = Pupil { x: 0.0, y: 0.0, diameter: self.display.eyebox_min() / 4.0, depth: 0.0 };
        let pixels = self.display.height * self.display.width;
        for ((color, solution), problem) in self.colors.iter().zip(solutions).zip(problems) {
            let of_color = ColorHologram {
                color: Some(*color),
                wavelength: problem.optics.wavelength,
                exposure: solution.exposure,
                efficiency: solution.efficiency,
                phases: solution.phases.clone(),
            };
            let mut hologram = Hologram::on(self.display, solution.phases.len() / pixels, vec![of_color]);
            hologram.metadata.joint_color = joint.clone();
            let scene = SceneSource::from(vec![problem.clone()]);
            let scored = hologram.score(&scene, self.pupils, engine)?;
            let of_color: Vec<f64> = scored.pupils.iter().filter_map(|p| p.psnr).collect();
            by_color.extend(Summary::of(&of_color).map(|s| (*color, s.mean)));
            scores.extend(of_color);
            let seen = hologram.look(&middle, engine)?.remove(0);
            planes.push(seen.values.iter().map(|v| v * scored.exposures[0] as f32).collect::<Vec<f32>>());
        }
        let shown: Vec<(Color, &[f32])> = self.colors.iter().copied().zip(planes.iter().map(|p| &p[..])).collect();
        let (height, width) = self.display.picture_size();
        let summary = Summary::of(&scores);
        let undimmed = way == Lighting::Undimmed;
        Ok(JointFigures {
            scene: self.field.name.clone(),
            frames,
            way: way.name(),
            // The light is brighter by this factor, but the excess goes elsewhere. The picture is as bright as in
            // sequence.
            brightness: joint.as_ref().map_or(1.0, |j| if undimmed { 1.0 } else { j.brightness() }),
            mean_db: summary.map(|s| s.mean),
            worst_db: summary.map(|s| s.worst),
            colors_db: by_color,
            powers: joint.map(|joint| joint.lasers.into_iter().map(|(color, laser)| (color, laser.powers)).collect()),
            picture: Some(picture::light(&shown, height, width, self.longest, summary.map(|s| s.mean))),
        })
    }
}
