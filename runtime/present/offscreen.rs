//! Presents to memory, with video frames that light up at the ticks of a clock.

use super::{Clock, Feedback, PresentError, Presenter, Rate, Sink};
use eyebox_base::reason;
use std::collections::VecDeque;
use std::rc::Rc;

/// A presenter without a display. Video frames light up one period after the other, and the newest is stored.
pub struct Offscreen {
    clock: Rc<dyn Clock>,
    rate: Rate,
    first_time_ns: Option<i64>,
    next: i64,
    picture: Vec<u8>,
    feedback: VecDeque<Feedback>,
    sink: Option<Sink>,
}

/// Video frames that may wait to light up, as in a swapchain.
const QUEUE: i64 = 2;

impl Offscreen {
    /// Makes a presenter of pictures with this number of bytes.
    pub fn new(clock: Rc<dyn Clock>, rate: Rate, picture_bytes: usize) -> Self {
        let feedback = VecDeque::with_capacity(16);
        Self { clock, rate, first_time_ns: None, next: 0, picture: vec![0; picture_bytes], feedback, sink: None }
    }

    /// Sends every video frame to a sink, too.
    pub fn with_sink(self, sink: Option<Sink>) -> Self {
        Self { sink, ..self }
    }

    /// The video frame that is lit, or will be next.
    pub fn picture(&self) -> &[u8] {
        &self.picture
    }
}

impl Presenter for Offscreen {
    fn describe(&self) -> String {
        let clock = if self.clock.is_simulated() { "simulated" } else { "real" };
        format!("offscreen at {} Hz, {clock} clock", self.rate)
    }

    fn upload(&mut self, picture: &[u8]) -> Result<(), PresentError> {
        if picture.len() != self.picture.len() {
            let reason = reason!(
                "picture-length",
                "a picture has {} bytes, and {} were expected",
                picture.len(),
                self.picture.len()
            );
            return Err(PresentError::Display { presenter: self.describe(), reason });
        }
        self.picture.copy_from_slice(picture);
        Ok(())
    }

    fn present(&mut self, id: u64, desired_present_time_ns: i64) -> Result<(), PresentError> {
        if let Some(sink) = &mut self.sink {
            sink.put(&self.picture, desired_present_time_ns)?;
        }
        let now = self.clock.now_ns();
        let first = *self.first_time_ns.get_or_insert(now.max(desired_present_time_ns));
        // The next tick that is not over yet.
        while first.saturating_add(self.rate.time_of_ns(self.next)) < now {
            self.next += 1;
        }
        let actual_display_time_ns = first.saturating_add(self.rate.time_of_ns(self.next));
        self.next += 1;
        if self.feedback.len() == self.feedback.capacity() {
            self.feedback.pop_front();
        }
        self.feedback.push_back(Feedback { id, actual_display_time_ns });
        // A caller that is too far ahead has to wait, as with a swapchain.
        let behind = first.saturating_add(self.rate.time_of_ns(self.next - QUEUE));
        if self.clock.now_ns() < behind {
            self.clock.wait_until_ns(behind);
        }
        Ok(())
    }

    fn feedback(&mut self) -> Option<Feedback> {
        let due = self.feedback.front().is_some_and(|f| f.actual_display_time_ns <= self.clock.now_ns());
        if due { self.feedback.pop_front() } else { None }
    }

    fn finish(&mut self) -> Result<(), PresentError> {
        self.sink.as_mut().map_or(Ok(()), Sink::finish)
    }
}
