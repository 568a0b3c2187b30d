//! Video frames on their way to Python: copied once, from the session's memory, which goes on to the next, into memory that becomes
//! NumPy's.

use eyebox::session::PresentedFrame;
use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// A video frame that was shown.
pub(crate) struct DisplayedFrame {
    /// (row, column, channel).
    pub(crate) pixels: Vec<u8>,
    /// Which video frame of the display.
    pub(crate) number: u64,
    /// When it lights up, on the display's clock.
    pub(crate) lit_ns: i64,
    /// Which hologram of the content; none for the idle picture.
    pub(crate) hologram: Option<u64>,
    /// Which video frame of its set.
    pub(crate) part: u64,
    /// Whether the set is new.
    pub(crate) new: bool,
    /// Why not, or why late.
    pub(crate) late: Option<&'static str>,
}

#[derive(Default)]
struct Waiting {
    frames: VecDeque<DisplayedFrame>,
    left_out: u64,
    /// No more will come.
    over: bool,
    /// Nobody will take any.
    given_up: bool,
}

/// Python's end.
#[derive(Clone)]
pub(crate) struct Frames {
    shared: Arc<(Mutex<Waiting>, Condvar)>,
    most: usize,
    /// Whether the display waits for Python, as one whose time is simulated does; else the oldest are given up.
    waits: bool,
}

impl Frames {
    pub(crate) fn new(most: usize, waits: bool) -> Self {
        Self { shared: Arc::default(), most, waits }
    }

    fn lock(&self) -> MutexGuard<'_, Waiting> {
        self.shared.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The session's end: when it is dropped no more will come.
    pub(crate) fn sender(&self) -> Sender {
        Sender(self.clone())
    }

    /// The oldest that waits, or none where no more will come; fails where nothing came in time.
    pub(crate) fn take(&self, patience: Duration) -> Result<Option<DisplayedFrame>, ()> {
        let empty = |w: &mut Waiting| w.frames.is_empty() && !w.over && !w.given_up && self.most > 0;
        let waited = self.shared.1.wait_timeout_while(self.lock(), patience, empty);
        let mut waiting = waited.map_or_else(|poisoned| poisoned.into_inner().0, |(waiting, _)| waiting);
        if empty(&mut waiting) {
            return Err(());
        }
        let shown = waiting.frames.pop_front();
        drop(waiting);
        self.shared.1.notify_all();
        Ok(shown)
    }

    /// How many were given up.
    pub(crate) fn left_out(&self) -> u64 {
        self.lock().left_out
    }

    /// Nobody will take any more.
    pub(crate) fn give_up(&self) {
        self.lock().given_up = true;
        self.shared.1.notify_all();
    }
}

/// The session's end.
pub(crate) struct Sender(Frames);

impl Sender {
    /// Takes in what is shown.
    pub(crate) fn put(&mut self, frame: &PresentedFrame<'_>) {
        let frames = &self.0;
        let full = |waiting: &mut Waiting| waiting.frames.len() >= frames.most;
        let mut waiting = frames.lock();
        if frames.waits {
            let wait = |w: &mut Waiting| full(w) && !w.given_up;
            waiting = frames.shared.1.wait_while(waiting, wait).unwrap_or_else(PoisonError::into_inner);
        }
        if waiting.given_up {
            return;
        }
        // The memory of one that is given up is of use for the next.
        let spare = if full(&mut waiting) { waiting.frames.pop_front() } else { None };
        waiting.left_out += u64::from(spare.is_some());
        drop(waiting);
        let mut pixels = spare.map(|spare| spare.pixels).unwrap_or_default();
        pixels.clear();
        pixels.extend_from_slice(frame.picture);
        frames.lock().frames.push_back(DisplayedFrame {
            pixels,
            number: frame.vblank,
            lit_ns: frame.predicted_display_time_ns,
            hologram: frame.index,
            part: frame.video_frame,
            new: frame.new,
            late: frame.late.map(|cause| cause.name()),
        });
        frames.shared.1.notify_all();
    }
}

impl Drop for Sender {
    fn drop(&mut self) {
        self.0.lock().over = true;
        self.0.shared.1.notify_all();
    }
}
