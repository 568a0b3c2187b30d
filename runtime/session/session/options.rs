//! What a session shows, how it runs, and what its holder and its threads share.

use crate::gpu::Gpu;
use crate::mailbox::Mailbox;
use crate::present::Rate;
use crate::session::feeds::following::LiveStatus;
use crate::session::feeds::live::Live;
use crate::session::feeds::play::Play;
use crate::session::feeds::statistics::Statistics;
use crate::session::frame_log::account::Account;
use crate::session::frame_log::error::SessionError;
use crate::session::frame_log::notes::Notes;
use crate::session::playback::player::{Command, PresentedFrame};
use crate::session::playback::report::{Report, Timing};
use crossbeam_utils::atomic::AtomicCell;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

/// What a session shows.
#[non_exhaustive]
pub enum Content {
    /// Holograms from disk.
    Play(Box<Play>),
    /// One hologram, refined for where the eye is.
    Live(Box<Live>),
}

impl From<Play> for Content {
    fn from(play: Play) -> Self {
        Self::Play(Box::new(play))
    }
}

impl From<Live> for Content {
    fn from(live: Live) -> Self {
        Self::Live(Box::new(live))
    }
}

/// Sees every video frame as it is handed over, on the present thread.
pub type FrameObserver = Box<dyn FnMut(&PresentedFrame<'_>) + Send>;

/// How a session runs, whatever it shows.
#[derive(Default)]
#[non_exhaustive]
pub struct SessionOptions {
    /// Video frames a second; else what the display says, or 60.
    pub display_rate: Option<Rate>,
    /// So long content is shown; else until it ends or the session is stopped.
    pub duration: Option<Duration>,
    /// The device that displays show from, for one that engines and encoders share; else one is opened where it is needed.
    pub gpu: Option<Gpu>,
    /// A new folder that keeps what was shown, as pictures: all of them where time is simulated, else as many as the disk
    /// takes.
    pub record: Option<PathBuf>,
    /// A file for what each thread did when, in the format of Chrome's tracing.
    pub trace: Option<PathBuf>,
    /// Sees every video frame.
    pub observer: Option<FrameObserver>,
}

/// What a session shows on, and how often.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct About {
    /// The display, for people.
    pub presenter: String,
    /// Video frames a second.
    pub display_rate: Rate,
    /// Video frames of a multiplex set.
    pub set_frames: u64,
    /// Sub-frames of a set, over all colours.
    pub sub_frames: u64,
    /// Whether sets roll: any video frame may be of a newer set.
    pub rolls: bool,
}

impl About {
    /// Multiplex sets a second.
    pub fn sets_per_second(&self) -> f64 {
        self.display_rate.hz() / self.set_frames as f64
    }
}

/// How a session is doing.
#[derive(Debug, Clone, Copy, Default)]
#[non_exhaustive]
pub struct Status {
    /// Seconds since it began, on the display's clock.
    pub seconds: f64,
    /// What was shown so far, and why not more.
    pub account: Account,
    /// How well video frames came when they were predicted.
    pub timing: Timing,
    /// Of a live hologram.
    pub live: Option<LiveStatus>,
}

impl Status {
    /// What came of it so far, on what it shows on; what is pending is not known before the end.
    pub fn report(&self, about: &About) -> Report {
        let Self { seconds, account, timing, .. } = *self;
        let planes = if about.rolls { about.sub_frames / about.set_frames.max(1) } else { about.sub_frames };
        Report { account, pending: 0, seconds, planes, timing }
    }
}

/// What came of a session.
#[derive(Debug)]
pub struct Ended {
    /// What was shown, and how late.
    pub statistics: Statistics,
    /// What ended it, if that was a failure, or what could not be written.
    pub result: Result<(), SessionError>,
}

pub(super) struct Shared {
    pub stop: AtomicBool,
    pub steered: Arc<AtomicBool>,
    pub status: AtomicCell<Status>,
    pub commands: Mailbox<Command>,
    pub notes: Notes,
}

/// Commands that wait for the next video frame at most.
pub(super) const COMMANDS: usize = 32;
