//! What passes between a program that ticks and the thread that decides what it is given ([`TickedSession`](crate::session::TickedSession)).

use crate::mailbox::Mailbox;
use crate::present::{Clock, Feedback, PresentError, Presenter, Rate, RealClock};
use crate::session::frame_log::account::Cause;
use crate::session::playback::player::PresentedFrame;
use std::cell::Cell;
use std::collections::VecDeque;
use std::rc::Rc;

/// A video frame, as a program takes it.
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct TickedFrame {
    /// (row, column, channel) of 8 bits.
    pub picture: Vec<u8>,
    /// Which video frame of the display; those that no tick was for are counted.
    pub number: u64,
    /// Which hologram of what is played, or which refined set; none for the idle picture.
    pub content: Option<u64>,
    /// Which video frame of its set.
    pub video_frame: u64,
    /// Whether a set begins with it; `content` says whether it is another one.
    pub new: bool,
    /// Why there is no newer one, where one was due.
    pub late: Option<Cause>,
}

/// What passes between the program and the thread that decides.
#[derive(Debug, Clone)]
pub(crate) struct Ticks {
    /// When the next video frame is to light up, on the steady clock; none to end.
    pub asks: Mailbox<Option<u64>>,
    pub frames: Mailbox<Option<TickedFrame>>,
    /// Memory of video frames that were taken.
    pub spare: Mailbox<Vec<u8>>,
}

impl Ticks {
    pub(crate) fn new() -> Self {
        Self { asks: Mailbox::new(2), frames: Mailbox::new(2), spare: Mailbox::new(1) }
    }
}

/// Dropped, it has the thread wait for no more ticks.
pub(crate) struct LastTick(pub Ticks);

impl Drop for LastTick {
    fn drop(&mut self) {
        self.0.asks.push(None);
    }
}

/// The thread's end: when it is dropped no more will come.
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
    /// The clock that waits for ticks, and the display.
    pub(crate) fn open(&self, real: RealClock, rate: Rate) -> (Rc<dyn Clock>, Box<dyn Presenter>) {
        let clock = Rc::new(TickedClock { real, ticks: self.0.clone(), lit_ns: Cell::new(0), over: Cell::new(false) });
        let presenter = TickedPresenter { clock: Rc::clone(&clock), rate, feedback: VecDeque::with_capacity(4) };
        (clock, Box::new(presenter))
    }
}

/// The system's steady clock, on which nothing is waited for but ticks.
struct TickedClock {
    real: RealClock,
    ticks: Ticks,
    /// When the video frame that was asked for last lights up.
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

/// Says that video frames light up when the program said.
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
        // The session's observer takes it.
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
