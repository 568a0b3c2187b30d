//! Refining a hologram for where the eye is (OPTICS 6d): steps over pupils around it, and a few over the whole eyebox, so
//! that a sudden look elsewhere never meets the dark.

use super::{Problem, SolveError, SplitMix, fault};
use crate::engine::{Buffer, Engine, EngineError};
use crate::evaluate::{self, Sums};
use crate::optics::{Pupil, WindowFactor};
use crate::plan::{Comparison, Kernel, Lane, Planner, Purpose, Sight, Step};
use eyebox_kernels::compare;
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Where the eye is believed to be, metres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Aim {
    /// Centre of the pupil, to the right.
    pub x: f64,
    /// Centre of the pupil, down.
    pub y: f64,
    /// It is within this distance of the centre, along each axis.
    pub spread: f64,
    /// Smallest and largest diameter.
    pub diameter: [f64; 2],
    /// Nearest and farthest focus.
    pub depth: [f64; 2],
}

/// How the phases follow.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", tag = "kind")]
pub enum Strategy {
    /// Pupil-wise projection (OPTICS 6b).
    Projection {
        /// Gain of every step.
        gain: f64,
        /// Share of the velocity that is kept.
        momentum: f64,
        /// The change is divided by the overlap to this power.
        overlap_power: f64,
    },
    /// Adam on the closed-form gradient (OPTICS 4).
    Adam {
        /// Learning rate, radians.
        rate: f64,
    },
}

/// Everything that decides a refinement, besides the scene and the aim.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Steering {
    /// How the phases follow.
    pub strategy: Strategy,
    /// Pupils around the eye a step.
    pub pupils: usize,
    /// Pupils over the whole eyebox a step, on average.
    pub elsewhere: f64,
    /// Window per pupil.
    pub window: WindowFactor,
    /// Steps over the same pupils before others are drawn: their photographs are made once. At least 1.
    pub repeats: usize,
    /// Decides the pupils.
    pub seed: u64,
}

impl Default for Steering {
    fn default() -> Self {
        Self {
            strategy: Strategy::Projection { gain: 3.0, momentum: 0.0, overlap_power: 1.0 },
            pupils: 4,
            elsewhere: 0.5,
            window: WindowFactor::Two,
            repeats: 1,
            seed: 0,
        }
    }
}

/// A hologram under refinement: one colour on one engine.
pub struct Refiner {
    problem: Problem,
    planner: Planner,
    steering: Steering,
    engine: Box<dyn Engine>,
    exposure: f64,
    aim: Aim,
    random: SplitMix,
    /// Pupils over the whole eyebox that are due.
    due: f64,
    /// The lanes of the last step, and how often they have been used.
    lanes: Vec<Lane>,
    used: usize,
    /// Steps since phases or aim were set anew: Adam's corrections count them.
    since: usize,
    /// Seconds that a step is expected to take.
    expected: f64,
}

impl Refiner {
    /// Begins with these phases ((frames, height, width), radians), solved for `exposure`, and the whole eyebox as aim.
    ///
    /// # Errors
    /// [`SolveError::Setting`] for phases of another number or numbers that cannot be; those of the engine.
    pub fn new(
        problem: Problem,
        phases: &[f32],
        exposure: f64,
        steering: Steering,
        mut engine: Box<dyn Engine>,
    ) -> Result<Self, SolveError> {
        let wrong = |what, value: String, right| Err(SolveError::Setting { what, value, right });
        let pixels = problem.optics.height * problem.optics.width;
        let frames = phases.len() / pixels.max(1);
        if frames == 0 || frames * pixels != phases.len() || !phases.iter().all(|p| p.is_finite()) {
            return wrong("the number of phases to refine", phases.len().to_string(), "whole sub-frames, all finite");
        }
        if !(1..=4096).contains(&steering.pupils) {
            return wrong("the number of pupils a step", steering.pupils.to_string(), "1 to 4096");
        }
        if !(0.0..=64.0).contains(&steering.elsewhere) {
            return wrong("the pupils elsewhere a step", steering.elsewhere.to_string(), "0 to 64");
        }
        if !(exposure > 0.0 && exposure.is_finite()) {
            return wrong("the exposure", exposure.to_string(), "a positive, finite number");
        }
        let planner = problem.planner(frames, steering.window);
        let adam = matches!(steering.strategy, Strategy::Adam { .. });
        let purpose = if adam { Purpose::Adam } else { Purpose::Project };
        engine.load(&planner.shape(purpose), Some(Arc::clone(&problem.pyramid)))?;
        let half = problem.eyebox / 2.0;
        let aim = Aim { x: 0.0, y: 0.0, spread: half, diameter: [half / 4.0, half / 2.0], depth: [0.0, 0.0] };
        let random = SplitMix(steering.seed ^ 0x0073_7465_6572);
        let (lanes, expected) = (Vec::new(), 0.0);
        let mut refiner = Self {
            problem,
            planner,
            steering,
            engine,
            exposure,
            aim,
            random,
            due: 0.0,
            lanes,
            used: 0,
            since: 0,
            expected,
        };
        refiner.restart(phases)?;
        Ok(refiner)
    }

    /// Begins again with other phases of the same hologram: after a look elsewhere, those made for the whole eyebox.
    ///
    /// # Errors
    /// Those of the engine.
    pub fn restart(&mut self, phases: &[f32]) -> Result<(), EngineError> {
        self.engine.write(Buffer::Phases, phases)?;
        self.forget()
    }

    /// The eye has moved. Velocities go where it is elsewhere altogether: they would carry on for where it was.
    ///
    /// # Errors
    /// Those of the engine.
    pub fn aim(&mut self, aim: Aim) -> Result<(), EngineError> {
        if aim == self.aim {
            return Ok(());
        }
        let moved = (aim.x - self.aim.x).hypot(aim.y - self.aim.y);
        let jumped = moved > 0.5 * (aim.diameter[0] + self.aim.diameter[0]).max(aim.spread);
        self.aim = aim;
        self.used = self.steering.repeats.max(1);
        if jumped { self.forget() } else { Ok(()) }
    }

    fn forget(&mut self) -> Result<(), EngineError> {
        self.since = 0;
        let zeros = vec![0.0; self.planner.frames * self.planner.slm.height * self.planner.slm.width];
        self.engine.write(Buffer::Momentum, &zeros)?;
        if matches!(self.steering.strategy, Strategy::Adam { .. }) {
            self.engine.write(Buffer::Second, &zeros)?;
        }
        Ok(())
    }

    /// Pupils for the next step: around the eye, and now and then anywhere.
    fn draw(&mut self) -> Vec<Pupil> {
        let (aim, eyebox) = (self.aim, self.problem.eyebox);
        let mut between = |[low, high]: [f64; 2]| low + (high - low) * self.random.unit();
        let mut pupils = Vec::with_capacity(self.steering.pupils + 1);
        for _ in 0..self.steering.pupils {
            let (x, y) = (aim.x + between([-aim.spread, aim.spread]), aim.y + between([-aim.spread, aim.spread]));
            pupils.push(Pupil { x, y, diameter: between(aim.diameter), depth: between(aim.depth) });
        }
        self.due += self.steering.elsewhere;
        while self.due >= 1.0 {
            self.due -= 1.0;
            let diameter = between(aim.diameter);
            let reach = (eyebox / 2.0 - diameter / 2.0).max(0.0);
            let (x, y) = (between([-reach, reach]), between([-reach, reach]));
            pupils.push(Pupil { x, y, diameter, depth: between(aim.depth) });
        }
        pupils
    }

    /// The next step, and the part of its list that has to run: what depends on the pupils alone is left out where they
    /// are those of the step before.
    fn next(&mut self) -> (Step, Vec<Range<usize>>) {
        let fresh = self.lanes.is_empty() || self.used >= self.steering.repeats.max(1);
        if fresh {
            let pupils = self.draw();
            let mode = match self.steering.strategy {
                Strategy::Projection { .. } => compare::PROJECTION,
                Strategy::Adam { .. } => compare::INTENSITY,
            };
            let comparison = Comparison { mode, exposure: self.exposure, batch: pupils.len(), ..Comparison::default() };
            self.lanes = pupils.iter().map(|p| self.planner.lane(p, &comparison)).collect();
            self.used = 0;
        }
        self.used += 1;
        self.since += 1;
        let lanes = self.lanes.clone();
        let step = match self.steering.strategy {
            Strategy::Projection { gain, momentum, overlap_power } => {
                self.planner.project_step(lanes, usize::MAX, overlap_power, gain, momentum)
            }
            Strategy::Adam { rate } => self.planner.adam_step(lanes, usize::MAX, self.since, rate),
        };
        let known = |kernel| matches!(kernel, Kernel::Transfer | Kernel::Photograph | Kernel::Resample);
        let mut parts: Vec<Range<usize>> = Vec::new();
        for (i, dispatch) in step.list.iter().enumerate().filter(|(_, d)| fresh || !known(d.kernel)) {
            match parts.last_mut() {
                Some(last) if last.end == i => last.end = i + 1,
                _ => parts.push(i..i + 1),
            }
            debug_assert!(dispatch.lanes.end <= step.lanes.len());
        }
        (step, parts)
    }

    /// One step. A loss that is no finite number takes none, and says so by being returned.
    ///
    /// # Errors
    /// Those of the engine.
    pub fn step(&mut self) -> Result<f64, EngineError> {
        let start = Instant::now();
        let (step, parts) = self.next();
        let state = fault::before_state(&step);
        let mut losses = vec![0.0; step.lanes.len()];
        for part in parts {
            // The losses are known before phases move.
            let before = part.start..part.end.min(state).max(part.start);
            for (sum, loss) in losses.iter_mut().zip(self.engine.run_part(&step, before.clone())?) {
                *sum += loss;
            }
            let loss = mean_loss(&losses, &step.lanes);
            if part.end > state {
                if !loss.is_finite() {
                    self.lanes.clear();
                    return Ok(loss);
                }
                self.engine.run_part(&step, before.end..part.end)?;
            }
        }
        let seconds = start.elapsed().as_secs_f64();
        // Slow to hope, quick to fear: a step that takes longer counts at once.
        self.expected = if seconds > self.expected { seconds } else { 0.8 * self.expected + 0.2 * seconds };
        Ok(mean_loss(&losses, &step.lanes))
    }

    /// As many steps as are expected to end before `deadline`, `most` at most; how many were taken.
    ///
    /// # Errors
    /// Those of the engine.
    pub fn refine_until(&mut self, deadline: Instant, most: usize) -> Result<usize, EngineError> {
        let mut taken = 0;
        while taken < most && Instant::now() + Duration::from_secs_f64(self.expected) <= deadline {
            self.step()?;
            taken += 1;
        }
        Ok(taken)
    }

    /// The phases as they are now: (frames, height, width), radians in -pi .. pi.
    ///
    /// # Errors
    /// Those of the engine.
    pub fn phases(&mut self) -> Result<Vec<f32>, EngineError> {
        self.engine.read(Buffer::Phases)
    }

    /// What each of these pupils sees now, and should see: sums from which exposure and PSNR follow.
    ///
    /// # Errors
    /// Those of the engine.
    pub fn look(&mut self, pupils: &[Pupil]) -> Result<Vec<Sums>, EngineError> {
        let sights: Vec<Sight> = pupils.iter().map(|p| Sight::Pupil(*p)).collect();
        // The first slot will hold other lanes than a step's.
        self.lanes.clear();
        evaluate::sums(self.engine.as_mut(), &self.planner, &sights)
    }
}

fn mean_loss(losses: &[f64], lanes: &[Lane]) -> f64 {
    losses.iter().zip(lanes).map(|(loss, lane)| loss / lane.count() as f64).sum::<f64>() / losses.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::cpu::CpuEngine;
    use crate::optics::{Color, Display, Padding};
    use crate::scene::{self, Request};
    use crate::solve::{Flow, Settings, solve};

    /// A hologram of the still life for the whole eyebox, and its exposure.
    fn solved() -> (Problem, Vec<f32>, f64) {
        let display = Display { height: 96, width: 112, ..Display::preset("small").unwrap() };
        let field = scene::load("builtin:still-life", &Request::new(&display, &[Color::Green])).unwrap();
        let problem = Problem::new(&field, Color::Green, &display, Padding::default()).unwrap();
        let settings = Settings { steps: 24, diameter: [2e-3, 18e-3], depth: [-5e-4, 5e-4], ..Settings::default() };
        let solution = solve(&problem, &settings, &mut CpuEngine::new(), &mut |_| Flow::Continue).unwrap();
        (problem, solution.phases, solution.exposure)
    }

    const AIM: Aim = Aim { x: 4e-3, y: -2e-3, spread: 5e-4, diameter: [3.5e-3, 4.5e-3], depth: [2e-4, 2e-4] };

    fn refiner(of: &(Problem, Vec<f32>, f64), steering: Steering) -> Refiner {
        let mut refiner =
            Refiner::new(of.0.clone(), &of.1, of.2, steering, Box::new(CpuEngine::new())).expect("a sound refinement");
        refiner.aim(AIM).unwrap();
        refiner
    }

    fn pupils(centers: &[[f64; 2]]) -> Vec<Pupil> {
        centers.iter().map(|&[x, y]| Pupil { x: x * 1e-3, y: y * 1e-3, diameter: 4e-3, depth: 2e-4 }).collect()
    }

    fn mean(refiner: &mut Refiner, pupils: &[Pupil]) -> f64 {
        let exposure = refiner.exposure;
        let sums = refiner.look(pupils).unwrap();
        sums.iter().map(|s| s.psnr(exposure)).sum::<f64>() / sums.len() as f64
    }

    /// OPTICS 6d. On a display as small as this 2.6 dB after eight steps (3.5 at 256 x 256), by Adam 1.6, and next to nothing
    /// lost elsewhere.
    #[test]
    fn the_eye_sees_better_and_the_eyebox_hardly_worse() {
        let whole = solved();
        let there = pupils(&[[4.0, -2.0], [4.3, -1.8], [3.7, -2.4]]);
        let elsewhere = pupils(&[[-6.0, 5.0], [0.0, 0.0], [-4.0, -7.0], [6.0, 6.0]]);
        for (strategy, least) in [(Steering::default().strategy, 2.0), (Strategy::Adam { rate: 0.1 }, 1.2)] {
            let mut refiner = refiner(&whole, Steering { strategy, ..Steering::default() });
            let before = (mean(&mut refiner, &there), mean(&mut refiner, &elsewhere));
            for _ in 0..8 {
                assert!(refiner.step().unwrap().is_finite());
            }
            let after = (mean(&mut refiner, &there), mean(&mut refiner, &elsewhere));
            assert!(after.0 > before.0 + least, "{strategy:?}: {before:?} before, {after:?} after");
            assert!(after.1 > before.1 - 1.0, "{strategy:?}: {before:?} before, {after:?} after");
        }
    }

    /// Where every pupil drawn is the same, photographs that are made once are those that are made anew.
    #[test]
    fn photographs_that_are_kept_change_nothing() {
        let whole = solved();
        let run = |repeats| {
            let steering = Steering { repeats, elsewhere: 0.0, ..Steering::default() };
            let mut refiner = refiner(&whole, steering);
            refiner.aim(Aim { spread: 0.0, diameter: [4e-3; 2], ..AIM }).unwrap();
            (0..5).for_each(|_| assert!(refiner.step().unwrap().is_finite()));
            refiner.phases().unwrap()
        };
        assert!(run(1) == run(3));
        // A look in between takes the slots: they are filled again.
        let steering = Steering { repeats: 3, elsewhere: 0.0, ..Steering::default() };
        let mut refiner = refiner(&whole, steering);
        refiner.aim(Aim { spread: 0.0, diameter: [4e-3; 2], ..AIM }).unwrap();
        for _ in 0..5 {
            refiner.step().unwrap();
            refiner.look(&pupils(&[[-6.0, 5.0]])).unwrap();
        }
        assert!(refiner.phases().unwrap() == run(1));
    }

    #[test]
    fn time_is_kept_and_phases_begin_again() {
        let whole = solved();
        let mut refiner = refiner(&whole, Steering::default());
        refiner.step().unwrap();
        assert_eq!(refiner.refine_until(Instant::now(), 100).unwrap(), 0, "a step takes longer than no time");
        assert_eq!(refiner.refine_until(Instant::now() + Duration::from_secs(60), 2).unwrap(), 2);
        refiner.restart(&whole.1).unwrap();
        assert!(refiner.phases().unwrap() == whole.1);
    }

    #[test]
    fn what_cannot_be_is_refused() {
        let (problem, phases, exposure) = solved();
        let new = |phases: &[f32], exposure, steering| {
            Refiner::new(problem.clone(), phases, exposure, steering, Box::new(CpuEngine::new())).map(drop)
        };
        let fine = Steering::default();
        assert!(new(&phases, exposure, fine).is_ok());
        assert!(new(&phases[1..], exposure, fine).is_err() && new(&[], exposure, fine).is_err());
        assert!(new(&vec![f32::NAN; phases.len()], exposure, fine).is_err());
        assert!(new(&phases, 0.0, fine).is_err() && new(&phases, f64::NAN, fine).is_err());
        assert!(new(&phases, exposure, Steering { pupils: 0, ..fine }).is_err());
        assert!(new(&phases, exposure, Steering { elsewhere: f64::INFINITY, ..fine }).is_err());
    }
}
