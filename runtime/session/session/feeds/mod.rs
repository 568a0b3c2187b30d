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
pub(crate) mod tracking;

use crate::encode::VideoFrames;
use crate::session::playback::player::SetSource;
use crate::session::playback::scheduler::Schedule;
use crate::session::playback::stream::Stream;
use crate::session::stereo::both_eyes::BothEyes;
use following::LiveState;

/// Running content, as the present thread uses it.
pub(crate) enum ActiveContent {
    Play(Stream),
    Live(Box<LiveState>),
    Both(Box<BothEyes>),
}

impl ActiveContent {
    pub(crate) fn source(&mut self) -> &mut dyn SetSource {
        match self {
            Self::Play(stream) => stream,
            Self::Live(following) => &mut following.source,
            Self::Both(both) => both.as_mut(),
        }
    }

    pub(crate) fn source_ref(&self) -> &dyn SetSource {
        match self {
            Self::Play(stream) => stream,
            Self::Live(following) => &following.source,
            Self::Both(both) => both.as_ref(),
        }
    }

    /// Returns the live holograms, of one eye or of both.
    pub(crate) fn lives(&self) -> impl Iterator<Item = &LiveState> {
        let eyes = match self {
            Self::Both(both) => both.eyes.as_slice(),
            one => std::slice::from_ref(one),
        };
        eyes.iter().filter_map(|eye| match eye {
            Self::Live(live) => Some(live.as_ref()),
            _ => None,
        })
    }

    /// Returns the live holograms, of one eye or of both.
    pub(crate) fn lives_mut(&mut self) -> impl Iterator<Item = &mut LiveState> {
        let eyes = match self {
            Self::Both(both) => both.eyes.as_mut_slice(),
            one => std::slice::from_mut(one),
        };
        eyes.iter_mut().filter_map(|eye| match eye {
            Self::Live(live) => Some(live.as_mut()),
            _ => None,
        })
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
