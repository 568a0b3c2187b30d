//! Content that has begun: what the present thread has of it.

use crate::encode::VideoFrames;
use crate::session::feeds::following::LiveState;
use crate::session::playback::player::SetSource;
use crate::session::playback::scheduler::Schedule;
use crate::session::playback::stream::Stream;

/// Content that has begun.
pub(crate) enum ActiveContent {
    Play(Stream),
    Live(Box<LiveState>),
}

impl ActiveContent {
    pub(crate) fn source(&mut self) -> &mut dyn SetSource {
        match self {
            Self::Play(stream) => stream,
            Self::Live(following) => &mut following.source,
        }
    }
}

/// What content brings along.
pub(crate) struct ContentSetup {
    pub running: ActiveContent,
    pub schedule: Schedule,
    /// A set of video frames that is shown while there is no content.
    pub idle: VideoFrames,
    /// Sub-frames of a set, over all colours.
    pub sub_frames: u64,
}
