//! What is studied, and what came of it.

use eyebox::low_level::gaze;
use eyebox::low_level::optics::{Color, Viewing};
use eyebox::low_level::session::Cost;
use eyebox::low_level::session::SetTiming;
use eyebox::low_level::trackers::simulated;
use serde::Serialize;

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
    /// What refining costs.
    pub cost: Cost,
    /// The eye and its tracker.
    pub eye: simulated::Settings,
    /// From samples to the pupil. The eye's focus is the middle of its range.
    pub gaze: gaze::Settings,
    /// Where given, the last set of every fixation is judged in just-objectionable differences, too.
    pub judging: Option<Judging>,
}

/// How what is seen is judged in just-objectionable differences (ColorVideoVDP).
#[derive(Debug, Clone, PartialEq)]
pub struct Judging {
    /// How bright the display is.
    pub viewing: Viewing,
    /// Pixels of the picture a degree.
    pub pixels_per_degree: f64,
    /// Which colours are steered, in their order.
    pub colors: Vec<Color>,
}

impl Default for StudySettings {
    /// A set a video frame at 60 Hz; fixations of 300 ms.
    fn default() -> Self {
        let eye = simulated::Settings { fixation: [0.3, 0.3], pursuit: 0.0, blinks: 0.0, ..Default::default() };
        let period_ns = 1_000_000_000 / 60;
        Self {
            seconds: 4.0,
            period_ns,
            lead_ns: SetTiming::usual_lead_ns(period_ns),
            light_after_ns: period_ns / 2,
            cost: Cost::Measured,
            eye,
            gaze: gaze::Settings::default(),
            judging: None,
        }
    }
}

/// One set, at its light.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct StudySample {
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
    /// Just-objectionable differences of both, 10 for none; of the last set of a fixation, where they are asked for.
    pub jod: Option<[f64; 2]>,
    /// Steps that were taken for the set, over all colours.
    pub steps: u32,
    /// Share of the pupil that the display's switchable sources serve which are lit; 1 where it has none.
    pub served: f64,
    /// How many of those sources are lit, at most in any colour.
    pub sources: usize,
    /// Whether the set is new.
    pub new: bool,
}

impl StudySample {
    /// What steering gains, dB.
    pub fn gain_db(&self) -> f64 {
        self.steered_db - self.whole_db
    }
}

/// What came of it.
#[derive(Debug, Clone, Serialize)]
pub struct Study {
    /// Every set at which the eye was open.
    pub moments: Vec<StudySample>,
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
        let last = |pair: &[StudySample]| pair[1].jumps > pair[0].jumps && pair[0].since_landing_ms.is_some();
        let with_jump = |pair: &[StudySample]| pair[0].since_landing_ms.is_some() && pair[1].since_landing_ms.is_none();
        self.moments.windows(2).filter(|p| last(p) || with_jump(p)).map(|p| p[0].gain_db()).collect()
    }

    /// Of each fixation that lasted to a jump, at its last set: JOD steered and unsteered; of those that were judged.
    pub fn at_the_end_jod(&self) -> Vec<[f64; 2]> {
        self.moments.iter().filter_map(|m| m.jod).collect()
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

    /// Sets of which the eye saw nothing, for it was in the eyebox of no source that was lit: while it was under way from one
    /// place to another, and while it rested.
    pub fn dark_sets(&self) -> [usize; 2] {
        let dark = |rests: bool| {
            let is = |m: &&StudySample| m.served == 0.0 && (m.since_landing_ms.is_some() || m.jumps == 0) == rests;
            self.moments.iter().filter(is).count()
        };
        [dark(false), dark(true)]
    }

    /// The worst that steering did at any time, dB; `None` if nothing was compared.
    pub fn worst_db(&self) -> Option<f64> {
        self.moments.iter().map(StudySample::gain_db).reduce(f64::min)
    }
}
