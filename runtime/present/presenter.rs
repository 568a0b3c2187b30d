//! The display's side: takes video frames in order and says when they lit up.

use super::{Interference, PresentError};
use eyebox_base::reason;
use eyebox_compute::gpu::{Gpu, Pictures, PixelOrder};

/// When a video frame lit up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Feedback {
    /// The number that it was handed over with.
    pub id: u64,
    /// On the player's clock.
    pub actual_display_time_ns: i64,
}

/// What a user did to a presenter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Event {
    /// Closed it.
    Close,
    /// Asked for content to stand still, or to go on.
    Pause,
    /// Asked for the next content frame.
    Step,
    /// Asked for so many content frames further.
    Seek(i64),
    /// Asked for content to run so many times as fast as now.
    Faster(f64),
}

/// A display, a window, or memory.
///
/// Video frames are shown one after the other, none left out (FIFO), each for at least one period; the last one stays.
pub trait Presenter {
    /// For people: what it is, and how it learns when frames light up.
    fn describe(&self) -> String;

    /// For people and statistics: how it is known when video frames light up.
    fn timed_by(&self) -> &'static str {
        "its own clock"
    }

    /// Takes in a video frame, (row, column, channel) of 8 bits, 1 or 3 channels: exactly what the display receives.
    ///
    /// # Errors
    /// [`PresentError::Display`]: it is lost, in a sentence.
    fn upload(&mut self, picture: &[u8]) -> Result<(), PresentError>;

    /// The device, and the order of colours, of pictures that [`take`](Self::take) takes; none where video frames come from
    /// the host only.
    fn takes(&self) -> Option<(&Gpu, PixelOrder)> {
        None
    }

    /// Takes in a video frame that is on that device already, as [`upload`](Self::upload) does from the host.
    ///
    /// # Errors
    /// [`PresentError::Display`]: it is lost, or takes none such, in a sentence.
    fn take(&mut self, _pictures: &Pictures, _index: usize) -> Result<(), PresentError> {
        Err(PresentError::display(&self.describe(), reason!("host-only", "it takes video frames from the host only")))
    }

    /// Puts the video frame that was taken in last in line. `id` rises from call to call; `desired_present_time_ns` is
    /// the player's plan, on its clock.
    ///
    /// # Errors
    /// [`PresentError::Display`]: it is lost, in a sentence.
    fn present(&mut self, id: u64, desired_present_time_ns: i64) -> Result<(), PresentError>;

    /// The next video frame that is known to have lit up, in order.
    fn feedback(&mut self) -> Option<Feedback>;

    /// Brings to its end what is still on its way; the last video frame stays.
    ///
    /// # Errors
    /// [`PresentError::Display`], [`PresentError::File`].
    fn finish(&mut self) -> Result<(), PresentError> {
        Ok(())
    }

    /// Returns what began to change or blank the display's picture since the last call, as far as the system reports it.
    fn interference(&mut self) -> Vec<Interference> {
        Vec::new()
    }

    /// The next thing that a user did.
    fn event(&mut self) -> Option<Event> {
        None
    }
}
