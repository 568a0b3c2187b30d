//! Holds the running content of one eye.

use crate::session::feeds::following::LiveState;
use crate::session::playback::player::SetSource;
use crate::session::playback::stream::Stream;

/// The running content of one eye, which is played or refined.
pub(crate) enum EyeContent {
    Play(Stream),
    Live(Box<LiveState>),
}

impl EyeContent {
    pub(crate) fn source(&mut self) -> &mut dyn SetSource {
        match self {
            Self::Play(stream) => stream,
            Self::Live(following) => &mut following.source,
        }
    }

    pub(crate) fn source_ref(&self) -> &dyn SetSource {
        match self {
            Self::Play(stream) => stream,
            Self::Live(following) => &following.source,
        }
    }

    pub(crate) fn live(&self) -> Option<&LiveState> {
        match self {
            Self::Play(_) => None,
            Self::Live(live) => Some(live),
        }
    }

    pub(crate) fn live_mut(&mut self) -> Option<&mut LiveState> {
        match self {
            Self::Play(_) => None,
            Self::Live(live) => Some(live),
        }
    }
}
