//! Brings video frames to light in a window, on a direct display or in memory, and reports when each one lit up.
//!
//! A [`Presenter`] takes video frames in order: [`Offscreen`] is memory (with its [`Sink`]s), a [`DisplayPresenter`] a window
//! over a monitor of the [`Desktop`], or a display that no desktop drives ([`direct_displays`]). [`OrdinaryWindow`] is a
//! resizable window beside it on the same desktop. Both show by a [`Swapchain`], whose [`Policy`] says whether every picture
//! counts or the newest; all swapchains of a program share one [`Gpu`](eyebox_compute::gpu::Gpu), opened to present.
//!
//! `surface` is what a swapchain is on; `slot` a picture under way and `copy` how it gets into an image; `recreate` what happens when it is no longer
//! right; `timing` says when pictures lit up. `direct` takes displays, by their `modes` and the system's `connectors`;
//! `monitor` says which of a desktop's is meant; `system` what desktops do differently, `x_server` what happens when an X server goes away; `interference` names what a desktop
//! does to levels and light, and `x_observer` reads it. `clock` is real or
//! simulated, `rate` says how often, exactly. Every time carries its unit and its meaning in its name.

mod clock;
#[cfg(feature = "direct-display")]
mod connectors;
mod copy;
mod desktop;
#[cfg(feature = "direct-display")]
mod direct;
mod display;
mod interference;
#[cfg(feature = "direct-display")]
mod modes;
mod monitor;
mod offscreen;
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
mod timing;
#[cfg(not(all(unix, not(target_vendor = "apple"))))]
mod unobserved;
mod window;
#[cfg(all(unix, not(target_vendor = "apple")))]
mod x_observer;
#[cfg(all(unix, not(target_vendor = "apple")))]
mod x_server;

pub use clock::{Clock, RealClock, SimulatedClock};
pub use desktop::Desktop;
#[cfg(feature = "direct-display")]
pub use direct::direct_displays;
pub use display::DisplayPresenter;
pub use interference::Interference;
#[cfg(feature = "direct-display")]
pub use modes::{DirectDisplay, DirectMode};
pub use monitor::Monitor;
pub use offscreen::Offscreen;
pub use presenter::{Event, Feedback, Presenter};
pub use rate::{Rate, SECOND_NS};
pub use sink::Sink;
pub use surface::WindowHandle;
pub use swapchain::{Policy, Swapchain};
pub use timing::PresentTiming;
pub use window::{OrdinaryWindow, WindowEvent, WindowKey};

use eyebox_base::error::Reason;
use eyebox_base::files::FileError;

/// What can go wrong between a video frame and its light.
#[derive(Debug, thiserror::Error, serde::Serialize)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
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
