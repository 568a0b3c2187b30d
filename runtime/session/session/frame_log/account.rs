//! What was shown when, in numbers that add up.

use serde::Serialize;

/// Why a content frame was dropped, or a set came late.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Cause {
    /// Content is faster than the sets: nobody's fault.
    Rates,
    /// It was not read from the disk in time.
    LateContent,
    /// It was not encoded or uploaded in time.
    LateGpu,
    /// The display showed another video frame once more than it was told.
    MissedPresent,
    /// Its checksum is wrong.
    Damaged,
}

impl Cause {
    /// All of them, in the order of the account.
    pub const ALL: [Self; 5] = [Self::Rates, Self::LateContent, Self::LateGpu, Self::MissedPresent, Self::Damaged];

    /// For people.
    pub fn name(self) -> &'static str {
        ["rates", "late content", "late GPU", "missed present", "damaged"][self as usize]
    }
}

/// Counts since the start.
///
/// `due == shown + dropped + pending`, and, where every set was shown to its end,
/// `video_frames == sets x video frames a set + missed_presents + held_video_frames`;
/// `sets == shown + repeats + idle_sets + late sets that showed nothing new`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Account {
    /// Video frames of the display, shown or missed.
    pub video_frames: u64,
    /// Video frames for which nothing came: the one before stayed.
    pub missed_presents: u64,
    /// Video frames held so that sets keep their phase.
    pub held_video_frames: u64,
    /// Multiplex sets begun.
    pub sets: u64,
    /// Of them, those of the idle picture, or of a picture held while content begins anew.
    pub idle_sets: u64,
    /// Of them, repeats because nothing new was due.
    pub repeats: u64,
    /// Of them, those at whose start the content frame that was due could not be shown, by cause: an older one came, or a
    /// repeat.
    pub late_sets: [u64; 5],
    /// Sets during which a present was missed: whole, with a video frame that lasted longer.
    pub stretched_sets: u64,
    /// Content frames that were due.
    pub due: u64,
    /// Content frames shown.
    pub shown: u64,
    /// Content frames dropped, by cause.
    pub dropped: [u64; 5],
}

impl Account {
    /// Content frames dropped for any cause.
    pub fn drops(&self) -> u64 {
        self.dropped.iter().sum()
    }

    /// Dropped for one cause.
    pub fn dropped_for(&self, cause: Cause) -> u64 {
        self.dropped[cause as usize]
    }

    /// The causes that dropped anything, for people: "3 late content, 1 missed present".
    pub fn causes(&self) -> String {
        let one = |cause: &Cause| match self.dropped_for(*cause) {
            0 => None,
            n => Some(format!("{n} {}", cause.name())),
        };
        Cause::ALL.iter().filter_map(one).collect::<Vec<_>>().join(", ")
    }
}

/// Why a set of what is refined is shown again: what was the matter when the next was decided on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum RepeatReason {
    /// Nothing has changed, and nothing is refined.
    #[default]
    Unchanged,
    /// Steps were under way: they take longer than there is from one set to the next.
    StepTooLong,
    /// Another scene was being made ready.
    SceneTooLong,
    /// It was being encoded.
    EncodingTooLong,
    /// The engine was lost, and another was being made.
    EngineLost,
    /// Refinement has ended.
    RefinementEnded,
}

impl RepeatReason {
    /// All of them, in the order of accounts.
    pub const ALL: [Self; 6] = [
        Self::Unchanged,
        Self::StepTooLong,
        Self::SceneTooLong,
        Self::EncodingTooLong,
        Self::EngineLost,
        Self::RefinementEnded,
    ];

    /// For people and statistics.
    pub fn name(self) -> &'static str {
        ["unchanged", "step too long", "scene too long", "encoding too long", "engine lost", "refinement ended"]
            [self as usize]
    }
}
