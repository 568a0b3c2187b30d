//! The display's side of a session: takes video frames in order, and says when they lit up.
//!
//! `presenter` is the trait; behind it `offscreen` (memory, with its `sink`s), `window` (over a whole monitor, with its
//! `connection`) and `direct` (a display that no desktop drives). `panel`: ordinary windows on the same desktop. `clock`, real
//! or simulated, and `rate`, an exact one, are what they and [`session`](crate::session) count time by.
//!
//! Every time carries its unit and its meaning in its name. This room imports [`files`](crate::files), and of
//! [`engine`](crate::engine) the Vulkan screen.

mod clock;
mod connection;
mod direct;
mod offscreen;
mod panel;
mod presenter;
mod rate;
mod sink;
mod window;

pub use clock::{Clock, RealClock, SimulatedClock};
pub use direct::{Connected, Direct, DirectWindow};
pub use offscreen::Offscreen;
pub use panel::{Panel, PanelEvent, PanelKey};
pub use presenter::{Event, Feedback, Presenter};
pub use rate::{Rate, SECOND_NS};
pub use sink::Sink;
pub use window::{Desktop, Monitor, Window};

use crate::files::FileError;

/// What can go wrong with a display.
#[derive(Debug, thiserror::Error)]
pub enum PlaybackError {
    /// A rate that cannot be.
    #[error("the rate {value} cannot be: give hertz, 0.001 to 100000, such as 60, 59.94 or 60000/1001")]
    Rate {
        /// What was given.
        value: String,
    },
    /// A file.
    #[error(transparent)]
    File(#[from] FileError),
    /// The display refused, or was lost.
    #[error("{presenter}: {reason}")]
    Presenter {
        /// Which one.
        presenter: String,
        /// What is wrong, and what would be right.
        reason: String,
    },
}
