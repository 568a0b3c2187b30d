//! A hologram that is refined while it is in use: all colours, for where the pupil is.

use super::{Hologram, HologramError};
use crate::engine::{Engine, EngineError};
use crate::evaluate::Sums;
use crate::optics::PupilDistribution;
use crate::scene::LightField;
use crate::solve::{
    BestState, Flow, JUDGED_PUPILS, JointPart, JointRefiner, Problem, Refiner, Steering, is_judged, pupils_of,
};

/// All colours of a hologram under refinement, each on an engine of its own.
pub struct Refinement {
    hologram: Hologram,
    refiners: Refiners,
    seed: u64,
    /// The pupil that it is refined for.
    aim: Option<PupilDistribution>,
    /// Of each color that has phases of its own, or of all together: the best state since the pupil was set.
    best: Vec<BestState<Vec<Vec<f32>>>>,
}

/// Who refines it.
enum Refiners {
    /// Each colour its own phases,
    Apart(Vec<Refiner>),
    /// or all of them the drives that they share.
    Together(Box<JointRefiner>),
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
        let part = |(problem, color): (Problem, &super::ColorHologram)| {
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
        steering: Steering,
        mut open: impl FnMut() -> Result<Box<dyn Engine>, EngineError>,
    ) -> Result<Refinement, HologramError> {
        let problems = self.problems(field)?;
        if let Some(parts) = self.joint_parts(problems.clone()) {
            let drives = self.sent_phases().swap_remove(0);
            let refiner = JointRefiner::new(parts, &drives, steering, open)?;
            drop(drives);
            return Ok(Refinement::new(self, Refiners::Together(Box::new(refiner)), steering));
        }
        let begin = |(problem, color): (Problem, &super::ColorHologram)| {
            Ok(Refiner::new(problem, &color.phases, color.exposure, steering, open()?)?)
        };
        let refiners = problems.into_iter().zip(&self.colors).map(begin).collect::<Result<_, HologramError>>()?;
        Ok(Refinement::new(self, Refiners::Apart(refiners), steering))
    }
}

impl Refinement {
    fn new(hologram: Hologram, refiners: Refiners, steering: Steering) -> Self {
        Self { hologram, refiners, seed: steering.seed, aim: None, best: Vec::new() }
    }

    /// The pupil is there from now on, as far as is known.
    ///
    /// # Errors
    /// Those of the engines.
    pub fn set_pupil(&mut self, pupil: PupilDistribution) -> Result<(), EngineError> {
        (self.aim, self.best) = (Some(pupil), Vec::new());
        match &mut self.refiners {
            Refiners::Apart(refiners) => refiners.iter_mut().try_for_each(|r| r.aim(pupil)),
            Refiners::Together(refiner) => refiner.aim(pupil),
        }
    }

    /// One step of every colour. Returns the mean loss: squared difference in linear light over the pupils of the step; not
    /// finite where no step was taken.
    ///
    /// # Errors
    /// Those of the engines.
    pub fn step(&mut self) -> Result<f64, EngineError> {
        let refiners = match &mut self.refiners {
            Refiners::Apart(refiners) => refiners,
            Refiners::Together(refiner) => return refiner.step(),
        };
        let losses = refiners.iter_mut().map(Refiner::step).collect::<Result<Vec<_>, _>>()?;
        Ok(losses.iter().sum::<f64>() / losses.len().max(1) as f64)
    }

    /// Takes so many steps for the pupil that was set, unless `observe`, called with each step's number and loss, stops it or a
    /// loss is no finite number, and judges what they reach; [`best`](Self::best) has the best. Returns the last loss and the
    /// number of steps.
    ///
    /// # Errors
    /// Those of the engines; [`HologramError::Evaluate`] for a scene without light.
    pub fn refine(
        &mut self,
        steps: usize,
        observe: &mut dyn FnMut(usize, f64) -> Flow,
    ) -> Result<(f64, usize), HologramError> {
        self.judge(0)?;
        let (mut loss, mut taken) = (f64::NAN, 0);
        while taken < steps {
            loss = self.step()?;
            if !loss.is_finite() {
                break;
            }
            taken += 1;
            let flow = observe(taken, loss);
            if is_judged(taken, steps) || flow == Flow::Stop {
                self.judge(taken)?;
            }
            if flow == Flow::Stop {
                break;
            }
        }
        Ok((loss, taken))
    }

    /// Keeps the state after a step if it is the best for the pupil.
    fn judge(&mut self, step: usize) -> Result<(), HologramError> {
        let Some(aim) = self.aim else { return Ok(()) };
        let pupils = pupils_of(&aim, JUDGED_PUPILS, !self.seed);
        let mean = |sums: &[Sums], exposure: f64| {
            sums.iter().map(|sums| sums.psnr(exposure)).sum::<f64>() / sums.len().max(1) as f64
        };
        let unknown = || BestState { step, psnr: f64::NEG_INFINITY, state: Vec::new() };
        match &mut self.refiners {
            Refiners::Apart(refiners) => {
                self.best.resize_with(refiners.len(), unknown);
                for (refiner, best) in refiners.iter_mut().zip(&mut self.best) {
                    let psnr = mean(&refiner.look(&pupils)?, refiner.exposure());
                    best.offer(step, psnr, || Ok::<_, EngineError>(vec![refiner.phases()?]))?;
                }
            }
            Refiners::Together(refiner) => {
                self.best.resize_with(1, unknown);
                let mut psnr = 0.0;
                for (at, color) in self.hologram.colors.iter().enumerate() {
                    psnr += mean(&refiner.look(at, &pupils)?, color.exposure);
                }
                let psnr = psnr / self.hologram.colors.len().max(1) as f64;
                self.best[0].offer(step, psnr, || Ok::<_, EngineError>(refiner.phases().to_vec()))?;
            }
        }
        Ok(())
    }

    /// The hologram in the best state that [`refine`](Self::refine) found since the pupil was set; as it is now where it has not
    /// been called.
    ///
    /// # Errors
    /// Those of the engines.
    pub fn best(&mut self) -> Result<&Hologram, EngineError> {
        self.hologram()?;
        let states = self.best.iter().flat_map(|best| &best.state);
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
        match &mut self.refiners {
            Refiners::Apart(refiners) => {
                for (color, refiner) in self.hologram.colors.iter_mut().zip(refiners) {
                    color.phases = refiner.phases()?;
                    if let Some(name) = color.color {
                        self.hologram.metadata.sources.light_only(name, refiner.sources());
                    }
                }
            }
            Refiners::Together(refiner) => {
                let colors = self.hologram.colors.iter_mut().zip(refiner.phases());
                colors.for_each(|(color, phases)| color.phases.clone_from(phases));
            }
        }
        Ok(&self.hologram)
    }
}
