//! The eye that is followed.

use clap::ValueEnum;

/// Whose pupil.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum EyeName {
    /// The left eye's
    Left,
    /// The right eye's
    Right,
    /// The mean of both, or what the tracker has
    Mean,
}

impl From<EyeName> for eyebox::low_level::gaze::Eye {
    fn from(name: EyeName) -> Self {
        match name {
            EyeName::Left => Self::Left,
            EyeName::Right => Self::Right,
            EyeName::Mean => Self::Mean,
        }
    }
}
