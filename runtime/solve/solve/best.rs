//! Keeps the best state of a refinement, because refinement for one pupil can become worse again.
//!
//! The last state is therefore often not the best. Every step is judged at the requested pupil, as
//! [`Hologram::score`](crate::hologram::Hologram::score) does, at the exposure that suits the state best. Only this
//! makes the result of more steps never worse. A simulation through one pupil takes about as long as a step.

use super::outcome::Flow;
use super::steer::Refiner;
use crate::engine::EngineError;
use crate::evaluate::Sums;
use crate::optics::{Pupil, PupilDistribution};
use std::time::Instant;

/// One color under refinement, or all colors that share their drive values.
pub trait Refinable {
    /// Aims the refinement at a new position of the eye.
    ///
    /// # Errors
    /// [`EngineError`] if the engine fails.
    fn aim(&mut self, aim: PupilDistribution) -> Result<(), EngineError>;

    /// Takes a step and returns its loss. If the loss is NaN or infinite, the phases stay as they were.
    ///
    /// # Errors
    /// [`EngineError`] if the engine fails.
    fn step(&mut self) -> Result<f64, EngineError>;

    /// Simulates the view through pupils and returns, per color, the sums of each pupil.
    ///
    /// # Errors
    /// [`EngineError`] if the engine fails.
    fn look_at_colors(&mut self, pupils: &[Pupil]) -> Result<Vec<Vec<Sums>>, EngineError>;

    /// Returns the pupils for which steps are taken.
    fn aimed_at(&self) -> PupilDistribution;

    /// Reads the phases of each color: (frames, height, width), radians.
    ///
    /// # Errors
    /// [`EngineError`] if the engine fails.
    fn state(&mut self) -> Result<Vec<Vec<f32>>, EngineError>;

    /// Returns the indices of the display's switchable sources that light it, if it chooses them.
    fn lit(&self) -> Option<&[usize]> {
        None
    }
}

impl Refinable for Refiner {
    fn aim(&mut self, aim: PupilDistribution) -> Result<(), EngineError> {
        Refiner::aim(self, aim)
    }

    fn step(&mut self) -> Result<f64, EngineError> {
        Refiner::step(self)
    }

    fn look_at_colors(&mut self, pupils: &[Pupil]) -> Result<Vec<Vec<Sums>>, EngineError> {
        Ok(vec![self.look(pupils)?])
    }

    fn aimed_at(&self) -> PupilDistribution {
        self.aim
    }

    fn state(&mut self) -> Result<Vec<Vec<f32>>, EngineError> {
        Ok(vec![self.phases()?])
    }

    fn lit(&self) -> Option<&[usize]> {
        Some(self.sources())
    }
}

/// One step of a refinement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RefinedStep {
    /// Steps since the pupil was set.
    pub step: usize,
    /// The loss of this step, averaged over the colors.
    pub loss: f64,
    /// Time of the steps of this call in seconds, without the time for judging them.
    pub seconds: f64,
}

/// A state of a refinement.
#[derive(Debug, Clone, PartialEq)]
pub struct BestState {
    /// The step after which this state was reached. 0 is the state before the first step.
    pub step: usize,
    /// PSNR at the pupil over all of its colors, in dB. `None` if the target is black.
    pub psnr: Option<f64>,
    /// Phases of each color: (frames, height, width), radians.
    pub phases: Vec<Vec<f32>>,
}

/// Keeps the best state of a refinement for one pupil.
#[derive(Debug, Clone)]
pub struct BestKeeper {
    pupil: Pupil,
    taken: usize,
    /// PSNR of each color after the last step, in dB. It is empty before the first judgment.
    last: Vec<Option<f64>>,
    best: Option<BestState>,
}

impl BestKeeper {
    /// Starts with no state for a pupil in meters.
    pub fn new(pupil: Pupil) -> Self {
        Self { pupil, taken: 0, last: Vec::new(), best: None }
    }

    /// Returns the current best state, or `None` before the first judgment.
    pub fn best(&self) -> Option<&BestState> {
        self.best.as_ref()
    }

    /// Returns the best state and consumes the keeper. The result is `None` before the first judgment.
    pub fn into_best(self) -> Option<BestState> {
        self.best
    }

    /// Returns the PSNR at the pupil of each color in its current state, in dB. `None` is a black target.
    pub fn psnr_of_colors(&self) -> &[Option<f64>] {
        &self.last
    }

    /// Judges the current state and keeps it if it is the best.
    ///
    /// # Errors
    /// [`EngineError`] if the engine fails.
    pub fn judge(&mut self, refined: &mut dyn Refinable) -> Result<(), EngineError> {
        // Without light every exposure is equally bad.
        let exposed = |sums: Sums| (sums, Sums::fit_exposure(&[sums]).unwrap_or(0.0));
        let looks = refined.look_at_colors(&[self.pupil])?;
        let colors: Vec<(Sums, f64)> = looks.into_iter().flatten().map(exposed).collect();
        self.last = colors.iter().map(|(sums, exposure)| sums.quality(*exposure)).collect();
        let psnr = Sums::quality_of_colors(&colors);
        if self.best.as_ref().is_none_or(|best| is_better(psnr, best.psnr)) {
            self.best = Some(BestState { step: self.taken, psnr, phases: refined.state()? });
        }
        Ok(())
    }
}

/// Returns true if a PSNR exceeds the best one before it. A black target allows no judgment, so the last state is kept.
fn is_better(psnr: Option<f64>, best: Option<f64>) -> bool {
    psnr.zip(best).is_none_or(|(psnr, best)| psnr > best)
}

/// Takes at most `steps` steps of all given refinements and judges each step. It ends earlier if `observe` stops it or
/// if a loss is not a finite number. It returns the last loss and the number of steps.
///
/// # Errors
/// [`EngineError`] if an engine fails.
pub fn refine(
    parts: &mut [(&mut dyn Refinable, &mut BestKeeper)],
    steps: usize,
    observe: &mut dyn FnMut(RefinedStep) -> Flow,
) -> Result<(f64, usize), EngineError> {
    for (refined, keeper) in parts.iter_mut().filter(|(_, keeper)| keeper.best.is_none()) {
        keeper.judge(*refined)?;
    }
    let (mut loss, mut taken, mut seconds) = (f64::NAN, 0, 0.0);
    while taken < steps {
        let (start, mut sum) = (Instant::now(), 0.0);
        for (refined, _) in parts.iter_mut() {
            sum += refined.step()?;
        }
        seconds += start.elapsed().as_secs_f64();
        loss = sum / parts.len().max(1) as f64;
        if !loss.is_finite() {
            break;
        }
        taken += 1;
        let mut step = taken;
        for (refined, keeper) in parts.iter_mut() {
            keeper.taken += 1;
            step = keeper.taken;
            keeper.judge(*refined)?;
        }
        if observe(RefinedStep { step, loss, seconds }) == Flow::Stop {
            break;
        }
    }
    Ok((loss, taken))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A refinement with a given PSNR after each step.
    struct Scripted {
        decibels: Vec<f64>,
        at: usize,
    }

    impl Refinable for Scripted {
        fn aim(&mut self, _: PupilDistribution) -> Result<(), EngineError> {
            Ok(())
        }

        fn step(&mut self) -> Result<f64, EngineError> {
            self.at += 1;
            Ok(if self.at < self.decibels.len() { 0.1 } else { f64::NAN })
        }

        fn look_at_colors(&mut self, _: &[Pupil]) -> Result<Vec<Vec<Sums>>, EngineError> {
            // At an exposure of 1/2 the error is orthogonal to the image.
            let error = 10f64.powf(-self.decibels[self.at] / 10.0);
            Ok(vec![vec![Sums { with_target: 1.0, with_itself: 2.0, of_target: 0.5 + error, pixels: 1 }]])
        }

        fn aimed_at(&self) -> PupilDistribution {
            PupilDistribution::around(&Pupil::from_mm([4.0, 0.0, 4.0, 1.0]), 0.0)
        }

        fn state(&mut self) -> Result<Vec<Vec<f32>>, EngineError> {
            Ok(vec![vec![self.at as f32]])
        }
    }

    fn scripted(decibels: &[f64]) -> (Scripted, BestKeeper) {
        (Scripted { decibels: decibels.to_vec(), at: 0 }, BestKeeper::new(Pupil::from_mm([4.0, 0.0, 4.0, 1.0])))
    }

    #[test]
    fn a_worse_state_is_not_taken_and_more_steps_are_never_worse() {
        let decibels = [18.0, 17.0, 19.0, 20.95, 20.5, 19.9, 21.0, 20.0];
        let mut before = f64::NEG_INFINITY;
        for steps in 0..decibels.len() {
            let (mut refined, mut keeper) = scripted(&decibels);
            // The steps are taken in one call and in two.
            for part in [steps / 2, steps - steps / 2] {
                let (_, taken) = refine(&mut [(&mut refined, &mut keeper)], part, &mut |_| Flow::Continue).unwrap();
                assert_eq!(taken, part);
            }
            let best = keeper.into_best().unwrap();
            let psnr = best.psnr.unwrap();
            let wanted = decibels[..=steps].iter().copied().fold(f64::NEG_INFINITY, f64::max);
            assert!((psnr - wanted).abs() < 1e-9 && psnr >= before, "{steps}: {psnr}");
            assert_eq!(decibels[best.step], wanted);
            assert_eq!(best.phases, [[best.step as f32]]);
            before = psnr;
        }
    }

    #[test]
    fn a_loss_that_is_no_number_and_an_observer_end_it() {
        let (mut refined, mut keeper) = scripted(&[18.0, 19.0]);
        let (loss, taken) = refine(&mut [(&mut refined, &mut keeper)], 9, &mut |_| Flow::Continue).unwrap();
        assert!(loss.is_nan() && taken == 1 && keeper.best().unwrap().step == 1);
        let (mut refined, mut keeper) = scripted(&[18.0; 9]);
        let mut stop = |at: RefinedStep| if at.step == 3 { Flow::Stop } else { Flow::Continue };
        assert_eq!(refine(&mut [(&mut refined, &mut keeper)], 8, &mut stop).unwrap().1, 3);
    }

    #[test]
    fn a_black_target_has_no_best_state_but_the_last() {
        assert!(is_better(None, None) && is_better(Some(20.0), None) && !is_better(Some(f64::NAN), Some(20.0)));
    }
}
