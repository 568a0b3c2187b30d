//! Counts the shown and dropped content frames in numbers that add up.

use serde::Serialize;

/// The cause of a dropped content frame or a late set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Cause {
    /// Content is faster than the sets, which is no error.
    Rates,
    /// The content frame was not read from the disk in time.
    LateContent,
    /// The content frame was not encoded or uploaded in time.
    LateGpu,
    /// The display showed the previous video frame once more than requested.
    MissedPresent,
    /// The checksum of the content frame is wrong.
    Damaged,
}

impl Cause {
    /// All causes in the order of the statistics.
    pub const ALL: [Self; 5] = [Self::Rates, Self::LateContent, Self::LateGpu, Self::MissedPresent, Self::Damaged];

    /// Returns the name for people.
    pub fn name(self) -> &'static str {
        ["rates", "late content", "late GPU", "missed present", "damaged"][self as usize]
    }
}

/// Counts since the start of a session.
///
/// The identity `due == shown + dropped + pending` always holds. If every set was shown to its end, `video_frames ==
/// sets x video frames per set + missed_presents + held_video_frames` and `sets == shown + repeats + idle_sets + late
/// sets that showed nothing new` hold too.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Account {
    /// The video frames of the display, shown or missed.
    pub video_frames: u64,
    /// The video frames for which no new frame arrived, so that the previous one stayed.
    pub missed_presents: u64,
    /// The video frames that were held so that sets keep their phase.
    pub held_video_frames: u64,
    /// The multiplex sets that began.
    pub sets: u64,
    /// The sets of the idle picture, or of a picture held while content starts again.
    pub idle_sets: u64,
    /// The sets that were repeated because nothing new was due.
    pub repeats: u64,
    /// The sets that could not show the content frame due at their start, by cause. They showed an older frame or a
    /// repeat.
    pub late_sets: [u64; 5],
    /// The sets with a missed present. They are whole, but one of their video frames lasted longer.
    pub stretched_sets: u64,
    /// The content frames that were due.
    pub due: u64,
    /// The content frames that were shown.
    pub shown: u64,
    /// The content frames that were dropped, by cause.
    pub dropped: [u64; 5],
}

impl Account {
    /// Returns the content frames that were dropped for any cause.
    pub fn drops(&self) -> u64 {
        self.dropped.iter().sum()
    }

    /// Returns the content frames that were dropped for one cause.
    pub fn dropped_for(&self, cause: Cause) -> u64 {
        self.dropped[cause as usize]
    }

    /// Lists the causes of dropped frames for people, such as "3 late content, 1 missed present".
    pub fn causes(&self) -> String {
        let one = |cause: &Cause| match self.dropped_for(*cause) {
            0 => None,
            n => Some(format!("{n} {}", cause.name())),
        };
        Cause::ALL.iter().filter_map(one).collect::<Vec<_>>().join(", ")
    }
}

/// The reason why a refined set is shown again, taken when the next set was decided on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum RepeatReason {
    /// The content is unchanged, and refinement is off.
    #[default]
    Unchanged,
    /// Steps were still running, because they take longer than the time between sets.
    StepTooLong,
    /// Another scene was being prepared.
    SceneTooLong,
    /// The set was being encoded.
    EncodingTooLong,
    /// The engine was lost, and another one was being opened.
    EngineLost,
    /// Refinement has ended for good.
    RefinementEnded,
    /// The set of the other eye was not ready.
    OtherEye,
}

impl RepeatReason {
    /// All reasons in the order of the statistics.
    pub const ALL: [Self; 7] = [
        Self::Unchanged,
        Self::StepTooLong,
        Self::SceneTooLong,
        Self::EncodingTooLong,
        Self::EngineLost,
        Self::RefinementEnded,
        Self::OtherEye,
    ];

    /// Returns the name for people and statistics.
    pub fn name(self) -> &'static str {
        [
            "unchanged",
            "step too long",
            "scene too long",
            "encoding too long",
            "engine lost",
            "refinement ended",
            "other eye",
        ][self as usize]
    }
}
