//! Refines all colors of a hologram for the position of the pupil while it is in use.

use super::ProduceError;
use crate::engine::{Engine, EngineError};
use crate::hologram::{ColorHologram, Hologram, HologramError};
use crate::optics::PupilDistribution;
use crate::scene::LightField;
use crate::solve::{
    BestKeeper, Flow, JointPart, JointRefiner, Problem, Refinable, RefineSettings, RefinedStep, Refiner, refine,
};

/// All colors of a hologram under refinement, with one engine each.
pub struct Refinement {
    hologram: Hologram,
    /// Each color with its own phases, or all colors with shared drive values.
    refined: Vec<Box<dyn Refinable + Send>>,
    /// The best state of each of these since the pupil was set.
    best: Vec<BestKeeper>,
}

impl Hologram {
    /// Returns the problem of each color, as its scene on its display with the padding of the solve.
    ///
    /// # Errors
    /// [`HologramError::NoDisplay`] without a display, and [`HologramError::Optics`] for a scene that lacks one of its
    /// colors.
    pub fn problems(&self, field: &LightField) -> Result<Vec<Problem>, HologramError> {
        let (display, padding) = (self.made_for()?, self.metadata.padding());
        self.named_colors().into_iter().map(|c| Ok(Problem::new(field, c, &display, padding)?)).collect()
    }

    /// Returns the parts of a hologram whose colors share their sub-frames, per color, or `None` for another one.
    /// `problems` are its [`problems`](Self::problems).
    pub fn joint_parts(&self, problems: Vec<Problem>) -> Option<Vec<JointPart>> {
        let joint = self.metadata.joint_color.as_ref()?;
        let part = |(problem, color): (Problem, &ColorHologram)| {
            let laser = joint.lasers.get(&color.color?)?.clone();
            Some(JointPart { problem, exposure: color.exposure, laser })
        };
        problems.into_iter().zip(&self.colors).map(part).collect()
    }

    /// Starts the refinement for the position of the pupil.
    ///
    /// `field` is its scene, and `open` opens an engine for each color. Simultaneous color is refined as a whole, with
    /// the same powers of the lasers.
    ///
    /// # Errors
    /// The errors of [`problems`](Self::problems), [`Refiner::new`], [`JointRefiner::new`] and `open`.
    pub fn refine(
        self,
        field: &LightField,
        steering: RefineSettings,
        mut open: impl FnMut() -> Result<Box<dyn Engine>, EngineError>,
    ) -> Result<Refinement, ProduceError> {
        let problems = self.problems(field)?;
        let mut begin =
            |(problem, color): (Problem, &ColorHologram)| -> Result<Box<dyn Refinable + Send>, ProduceError> {
                Ok(Box::new(Refiner::new(problem, &color.phases, color.exposure, steering, open()?)?))
            };
        let refined = match self.joint_parts(problems.clone()) {
            Some(parts) => vec![Box::new(JointRefiner::new(parts, &self.sent_phases()[0], steering, open)?) as _],
            None => problems.into_iter().zip(&self.colors).map(&mut begin).collect::<Result<_, _>>()?,
        };
        Ok(Refinement { hologram: self, refined, best: Vec::new() })
    }
}

impl Refinement {
    /// Sets the expected position of the pupil, from now on.
    ///
    /// # Errors
    /// [`EngineError`] if an engine fails.
    pub fn set_pupil(&mut self, pupil: PupilDistribution) -> Result<(), EngineError> {
        self.best.clear();
        self.refined.iter_mut().try_for_each(|refined| refined.aim(pupil))
    }

    /// Takes one step of every color and returns the mean loss. It is the squared difference in linear light over the
    /// pupils of the step. It is not finite if no step was taken.
    ///
    /// # Errors
    /// [`EngineError`] if an engine fails.
    pub fn step(&mut self) -> Result<f64, EngineError> {
        let losses = self.refined.iter_mut().map(|refined| refined.step()).collect::<Result<Vec<_>, _>>()?;
        Ok(losses.iter().sum::<f64>() / losses.len().max(1) as f64)
    }

    /// Takes at most `steps` steps for the current pupil and judges each one.
    ///
    /// [`best`](Self::best) has the best state. It ends earlier if `observe` stops it or if a loss is not a finite
    /// number. It returns the last loss and the number of steps.
    ///
    /// # Errors
    /// [`EngineError`] if an engine fails.
    pub fn refine(
        &mut self,
        steps: usize,
        observe: &mut dyn FnMut(RefinedStep) -> Flow,
    ) -> Result<(f64, usize), EngineError> {
        if self.best.is_empty() {
            self.best = self.refined.iter().map(|refined| BestKeeper::new(refined.aimed_at().middle())).collect();
        }
        let each = self.refined.iter_mut().map(|refined| refined.as_mut() as &mut dyn Refinable);
        let mut parts: Vec<_> = each.zip(&mut self.best).collect();
        refine(&mut parts, steps, observe)
    }

    /// Returns the hologram in the best state that [`refine`](Self::refine) found since the pupil was set. Without a
    /// call of `refine` it is the current state.
    ///
    /// # Errors
    /// [`EngineError`] if an engine fails.
    pub fn best(&mut self) -> Result<&Hologram, EngineError> {
        self.hologram()?;
        let states = self.best.iter().filter_map(BestKeeper::best).flat_map(|best| &best.phases);
        for (color, phases) in self.hologram.colors.iter_mut().zip(states) {
            color.phases.clone_from(phases);
        }
        Ok(&self.hologram)
    }

    /// Returns the hologram in its current state.
    ///
    /// # Errors
    /// [`EngineError`] if an engine fails.
    pub fn hologram(&mut self) -> Result<&Hologram, EngineError> {
        let mut states = Vec::new();
        for refined in &mut self.refined {
            states.append(&mut refined.state()?);
        }
        for (color, refined) in self.hologram.colors.iter().zip(&self.refined) {
            if let (Some(name), Some(lit)) = (color.color, refined.lit()) {
                self.hologram.metadata.sources.light_only(name, lit);
            }
        }
        self.hologram.colors.iter_mut().zip(states).for_each(|(color, phases)| color.phases = phases);
        Ok(&self.hologram)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::cpu::CpuEngine;
    use crate::optics::{Color, Display, Padding, Pupil};
    use crate::reconstruction::SceneSource;
    use crate::scene::{self, Request};
    use crate::solve::{self, Settings};

    /// Returns the PSNR of a hologram at one pupil.
    fn score(hologram: &Hologram, field: &LightField, pupil: Pupil) -> f64 {
        let scene = SceneSource::from(hologram.problems(field).unwrap());
        hologram.score(&scene, &[pupil], &mut CpuEngine::new()).unwrap().pupils[0].psnr.unwrap()
    }

    /// By its score at the pupil, the best state is never worse than the state with fewer steps or the last state, for
    /// any spread of the pupils. The case resembles issue 41 and the golden one, but is smaller.
    #[test]
    fn more_steps_are_never_worse_at_the_pupil_by_score() {
        let (display, colors) =
            (Display { height: 40, width: 48, ..Display::preset("paper").unwrap() }, [Color::Red, Color::Blue]);
        let field =
            scene::load("builtin:still-life", &Request { views: 5, ..Request::new(&display, &colors) }).unwrap();
        let settings = Settings { frames: 2, steps: 3, pupils: 4, ..Settings::default() };
        let solve = |color: Color| {
            let problem = Problem::new(&field, color, &display, Padding::default()).unwrap();
            let solved = solve::solve(&problem, &settings, &mut CpuEngine::new(), &mut |_| Flow::Continue).unwrap();
            (color, solved)
        };
        let solved = colors.map(solve);
        let hologram = Hologram::from_solutions(&field, &display, &settings, Padding::default(), &solved).unwrap();
        let mut fell = 0.0f64;
        for (pupil, spread) in
            [([4.0, 0.0, 4.0, 1.0], 0.25e-3), ([4.0, -2.0, 4.0, 1.5], 0.25e-3), ([-3.0, 1.0, 3.0, 0.0], 1e-3)]
        {
            let pupil = Pupil::from_mm(pupil);
            let mut before = score(&hologram, &field, pupil);
            for steps in [1, 2, 3, 6, 8, 12] {
                let engine = || Ok(Box::new(CpuEngine::new()) as Box<dyn Engine>);
                let mut refinement = hologram.clone().refine(&field, RefineSettings::default(), engine).unwrap();
                refinement.set_pupil(PupilDistribution::around(&pupil, spread)).unwrap();
                let (_, taken) = refinement.refine(steps, &mut |_| Flow::Continue).unwrap();
                assert_eq!(taken, steps);
                let last = score(refinement.hologram().unwrap(), &field, pupil);
                let best = score(refinement.best().unwrap(), &field, pupil);
                assert!(best >= before - 0.01, "{steps} steps: {best} dB, {before} dB with fewer");
                assert!(best >= last - 0.01, "{steps} steps: {best} dB, but {last} dB at last");
                fell = fell.max(best - last);
                before = best;
            }
            assert!(before > score(&hologram, &field, pupil) + 1.0, "{before} dB");
        }
        assert!(fell > 0.1, "no last state was worse than the best, so the test has no effect, {fell} dB");
    }
}
