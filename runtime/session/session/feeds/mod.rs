//! Holds the two kinds of content, solved and refined holograms, and the threads that make their sets.

pub(crate) mod both_eyes;
pub(crate) mod eye_content;
pub(crate) mod following;
pub(crate) mod joined;
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
pub(crate) mod two_eyed;

use crate::encode::VideoFrames;
use crate::session::playback::player::SetSource;
use crate::session::playback::scheduler::Schedule;
use both_eyes::BothEyes;
use eye_content::EyeContent;
use following::LiveState;

/// Running content, as the present thread uses it.
pub(crate) enum ActiveContent {
    One(EyeContent),
    Both(Box<BothEyes>),
}

impl ActiveContent {
    pub(crate) fn source(&mut self) -> &mut dyn SetSource {
        match self {
            Self::One(eye) => eye.source(),
            Self::Both(both) => both.as_mut(),
        }
    }

    /// Returns the content of each eye, the left one first.
    pub(crate) fn into_eyes(self) -> Vec<EyeContent> {
        match self {
            Self::One(eye) => vec![eye],
            Self::Both(both) => Vec::from(both.eyes),
        }
    }

    /// Returns the live holograms, of one eye or of both.
    pub(crate) fn lives(&self) -> impl Iterator<Item = &LiveState> {
        let eyes = match self {
            Self::One(eye) => std::slice::from_ref(eye),
            Self::Both(both) => both.eyes.as_slice(),
        };
        eyes.iter().filter_map(EyeContent::live)
    }

    /// Returns the live holograms, of one eye or of both.
    pub(crate) fn lives_mut(&mut self) -> impl Iterator<Item = &mut LiveState> {
        let eyes = match self {
            Self::One(eye) => std::slice::from_mut(eye),
            Self::Both(both) => both.eyes.as_mut_slice(),
        };
        eyes.iter_mut().filter_map(EyeContent::live_mut)
    }
}

/// Content that is ready to run, of one eye or of both.
pub(crate) struct ContentSetup<C> {
    pub running: C,
    pub schedule: Schedule,
    /// The set of video frames that is shown without content.
    pub idle: VideoFrames,
    /// The sub-frames of a set, over all colors.
    pub sub_frames: u64,
}

impl<C> ContentSetup<C> {
    /// Changes the type of the running content.
    pub(crate) fn map<D>(self, change: impl FnOnce(C) -> D) -> ContentSetup<D> {
        let Self { running, schedule, idle, sub_frames } = self;
        ContentSetup { running: change(running), schedule, idle, sub_frames }
    }
}
