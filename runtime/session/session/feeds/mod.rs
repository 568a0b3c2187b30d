//! The two things that a session shows, and the threads that make their sets: holograms that were solved before, and live content that is refined.

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

/// Content that has begun, as the present thread has it.
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
    /// A set of video frames that is shown while there is no content.
    pub idle: VideoFrames,
    /// Sub-frames of a set, over all colours.
    pub sub_frames: u64,
}
