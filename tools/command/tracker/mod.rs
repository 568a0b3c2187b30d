//! `eyebox tracker` has commands for eye trackers, their samples, and a user's calibration.

mod calibrate;
mod eye;
mod list;
pub mod source;
mod watch;

pub use eye::EyeName;

use crate::Failure;
use clap::Subcommand;

/// The commands of `eyebox tracker`.
#[derive(Subcommand)]
pub enum Tracker {
    /// List the eye trackers of this machine and the other sources
    #[command(after_help = "Example:\n  eyebox tracker list --json")]
    List(list::List),
    /// Explain a HID report descriptor
    #[command(after_help = "Example:\n  eyebox tracker describe descriptor.bin --json")]
    Describe(list::Describe),
    /// Print the samples of a tracker, or the predicted pupil
    #[command(after_help = "Examples:\n  eyebox tracker watch hid --duration 10\n  \
                      eyebox tracker watch session.hid --json\n  \
                      eyebox tracker watch simulated:7 --tracker-rate 500 --duration 2 --predict 20")]
    Watch(watch::Watch),
    /// Record the samples of a tracker, and print them
    #[command(after_help = "Example:\n  eyebox tracker record hid --duration 10 -o session.hid")]
    Record(watch::Record),
    /// Calibrate a tracker for a user, who looks at targets
    #[command(after_help = "Example:\n  eyebox tracker calibrate pupil://localhost -o ada.toml")]
    Calibrate(calibrate::Calibrate),
}

/// Runs one of these commands.
pub fn run(tracker: &Tracker) -> Result<(), Failure> {
    match tracker {
        Tracker::List(args) => list::list(args),
        Tracker::Describe(args) => list::describe(args),
        Tracker::Watch(args) => watch::watch(args),
        Tracker::Record(args) => watch::record(args),
        Tracker::Calibrate(args) => calibrate::run(args),
    }
}
