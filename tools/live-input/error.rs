//! What can go wrong, each in one line.

use std::fmt;

/// What is wrong with a frame. The frame before stays.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum FrameFault {
    /// A number that is none of those that are right.
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
    Code {
        /// Of what.
        what: &'static str,
        /// What it is.
        found: u64,
        /// What would be right.
        must: &'static str,
    },
    /// A length, a place or a distance.
    Length {
        /// Of what.
        what: &'static str,
        /// What it is.
        found: f64,
        /// What would be right.
        must: &'static str,
    },
    /// A sample.
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
    Torn,
    /// The device that shares its memory failed.
    Device,
}

impl fmt::Display for FrameFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the application's frame is refused: ")?;
        match self {
            Self::Number { what, found, least, most } if least == most => {
                write!(f, "{what} {found}; it must be {least}")
            }
            Self::Number { what, found, least, most } => write!(f, "{what} {found}; it must be {least} to {most}"),
            Self::Code { what, found, must } => write!(f, "{what} {found}; it must be {must}"),
            Self::Length { what, found, must } => write!(f, "{what} {found}; it must be {must}"),
            Self::Value { channel, index, found, must } => {
                write!(f, "sample {index} of channel {channel} is {found}; it must be {must}")
            }
            Self::Device => write!(f, "the display's device failed: connect again, and share no memory of it"),
            Self::Torn => write!(f, "it was written while it was read; a slot that is held must not be written"),
        }
    }
}

impl std::error::Error for FrameFault {}

/// What can go wrong between a display and an application.
#[derive(Debug)]
#[non_exhaustive]
pub enum LiveError {
    /// There is none on this system.
    Unsupported,
    /// A name that cannot be.
    Name(String),
    /// The runtime folder cannot be trusted, or not made.
    Folder {
        /// Which.
        path: String,
        /// Why.
        reason: String,
    },
    /// Another display listens there.
    Taken(String),
    /// No display listens there.
    NoDisplay {
        /// The name.
        name: String,
        /// What the system said.
        reason: String,
    },
    /// The display refused the application.
    Refused(String),
    /// The other side is another user's.
    OtherUser {
        /// Whose.
        uid: u32,
        /// Ours.
        own: u32,
    },
    /// What the display sent is not what it should be.
    Damaged(String),
    /// What a display offers cannot be.
    Offer {
        /// What of it.
        what: &'static str,
        /// What it is.
        found: String,
        /// What would be right.
        must: &'static str,
    },
    /// A frame that the display would refuse.
    Frame(FrameFault),
    /// The display is gone.
    Gone,
    /// The system refused.
    System {
        /// What it was asked for.
        what: &'static str,
        /// What it said.
        error: std::io::Error,
    },
}

impl fmt::Display for LiveError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unsupported => {
                write!(
                    f,
                    "live input: only on little-endian Linux of 64 bits, whose shared memory can be sealed against being cut"
                )
            }
            Self::Name(name) => write!(
                f,
                "live:{name}: a name has 1 to 64 letters, digits, '.', '_' and '-', and does not begin with '.'"
            ),
            Self::Folder { path, reason } => write!(f, "{path}: {reason}"),
            Self::Taken(name) => write!(f, "live:{name}: another display takes frames there: choose another name"),
            Self::NoDisplay { name, reason } => write!(f, "live:{name}: no display takes frames there: {reason}"),
            Self::Refused(reason) => write!(f, "the display refused: {reason}"),
            Self::OtherUser { uid, own } => {
                write!(f, "the other side belongs to user {uid}: only those of user {own} are taken")
            }
            Self::Damaged(reason) => write!(f, "what the display sent is damaged: {reason}"),
            Self::Offer { what, found, must } => write!(f, "{what} of a live input is {found}; it must be {must}"),
            Self::Frame(fault) => fault.fmt(f),
            Self::Gone => write!(f, "the display is gone"),
            Self::System { what, error } => write!(f, "{what}: {error}"),
        }
    }
}

impl std::error::Error for LiveError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::System { error, .. } => Some(error),
            Self::Frame(fault) => Some(fault),
            _ => None,
        }
    }
}

impl From<FrameFault> for LiveError {
    fn from(fault: FrameFault) -> Self {
        Self::Frame(fault)
    }
}
