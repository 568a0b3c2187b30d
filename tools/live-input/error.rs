//! Defines the errors of live input, each with a message of one line.

use thiserror::Error;

/// The beginning of each message about a frame.
const REFUSED: &str = "the application's frame is refused: ";

/// Faults of a frame. The frame before stays.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[non_exhaustive]
pub enum FrameFault {
    /// A number is outside its range.
    #[error("{refused}{what} {found}, but it must be {}", range(*least, *most), refused = REFUSED)]
    Number {
        /// The name of the number.
        what: &'static str,
        /// The value that was found.
        found: u64,
        /// The smallest accepted value.
        least: u64,
        /// The largest accepted value.
        most: u64,
    },
    /// A code is unknown, or is one that the display does not accept.
    #[error("{refused}{what} {found}, but it must be {must}", refused = REFUSED)]
    Code {
        /// The name of the code.
        what: &'static str,
        /// The value that was found.
        found: u64,
        /// The values that are accepted.
        must: &'static str,
    },
    /// A length, a position or a distance is invalid.
    #[error("{refused}{what} {found}, but it must be {must}", refused = REFUSED)]
    Length {
        /// The name of the length.
        what: &'static str,
        /// The value that was found.
        found: f64,
        /// The values that are accepted.
        must: &'static str,
    },
    /// A sample is outside its range.
    #[error("{refused}sample {index} of channel {channel} is {found}, but it must be {must}", refused = REFUSED)]
    Value {
        /// The channel of the sample. Colors are first and opacity follows. Depths have the first number after the
        /// colors.
        channel: usize,
        /// The index of the sample in its channel.
        index: usize,
        /// The value that was found.
        found: f32,
        /// The values that are accepted.
        must: &'static str,
    },
    /// The frame changed during each copy.
    #[error("{refused}it was written while it was read. Do not write a slot that is held.", refused = REFUSED)]
    Torn,
    /// The device that shares its memory failed.
    #[error("{refused}the display's device failed. Connect again without its memory.", refused = REFUSED)]
    Device,
}

/// Describes a range of accepted numbers.
fn range(least: u64, most: u64) -> String {
    if least == most { least.to_string() } else { format!("{least} to {most}") }
}

/// Errors between a display and an application.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LiveError {
    /// Live input is not supported on this system.
    #[error("live input: supported only on 64-bit little-endian Linux, where shared memory can be sealed")]
    Unsupported,
    /// The name is invalid.
    #[error("live:{0}: a name has 1 to 64 letters, digits, '.', '_' and '-', and does not begin with '.'")]
    Name(String),
    /// The runtime folder is not safe, or cannot be created.
    #[error("{path}: {reason}")]
    Folder {
        /// The path of the folder.
        path: String,
        /// The problem with the folder.
        reason: String,
    },
    /// Another display listens under this name.
    #[error("live:{0}: another display takes frames there. Choose another name.")]
    Taken(String),
    /// No display listens under this name.
    #[error("live:{name}: no display takes frames there ({reason})")]
    NoDisplay {
        /// The name of the live input.
        name: String,
        /// The error of the system.
        reason: String,
    },
    /// The display refused the application.
    #[error("the display refused: {0}")]
    Refused(String),
    /// The other side belongs to another user.
    #[error("the other side belongs to user {uid}, but only user {own} is accepted")]
    OtherUser {
        /// The user of the other side.
        uid: u32,
        /// The user of this process.
        own: u32,
    },
    /// The display sent invalid data.
    #[error("the display sent damaged data: {0}")]
    Damaged(String),
    /// The offer of a display is invalid.
    #[error("live input: {what} is {found}, but it must be {must}")]
    Offer {
        /// The name of the property.
        what: &'static str,
        /// The value that was found.
        found: String,
        /// The values that are accepted.
        must: &'static str,
    },
    /// The display would refuse the frame.
    #[error("{0}")]
    Frame(#[from] FrameFault),
    /// The display is gone.
    #[error("the display is gone")]
    Gone,
    /// The system reported an error.
    #[error("{what}: {error}")]
    System {
        /// The subject of the system call.
        what: &'static str,
        /// The error of the system.
        #[source]
        error: std::io::Error,
    },
}
