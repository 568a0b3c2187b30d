//! Decides what the next video frame shows, without a clock, a thread or a device.
//!
//! A multiplex set takes some successive video frames of the display. A decision is made only before the first of them.
//! It shows the newest content frame that is due and ready, or repeats the set on the screen as a whole.
//!
//! Each content frame that is never shown is dropped for one cause. The cause is the state at the last start of a set
//! at which the frame was due. Without such a start, the cause is a missed present if the frame would have been due at
//! a missed start. Otherwise the cause is the rates, because content is faster than the sets.

use crate::present::Rate;
use crate::session::frame_log::account::{Account, Cause};
use crate::session::playback::timeline::{Speed, Timeline};
use std::collections::VecDeque;

/// The times of a set to come.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Target {
    /// The time at which it begins to be lit.
    pub start_ns: i64,
    /// The time at which it has to be handed over.
    pub hand_over_ns: i64,
    /// With rolling updates, the video frame of the set whose turn it is then.
    pub turn: u64,
}

/// The progress of a content frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Readiness {
    /// It is not read from the disk.
    Unread,
    /// It is read, but not encoded or not on the device.
    Read,
    /// It can be shown now.
    Ready,
    /// It can never be shown because its checksum is wrong.
    Damaged,
}

/// Content as the scheduler uses it, by position on the [`Timeline`].
pub trait Content {
    /// Returns the progress of a position.
    fn readiness(&self, position: u64) -> Readiness;
    /// Returns the first position after the end, once the source has found it.
    fn end(&self) -> Option<u64>;
}

/// The rule for the start of position 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Start {
    /// Content starts as soon as it is ready, after some sets of the idle picture.
    WhenReady {
        /// The sets of the idle picture that come first, even if content is ready.
        idle_sets: u64,
    },
    /// Content starts at this time even if it is not ready, so that several displays can agree on a time.
    At {
        /// The start time (ns on the clock of the player).
        display_time_ns: i64,
    },
}

/// The settings that do not change during playback.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Schedule {
    /// The video frames per second.
    pub display_rate: Rate,
    /// The content frames per second.
    pub content_rate: Rate,
    /// The speed of the content.
    pub speed: Speed,
    /// The video frames of a multiplex set.
    pub set_frames: u64,
    /// True for rolling updates. Each video frame is then a decision of its own. It comes from the newest set, and is
    /// the video frame whose turn it is, so that the newest sub-frames replace the oldest. One such decision counts as
    /// a set.
    pub rolls: bool,
    /// The start of the content.
    pub start: Start,
    /// True if content waits after each frame until it is [stepped](Scheduler::step).
    pub waits: bool,
    /// True if sets start only a multiple of `set_frames` after the first, despite missed presents. This is for lasers
    /// that count video frames by themselves.
    pub keep_phase: bool,
}

impl Schedule {
    pub(crate) fn decided_every(&self) -> u64 {
        if self.rolls { 1 } else { self.set_frames }
    }
}

/// The content of a video frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum What {
    /// The idle picture is shown, which is a sync frame or flat.
    Idle,
    /// The set on the screen stays.
    Keep,
    /// The new set of this position is shown.
    Set(u64),
    /// The playback ends, because the last set was shown for its time.
    End,
}

/// A decision for a video frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Slot {
    /// The content of the video frame.
    pub what: What,
    /// The number of the video frame in the set.
    pub video_frame: u64,
    /// The cause why a set that should be new is not, or is late.
    pub late: Option<Cause>,
}

/// The content frames behind the one that is due that may still be shown if nothing newer is ready.
const LATEST: usize = 64;
/// The missed starts of sets in one gap that are examined one by one.
const LONGEST_MISS: u64 = 1 << 20;

/// Decides on video frames and keeps the counts.
#[derive(Debug, Clone)]
pub struct Scheduler {
    schedule: Schedule,
    timeline: Option<Timeline>,
    start: Start,
    account: Account,
    /// The newest position on the screen, since positions last started at 0.
    shown: Option<u64>,
    /// True if the set on the screen is content.
    content_on_screen: bool,
    /// The first position that has not been checked for being due.
    considered: u64,
    /// The positions that were due and are not shown yet, ascending, each with its cause.
    pending: VecDeque<(u64, Cause)>,
    /// The video frame and the predicted time of the start of the last set.
    last_start: Option<(u64, i64)>,
    last_vblank: Option<u64>,
    first_start: Option<u64>,
    next_video_frame: u64,
    /// With rolling updates, the video frame whose turn is next.
    turn: u64,
    stretched: bool,
    idle_sets: u64,
}

impl Scheduler {
    /// Creates a scheduler that has shown nothing.
    pub fn new(schedule: Schedule) -> Self {
        let schedule = Schedule { set_frames: schedule.set_frames.max(1), ..schedule };
        Self {
            schedule,
            timeline: None,
            start: schedule.start,
            account: Account::default(),
            shown: None,
            content_on_screen: false,
            considered: 0,
            pending: VecDeque::with_capacity(2 * LATEST),
            last_start: None,
            last_vblank: None,
            first_start: None,
            next_video_frame: 0,
            turn: 0,
            stretched: false,
            idle_sets: 0,
        }
    }

    /// Returns the counts of the content that was shown or dropped.
    pub fn account(&self) -> &Account {
        &self.account
    }

    /// Returns the settings of the schedule.
    pub fn schedule(&self) -> &Schedule {
        &self.schedule
    }

    /// Returns true if content is paused.
    pub fn is_paused(&self) -> bool {
        self.timeline.as_ref().is_some_and(Timeline::is_paused)
    }

    /// Returns the oldest position that a set starting at `predicted_display_time_ns` would still show. Readers may
    /// skip older ones.
    pub(crate) fn useful_from(&self, predicted_display_time_ns: i64) -> u64 {
        let due = self.due(predicted_display_time_ns).unwrap_or(0);
        due.max(self.shown.map_or(0, |s| s + 1))
    }

    /// Returns, with rolling updates, the video frame whose turn it is with the next content, otherwise 0.
    pub(crate) fn turn(&self) -> u64 {
        if self.account.shown == 0 { 0 } else { self.turn }
    }

    /// Returns the position that a video frame lit then would show as new if it were ready, or `None` if nothing new is
    /// due.
    pub fn wanted(&self, predicted_display_time_ns: i64) -> Option<u64> {
        if self.next_video_frame > 0 && self.next_video_frame < self.schedule.decided_every() {
            return None;
        }
        if self.timeline.is_none() {
            return match self.start {
                Start::WhenReady { idle_sets } => (self.idle_sets >= idle_sets).then_some(0),
                Start::At { display_time_ns } => {
                    (predicted_display_time_ns.saturating_add(self.early_ns()) >= display_time_ns).then_some(0)
                }
            };
        }
        self.due(predicted_display_time_ns).filter(|due| self.shown.is_none_or(|s| s < *due))
    }

    /// Pauses or resumes content from a display time on.
    pub fn pause(&mut self, paused: bool, display_time_ns: i64) {
        if let Some(t) = &mut self.timeline {
            t.pause(paused, display_time_ns);
        }
    }

    /// Advances by one content frame and pauses.
    pub fn step(&mut self, display_time_ns: i64) {
        if let Some(t) = &mut self.timeline {
            t.step(1, display_time_ns);
        }
    }

    /// Sets another speed from a display time on.
    pub fn set_speed(&mut self, speed: Speed, display_time_ns: i64) {
        self.schedule.speed = speed;
        if let Some(t) = &mut self.timeline {
            t.set_speed(speed, display_time_ns);
        }
    }

    /// Starts positions at 0 again, with other content. It starts when it is ready, and the picture on the screen stays
    /// until then. Frames that were due and not shown are dropped.
    pub fn restart(&mut self) {
        self.give_up();
        self.timeline = None;
        self.start = Start::WhenReady { idle_sets: 0 };
        (self.shown, self.considered) = (None, 0);
    }

    /// Decides on the video frame at `vblank`, which is predicted to light up at `predicted_display_time_ns`. Video
    /// frames are requested in order, and a gap is a missed present.
    pub fn next(&mut self, vblank: u64, predicted_display_time_ns: i64, content: &dyn Content) -> Slot {
        let missed = self.last_vblank.map_or(0, |last| vblank.saturating_sub(last.saturating_add(1)));
        if self.last_vblank.is_some_and(|last| vblank <= last) {
            // The video frame is not new, which is an error of the caller. The picture on the screen stays.
            return Slot { what: What::Keep, video_frame: self.next_video_frame.saturating_sub(1), late: None };
        }
        self.last_vblank = Some(vblank);
        self.account.video_frames += 1 + missed;
        self.account.missed_presents += missed;
        let inside = self.next_video_frame > 0 && self.next_video_frame < self.schedule.decided_every();
        if missed > 0 && inside && !self.stretched {
            self.stretched = true;
            self.account.stretched_sets += 1;
        }
        if inside {
            let video_frame = self.next_video_frame;
            self.next_video_frame += 1;
            return Slot { what: What::Keep, video_frame, late: None };
        }
        let phase = self.first_start.map_or(0, |first| (vblank - first) % self.schedule.decided_every());
        if self.schedule.keep_phase && phase != 0 {
            self.account.held_video_frames += 1;
            return Slot { what: What::Keep, video_frame: self.schedule.set_frames - 1, late: None };
        }
        let slot = self.set_start(vblank, predicted_display_time_ns, content);
        if self.schedule.rolls { self.in_turn(slot) } else { slot }
    }

    /// Takes the video frames of rolling sets in order, from the first when content starts, and never skips one. The
    /// eye then always adds up equally many of each.
    fn in_turn(&mut self, slot: Slot) -> Slot {
        let begins = self.account.shown == 1 && matches!(slot.what, What::Set(_));
        let video_frame = if begins { 0 } else { self.turn };
        self.turn = (video_frame + 1) % self.schedule.set_frames;
        Slot { video_frame, ..slot }
    }

    fn set_start(&mut self, vblank: u64, time_ns: i64, content: &dyn Content) -> Slot {
        self.first_start.get_or_insert(vblank);
        self.pass_missed_starts(vblank);
        self.last_start = Some((vblank, time_ns));
        (self.next_video_frame, self.stretched) = (1, false);
        self.account.sets += 1;
        if self.timeline.is_none() {
            self.try_to_start(time_ns, content);
        }
        let Some(due) = self.due(time_ns) else { return self.idle(content) };
        if let Some(end) = content.end().filter(|end| due >= *end) {
            self.pass(end.saturating_sub(1), Cause::Rates);
            self.give_up();
            return self.ended();
        }
        let late = match content.readiness(due) {
            Readiness::Ready => None,
            Readiness::Read => Some(Cause::LateGpu),
            Readiness::Unread => Some(Cause::LateContent),
            Readiness::Damaged => Some(Cause::Damaged),
        };
        let late = late.filter(|_| self.shown.is_none_or(|s| s < due));
        self.pass(due, late.unwrap_or(Cause::MissedPresent));
        if let (Some(last), Some(cause)) = (self.pending.back_mut().filter(|p| p.0 == due), late) {
            last.1 = cause;
        }
        let oldest = self.shown.map_or(0, |s| s + 1).max(due.saturating_sub(LATEST as u64 - 1));
        let found = (oldest..=due).rev().find(|p| content.readiness(*p) == Readiness::Ready);
        if let Some(cause) = late {
            self.account.late_sets[cause as usize] += 1;
        }
        let Some(position) = found else {
            if late.is_none() {
                self.account.repeats += 1;
            }
            let what = if self.content_on_screen { What::Keep } else { What::Idle };
            return Slot { what, video_frame: 0, late };
        };
        while let Some((p, cause)) = self.pending.front().copied().filter(|p| p.0 <= position) {
            self.pending.pop_front();
            if p < position {
                self.account.dropped[cause as usize] += 1;
            }
        }
        self.shown = Some(position);
        self.content_on_screen = true;
        self.account.shown += 1;
        Slot { what: What::Set(position), video_frame: 0, late }
    }

    fn try_to_start(&mut self, time_ns: i64, content: &dyn Content) {
        let Schedule { content_rate, speed, .. } = self.schedule;
        let begin = match self.start {
            Start::At { display_time_ns } => Some(display_time_ns),
            Start::WhenReady { idle_sets } => {
                let ready = matches!(content.readiness(0), Readiness::Ready | Readiness::Damaged);
                (self.idle_sets >= idle_sets && (ready || content.end() == Some(0))).then_some(time_ns)
            }
        };
        self.timeline = begin.map(|begin| Timeline::new(content_rate, speed, begin));
        if let Some(timeline) = self.timeline.as_mut().filter(|_| self.schedule.waits) {
            timeline.pause(true, timeline.start_ns());
        }
    }

    /// Ends the playback and removes this video frame from the counts, because it is not shown.
    fn ended(&mut self) -> Slot {
        self.account.sets -= 1;
        self.account.video_frames -= 1;
        Slot { what: What::End, video_frame: 0, late: None }
    }

    fn idle(&mut self, content: &dyn Content) -> Slot {
        if content.end() == Some(0) {
            return self.ended();
        }
        self.idle_sets += 1;
        self.account.idle_sets += 1;
        let what = if self.content_on_screen { What::Keep } else { What::Idle };
        Slot { what, video_frame: 0, late: None }
    }

    /// Returns the position that is due for a set starting then. A content frame goes to the first set that starts no
    /// more than 3/8 of a video frame before its time. Then jitter of the display does no harm, and 24 Hz content on a
    /// 60 Hz display has no ties.
    fn due(&self, time_ns: i64) -> Option<u64> {
        self.timeline.as_ref().and_then(|t| t.due(time_ns.saturating_add(self.early_ns())))
    }

    fn early_ns(&self) -> i64 {
        self.schedule.display_rate.period_ns() * 3 / 8
    }

    /// Counts positions that were due at starts of sets that did not happen.
    fn pass_missed_starts(&mut self, vblank: u64) {
        let Some((last, time_ns)) = self.last_start else { return };
        let step = self.schedule.decided_every();
        let missed = (vblank - last).saturating_sub(1) / step;
        for i in 1..=missed.min(LONGEST_MISS) {
            let later = self.schedule.display_rate.time_of_ns((i * step) as i64);
            if let Some(due) = self.due(time_ns.saturating_add(later)) {
                self.pass(due, Cause::MissedPresent);
            }
        }
    }

    /// Marks everything up to `due` as due. Positions that were not due before are pending from now on, and `due` has
    /// this cause.
    fn pass(&mut self, due: u64, cause: Cause) {
        if due < self.considered {
            return;
        }
        let skipped = due - self.considered;
        let kept = skipped.min(LATEST as u64);
        self.account.dropped[Cause::Rates as usize] += skipped - kept;
        for position in due - kept..due {
            self.pending.push_back((position, Cause::Rates));
        }
        self.pending.push_back((due, cause));
        self.considered = due + 1;
        self.account.due += skipped + 1;
        while self.pending.len() > LATEST {
            if let Some((_, cause)) = self.pending.pop_front() {
                self.account.dropped[cause as usize] += 1;
            }
        }
    }

    fn give_up(&mut self) {
        while let Some((_, cause)) = self.pending.pop_front() {
            self.account.dropped[cause as usize] += 1;
        }
    }

    /// Returns the content frames that were due, are not shown, and still may be.
    pub fn pending(&self) -> usize {
        self.pending.len()
    }
}
