//! What steering gains: a simulated eye before a hologram that follows it, judged by what the eye really sees.
//!
//! Time is counted, not waited for: it passes by what refining, reading back and encoding take on this machine, and
//! stands still while quality is judged. Everything else is as in [`refine`](super::start): samples come late and with
//! noise, the pupil is predicted, sets are handed over whole, and those that come too late are shown a set later.

use super::{Beat, LiveError, Part, Policy, Steerer, aim_of, as_ns};
use crate::encode::{Encoder, PhaseSet};
use crate::engine::{Engine, EngineError};
use crate::evaluate::Sums;
use crate::gaze::{self, Estimator, GazeError};
use crate::optics::Pupil;
use crate::solve::{PupilRange, Refiner, Sampler, Sequence};
use crate::trackers::simulated::{self, Doing, Eye, SimulatedSource, Truth};
use crate::trackers::{Event, Sample, Source};
use serde::Serialize;
use std::time::{Duration, Instant};

/// What is studied.
#[derive(Debug, Clone)]
pub struct StudySettings {
    /// So long, seconds.
    pub seconds: f64,
    /// From the beginning of a set to that of the next, nanoseconds.
    pub period_ns: i64,
    /// So long before it begins, a set is decided on.
    pub lead_ns: i64,
    /// From the beginning of a set to the middle of its light.
    pub light_after_ns: i64,
    /// The eye and its tracker.
    pub eye: simulated::Settings,
    /// From samples to the pupil. The eye's focus is the middle of its range.
    pub gaze: gaze::Settings,
}

impl Default for StudySettings {
    /// A set a video frame at 60 Hz; fixations of 300 ms.
    fn default() -> Self {
        let eye = simulated::Settings { fixation: [0.3, 0.3], pursuit: 0.0, blinks: 0.0, ..Default::default() };
        let period_ns = 1_000_000_000 / 60;
        Self {
            seconds: 4.0,
            period_ns,
            lead_ns: Beat::usual_lead_ns(period_ns),
            light_after_ns: period_ns / 2,
            eye,
            gaze: gaze::Settings::default(),
        }
    }
}

/// One set, at its light.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Moment {
    /// When, seconds from the beginning.
    pub time_s: f64,
    /// Since the eye came to rest, ms; none while it jumps, and before the first jump.
    pub since_landing_ms: Option<f64>,
    /// Jumps so far.
    pub jumps: u32,
    /// Where the pupil is, metres.
    pub position: [f64; 2],
    /// Its diameter, metres.
    pub diameter: f64,
    /// How far from there the set was made for, metres; none before the first.
    pub error: Option<f64>,
    /// PSNR of what the eye sees, mean over the colours, dB.
    pub steered_db: f64,
    /// The same of the hologram for the whole eyebox.
    pub whole_db: f64,
    /// Steps that were taken for the set, over all colours.
    pub steps: u32,
    /// Whether the set is new.
    pub new: bool,
}

impl Moment {
    /// What steering gains, dB.
    pub fn gain_db(&self) -> f64 {
        self.steered_db - self.whole_db
    }
}

/// What came of it.
#[derive(Debug, Clone, Serialize)]
pub struct Study {
    /// Every set at which the eye was open.
    pub moments: Vec<Moment>,
    /// How often the refinement began again.
    pub restarts: u64,
    /// Steps over all colours.
    pub steps: u64,
    /// What a step of one colour takes, ms: the mean.
    pub step_ms: f64,
    /// Reading back and encoding a set, ms: the mean.
    pub encode_ms: f64,
}

impl Study {
    /// Of each fixation that lasted to a jump: the gain at its last set, in dB.
    pub fn at_the_end_db(&self) -> Vec<f64> {
        let last = |pair: &[Moment]| pair[1].jumps > pair[0].jumps && pair[0].since_landing_ms.is_some();
        let with_jump = |pair: &[Moment]| pair[0].since_landing_ms.is_some() && pair[1].since_landing_ms.is_none();
        self.moments.windows(2).filter(|p| last(p) || with_jump(p)).map(|p| p[0].gain_db()).collect()
    }

    /// Of each fixation: the gain at the last set that is lit within so many milliseconds of the landing, dB.
    pub fn within_db(&self, ms: f64) -> Vec<f64> {
        let mut all: Vec<(u32, f64)> = Vec::new();
        for m in self.moments.iter().filter(|m| m.since_landing_ms.is_some_and(|t| t <= ms)) {
            match all.last_mut() {
                Some((jumps, gain)) if *jumps == m.jumps => *gain = m.gain_db(),
                _ => all.push((m.jumps, m.gain_db())),
            }
        }
        all.into_iter().map(|a| a.1).collect()
    }

    /// The worst that steering did at any time, dB.
    pub fn worst_db(&self) -> f64 {
        self.moments.iter().map(Moment::gain_db).fold(f64::INFINITY, f64::min)
    }
}

/// Pupils that the exposure is fitted over.
const EXPOSED: usize = 12;
/// What handing over is allowed beside encoding, nanoseconds.
const SLACK_NS: i64 = 500_000;

/// One colour's judge: what an eye sees of some phases, at an exposure that stays.
struct Judge {
    seen: Refiner,
    exposure: f64,
}

impl Judge {
    fn new(part: &Part, policy: &Policy, depth: f64, engine: Box<dyn Engine>) -> Result<Self, LiveError> {
        let problem = part.problem.clone();
        let range = PupilRange::over(problem.eyebox, [depth, depth]);
        let mut seen = Refiner::new(problem, &part.phases, part.exposure, policy.steering, engine)?;
        let mut sampler = Sampler::new(range, Sequence::Sobol, 0x006a_7564_6765);
        let pupils: Vec<Pupil> = (0..EXPOSED).map(|_| sampler.draw()).collect();
        // Lasers stay as they are: one exposure, that of the hologram for the whole eyebox.
        let exposure = Sums::fit_exposure(&seen.look(&pupils)?).map_err(|e| LiveError::Setting(e.to_string()))?;
        Ok(Self { seen, exposure })
    }

    fn psnr(&mut self, pupil: Pupil) -> Result<f64, EngineError> {
        Ok(self.seen.look(&[pupil])?.iter().map(|s| s.psnr(self.exposure)).sum())
    }
}

/// What is on the screen.
struct Shown {
    pupil: Option<[f64; 2]>,
    steps: u32,
    new: bool,
}

struct Stage {
    settings: StudySettings,
    eye: Eye,
    source: SimulatedSource,
    waiting: Option<Sample>,
    estimator: Estimator,
    /// Time that has passed.
    now_ns: i64,
    /// Looked at until here for jumps.
    watched_ns: u64,
    landed_ns: Option<u64>,
    jumps: u32,
}

impl Stage {
    fn new(settings: &StudySettings) -> Result<Self, LiveError> {
        let wrong = |e: GazeError| LiveError::Setting(e.to_string());
        Ok(Self {
            eye: Eye::new(settings.eye.clone(), 0),
            source: SimulatedSource::starting(settings.eye.clone(), false, 0)?,
            waiting: None,
            estimator: Estimator::new(settings.gaze.clone(), None).map_err(wrong)?,
            now_ns: 0,
            watched_ns: 0,
            landed_ns: None,
            jumps: 0,
            settings: settings.clone(),
        })
    }

    /// Samples that have arrived by now.
    fn arrive(&mut self) -> Result<(), LiveError> {
        let now = u64::try_from(self.now_ns).unwrap_or(0);
        loop {
            let sample = match self.waiting.take() {
                Some(sample) => sample,
                None => match self.source.next(Duration::ZERO)? {
                    Event::Sample(sample, _) => sample,
                    _ => return Ok(()),
                },
            };
            if sample.received_ns > now {
                self.waiting = Some(sample);
                return Ok(());
            }
            self.estimator.update(&sample);
        }
    }

    /// The eye at a time, and what it did until then.
    fn truth(&mut self, time_ns: u64) -> Truth {
        // Jumps last 20 ms at least.
        while self.watched_ns < time_ns {
            self.watched_ns = (self.watched_ns + 5_000_000).min(time_ns);
            if let Doing::Saccade { lands_ns, .. } = self.eye.at(self.watched_ns).doing
                && self.landed_ns != Some(lands_ns)
            {
                self.landed_ns = Some(lands_ns);
                self.jumps += 1;
            }
        }
        self.eye.at(time_ns)
    }

    /// The last set that is decided on by now.
    fn beat(&self) -> Beat {
        let StudySettings { period_ns, lead_ns, .. } = self.settings;
        let start_ns = (self.now_ns + lead_ns).div_euclid(period_ns) * period_ns;
        Beat { start_ns, period_ns, lead_ns }
    }
}

/// Sees every moment, with the phases that were lit, colour by colour, and which share of the study is done; ends it by
/// answering `false`.
pub type Observer<'a> = dyn FnMut(&Moment, &[Vec<f32>], f64) -> bool + 'a;

/// Steers `parts` for a simulated eye. `engine` makes engines, three for each colour.
///
/// # Errors
/// [`LiveError::Setting`] for what cannot be; those of the engines and of the encoder.
pub fn study(
    parts: &[Part],
    policy: &Policy,
    encoder: &Encoder,
    settings: &StudySettings,
    engine: &mut dyn FnMut() -> Result<Box<dyn Engine>, EngineError>,
    observe: &mut Observer<'_>,
) -> Result<Study, LiveError> {
    if settings.period_ns <= 0 || settings.lead_ns < 0 || !(settings.seconds > 0.0 && settings.seconds <= 3600.0) {
        return Err(LiveError::Setting("a study lasts up to an hour, with sets of a positive period".into()));
    }
    let depth = 0.5 * (settings.gaze.focus[0] + settings.gaze.focus[1]);
    let mut steerer = Steerer::new(parts.to_vec(), *policy, &mut *engine)?;
    let mut judge = |part: &Part| Judge::new(part, policy, depth, engine()?);
    let mut lit: Vec<Judge> = parts.iter().map(&mut judge).collect::<Result<_, _>>()?;
    let mut whole: Vec<Judge> = parts.iter().map(&mut judge).collect::<Result<_, _>>()?;
    let mut stage = Stage::new(settings)?;
    let mut frames = encoder.frames();
    let mut phases: Vec<Vec<f32>> = parts.iter().map(|p| p.phases.clone()).collect();
    let mut shown = Shown { pupil: None, steps: 0, new: false };
    let mut moments = Vec::new();
    let (mut encoding_ns, mut encoded, mut refined_ns, mut handed_over) = (0i64, 0i64, 0i64, 0u32);
    let mut next_start = settings.period_ns;
    let end_ns = (settings.seconds * 1e9) as i64;
    // Before time begins: no first step is like the others.
    for _ in 0..4 {
        steerer.round_until(Instant::now() + Duration::from_secs(3600))?;
    }
    steerer.restart()?;
    'time: while next_start < end_ns {
        stage.arrive()?;
        let ends = encoding_ns + SLACK_NS;
        let target = stage.beat().reachable(stage.now_ns, as_ns(steerer.round()).saturating_add(ends));
        let light = u64::try_from(target.start_ns + settings.light_after_ns).unwrap_or(0);
        // Time passes here,
        let (begun, began_ns) = (Instant::now(), stage.now_ns);
        let left = u64::try_from(target.hand_over_ns - ends - began_ns).unwrap_or(0);
        let deadline = begun + Duration::from_nanos(left);
        let mut steps = 0;
        let pupil = loop {
            let pupil = stage.estimator.predict(light);
            steerer.aim(aim_of(&pupil))?;
            let taken = steerer.round_until(deadline)?;
            steps += taken;
            if taken == 0 || Instant::now() + steerer.round() > deadline {
                break pupil;
            }
            stage.now_ns = began_ns.saturating_add(as_ns(begun.elapsed()));
            stage.arrive()?;
        };
        let refined = as_ns(begun.elapsed());
        let made = if steps > 0 {
            let now = steerer.phases()?;
            encoder.encode_into(&PhaseSet::trusted(&now), &mut frames)?;
            Some(now.into_iter().map(<[f32]>::to_vec).collect::<Vec<_>>())
        } else {
            None
        };
        let took = as_ns(begun.elapsed());
        stage.now_ns = began_ns.saturating_add(if steps > 0 { took } else { took + SLACK_NS });
        // and stands from here on.
        if steps > 0 {
            refined_ns += refined;
            encoded += took - refined;
            handed_over += 1;
            encoding_ns = (took - refined).max(encoding_ns - encoding_ns / 10);
        }
        let first_new = stage.beat().reachable(stage.now_ns, 0).start_ns;
        while next_start < first_new.min(end_ns) {
            let light = next_start + settings.light_after_ns;
            let truth = stage.truth(u64::try_from(light).unwrap_or(0));
            let landed = stage.landed_ns.filter(|_| !matches!(truth.doing, Doing::Saccade { .. }));
            next_start += settings.period_ns;
            if truth.lid < 0.5 {
                continue;
            }
            let [x, y] = truth.position;
            let pupil = Pupil { x, y, diameter: truth.diameter, depth };
            let mean = |judges: &mut [Judge]| -> Result<f64, EngineError> {
                let count = judges.len() as f64;
                let all: Vec<f64> = judges.iter_mut().map(|j| j.psnr(pupil)).collect::<Result<_, _>>()?;
                Ok(all.iter().sum::<f64>() / count)
            };
            let moment = Moment {
                time_s: light as f64 * 1e-9,
                since_landing_ms: landed.map(|l| (light as f64 - l as f64) * 1e-6),
                jumps: stage.jumps,
                position: truth.position,
                diameter: truth.diameter,
                error: shown.pupil.map(|p| (p[0] - x).hypot(p[1] - y)),
                steered_db: mean(&mut lit)?,
                whole_db: mean(&mut whole)?,
                steps: shown.steps,
                new: std::mem::take(&mut shown.new),
            };
            moments.push(moment);
            if !observe(&moment, &phases, light as f64 / end_ns as f64) {
                break 'time;
            }
        }
        if let Some(made) = made {
            for (judge, phases) in lit.iter_mut().zip(&made) {
                judge.seen.restart(phases)?;
            }
            phases = made;
            shown = Shown { pupil: Some(pupil.centre), steps, new: true };
        }
    }
    let [restarts, steps] = steerer.counts();
    let per = |ns: i64, count: u64| ns as f64 * 1e-6 / count.max(1) as f64;
    let (step_ms, encode_ms) = (per(refined_ns, steps), per(encoded, u64::from(handed_over)));
    Ok(Study { moments, restarts, steps, step_ms, encode_ms })
}
