//! Video frames to light: presenters, and when what they were given lit up.
//!
//! A [`Presenter`] takes video frames in order: [`Offscreen`] is memory (with its [`Sink`]s), [`DisplayPresenter`] a window
//! over a monitor of the [`Desktop`], or one of the [`DirectDisplays`] that no desktop drives. [`OrdinaryWindow`] is a
//! resizable window beside it on the same desktop.
//!
//! Below them: `monitor` (which one is meant), `x_server` (what happens when an X server goes away), `clock` (real or
//! simulated) and `rate` (how often, exactly). Every time carries its unit and its meaning in its name.

mod clock;
mod desktop;
mod direct;
mod display;
mod monitor;
mod offscreen;
mod presenter;
mod rate;
mod sink;
mod window;
mod x_server;

pub use clock::{Clock, RealClock, SimulatedClock};
pub use desktop::Desktop;
pub use direct::{Connected, DirectDisplays};
pub use display::DisplayPresenter;
pub use monitor::Monitor;
pub use offscreen::Offscreen;
pub use presenter::{Event, Feedback, Presenter};
pub use rate::{Rate, SECOND_NS};
pub use sink::Sink;
pub use window::{OrdinaryWindow, WindowEvent, WindowKey};

use crate::files::FileError;

/// What can go wrong between a video frame and its light.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PresentError {
    /// A rate that cannot be.
    #[error("the rate {value} cannot be: give hertz, 0.001 to 100000, such as 60, 59.94 or 60000/1001")]
    Rate {
        /// What was given.
        value: String,
    },
    /// A file that takes video frames.
    #[error(transparent)]
    File(#[from] FileError),
    /// The display: refused, or lost.
    #[error("{presenter}: {reason}")]
    Display {
        /// Which one.
        presenter: String,
        /// What is wrong, and what would be right.
        reason: String,
    },
}

impl PresentError {
    fn display(presenter: &str, reason: impl ToString) -> Self {
        Self::Display { presenter: presenter.into(), reason: reason.to_string() }
    }
}

fn no_desktop(reason: String) -> PresentError {
    PresentError::display("the desktop", reason)
}
