//! The names of the tracked eye.

use clap::ValueEnum;

/// The eye whose pupil is tracked.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum EyeName {
    /// Pupil of the left eye
    Left,
    /// Pupil of the right eye
    Right,
    /// Mean of both pupils, or the one that the tracker has
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
