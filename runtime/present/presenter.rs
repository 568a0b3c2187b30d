//! Defines presenters, which take video frames in order and report when they lit up.

use super::link::Link;
use super::{Interference, PresentError};
use eyebox_base::reason;
use eyebox_compute::gpu::{Gpu, Pictures, PixelOrder};

/// The time at which a video frame lit up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Feedback {
    /// The number of the frame at its presentation.
    pub id: u64,
    /// The time on the player's clock.
    pub actual_display_time_ns: i64,
}

/// The distance in time between the lights of two panels.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Apart {
    /// The video frames whose lights both panels reported.
    pub video_frames: u64,
    /// The video frames that the panels lit more than half a period apart.
    pub in_other_periods: u64,
    /// The sum of the distances, and the largest one (ns).
    pub(super) sum_ns: u64,
    pub(super) largest_ns: u64,
}

impl Apart {
    /// Returns the mean distance (ms).
    pub fn mean_ms(&self) -> f64 {
        self.sum_ns as f64 / self.video_frames.max(1) as f64 * 1e-6
    }

    /// Returns the largest distance (ms).
    pub fn largest_ms(&self) -> f64 {
        self.largest_ns as f64 * 1e-6
    }
}

/// An action of a user on a presenter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Event {
    /// The user closed the presenter.
    Close,
    /// The user paused or resumed the content.
    Pause,
    /// The user requested the next content frame.
    Step,
    /// The user requested a jump by this number of content frames.
    Seek(i64),
    /// The user requested another speed, this factor times the current one.
    Faster(f64),
}

/// A display, a window, or memory that shows video frames.
///
/// Video frames are shown in order and none is left out (FIFO). Each is shown for at least one period, and the last one
/// stays.
pub trait Presenter {
    /// A description in words, with the source of presentation times.
    fn describe(&self) -> String;

    /// The source of presentation times, in words for users and statistics.
    fn timed_by(&self) -> &'static str {
        "its own clock"
    }

    /// Takes a video frame, (row, column, channel) of 8 bits with 1 or 3 channels, exactly as the display receives it.
    ///
    /// # Errors
    /// [`PresentError::Display`] with a sentence, if the display is lost.
    fn upload(&mut self, picture: &[u8]) -> Result<(), PresentError>;

    /// The device, and the order of colors, of pictures for [`take`](Self::take). It is none if video frames come only
    /// from the host.
    fn takes(&self) -> Option<(&Gpu, PixelOrder)> {
        None
    }

    /// Takes a video frame that is already on that device, as [`upload`](Self::upload) does from the host.
    ///
    /// # Errors
    /// [`PresentError::Display`] with a sentence, if the display is lost or takes only frames from the host.
    fn take(&mut self, _pictures: &Pictures, _index: usize) -> Result<(), PresentError> {
        Err(PresentError::display(&self.describe(), reason!("host-only", "it takes video frames from the host only")))
    }

    /// Queues the video frame that was taken last. `id` rises from call to call. `desired_present_time_ns` is the
    /// player's plan, on its clock.
    ///
    /// # Errors
    /// [`PresentError::Display`] with a sentence, if the display is lost.
    fn present(&mut self, id: u64, desired_present_time_ns: i64) -> Result<(), PresentError>;

    /// The next video frame with a known time of light, in order.
    fn feedback(&mut self) -> Option<Feedback>;

    /// Completes all pending work. The last video frame stays.
    ///
    /// # Errors
    /// [`PresentError::Display`] or [`PresentError::File`] if that fails.
    fn finish(&mut self) -> Result<(), PresentError> {
        Ok(())
    }

    /// Returns the link between the swapchain and the panel, as it was when the presenter was opened.
    fn link(&self) -> Option<&Link> {
        None
    }

    /// Returns the links of all panels, the left one first.
    fn links(&self) -> Vec<&Link> {
        self.link().into_iter().collect()
    }

    /// Returns what happened to one panel of several since the last call, in words for notes.
    fn panel_notes(&mut self) -> Vec<String> {
        Vec::new()
    }

    /// Returns how far apart the panels lit their video frames, if there are two.
    fn apart(&self) -> Option<Apart> {
        None
    }

    /// Returns the changes or blanking of the display's picture that began since the last call, as far as the system
    /// reports them.
    fn interference(&mut self) -> Vec<Interference> {
        Vec::new()
    }

    /// The next action of a user.
    fn event(&mut self) -> Option<Event> {
        None
    }
}
