//! Takes steps with the camera and judges them by held-out pictures.

use super::pictures::{CameraBench, CapturedLight, OfColor};
use super::registration::{PLACE, Pair, registered};
use super::sensor::{Fine, Grid};
use crate::{CalibrateError, Event, dots};
use eyebox_base::reason;
use eyebox_compute::engine::{Buffer, Engine};
use eyebox_compute::plan::{Comparison, Planner, PupilPass, Purpose, Viewpoint};
use eyebox_optics::{Color, Pupil, WindowFactor};
use eyebox_solve::evaluate::Sums;
use eyebox_solve::solve::{Diameters, Problem, PupilRange, Sampler, Sequence, Settings, Update, cosine, take_seen};
use std::sync::Arc;

/// Number of pupils per step.
const PUPILS: usize = 6;
/// Number of pupils that no step uses and that judge the steps.
const HELD_OUT: usize = 6;
/// Number of verdicts during the steps.
const VERDICTS: usize = 4;
/// Gain of the first and of the last step, and the factor on it after a verdict that it was too much.
const GAIN: [f64; 2] = [1.0, 0.3];
const DAMPED: f64 = 0.5;
/// The overlap power of the projection (OPTICS 6).
const OVERLAP_POWER: f64 = 0.5;
/// A hologram is better if the mean gain of the held-out pictures exceeds this many of its standard errors.
const SURE: f64 = 2.0;
/// Pictures that correlate less than this with the model's prediction show something else.
const ALIKE: f64 = 0.2;

/// The color of a hologram that the steps improve.
#[derive(Clone, Copy)]
pub struct CameraJob<'a> {
    /// The scene on the display with its model.
    pub problem: &'a Problem,
    /// The color to improve.
    pub color: Color,
    /// Settings of the solve, such as pupils, depths, levels and seed.
    pub settings: &'a Settings,
    /// The exposure (intensity scale) of the solve.
    pub exposure: f64,
}

/// The result of a camera's steps.
#[derive(Debug)]
#[non_exhaustive]
pub struct CameraGain {
    /// The color that was improved.
    pub color: Color,
    /// Number of steps that were taken.
    pub taken: usize,
    /// Number of steps behind the phases that are kept. It is 0 if the hologram did not change.
    pub kept: usize,
    /// Number of pictures that were answered.
    pub pictures: usize,
    /// PSNR of each held-out picture against the scene's target image over the camera's pixels, dB, at one exposure,
    /// before the first step.
    pub before: Vec<f64>,
    /// PSNR of the same pictures for the hologram that is kept, dB.
    pub after: Vec<f64>,
    /// The error that ended the steps early.
    pub trouble: Option<CalibrateError>,
}

/// The state of the steps of one color.
struct Run<'r, 'a> {
    bench: &'r mut CameraBench<'a>,
    of: usize,
    job: CameraJob<'r>,
    planner: Planner,
    engine: &'r mut dyn Engine,
    held_out: Vec<Pupil>,
    targets: Vec<(Vec<f32>, Grid)>,
    /// Factor from the model's intensity to the camera's light per millisecond.
    gain: f64,
}

impl CameraBench<'_> {
    /// Takes the steps of one color from these phases ((frames, height, width), radians). The better phases replace
    /// them. They stay as they are if the held-out pictures do not show that others are better.
    pub fn improve(
        &mut self,
        job: CameraJob,
        phases: &mut Vec<f32>,
        engine: &mut dyn Engine,
        observe: &mut dyn FnMut(Event),
    ) -> CameraGain {
        let (color, begun) = (job.color, self.camera.session.count());
        let (before, after) = (Vec::new(), Vec::new());
        let mut gain = CameraGain { color, taken: 0, kept: 0, pictures: 0, before, after, trouble: None };
        let outcome = Run::new(self, job, phases, engine).and_then(|mut run| run.descend(phases, &mut gain, observe));
        gain.trouble = outcome.err();
        gain.pictures = self.camera.session.count() - begun;
        gain
    }
}

impl<'r, 'a> Run<'r, 'a> {
    fn new(
        bench: &'r mut CameraBench<'a>,
        job: CameraJob<'r>,
        phases: &[f32],
        engine: &'r mut dyn Engine,
    ) -> Result<Self, CalibrateError> {
        let CameraJob { problem, settings, color, .. } = job;
        let of = bench.colors.iter().position(|of| of.color == color);
        let of = of.ok_or_else(|| {
            CalibrateError::Pictures(reason!("camera-color", "the camera was not opened for {color}"))
        })?;
        let frames = phases.len() / (problem.optics.height * problem.optics.width);
        let settings = Settings { frames, repeats: 1, window: WindowFactor::Two, ..settings.clone() };
        let mut planner = problem.planner_of(&settings);
        if let Some(views) = &mut planner.views {
            views.unit /= problem.unit();
        }
        engine.load(&planner.shape(Purpose::Project), Some(Arc::clone(&problem.pyramid)))?;
        if let Some(levels) = settings.levels.table() {
            engine.write(Buffer::Levels, &levels)?;
        }
        engine.write(Buffer::Phases, phases)?;
        let mut held_out = sampler(problem, &settings, Diameters::Uniform, !settings.seed ^ 0x6865_6c64);
        let held_out = (0..HELD_OUT).map(|_| held_out.draw()).collect();
        Ok(Self { bench, of, job, planner, engine, held_out, targets: Vec::new(), gain: 1.0 })
    }

    fn descend(
        &mut self,
        phases: &mut Vec<f32>,
        gain: &mut CameraGain,
        observe: &mut dyn FnMut(Event),
    ) -> Result<(), CalibrateError> {
        let (steps, color) = (self.bench.steps, self.job.color);
        let every = steps.div_ceil(VERDICTS).max(1);
        // Number of all pictures that will be taken.
        let all = (steps * PUPILS + HELD_OUT * (1 + steps.div_ceil(every))) as f64;
        let mut done = 0;
        let mut tell = |taken: usize, more: usize, best: &[f64]| {
            let best =
                if best.is_empty() { String::new() } else { format!(", held-out pictures at {:.2} dB", mean(best)) };
            observe(Event::At(&format!("{color}, camera step {taken} of {steps}{best}"), f64::from(done as u32) / all));
            done += more;
        };
        tell(0, HELD_OUT, &[]);
        let seen = self.held_out(phases)?;
        self.look_at_once(&seen)?;
        gain.before = self.scores(&seen)?;
        gain.after.clone_from(&gain.before);
        self.engine.keep(Buffer::Phases)?;
        let settings = self.job.settings;
        let mut pupils = sampler(self.job.problem, settings, settings.diameters, settings.seed ^ 0x6361_6d65_7261);
        let mut damping = 1.0;
        for step in 1..=steps {
            tell(step, PUPILS, &gain.after);
            let now = self.shown()?;
            let progress = (step - 1) as f64 / steps as f64;
            let pupils: Vec<Pupil> = (0..PUPILS).map(|_| pupils.draw()).collect();
            self.step(&now, &pupils, damping * cosine(GAIN, progress))?;
            gain.taken = step;
            if step % every != 0 && step != steps {
                continue;
            }
            tell(step, HELD_OUT, &gain.after);
            let now = self.shown()?;
            let seen = self.held_out(&now)?;
            let scores = self.scores(&seen)?;
            if mean(&scores) > mean(&gain.after) && is_better(&gain.before, &scores) {
                (gain.after, gain.kept) = (scores, step);
                self.engine.keep(Buffer::Phases)?;
                phases.clone_from(&now);
            } else if mean(&scores) < mean(&gain.after) {
                self.engine.restore()?;
                damping *= DAMPED;
            }
        }
        Ok(())
    }

    /// The phases as the SLM should show them.
    fn shown(&mut self) -> Result<Vec<f32>, CalibrateError> {
        let phases = self.engine.read(Buffer::Phases)?;
        let Some(levels) = self.job.settings.levels.table() else { return Ok(phases) };
        let levels = &levels[..self.planner.levels];
        let far = |a: f32, b: f32| eyebox_kernels::trig::wrap(a - b).abs();
        let nearest = |p: f32| levels.iter().copied().min_by(|a, b| far(*a, p).total_cmp(&far(*b, p))).unwrap_or(p);
        Ok(phases.into_iter().map(nearest).collect())
    }

    fn of(&self) -> &OfColor {
        &self.bench.colors[self.of]
    }

    fn grid(&self, pass: &PupilPass) -> Grid {
        Grid { rows: pass.window.rows, columns: pass.window.columns, place: self.planner.place() }
    }

    /// Share of the eyebox that the true iris covers.
    fn share(&self, pupil: &Pupil) -> f64 {
        let iris = self.planner.model.as_ref().map_or(*pupil, |model| model.model().true_pupil(pupil));
        self.planner.grid.share(iris.diameter)
    }

    /// Takes pictures through the held-out pupils. The true pupils of the pictures replace them.
    fn held_out(&mut self, phases: &[f32]) -> Result<Vec<CapturedLight>, CalibrateError> {
        let CameraBench { camera, colors, .. } = &mut *self.bench;
        let mut all = Vec::with_capacity(HELD_OUT);
        for pupil in &mut self.held_out {
            let seen = camera.see(&colors[self.of], phases, *pupil)?;
            let seen = seen.ok_or_else(|| camera.refused("take a picture by which the steps are judged"))?;
            *pupil = seen.pupil;
            all.push(seen);
        }
        Ok(all)
    }

    /// Computes the target images of the held-out pupils, and fits the gain of the camera by the first pictures.
    fn look_at_once(&mut self, seen: &[CapturedLight]) -> Result<(), CalibrateError> {
        let whole = Planner { factor: WindowFactor::Full, ..self.planner.clone() };
        let mut predicted = Vec::with_capacity(seen.len());
        for seen in seen {
            let pass = whole.viewpoint(&Viewpoint::Pupil(seen.pupil), &Comparison::default());
            let (grid, gain) = (self.grid(&pass), f64::from(pass.intensity.gain) * self.share(&seen.pupil));
            self.engine.run(&whole.exposure_step(vec![pass]))?;
            predicted.push(Fine::of_fields(&self.engine.read(Buffer::Window(0))?, gain, grid));
            self.targets.push((self.engine.read(Buffer::Target(0))?, grid));
        }
        let models = self.register(seen, &predicted, &dots::ALL);
        let alike = seen.iter().zip(&models).map(|(seen, model)| {
            let pairs = model.iter().zip(&seen.light).map(|(m, l)| [f64::from(*m), f64::from(*l)]);
            correlation(pairs.filter(|[_, l]| l.is_finite()))
        });
        let alike = mean(&alike.collect::<Vec<_>>());
        tracing::debug!("correlation of pictures and model {alike:.3}, {:.3e} of full scale per ms", self.gain);
        if alike.is_nan() || alike < ALIKE {
            return Err(reason!(
                "other-pictures",
                "the camera's pictures do not show the hologram: their correlation with the prediction is {alike:.2}. \
                 Calibrate first, and take the dots again if the camera was moved"
            )
            .into());
        }
        Ok(())
    }

    /// Fits the place of the camera and its gain by comparing pictures with predictions. Returns the predictions at the
    /// camera's pixels.
    fn register(&mut self, seen: &[CapturedLight], predicted: &[Fine], free: &[usize]) -> Vec<Vec<f32>> {
        let of = &mut self.bench.colors[self.of];
        let pairs = seen.iter().zip(predicted).map(|(seen, predicted)| Pair { light: &seen.light, predicted });
        of.sensor = registered(&of.sensor, &pairs.collect::<Vec<_>>(), free);
        let mut sums = [0.0; 2];
        let models: Vec<Vec<f32>> = predicted.iter().map(|fine| of.sensor.see(fine)).collect();
        for (seen, model) in seen.iter().zip(&models) {
            let pairs = model.iter().zip(&seen.light).filter(|(_, l)| l.is_finite());
            pairs.for_each(|(m, l)| sums = [sums[0] + f64::from(*m), sums[1] + f64::from(*l)]);
        }
        self.gain = sums[1] / sums[0];
        models
    }

    /// PSNR of pictures through the held-out pupils, dB, at one exposure for all.
    fn scores(&self, seen: &[CapturedLight]) -> Result<Vec<f64>, CalibrateError> {
        let of = |(seen, (target, grid)): (&CapturedLight, &(Vec<f32>, Grid))| {
            let target = self.of().sensor.see(&Fine::of_image(target, *grid));
            let per = (1.0 / (self.gain * self.share(&seen.pupil))) as f32;
            let pairs = seen.light.iter().zip(&target).filter(|(l, _)| l.is_finite());
            let (image, target): (Vec<f32>, Vec<f32>) = pairs.map(|(l, t)| (l * per, *t)).unzip();
            Sums::of_images(&image, &target)
        };
        let wrong = |e: eyebox_solve::evaluate::EvaluateError| {
            CalibrateError::Pictures(reason!("held-out", "the held-out pictures: {e}"))
        };
        let sums = seen.iter().zip(&self.targets).map(of).collect::<Result<Vec<_>, _>>().map_err(wrong)?;
        let exposure = Sums::fit_exposure(&sums).map_err(wrong)?;
        Ok(sums.iter().map(|s| s.psnr(exposure)).collect())
    }

    /// Takes one step with the pictures through these pupils.
    fn step(&mut self, phases: &[f32], pupils: &[Pupil], gain: f64) -> Result<(), CalibrateError> {
        let CameraBench { camera, colors, .. } = &mut *self.bench;
        let mut seen = Vec::with_capacity(pupils.len());
        for pupil in pupils {
            seen.extend(camera.see(&colors[self.of], phases, *pupil)?);
        }
        if seen.is_empty() {
            return Err(camera.refused("take any picture of a step"));
        }
        let exposure = self.job.exposure / self.job.problem.unit();
        // Ten pupils are the unit of the gain, as in a solve.
        let share = (seen.len() as f64 / 10.0).powf(1.0 - OVERLAP_POWER);
        let update = Update::Projection { gain: gain / share, momentum: 0.0, overlap_power: OVERLAP_POWER };
        let viewpoints: Vec<Viewpoint> = seen.iter().map(|s| Viewpoint::Pupil(s.pupil)).collect();
        let passes = update.pupil_passes(&self.planner, &viewpoints, exposure);
        let looks: Vec<(Grid, f64, f64)> = passes
            .iter()
            .zip(&seen)
            .map(|(pass, seen)| (self.grid(pass), f64::from(pass.intensity.gain), self.share(&seen.pupil)))
            .collect();
        let mut step = update.step(&self.planner, passes, usize::MAX);
        step.quantise.hardness = 1.0;
        let (sensor, of_light) = (&self.bench.colors[self.of].sensor, 1.0 / self.gain);
        let mut predicted = Vec::with_capacity(seen.len());
        let loss = take_seen(&mut *self.engine, &step, |slot, image, fields| -> Result<Vec<f32>, CalibrateError> {
            let (grid, gain, share) = looks[slot];
            let fine = Fine::of_fields(fields, gain * share, grid);
            // The camera's light minus the model's. Detail that is finer than the camera's pixels stays the model's.
            let rest = seen[slot].light.iter().zip(sensor.see(&fine));
            let rest: Vec<f32> =
                rest.map(|(l, m)| ((f64::from(*l) * of_light - f64::from(m)) / share) as f32).collect();
            let rest = sensor.spread(&rest, &grid);
            predicted.push(fine);
            Ok(image.iter().zip(rest).map(|(i, r)| (i + r).max(0.0)).collect())
        })?;
        // The picture creeps over the camera and the laser's power drifts, so the next step uses a new fit.
        self.register(&seen, &predicted, &PLACE);
        match loss.is_finite() {
            true => Ok(()),
            false => Err(reason!("camera-step-not-finite", "a camera step: the result is not finite").into()),
        }
    }
}

fn sampler(problem: &Problem, settings: &Settings, diameters: Diameters, seed: u64) -> Sampler {
    let Settings { diameter, depth, .. } = *settings;
    Sampler::new(PupilRange { eyebox: problem.eyebox, diameter, depth, diameters }, Sequence::Sobol, seed)
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// True if scores are higher than before by more than chance.
fn is_better(before: &[f64], after: &[f64]) -> bool {
    let gains: Vec<f64> = after.iter().zip(before).map(|(a, b)| a - b).collect();
    let (n, mean) = (gains.len() as f64, mean(&gains));
    let variance = gains.iter().map(|g| (g - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    mean > SURE * (variance / n).sqrt()
}

fn correlation(pairs: impl Iterator<Item = [f64; 2]>) -> f64 {
    let [n, a, b, aa, bb, ab] = pairs.fold([0.0; 6], |[n, sa, sb, aa, bb, ab], [a, b]| {
        [n + 1.0, sa + a, sb + b, aa + a * a, bb + b * b, ab + a * b]
    });
    (n * ab - a * b) / ((n * aa - a * a) * (n * bb - b * b)).sqrt()
}
