//! Video frames on their way to Python. The session reuses its memory for the next frame, so each frame is copied once,
//! into memory that becomes NumPy's.

use eyebox::session::PresentedFrame;
use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// A video frame that the display has shown.
pub(crate) struct DisplayedFrame {
    /// The bytes of the frame (row, column, channel).
    pub(crate) pixels: Vec<u8>,
    /// The number of the video frame on the display.
    pub(crate) number: u64,
    /// The time at which it lights up, in ns of the display's clock.
    pub(crate) lit_ns: i64,
    /// The number of its hologram in the content, or `None` for the idle picture.
    pub(crate) hologram: Option<u64>,
    /// The number of the video frame in its set.
    pub(crate) part: u64,
    /// True if the set is new.
    pub(crate) new: bool,
    /// The reason why the set is not new, or why it is late.
    pub(crate) late: Option<&'static str>,
}

#[derive(Default)]
struct Waiting {
    frames: VecDeque<DisplayedFrame>,
    left_out: u64,
    /// True if no more frames will come.
    over: bool,
    /// True if no reader will take a frame any more.
    given_up: bool,
}

/// The end of the queue that Python reads.
#[derive(Clone)]
pub(crate) struct Frames {
    shared: Arc<(Mutex<Waiting>, Condvar)>,
    most: usize,
    /// True if the display waits for Python, as a display with simulated time does. Otherwise the oldest frames are
    /// dropped.
    waits: bool,
}

impl Frames {
    pub(crate) fn new(most: usize, waits: bool) -> Self {
        Self { shared: Arc::default(), most, waits }
    }

    fn lock(&self) -> MutexGuard<'_, Waiting> {
        self.shared.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the sender for the session. Once it is dropped, no more frames will come.
    pub(crate) fn sender(&self) -> Sender {
        Sender(self.clone())
    }

    /// Takes the oldest frame that waits, or `None` if no more will come. Fails if no frame came in time.
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

    /// Returns the number of dropped frames.
    pub(crate) fn left_out(&self) -> u64 {
        self.lock().left_out
    }

    /// Ends the reading, so the session no longer waits for Python.
    pub(crate) fn give_up(&self) {
        self.lock().given_up = true;
        self.shared.1.notify_all();
    }
}

/// The end of the queue that the session fills.
pub(crate) struct Sender(Frames);

impl Sender {
    /// Adds a copy of a frame that is shown.
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
        // The new frame reuses the memory of a dropped one.
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
