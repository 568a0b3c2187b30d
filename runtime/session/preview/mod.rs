//! Shows what an eye sees of a hologram, live, in an ordinary window.
//!
//! A [`Viewer`] is a thread that owns the engines: it is given what the display shows ([`PreviewContent`]) and where to look from
//! ([`Look`]) as often as either changes, and has the newest picture ([`RenderedView`]); what came in between is never computed. A
//! [`PreviewWindow`] shows such pictures in a window of the same [`Desktop`](crate::present::Desktop) as playback's, and
//! never makes the thread that serves it wait. [`Controls`] say what a mouse and keys mean; [`Reader`] reads the holograms
//! of a sequence on a thread of its own.
//!
//! Pure, and tested without a window: `place` (where pictures lie, which pupil the mouse means), `picture` (from light to
//! sRGB at any size), `controls`, `overlay` and its `font`.

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

/// Why there is nothing to see.
#[derive(Debug, thiserror::Error, serde::Serialize)]
#[error(transparent)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum PreviewError {
    /// The desktop.
    Desktop(#[from] PresentError),
    /// The engine, or the window's device.
    Engine(#[from] EngineError),
    /// The optics of what is shown.
    Optics(#[from] OpticsError),
    /// A hologram that could not be read.
    Hologram(#[from] HologramError),
    /// The hologram could not be looked at.
    Reconstruction(#[from] ReconstructionError),
    /// What is shown contradicts itself, or the scene.
    #[error("this cannot be looked at: {reason}")]
    Showing {
        /// What does not fit.
        reason: Reason,
    },
    /// A thread that could not be started, or ended without a word.
    #[error("the thread that {what} {reason}")]
    Thread {
        /// What it does.
        what: &'static str,
        /// What happened to it.
        reason: String,
    },
}
