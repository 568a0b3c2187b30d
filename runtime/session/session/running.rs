//! Content that has begun: what the present thread has of it.

use super::following::Following;
use super::player::SetSource;
use super::scheduler::Schedule;
use super::stream::Stream;
use crate::encode::VideoFrames;

/// Content that has begun.
pub(super) enum Running {
    Play(Stream),
    Live(Box<Following>),
}

impl Running {
    pub(super) fn source(&mut self) -> &mut dyn SetSource {
        match self {
            Self::Play(stream) => stream,
            Self::Live(following) => &mut following.source,
        }
    }
}

/// What content brings along.
pub(super) struct Setup {
    pub running: Running,
    pub schedule: Schedule,
    /// A set of video frames that is shown while there is no content.
    pub idle: VideoFrames,
    /// Sub-frames of a set, over all colours.
    pub sub_frames: u64,
}
