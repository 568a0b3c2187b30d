//! Holds the two kinds of content, solved and refined holograms, and the threads that make their sets.

pub(crate) mod following;
pub(crate) mod journal;
pub(crate) mod live;
pub(crate) mod play;
pub(crate) mod refine;
pub(crate) mod replay;
pub(crate) mod sets;
pub(crate) mod showing;
pub(crate) mod sidecar;
pub(crate) mod statistics;

use crate::encode::VideoFrames;
use crate::session::playback::player::SetSource;
use crate::session::playback::scheduler::Schedule;
use crate::session::playback::stream::Stream;
use following::LiveState;

/// Running content, as the present thread uses it.
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

pub(crate) struct ContentSetup {
    pub running: ActiveContent,
    pub schedule: Schedule,
    /// The set of video frames that is shown without content.
    pub idle: VideoFrames,
    /// The sub-frames of a set, over all colors.
    pub sub_frames: u64,
}
