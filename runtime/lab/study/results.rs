//! Defines the settings and the results of a study.

use eyebox::low_level::gaze;
use eyebox::low_level::optics::{Color, Viewing};
use eyebox::low_level::session::Cost;
use eyebox::low_level::session::SetTiming;
use eyebox::low_level::trackers::simulated;
use serde::Serialize;

/// The settings of a study.
#[derive(Debug, Clone)]
pub struct StudySettings {
    /// The simulated duration in seconds.
    pub seconds: f64,
    /// The time from the beginning of a set to the beginning of the next, in nanoseconds.
    pub period_ns: i64,
    /// The time between the decision on a set and its beginning, in nanoseconds.
    pub lead_ns: i64,
    /// The time from the beginning of a set to the middle of its light, in nanoseconds.
    pub light_after_ns: i64,
    /// The cost of refining and encoding.
    pub cost: Cost,
    /// The simulated eye and its tracker.
    pub eye: simulated::Settings,
    /// The settings of the estimator, which converts samples to the pupil. The focus of the eye is the middle of its
    /// range.
    pub gaze: gaze::Settings,
    /// If given, the last set of each fixation is also judged in JOD.
    pub judging: Option<Judging>,
}

/// The viewing conditions for JOD (ColorVideoVDP).
#[derive(Debug, Clone, PartialEq)]
pub struct Judging {
    /// The luminance of the display.
    pub viewing: Viewing,
    /// Pixels of the picture per degree.
    pub pixels_per_degree: f64,
    /// The refined colors, in their order.
    pub colors: Vec<Color>,
}

impl Default for StudySettings {
    /// Has one set per video frame at 60 Hz, and fixations of 300 ms.
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

/// The scores of one set at its light.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct StudySample {
    /// The time in seconds from the beginning.
    pub time_s: f64,
    /// The time since the eye came to rest, in ms. `None` while it jumps, and before the first jump.
    pub since_landing_ms: Option<f64>,
    /// The number of jumps until then.
    pub jumps: u32,
    /// The position of the pupil, in meters.
    pub position: [f64; 2],
    /// The diameter of the pupil, in meters.
    pub diameter: f64,
    /// The distance of the pupil from the position for which the set was made, in meters. `None` before the first set.
    pub error: Option<f64>,
    /// The PSNR of the image at the eye, as the mean over the colors in dB.
    pub steered_db: f64,
    /// The same PSNR for the hologram for the whole eyebox.
    pub whole_db: f64,
    /// The JOD of both, 10 for no difference. Only the last set of a fixation has it, and only if it was requested.
    pub jod: Option<[f64; 2]>,
    /// The steps for the set, over all colors.
    pub steps: u32,
    /// The share of the pupil that the lit switchable sources serve. 1 for a display without such sources.
    pub served: f64,
    /// The largest number of lit sources of any color.
    pub sources: usize,
    /// True if the set is new.
    pub new: bool,
}

impl StudySample {
    /// Returns the gain of the refinement for the tracked pupil, in dB.
    pub fn gain_db(&self) -> f64 {
        self.steered_db - self.whole_db
    }
}

/// The results of a study.
#[derive(Debug, Clone, Serialize)]
pub struct Study {
    /// One sample per set at which the eye was open.
    pub moments: Vec<StudySample>,
    /// The number of restarts of the refinement.
    pub restarts: u64,
    /// The number of steps over all colors.
    pub steps: u64,
    /// The mean time of a step of one color, in ms.
    pub step_ms: f64,
    /// The mean time for reading back and encoding a set, in ms.
    pub encode_ms: f64,
}

impl Study {
    /// Returns the gain at the last set of each fixation that lasted to a jump, in dB.
    pub fn at_the_end_db(&self) -> Vec<f64> {
        let last = |pair: &[StudySample]| pair[1].jumps > pair[0].jumps && pair[0].since_landing_ms.is_some();
        let with_jump = |pair: &[StudySample]| pair[0].since_landing_ms.is_some() && pair[1].since_landing_ms.is_none();
        self.moments.windows(2).filter(|p| last(p) || with_jump(p)).map(|p| p[0].gain_db()).collect()
    }

    /// Returns the JOD of the refined and of the static hologram at the last set of each judged fixation that lasted to
    /// a jump.
    pub fn at_the_end_jod(&self) -> Vec<[f64; 2]> {
        self.moments.iter().filter_map(|m| m.jod).collect()
    }

    /// Returns the gain of each fixation at the last set that is lit within `ms` milliseconds of the landing, in dB.
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

    /// Returns the numbers of dark sets during saccades and at rest. A set is dark if the pupil is in the eyebox of no
    /// lit source.
    pub fn dark_sets(&self) -> [usize; 2] {
        let dark = |rests: bool| {
            let is = |m: &&StudySample| m.served == 0.0 && (m.since_landing_ms.is_some() || m.jumps == 0) == rests;
            self.moments.iter().filter(is).count()
        };
        [dark(false), dark(true)]
    }

    /// Returns the lowest gain of the refinement at any time, in dB. `None` if nothing was compared.
    pub fn worst_db(&self) -> Option<f64> {
        self.moments.iter().map(StudySample::gain_db).reduce(f64::min)
    }
}
