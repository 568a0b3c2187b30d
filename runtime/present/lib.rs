//! Brings video frames to light in a window, on a direct display or in memory, and reports when each one lit up.
//!
//! A [`Presenter`] takes video frames in order. [`Offscreen`] is memory, with its [`Sink`]s. A [`DisplayPresenter`] is
//! a window over a monitor of the [`Desktop`], or a display that no desktop drives ([`direct_displays`]).
//! [`OrdinaryWindow`] is a resizable window on the same desktop. Both show pictures through a [`Swapchain`]. Its
//! [`Policy`] decides if every picture counts or only the newest. All swapchains of a program share one
//! [`Gpu`](eyebox_compute::gpu::Gpu), which is opened to present.
//!
//! The modules divide the work as follows. `surface` is the target of a swapchain. `slot` is a picture in flight, and `copy` writes it into an image.
//! `recreate` replaces a swapchain that is out of date. `timing` measures when pictures light up. `direct` takes
//! displays, with their `modes` and the `connectors` of the system. `monitor` selects a monitor of a desktop. `system`
//! holds the differences between desktops. `x_server` handles the loss of an X server. `interference` names the effects
//! of a desktop on levels and light. `link` finds them and sets them right, and `x_observer` runs its checks. `clock` is
//! real or simulated, and `rate` is an exact frequency.
//!
//! [`test_picture`] draws a picture for the link, and [`judge_capture`] finds what the link changed in it.
//!
//! [`plm`] sets up the controllers of phase light modulators.
//!
//! Every name of a time has its unit and its meaning.

mod clock;
#[cfg(feature = "direct-display")]
mod connectors;
mod copy;
mod desktop;
#[cfg(feature = "direct-display")]
mod direct;
mod display;
mod interference;
mod link;
#[cfg(feature = "direct-display")]
mod modes;
mod monitor;
mod offscreen;
pub mod plm;
mod presenter;
mod rate;
mod recreate;
mod sink;
mod slot;
mod surface;
mod swapchain;
#[cfg(all(test, target_os = "linux"))]
mod swapchain_tests;
#[cfg_attr(windows, path = "system_windows.rs")]
#[cfg_attr(not(any(unix, windows)), path = "system_other.rs")]
#[cfg_attr(target_vendor = "apple", path = "system_other.rs")]
mod system;
mod test_picture;
mod timing;
pub mod trigger;
mod two_panels;
#[cfg(not(all(unix, not(target_vendor = "apple"))))]
mod unobserved;
mod window;
#[cfg(all(unix, not(target_vendor = "apple")))]
mod x_observer;
#[cfg(all(unix, not(target_vendor = "apple")))]
mod x_server;

pub use clock::{Clock, RealClock, SimulatedClock};
pub use desktop::{Desktop, SharedDesktop};
#[cfg(feature = "direct-display")]
pub use direct::{direct_displays, direct_link};
pub use display::DisplayPresenter;
pub use interference::Interference;
pub use link::{Link, LinkCheck, LinkPart, LinkState, LinkSystem};
#[cfg(feature = "direct-display")]
pub use modes::{DirectDisplay, DirectMode};
pub use monitor::Monitor;
pub use offscreen::Offscreen;
pub use presenter::{Apart, Event, Feedback, Presenter};
pub use rate::{Rate, SECOND_NS};
pub use sink::Sink;
pub use surface::WindowHandle;
pub use swapchain::{Policy, Swapchain};
pub use test_picture::{CaptureReport, LinkFault, TestPictureError, judge_capture, test_picture};
pub use timing::PresentTiming;
pub use two_panels::TwoPanels;
pub use window::{OrdinaryWindow, WindowEvent, WindowKey};

use eyebox_base::error::Reason;
use eyebox_base::files::FileError;

/// An error between a video frame and its light.
#[derive(Debug, thiserror::Error, serde::Serialize)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum PresentError {
    /// The rate is impossible.
    #[error("the rate {value} is impossible: give hertz, 0.001 to 100000, such as 60, 59.94 or 60000/1001")]
    Rate {
        /// The text that was given.
        value: String,
    },
    /// A file for video frames failed.
    #[error(transparent)]
    File(#[from] FileError),
    /// A test picture or its capture is unusable.
    #[error(transparent)]
    TestPicture(#[from] TestPictureError),
    /// The display was rejected or lost.
    #[error("{presenter}: {reason}")]
    Display {
        /// Name of the presenter.
        presenter: String,
        /// The problem and the remedy.
        reason: Reason,
    },
}

impl PresentError {
    fn display(presenter: &str, reason: impl Into<Reason>) -> Self {
        Self::Display { presenter: presenter.into(), reason: reason.into() }
    }
}

fn no_desktop(reason: Reason) -> PresentError {
    PresentError::display("the desktop", reason)
}
