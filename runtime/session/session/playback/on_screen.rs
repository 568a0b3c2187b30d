//! Stores which version of a replaceable hologram is on the screen, as the present thread knows it.

use crate::hologram::{NewestHologram, OnScreen};

/// More video frames than a swapchain holds. Timing that depends on the acquisition of an image may miss every video
/// frame, but a frame that this many have followed has lit up.
const IN_FLIGHT: u64 = 16;

/// Tracks versions from their first video frame until their second set lights up. When it is dropped, no version is on
/// the screen.
pub(crate) struct VersionLog {
    newest: NewestHologram,
    set_frames: u64,
    /// The version that was handed over last, and its first video frame. It is `None` for the idle picture.
    handed_over: Option<OnScreen>,
}

impl VersionLog {
    /// Creates a log for sets of this many video frames.
    pub(crate) fn new(newest: NewestHologram, set_frames: u64) -> Self {
        newest.put_on_screen(None);
        Self { newest, set_frames, handed_over: None }
    }

    /// Records a video frame before it goes to the display, which may show it at once.
    pub(crate) fn hands_over(&mut self, id: u64, version: Option<u64>) {
        if version != self.handed_over.map(|shown| shown.version) {
            self.handed_over = version.map(|version| OnScreen { version, since: id });
            self.newest.put_on_screen(None);
        }
        self.lit(id.saturating_sub(IN_FLIGHT));
    }

    /// Records that a video frame and all before it have lit up.
    pub(crate) fn lit(&mut self, id: u64) {
        // In the second set, the lag of the pixels comes from the same set.
        if let Some(shown) = self.handed_over.filter(|shown| id >= shown.since + self.set_frames) {
            self.newest.put_on_screen(Some(shown));
        }
    }
}

impl Drop for VersionLog {
    fn drop(&mut self) {
        self.newest.put_on_screen(None);
    }
}
