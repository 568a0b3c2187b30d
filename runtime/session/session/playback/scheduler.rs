//! What to show at the next video frame: pure, without a clock, a thread or a device.
//!
//! A multiplex set takes some video frames of the display, one after the other. Only before the first of them is
//! anything decided: the newest content frame that is due and ready is shown, else the set on screen is repeated, whole.
//! Each content frame that is never shown is dropped for one cause: what was the matter at the last start of a set at
//! which it was due. If there was no such start, it is a missed present where a start was missed at which it would have
//! been due, and else the rates: content is faster than the sets.

use crate::present::Rate;
use crate::session::frame_log::account::{Account, Cause};
use crate::session::playback::timeline::{Speed, Timeline};
use std::collections::VecDeque;

/// A set to come.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Target {
    /// When it begins to be lit.
    pub start_ns: i64,
    /// When it has to be handed over.
    pub hand_over_ns: i64,
    /// Of sets that roll: the video frame whose turn it is then.
    pub turn: u64,
}

/// How far a content frame has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Readiness {
    /// Not read from the disk.
    Unread,
    /// Read, and not encoded or not on the device yet.
    Read,
    /// Can be shown now.
    Ready,
    /// Will never be: its checksum is wrong.
    Damaged,
}

/// Content as the scheduler sees it, by position on the [`Timeline`].
pub trait Content {
    /// How far a position has come.
    fn readiness(&self, position: u64) -> Readiness;
    /// The first position that will never be, once that is known.
    fn end(&self) -> Option<u64>;
}

/// When position 0 is due.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Start {
    /// As soon as it is ready, after so many sets of the idle picture.
    WhenReady {
        /// Sets of the idle picture that come first, whatever is ready.
        idle_sets: u64,
    },
    /// At this time, whether ready or not: what several displays agree on.
    At {
        /// On the player's clock.
        display_time_ns: i64,
    },
}

/// What does not change while playing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Schedule {
    /// Video frames a second.
    pub display_rate: Rate,
    /// Content frames a second.
    pub content_rate: Rate,
    /// Of content.
    pub speed: Speed,
    /// Video frames of a multiplex set.
    pub set_frames: u64,
    /// Sets roll: every video frame is decided on, and shows the one of the newest set whose turn it is, so that the newest
    /// sub-frames replace the oldest. What is counted as a set is one such decision.
    pub rolls: bool,
    /// When content begins.
    pub start: Start,
    /// Sets start only a multiple of `set_frames` after the first, however many presents are missed: for lasers that
    /// count video frames by themselves.
    pub keep_phase: bool,
}

impl Schedule {
    pub(crate) fn decided_every(&self) -> u64 {
        if self.rolls { 1 } else { self.set_frames }
    }
}

/// What a video frame shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum What {
    /// The idle picture (a sync frame, or flat).
    Idle,
    /// The same set as before.
    Keep,
    /// The set of this position, new.
    Set(u64),
    /// Nothing more: the last set was up for its time.
    End,
}

/// A decision.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Slot {
    /// What is shown.
    pub what: What,
    /// Which video frame of the set.
    pub video_frame: u64,
    /// Why a set that should have been new is not, or is late.
    pub late: Option<Cause>,
}

/// How many content frames behind the one that is due may still be shown, when nothing newer is ready.
const LATEST: usize = 64;
/// Starts of sets missed in one piece that are looked at one by one.
const LONGEST_MISS: u64 = 1 << 20;

/// Decides, and keeps the account.
#[derive(Debug, Clone)]
pub struct Scheduler {
    schedule: Schedule,
    timeline: Option<Timeline>,
    start: Start,
    account: Account,
    /// Newest position on screen, of this run of positions.
    shown: Option<u64>,
    /// Whether the set on screen is content at all.
    content_on_screen: bool,
    /// First position of which it is not yet known whether it was due.
    considered: u64,
    /// Positions that were due and are not shown yet, ascending, each with its cause.
    pending: VecDeque<(u64, Cause)>,
    /// Video frame and predicted time of the last set's start.
    last_start: Option<(u64, i64)>,
    last_vblank: Option<u64>,
    first_start: Option<u64>,
    next_video_frame: u64,
    /// Of sets that roll, the video frame whose turn is next.
    turn: u64,
    stretched: bool,
    idle_sets: u64,
}

impl Scheduler {
    /// Nothing was shown yet.
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

    /// What was shown so far, and why not more.
    pub fn account(&self) -> &Account {
        &self.account
    }

    /// The rates and the like.
    pub fn schedule(&self) -> &Schedule {
        &self.schedule
    }

    /// Whether content stands still.
    pub fn is_paused(&self) -> bool {
        self.timeline.as_ref().is_some_and(Timeline::is_paused)
    }

    /// The oldest position that a set starting at `predicted_display_time_ns` would still show; readers may leave out
    /// what is older.
    pub(crate) fn useful_from(&self, predicted_display_time_ns: i64) -> u64 {
        let due = self.due(predicted_display_time_ns).unwrap_or(0);
        due.max(self.shown.map_or(0, |s| s + 1))
    }

    /// Of sets that roll, the video frame whose turn it is with the next content that is shown; else 0.
    pub(crate) fn turn(&self) -> u64 {
        if self.account.shown == 0 { 0 } else { self.turn }
    }

    /// The position that a video frame lighting up then would show new, were it ready; none where nothing new is due.
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

    /// Content stands still from a display time on, or goes on from it.
    pub fn pause(&mut self, paused: bool, display_time_ns: i64) {
        if let Some(t) = &mut self.timeline {
            t.pause(paused, display_time_ns);
        }
    }

    /// One content frame on, and stands still.
    pub fn step(&mut self, display_time_ns: i64) {
        if let Some(t) = &mut self.timeline {
            t.step(1, display_time_ns);
        }
    }

    /// Another speed from a display time on.
    pub fn set_speed(&mut self, speed: Speed, display_time_ns: i64) {
        self.schedule.speed = speed;
        if let Some(t) = &mut self.timeline {
            t.set_speed(speed, display_time_ns);
        }
    }

    /// Positions begin at 0 again, with content from elsewhere; it starts when it is ready, and what is on screen stays
    /// until then. What was due and not shown is dropped.
    pub fn restart(&mut self) {
        self.give_up();
        self.timeline = None;
        self.start = Start::WhenReady { idle_sets: 0 };
        (self.shown, self.considered) = (None, 0);
    }

    /// What the video frame at `vblank` shows, which is predicted to light up at `predicted_display_time_ns`. Video
    /// frames are asked for in order; a gap is a missed present.
    pub fn next(&mut self, vblank: u64, predicted_display_time_ns: i64, content: &dyn Content) -> Slot {
        let missed = self.last_vblank.map_or(0, |last| vblank.saturating_sub(last.saturating_add(1)));
        if self.last_vblank.is_some_and(|last| vblank <= last) {
            // Not a new video frame: the caller's fault, and what is on screen stays.
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

    /// Of sets that roll: one video frame after the other, beginning with the first when content does, and never skipping one:
    /// what the eye adds up is always as many of each as of the others.
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
    }

    /// Nothing more: what was counted for this video frame is not shown.
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

    /// The position due for a set that starts then. A content frame goes to the first set that starts no more than 3/8 of
    /// a video frame before its time: jitter of the display's time does no harm, and 24 a second on 60 is no tie.
    fn due(&self, time_ns: i64) -> Option<u64> {
        self.timeline.as_ref().and_then(|t| t.due(time_ns.saturating_add(self.early_ns())))
    }

    fn early_ns(&self) -> i64 {
        self.schedule.display_rate.period_ns() * 3 / 8
    }

    /// Positions that were due at starts of sets that did not happen.
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

    /// Everything up to `due` was due; what was not before is pending from now on, `due` itself for this cause.
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

    /// Content frames that were due, are not shown, and still may be.
    pub fn pending(&self) -> usize {
        self.pending.len()
    }
}
