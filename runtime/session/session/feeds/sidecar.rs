//! A window beside the display, served by the present thread in passing: one that shows what the tracked eye sees.

use crate::optics::Pupil;
use crate::present::Desktop;
use crate::session::feeds::sets::FinishedSet;

/// State that a sidecar window receives after every video frame.
#[derive(Debug, Clone, Copy)]
pub struct Now {
    /// The estimated pupil.
    pub pupil: Pupil,
    /// Whether the hologram follows it.
    pub steered: bool,
    /// Multiplex sets a second of the display.
    pub sets_per_second: f64,
}

/// What its user asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum UserRequest {
    /// Nothing.
    Nothing,
    /// To end the session.
    Close,
    /// That the hologram follows the eye, or does not.
    Steer(bool),
}

/// The window. Nothing of it may wait: it has a fraction of a video frame.
pub trait SidecarWindow {
    /// Another set is on the display. It carries its phases.
    fn shown(&mut self, set: &FinishedSet);

    /// Takes what its user did, and shows what is new.
    ///
    /// # Errors
    /// In a sentence; it is closed then, and the display goes on.
    fn serve(&mut self, now: &Now) -> Result<UserRequest, String>;
}

/// Opens it, on the present thread. Fails in a sentence.
pub type SidecarOpener = Box<dyn FnOnce(&mut Desktop) -> Result<Box<dyn SidecarWindow>, String> + Send>;

/// The display's switchable sources that light a set from its beginning on.
#[derive(Debug, Clone, Copy)]
pub struct LitSources<'a> {
    /// The set's number.
    pub set: u64,
    /// When it begins, on the player's clock, nanoseconds.
    pub start_ns: i64,
    /// The sources, colour by colour, by their places from 0; none where the display has none, or they are not steered.
    pub colors: &'a [Vec<usize>],
}

/// Switches the display's sources: told of each new set on the present thread, when it is handed to the display, a video frame before
/// its light. It must not wait.
pub type SourceSwitch = Box<dyn FnMut(&LitSources<'_>) + Send>;
