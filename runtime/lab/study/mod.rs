//! Measures the gain of the refinement for the tracked pupil with a simulated eye.
//!
//! The eye looks at a hologram that follows it, and the image at its true position is scored. Time is simulated. It
//! passes by the cost of refining and encoding ([`Cost`](eyebox::low_level::session::Cost)), and stops while the
//! quality is measured. All else is as in a live session. Samples arrive late and with noise, the pupil is predicted,
//! and sets are handed over complete. A set that is late is shown one set later.

mod content;
mod judged;
mod jump_start;
mod results;
mod seen;
mod stage;
#[cfg(test)]
mod tests;

pub use content::{ContentRun, ContentSample, ContentSettings, StudiedContent, StudiedEye, study_content};
pub use jump_start::JumpStart;
pub use results::{Judging, Study, StudySample, StudySettings};

use eyebox::low_level::encode::{Encoder, PhaseSet, VideoFrames};
use eyebox::low_level::engine::{Engine, EngineError};
use eyebox::low_level::optics::Pupil;
use eyebox::low_level::reason;
use eyebox::low_level::session::SessionError;
use eyebox::low_level::session::WorkTime;
use eyebox::low_level::session::{LiveColor, LiveRefiner, Policy};
use eyebox::low_level::trackers::simulated::Doing;
use judged::Judge;
use seen::SeenColor;
use stage::Stage;

/// The time that is reserved for the hand-over in addition to encoding, in nanoseconds.
const SLACK_NS: i64 = 500_000;

/// Returns the mean PSNR of the colors whose target images are not black, in dB.
fn psnr(colors: &mut [SeenColor], pupil: Pupil) -> Result<Option<f64>, EngineError> {
    let all: Vec<Option<f64>> = colors.iter_mut().map(|c| c.psnr(pupil)).collect::<Result<_, _>>()?;
    let lit: Vec<f64> = all.into_iter().flatten().collect();
    Ok((!lit.is_empty()).then(|| lit.iter().sum::<f64>() / lit.len() as f64))
}

/// Observer of a study. It receives each set at its light, the phases by color that were lit, and the completed share
/// of the study. It ends the study by returning `false`.
pub type Observer<'a> = dyn FnMut(&StudySample, &[Vec<f32>], f64) -> bool + 'a;

/// A complete set with its phases by color, the expected position of the pupil and the number of its steps.
struct MadeSet {
    phases: Vec<Vec<f32>>,
    pupil: Option<[f64; 2]>,
    /// The display's switchable sources that light it, by color.
    sources: Vec<Vec<usize>>,
    steps: u32,
    new: bool,
}

struct Studying<'a> {
    settings: &'a StudySettings,
    encoder: &'a Encoder,
    frames: VideoFrames,
    refiner: LiveRefiner,
    stage: Stage,
    depth: f64,
    /// The set on the display.
    lit: Vec<SeenColor>,
    /// The hologram for the whole eyebox.
    whole: Vec<SeenColor>,
    judge: Option<Judge>,
    shown: MadeSet,
    samples: Vec<StudySample>,
    next_start_ns: i64,
    /// The expected time of encoding.
    encoding_ns: i64,
    /// The total time of encoding.
    encoded_ns: i64,
    /// The total time of refining.
    refined_ns: i64,
    handed_over: u64,
}

/// Studies `colors` with refinement for a simulated eye. `engine` makes engines, three for each color.
///
/// # Errors
/// Returns [`SessionError::Setting`] for an invalid setting, and the errors of the engines and of the encoder.
pub fn study(
    colors: &[LiveColor],
    policy: &Policy,
    encoder: &Encoder,
    settings: &StudySettings,
    engine: &mut dyn FnMut() -> Result<Box<dyn Engine>, EngineError>,
    observe: &mut Observer<'_>,
) -> Result<Study, SessionError> {
    if settings.period_ns <= 0 || settings.lead_ns < 0 || !(settings.seconds > 0.0 && settings.seconds <= 3600.0) {
        return Err(SessionError::Setting(reason!(
            "study",
            "a study needs a duration of up to one hour and sets of a positive period"
        )));
    }
    let depth = 0.5 * (settings.gaze.focus[0] + settings.gaze.focus[1]);
    let mut refiner = LiveRefiner::new(colors.to_vec(), *policy, &mut *engine)?;
    let mut seen = || -> Result<Vec<SeenColor>, SessionError> {
        colors.iter().map(|color| SeenColor::new(color, policy, depth, engine()?)).collect()
    };
    let (lit, whole) = (seen()?, seen()?);
    let judge = settings.judging.as_ref().map(Judge::new).transpose()?;
    // These steps run before the simulated time begins, because first steps are slower than others.
    for _ in 0..4 {
        refiner.round_while(|_, _| true)?;
    }
    refiner.restart()?;
    let phases = colors.iter().map(|c| c.phases.clone()).collect();
    let sources = refiner.sources().map(<[usize]>::to_vec).collect();
    let mut studying = Studying {
        settings,
        encoder,
        frames: encoder.frames(),
        refiner,
        stage: Stage::new(settings)?,
        depth,
        lit,
        whole,
        judge,
        shown: MadeSet { phases, pupil: None, sources, steps: 0, new: false },
        samples: Vec::new(),
        next_start_ns: settings.period_ns,
        encoding_ns: 0,
        encoded_ns: 0,
        refined_ns: 0,
        handed_over: 0,
    };
    while studying.next_start_ns < studying.end_ns() {
        let made = studying.refine()?;
        if !studying.light(observe)? {
            break;
        }
        if let Some(made) = made {
            studying.show(made)?;
        }
    }
    Ok(studying.finish())
}

impl Studying<'_> {
    fn end_ns(&self) -> i64 {
        (self.settings.seconds * 1e9) as i64
    }

    /// Returns the expected cost of a step of all colors, in nanoseconds.
    fn round_ns(&self) -> i64 {
        self.settings.cost.round_ns(self.lit.len(), || self.refiner.round())
    }

    /// Refines the next set that can be reached, and encodes it. Simulated time passes. Returns `None` if there was no
    /// time for a step.
    fn refine(&mut self) -> Result<Option<MadeSet>, SessionError> {
        self.stage.arrive()?;
        let ends_ns = self.encoding_ns + SLACK_NS;
        let target = self.stage.timing().reachable(self.stage.now_ns, self.round_ns().saturating_add(ends_ns));
        let light = u64::try_from(target.start_ns + self.settings.light_after_ns).unwrap_or(0);
        let mut time = WorkTime::begin(self.settings.cost, self.stage.now_ns);
        let began_ns = self.stage.now_ns;
        let deadline_ns = target.hand_over_ns - ends_ns;
        let mut steps = 0;
        let pupil = loop {
            let pupil = self.stage.predict(light);
            self.refiner.aim(pupil)?;
            let taken = self.refiner.round_while(|steps, expected| time.steps_before(deadline_ns, steps, expected))?;
            steps += taken;
            if taken == 0 || time.now_ns().saturating_add(self.round_ns()) > deadline_ns {
                break pupil;
            }
            self.stage.now_ns = time.now_ns();
            self.stage.arrive()?;
        };
        if steps == 0 {
            self.stage.now_ns = time.now_ns() + SLACK_NS;
            return Ok(None);
        }
        self.refiner.settle()?;
        let refined_ns = time.now_ns();
        self.encoder.encode_into(&PhaseSet::trusted(&self.refiner.sent()?), &mut self.frames)?;
        let phases = self.refiner.phases()?;
        let phases = phases.iter().map(|of_color| of_color.to_vec()).collect();
        time.encoded();
        self.stage.now_ns = time.now_ns();
        let took_ns = time.now_ns() - refined_ns;
        self.refined_ns += refined_ns - began_ns;
        self.encoded_ns += took_ns;
        self.handed_over += 1;
        self.encoding_ns = took_ns.max(self.encoding_ns - self.encoding_ns / 10);
        let sources = self.refiner.sources().map(<[usize]>::to_vec).collect();
        Ok(Some(MadeSet { phases, pupil: Some(pupil.centre), sources, steps, new: true }))
    }

    /// Scores the sets that are lit before a set that is handed over now. Returns false if the observer ends the study.
    fn light(&mut self, observe: &mut Observer<'_>) -> Result<bool, SessionError> {
        let end_ns = self.end_ns();
        let first_new_ns = self.stage.timing().reachable(self.stage.now_ns, 0).start_ns;
        while self.next_start_ns < first_new_ns.min(end_ns) {
            let light_ns = self.next_start_ns + self.settings.light_after_ns;
            let truth = self.stage.truth(u64::try_from(light_ns).unwrap_or(0));
            let landed = self.stage.landed_ns.filter(|_| !matches!(truth.doing, Doing::Saccade { .. }));
            self.next_start_ns += self.settings.period_ns;
            if truth.lid < 0.5 {
                continue;
            }
            let [x, y] = truth.position;
            let pupil = Pupil { x, y, diameter: truth.diameter, depth: self.depth };
            let last = landed.is_some() && self.stage.jumps_by(light_ns + self.settings.period_ns);
            let jod = match self.judge.as_mut().filter(|_| last) {
                Some(judge) => judge.both([&mut self.lit, &mut self.whole], pupil)?,
                None => None,
            };
            let [steered, whole] = [&mut self.lit, &mut self.whole].map(|colors| psnr(colors, pupil));
            // A black target image gives no comparison.
            let (Some(steered_db), Some(whole_db)) = (steered?, whole?) else { continue };
            let sample = StudySample {
                time_s: light_ns as f64 * 1e-9,
                since_landing_ms: landed.map(|l| (light_ns as f64 - l as f64) * 1e-6),
                jumps: self.stage.jumps,
                position: truth.position,
                diameter: truth.diameter,
                error: self.shown.pupil.map(|p| (p[0] - x).hypot(p[1] - y)),
                steered_db,
                whole_db,
                jod,
                steps: self.shown.steps,
                served: self.served(pupil),
                sources: self.shown.sources.iter().map(Vec::len).max().unwrap_or(0),
                new: std::mem::take(&mut self.shown.new),
            };
            self.samples.push(sample);
            if !observe(&sample, &self.shown.phases, light_ns as f64 / end_ns as f64) {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Returns the share of the pupil that the lit sources serve, at the color that is served least.
    fn served(&self, pupil: Pupil) -> f64 {
        let colors = self.lit.iter().zip(&self.shown.sources);
        colors.map(|(color, lit)| color.seen.served(lit, &pupil)).fold(1.0, f64::min)
    }

    /// Shows this set on the display from now on.
    fn show(&mut self, made: MadeSet) -> Result<(), SessionError> {
        for (i, (color, phases)) in self.lit.iter_mut().zip(&made.phases).enumerate() {
            color.seen.restart(phases)?;
            // Sources are switched with the set that was made for them.
            if made.sources.get(i).is_some_and(|lit| !lit.is_empty()) {
                color.seen.light(&made.sources[i]);
            }
        }
        self.shown = made;
        Ok(())
    }

    fn finish(self) -> Study {
        let [restarts, steps] = self.refiner.counts();
        let per = |ns: i64, count: u64| ns as f64 * 1e-6 / count.max(1) as f64;
        let (step_ms, encode_ms) = (per(self.refined_ns, steps), per(self.encoded_ns, self.handed_over));
        Study { moments: self.samples, restarts, steps, step_ms, encode_ms }
    }
}
