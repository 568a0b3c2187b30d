//! A hologram that is refined while it is in use: all colours, for where the pupil is.

use super::ProduceError;
use crate::engine::{Engine, EngineError};
use crate::hologram::{ColorHologram, Hologram, HologramError};
use crate::optics::PupilDistribution;
use crate::scene::LightField;
use crate::solve::{
    BestKeeper, Flow, JointPart, JointRefiner, Problem, Refinable, RefineSettings, RefinedStep, Refiner, refine,
};

/// All colours of a hologram under refinement, each on an engine of its own.
pub struct Refinement {
    hologram: Hologram,
    /// Each colour with phases of its own, or all of them with the drives that they share.
    refined: Vec<Box<dyn Refinable + Send>>,
    /// The best state of each of these since the pupil was set.
    best: Vec<BestKeeper>,
}

impl Hologram {
    /// What it was solved for: its scene before its display, colour by colour, with the padding that it was solved with.
    ///
    /// # Errors
    /// [`HologramError::NoDisplay`]; [`HologramError::Optics`] for a scene without one of its colours.
    pub fn problems(&self, field: &LightField) -> Result<Vec<Problem>, HologramError> {
        let (display, padding) = (self.made_for()?, self.metadata.padding());
        self.named_colors().into_iter().map(|c| Ok(Problem::new(field, c, &display, padding)?)).collect()
    }

    /// What it is made of where its colours share their sub-frames, colour by colour; none where they do not. `problems` are its
    /// [`problems`](Self::problems).
    pub fn joint_parts(&self, problems: Vec<Problem>) -> Option<Vec<JointPart>> {
        let joint = self.metadata.joint_color.as_ref()?;
        let part = |(problem, color): (Problem, &ColorHologram)| {
            let laser = joint.lasers.get(&color.color?)?.clone();
            Some(JointPart { problem, exposure: color.exposure, laser })
        };
        problems.into_iter().zip(&self.colors).map(part).collect()
    }

    /// Begins to refine it for where the pupil is. `field` is its scene; `open` opens an engine for each colour. All colours at once are
    /// refined together: the powers of their lasers stay.
    ///
    /// # Errors
    /// Those of [`problems`](Self::problems), of [`Refiner::new`], of [`JointRefiner::new`] and of `open`.
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
    /// The pupil is there from now on, as far as is known.
    ///
    /// # Errors
    /// Those of the engines.
    pub fn set_pupil(&mut self, pupil: PupilDistribution) -> Result<(), EngineError> {
        self.best.clear();
        self.refined.iter_mut().try_for_each(|refined| refined.aim(pupil))
    }

    /// One step of every colour. Returns the mean loss: squared difference in linear light over the pupils of the step; not
    /// finite where no step was taken.
    ///
    /// # Errors
    /// Those of the engines.
    pub fn step(&mut self) -> Result<f64, EngineError> {
        let losses = self.refined.iter_mut().map(|refined| refined.step()).collect::<Result<Vec<_>, _>>()?;
        Ok(losses.iter().sum::<f64>() / losses.len().max(1) as f64)
    }

    /// Takes at most `steps` steps for the pupil that was set and judges each; [`best`](Self::best) has the best state. Ends earlier
    /// if `observe` stops it or if a loss is not a finite number. Returns the last loss and the number of steps.
    ///
    /// # Errors
    /// Those of the engines.
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

    /// The hologram in the best state that [`refine`](Self::refine) found since the pupil was set; as it is now if `refine` was not
    /// called.
    ///
    /// # Errors
    /// Those of the engines.
    pub fn best(&mut self) -> Result<&Hologram, EngineError> {
        self.hologram()?;
        let states = self.best.iter().filter_map(BestKeeper::best).flat_map(|best| &best.phases);
        for (color, phases) in self.hologram.colors.iter_mut().zip(states) {
            color.phases.clone_from(phases);
        }
        Ok(&self.hologram)
    }

    /// The hologram as it is now.
    ///
    /// # Errors
    /// Those of the engines.
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

    /// PSNR of a hologram at one pupil.
    fn score(hologram: &Hologram, field: &LightField, pupil: Pupil) -> f64 {
        let scene = SceneSource::from(hologram.problems(field).unwrap());
        hologram.score(&scene, &[pupil], &mut CpuEngine::new()).unwrap().pupils[0].psnr.unwrap()
    }

    /// The case of issue 41 and the golden one, smaller: by its score at the pupil the best state is never worse than that of fewer
    /// steps, nor than the last one, however wide the pupils of the steps are spread.
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
        assert!(fell > 0.1, "no last state was worse than the best, so nothing was shown: {fell} dB");
    }
}
