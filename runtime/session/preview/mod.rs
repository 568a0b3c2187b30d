//! Shows the simulated image of a hologram, live, in an ordinary window.
//!
//! A [`Viewer`] is a thread that owns the engines. It receives the content of the display ([`PreviewContent`]) and the
//! view ([`Look`]) as often as either changes. It returns the newest picture ([`RenderedView`]) and never computes
//! requests that a newer one replaced.
//!
//! A [`PreviewWindow`] shows these pictures in a window of the same [`Desktop`](crate::present::Desktop) as that used
//! for playback. It never blocks the thread that serves it. [`Controls`] interpret the mouse and the keys. [`Reader`]
//! reads the holograms of a sequence on a thread of its own.
//!
//! These modules are pure and are tested without a window:
//!
//! - `place` computes the rectangles of the pictures and the pupil at a position of the mouse.
//!
//! - `picture` converts light to sRGB at any size.
//!
//! - `controls`, `overlay` and its `font` hold the user interface.

mod controls;
mod eye;
mod font;
mod overlay;
mod picture;
mod place;
mod reader;
mod showing;
#[cfg(test)]
mod tiled_tests;
mod viewer;
#[cfg(test)]
mod viewer_tests;
mod window;
mod worker;

pub use controls::{Action, Controls};
pub use eye::{Eye, Opener};
pub use overlay::{Overlay, draw_overlay};
pub use picture::{Detail, Picture, develop};
pub use place::{Rect, places, pupil_at};
pub use reader::{ReadHologram, Reader};
pub use showing::{PreviewColor, PreviewContent};
pub use viewer::{Look, RenderedView, Side, Viewer};
pub use window::PreviewWindow;

use crate::engine::EngineError;
use crate::hologram::HologramError;
use crate::optics::OpticsError;
use crate::present::PresentError;
use crate::reconstruction::ReconstructionError;
use eyebox_base::error::Reason;

/// An error of a preview.
#[derive(Debug, thiserror::Error, serde::Serialize)]
#[error(transparent)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum PreviewError {
    /// The desktop reported an error.
    Desktop(#[from] PresentError),
    /// The engine or the device of the window reported an error.
    Engine(#[from] EngineError),
    /// The optics of the content are not valid.
    Optics(#[from] OpticsError),
    /// A hologram could not be read.
    Hologram(#[from] HologramError),
    /// The hologram could not be rendered.
    Reconstruction(#[from] ReconstructionError),
    /// The content contradicts itself or the scene.
    #[error("preview content: {reason}")]
    Showing {
        /// The parts that contradict each other.
        reason: Reason,
    },
    /// A thread could not be started, or ended without an answer.
    #[error("the thread that {what} {reason}")]
    Thread {
        /// The task of the thread, as a verb phrase.
        what: &'static str,
        /// The event that ended the thread.
        reason: String,
    },
}
