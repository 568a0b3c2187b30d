//! What can go wrong, each in one line.

use thiserror::Error;

/// Begins each message about a frame.
const REFUSED: &str = "the application's frame is refused: ";

/// What is wrong with a frame. The frame before stays.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[non_exhaustive]
pub enum FrameFault {
    /// A number that is none of those that are right.
    #[error("{refused}{what} {found}; it must be {}", range(*least, *most), refused = REFUSED)]
    Number {
        /// Which one.
        what: &'static str,
        /// What it is.
        found: u64,
        /// The least that is right.
        least: u64,
        /// The most that is right.
        most: u64,
    },
    /// A code that is none of those that there are, or that the display takes.
    #[error("{refused}{what} {found}; it must be {must}", refused = REFUSED)]
    Code {
        /// Of what.
        what: &'static str,
        /// What it is.
        found: u64,
        /// What would be right.
        must: &'static str,
    },
    /// A length, a place or a distance.
    #[error("{refused}{what} {found}; it must be {must}", refused = REFUSED)]
    Length {
        /// Of what.
        what: &'static str,
        /// What it is.
        found: f64,
        /// What would be right.
        must: &'static str,
    },
    /// A sample.
    #[error("{refused}sample {index} of channel {channel} is {found}; it must be {must}", refused = REFUSED)]
    Value {
        /// Which channel: colours, then opacity; for depths the first behind the colours.
        channel: usize,
        /// Which of its samples.
        index: usize,
        /// What it is.
        found: f32,
        /// What would be right.
        must: &'static str,
    },
    /// It changed each time while it was copied.
    #[error("{refused}it was written while it was read; a slot that is held must not be written", refused = REFUSED)]
    Torn,
    /// The device that shares its memory failed.
    #[error("{refused}the display's device failed: connect again, and share no memory of it", refused = REFUSED)]
    Device,
}

/// Describes the numbers that are right.
fn range(least: u64, most: u64) -> String {
    if least == most { least.to_string() } else { format!("{least} to {most}") }
}

/// What can go wrong between a display and an application.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LiveError {
    /// There is none on this system.
    #[error("live input: only on little-endian Linux of 64 bits, whose shared memory can be sealed against being cut")]
    Unsupported,
    /// A name that cannot be.
    #[error("live:{0}: a name has 1 to 64 letters, digits, '.', '_' and '-', and does not begin with '.'")]
    Name(String),
    /// The runtime folder cannot be trusted, or not made.
    #[error("{path}: {reason}")]
    Folder {
        /// Which.
        path: String,
        /// Why.
        reason: String,
    },
    /// Another display listens there.
    #[error("live:{0}: another display takes frames there: choose another name")]
    Taken(String),
    /// No display listens there.
    #[error("live:{name}: no display takes frames there: {reason}")]
    NoDisplay {
        /// The name.
        name: String,
        /// What the system said.
        reason: String,
    },
    /// The display refused the application.
    #[error("the display refused: {0}")]
    Refused(String),
    /// The other side is another user's.
    #[error("the other side belongs to user {uid}: only those of user {own} are taken")]
    OtherUser {
        /// Whose.
        uid: u32,
        /// Ours.
        own: u32,
    },
    /// What the display sent is not what it should be.
    #[error("what the display sent is damaged: {0}")]
    Damaged(String),
    /// What a display offers cannot be.
    #[error("{what} of a live input is {found}; it must be {must}")]
    Offer {
        /// What of it.
        what: &'static str,
        /// What it is.
        found: String,
        /// What would be right.
        must: &'static str,
    },
    /// A frame that the display would refuse.
    #[error("{0}")]
    Frame(#[from] FrameFault),
    /// The display is gone.
    #[error("the display is gone")]
    Gone,
    /// The system refused.
    #[error("{what}: {error}")]
    System {
        /// What it was asked for.
        what: &'static str,
        /// What it said.
        #[source]
        error: std::io::Error,
    },
}
