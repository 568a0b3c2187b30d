//! Passes video frames to a ticking program.
//!
//! The session of the program is a [`TickedSession`](crate::session::TickedSession).

use crate::mailbox::Mailbox;
use crate::present::{Clock, Feedback, PresentError, Presenter, Rate, RealClock};
use crate::session::frame_log::account::Cause;
use crate::session::playback::player::PresentedFrame;
use std::cell::Cell;
use std::collections::VecDeque;
use std::rc::Rc;

/// A video frame as a program takes it.
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct TickedFrame {
    /// The bytes of the picture (row, column, channel).
    pub picture: Vec<u8>,
    /// The number of the video frame of the display. Frames without a tick count too.
    pub number: u64,
    /// The number of the hologram or of the refined set, or `None` for the idle picture.
    pub content: Option<u64>,
    /// The number of the video frame in its set.
    pub video_frame: u64,
    /// True if a set begins with it. `content` shows if the set is a different one.
    pub new: bool,
    /// The cause if a newer one was due and is not shown.
    pub late: Option<Cause>,
}

/// The mailboxes between the program and the present thread.
#[derive(Debug, Clone)]
pub(crate) struct Ticks {
    /// The time at which the next video frame lights up (ns on the steady clock), or `None` to end.
    pub asks: Mailbox<Option<u64>>,
    pub frames: Mailbox<Option<TickedFrame>>,
    /// The memory of video frames that were taken.
    pub spare: Mailbox<Vec<u8>>,
}

impl Ticks {
    pub(crate) fn new() -> Self {
        Self { asks: Mailbox::new(2), frames: Mailbox::new(2), spare: Mailbox::new(1) }
    }
}

/// Ends the wait of the thread for ticks when it is dropped.
pub(crate) struct LastTick(pub Ticks);

impl Drop for LastTick {
    fn drop(&mut self) {
        self.0.asks.push(None);
    }
}

/// The end of the present thread. When it is dropped, no more video frames follow.
pub(crate) struct TickProducer(pub Ticks);

impl TickProducer {
    pub(crate) fn put(&self, frame: &PresentedFrame<'_>) {
        let mut picture = self.0.spare.take().unwrap_or_default();
        picture.clear();
        picture.extend_from_slice(frame.picture);
        let (number, content, video_frame) = (frame.vblank, frame.index, frame.video_frame);
        let (new, late) = (frame.new, frame.late);
        self.0.frames.push(Some(TickedFrame { picture, number, content, video_frame, new, late }));
    }
}

impl Drop for TickProducer {
    fn drop(&mut self) {
        self.0.frames.push(None);
    }
}

/// A display whose video frames a [`TickedSession`](crate::session::TickedSession) takes.
#[derive(Debug, Clone)]
pub struct TickedOutput(pub(crate) Ticks);

impl TickedOutput {
    /// Returns the clock that waits for ticks, and the display.
    pub(crate) fn open(&self, real: RealClock, rate: Rate) -> (Rc<dyn Clock>, Box<dyn Presenter>) {
        let clock = Rc::new(TickedClock { real, ticks: self.0.clone(), lit_ns: Cell::new(0), over: Cell::new(false) });
        let presenter = TickedPresenter { clock: Rc::clone(&clock), rate, feedback: VecDeque::with_capacity(4) };
        (clock, Box::new(presenter))
    }
}

/// The steady clock of the system, which waits only for ticks.
struct TickedClock {
    real: RealClock,
    ticks: Ticks,
    /// The time at which the last requested video frame lights up (ns).
    lit_ns: Cell<i64>,
    over: Cell<bool>,
}

impl Clock for TickedClock {
    fn now_ns(&self) -> i64 {
        self.real.now_ns()
    }

    fn wait_until_ns(&self, _time_ns: i64) {}

    fn wait_for_tick(&self) {
        if self.over.get() {
            return;
        }
        match self.ticks.asks.wait() {
            Some(lit_ns) => self.lit_ns.set(self.real.at_monotonic_ns(lit_ns)),
            None => self.over.set(true),
        }
    }
}

/// Reports that video frames light up at the times that the program gave.
struct TickedPresenter {
    clock: Rc<TickedClock>,
    rate: Rate,
    feedback: VecDeque<Feedback>,
}

impl Presenter for TickedPresenter {
    fn describe(&self) -> String {
        format!("a program's own display at {} Hz", self.rate)
    }

    fn timed_by(&self) -> &'static str {
        "the program"
    }

    fn upload(&mut self, _picture: &[u8]) -> Result<(), PresentError> {
        // The observer of the session takes the picture.
        Ok(())
    }

    fn present(&mut self, id: u64, _desired_present_time_ns: i64) -> Result<(), PresentError> {
        self.feedback.push_back(Feedback { id, actual_display_time_ns: self.clock.lit_ns.get() });
        Ok(())
    }

    fn feedback(&mut self) -> Option<Feedback> {
        self.feedback.pop_front()
    }
}
