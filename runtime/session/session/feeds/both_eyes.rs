//! Shows the sets of two eyes as one set, by one decision for each video frame.

use crate::encode::VideoFrames;
use crate::optics::{Panels, Stereo};
use crate::session::feeds::eye_content::EyeContent;
use crate::session::feeds::following::LiveState;
use crate::session::feeds::joined::{join, join_sets};
use crate::session::frame_log::account::RepeatReason;
use crate::session::frame_log::error::SessionError;
use crate::session::frame_log::notes::Notes;
use crate::session::playback::player::SetSource;
use crate::session::playback::scheduler::{Content, Readiness, Target};

/// The running content of two eyes.
pub(crate) struct BothEyes {
    /// The content of the left and the right eye.
    pub eyes: [EyeContent; 2],
    pub stereo: Stereo,
    places: Panels,
    /// The sets that are shown without content.
    idle: [VideoFrames; 2],
    /// The joined video frames. Only the last composed one is up to date.
    joined: VideoFrames,
    period_ns: i64,
    /// True for an eye whose content has failed. The other eye continues.
    has_failed: [bool; 2],
    /// The last position that each eye has shown, of content that is played.
    shown: [Option<u64>; 2],
    notes: Notes,
    /// The video frames of content on both eyes, and those in which their sets did not belong together.
    pub counts: [u64; 2],
}

const NAMES: [&str; 2] = ["left", "right"];

/// Returns the progress of a position that both eyes have to show.
fn slower(one: Readiness, other: Readiness) -> Readiness {
    let rank = |readiness: &Readiness| match readiness {
        Readiness::Damaged => 0,
        Readiness::Unread => 1,
        Readiness::Read => 2,
        Readiness::Ready => 3,
    };
    if rank(&one) <= rank(&other) { one } else { other }
}

impl BothEyes {
    /// Joins the content of both eyes on a display of this period (ns). `idle` is shown by each eye without content.
    pub(crate) fn new(
        eyes: [EyeContent; 2],
        idle: [VideoFrames; 2],
        (stereo, places): (Stereo, Panels),
        period_ns: i64,
        notes: Notes,
    ) -> Self {
        let joined = join_sets([&idle[0], &idle[1]], places);
        let (has_failed, shown, counts) = ([false; 2], [None; 2], [0; 2]);
        Self { eyes, stereo, places, idle, joined, period_ns, has_failed, shown, notes, counts }
    }

    /// Returns the picture set that is shown without content.
    pub(crate) fn idle(&self) -> VideoFrames {
        self.joined.clone()
    }

    /// Counts a video frame that was handed over with content.
    pub(crate) fn handed_over(&mut self) {
        let [left, right] = &self.eyes;
        let belong = match (left, right) {
            (EyeContent::Live(left), EyeContent::Live(right)) => {
                match (&left.source.on_screen, &right.source.on_screen) {
                    (Some(left), Some(right)) => Some(left.belongs_to(right, self.period_ns)),
                    _ => None,
                }
            }
            _ => {
                let numbers = [left, right].map(|eye| eye.source_ref().on_screen().map(|shown| shown.1));
                numbers.iter().all(Option::is_some).then(|| self.shown[0] == self.shown[1])
            }
        };
        if let Some(belong) = belong {
            self.counts[0] += 1;
            self.counts[1] += u64::from(!belong);
        }
    }

    fn lives(&self) -> Option<[&LiveState; 2]> {
        match &self.eyes {
            [EyeContent::Live(left), EyeContent::Live(right)] => Some([left, right]),
            _ => None,
        }
    }

    /// Returns the newest sets that belong together, as their places among the waiting sets of each eye.
    fn pair(&self) -> Option<[usize; 2]> {
        let [left, right] = self.lives()?;
        let [left, right] = [left.source.fresh(), right.source.fresh()];
        let newest = |i: &usize| {
            let belongs = |j: &usize| left[*i].belongs_to(&right[*j], self.period_ns);
            (0..right.len()).rev().find(belongs).map(|j| [*i, j])
        };
        (0..left.len()).rev().find_map(|i| newest(&i))
    }

    /// Returns true for eyes whose own sets are shown, because the eyes are independent or the other eye makes none.
    fn are_alone(&self) -> [bool; 2] {
        let is_away = |at: usize| match &self.eyes[at] {
            EyeContent::Live(live) => self.has_failed[at] || live.source.is_away(),
            _ => self.has_failed[at],
        };
        [1, 0].map(|other| self.stereo == Stereo::Independent || is_away(other))
    }

    fn show_live(&mut self, position: u64) {
        let (alone, pair, failed) = (self.are_alone(), self.pair(), self.has_failed);
        for (at, eye) in self.eyes.iter_mut().enumerate() {
            let (EyeContent::Live(live), false) = (eye, failed[at]) else { continue };
            match pair {
                _ if alone[at] => live.source.show(position),
                Some(pair) => live.source.show_waiting(pair[at]),
                None => live.source.show_again(),
            }
        }
    }

    fn show_played(&mut self, position: u64) {
        let (alone, failed) = (self.are_alone(), self.has_failed);
        for (at, eye) in self.eyes.iter_mut().enumerate().filter(|(at, _)| !failed[*at]) {
            let source = eye.source();
            let from = self.shown[at].map_or(0, |shown| shown + 1).max(position.saturating_sub(FARTHEST));
            let newest = match alone[at] {
                true => (from..=position).rev().find(|p| source.readiness(*p) == Readiness::Ready),
                false => Some(position),
            };
            if let Some(newest) = newest {
                source.show(newest);
                self.shown[at] = Some(newest);
            }
        }
    }

    /// Calls both eyes. The content of an eye that fails stays, and the other eye continues.
    fn each(
        &mut self,
        mut call: impl FnMut(&mut dyn SetSource) -> Result<(), SessionError>,
    ) -> Result<(), SessionError> {
        for at in [0, 1] {
            if self.has_failed[at] {
                continue;
            }
            let Err(error) = call(self.eyes[at].source()) else { continue };
            self.has_failed[at] = true;
            if self.has_failed[1 - at] {
                return Err(error);
            }
            let name = NAMES[at];
            self.notes.send(format!("the content of the {name} eye has ended, and its picture stays ({error})"));
        }
        Ok(())
    }
}

/// The positions behind the one that is due that an eye may still show alone.
const FARTHEST: u64 = 64;

impl Content for BothEyes {
    fn readiness(&self, position: u64) -> Readiness {
        let living = (0..2).filter(|at| !self.has_failed[*at]);
        let each = living.map(|at| self.eyes[at].source_ref().readiness(position));
        match self.stereo {
            Stereo::Together => each.reduce(slower),
            Stereo::Independent => each.reduce(|one, other| if slower(one, other) == one { other } else { one }),
        }
        .unwrap_or(Readiness::Unread)
    }

    fn end(&self) -> Option<u64> {
        let living = (0..2).filter(|at| !self.has_failed[*at]);
        living.filter_map(|at| self.eyes[at].source_ref().end()).min()
    }
}

impl SetSource for BothEyes {
    fn poll(&mut self, useful_from: u64) -> Result<(), SessionError> {
        self.each(|eye| eye.poll(useful_from))
    }

    fn settle(&mut self, position: u64, target: Target) -> Result<(), SessionError> {
        if self.stereo == Stereo::Together {
            let failed = self.has_failed;
            let mut can_make = |at: usize| match &mut self.eyes[at] {
                EyeContent::Live(live) if !failed[at] => live.source.can_make(target),
                _ => true,
            };
            let can = [can_make(0), can_make(1)];
            if can != [true; 2] {
                // Both wait for the slower one.
                for (at, eye) in self.eyes.iter_mut().enumerate() {
                    if let EyeContent::Live(live) = eye {
                        live.source.waits(if can[at] { RepeatReason::OtherEye } else { RepeatReason::StepTooLong });
                    }
                }
                return self.poll(0);
            }
        }
        self.each(|eye| eye.settle(position, target))
    }

    fn show(&mut self, position: u64) {
        match self.lives() {
            Some(_) => self.show_live(position),
            None => self.show_played(position),
        }
    }

    fn compose(&mut self, video_frame: usize) {
        let at = video_frame.min(self.joined.count() - 1);
        let [left, right] = [0, 1].map(|eye| match self.eyes[eye].source_ref().on_screen() {
            Some((frames, _)) => frames.frame(at),
            None => self.idle[eye].frame(at),
        });
        let row_bytes = self.idle[0].width * self.idle[0].channels;
        let each = self.joined.frame_bytes();
        join(&mut self.joined.bytes_mut()[at * each..][..each], [left, right], row_bytes, self.places);
    }

    fn on_screen(&self) -> Option<(&VideoFrames, u64)> {
        let shown = self.eyes.iter().find_map(|eye| eye.source_ref().on_screen())?;
        Some((&self.joined, shown.1))
    }

    fn seek(&mut self, index: u64) {
        self.shown = [None; 2];
        self.eyes.iter_mut().for_each(|eye| eye.source().seek(index));
    }
}
