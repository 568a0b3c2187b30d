//! Defines the sidecar window, which is a preview of the tracked eye, served by the present thread.

use crate::optics::Pupil;
use crate::present::Desktop;
use crate::session::feeds::sets::FinishedSet;

/// State that a sidecar window receives after every video frame.
#[derive(Debug, Clone, Copy)]
pub struct Now {
    /// The estimated pupil of the eye.
    pub pupil: Pupil,
    /// True if the hologram follows the pupil.
    pub steered: bool,
    /// The multiplex sets of the display per second.
    pub sets_per_second: f64,
}

/// A request of the user of the sidecar window.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum UserRequest {
    /// The user made no request.
    Nothing,
    /// The user ends the session.
    Close,
    /// The user turns refinement for the tracked pupil on or off.
    Steer(bool),
}

/// A window next to the display. Its calls must not wait, because they have a fraction of a video frame.
pub trait SidecarWindow {
    /// Receives another set that is on the display, with its phases.
    fn shown(&mut self, set: &FinishedSet);

    /// Handles the input of the user and shows new content.
    ///
    /// # Errors
    /// Returns the failure as a sentence. The window is then closed, and the display continues.
    fn serve(&mut self, now: &Now) -> Result<UserRequest, String>;
}

/// Opens a sidecar window on the present thread. A failure is returned as a sentence.
pub type SidecarOpener = Box<dyn FnOnce(&mut Desktop) -> Result<Box<dyn SidecarWindow>, String> + Send>;

/// The switchable sources of the display that light a set from its beginning on.
#[derive(Debug, Clone, Copy)]
pub struct LitSources<'a> {
    /// The number of the set.
    pub set: u64,
    /// The beginning of the set (ns on the clock of the player).
    pub start_ns: i64,
    /// The indices of the sources for each color, from 0. The lists are empty if the display has no sources or they are
    /// not switched.
    pub colors: &'a [Vec<usize>],
}

/// Switches the sources of the display. The present thread calls it for each new set when the set is handed to the
/// display, a video frame before its light. It must not wait.
pub type SourceSwitch = Box<dyn FnMut(&LitSources<'_>) + Send>;
