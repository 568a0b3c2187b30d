//! Defines the content and the options of a session, and the state that its handle and its threads share.

use crate::encode::Encoder;
use crate::gpu::Gpu;
use crate::mailbox::Mailbox;
use crate::present::Rate;
use crate::present::plm::Controller;
use crate::session::feeds::following::LiveStatus;
use crate::session::feeds::joined::joined_size;
use crate::session::feeds::live::Live;
use crate::session::feeds::play::Play;
use crate::session::feeds::statistics::Statistics;
use crate::session::feeds::two_eyed::{Eyes, TwoEyed};
use crate::session::frame_log::account::Account;
use crate::session::frame_log::error::SessionError;
use crate::session::frame_log::notes::Notes;
use crate::session::playback::player::{Command, PresentedFrame};
use crate::session::playback::report::{Report, Timing};
use crate::session::playback::triggers::LightObserver;
use crossbeam_utils::atomic::AtomicCell;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

/// The content of a session.
#[non_exhaustive]
pub enum Content {
    /// Holograms from disk are played.
    Play(Box<Play>),
    /// One hologram or successive scenes are refined for the tracked pupil.
    Live(Box<Live>),
    /// The content of two eyes is shown on one schedule.
    TwoEyed(Box<TwoEyed>),
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

impl From<TwoEyed> for Content {
    fn from(both: TwoEyed) -> Self {
        Self::TwoEyed(Box::new(both))
    }
}

impl Content {
    /// Checks the settings before anything is opened.
    pub(super) fn check(&self) -> Result<(), SessionError> {
        match self {
            Self::Play(play) => play.check(),
            Self::Live(live) => live.check(),
            Self::TwoEyed(both) => both.check(),
        }
    }

    /// Returns true if content is refined.
    pub(super) fn is_refined(&self) -> bool {
        match self {
            Self::Play(_) => false,
            Self::Live(_) => true,
            Self::TwoEyed(both) => matches!(both.eyes, Eyes::Live(_)),
        }
    }

    /// Returns true if content is refined for the tracked pupil from the start.
    pub(super) fn is_steered(&self) -> bool {
        match self {
            Self::Play(_) => false,
            Self::Live(live) => live.steered,
            Self::TwoEyed(both) => matches!(&both.eyes, Eyes::Live([left, _]) if left.steered),
        }
    }

    /// Returns true if all colors share each sub-frame.
    pub(super) fn is_joint(&self) -> bool {
        let of_play = |play: &Play| play.sequence.about().metadata.joint_color.is_some();
        let of_live = |live: &Live| live.colors.iter().any(|color| color.laser.is_some());
        match self {
            Self::Play(play) => of_play(play),
            Self::Live(live) => of_live(live),
            Self::TwoEyed(both) => match &both.eyes {
                Eyes::Play([left, _]) => of_play(left),
                Eyes::Live([left, _]) => of_live(left),
            },
        }
    }

    /// Returns the encoders of all panels, the left one first.
    pub(super) fn encoders(&self) -> Vec<&Encoder> {
        match self {
            Self::Play(play) => vec![&play.encoder],
            Self::Live(live) => vec![&live.encoder],
            Self::TwoEyed(both) => both.encoders().to_vec(),
        }
    }

    /// Returns rows, columns and channels of the video frames of the output.
    pub(super) fn frame_size(&self) -> [usize; 3] {
        let frames = self.encoders()[0].frames();
        let one = [frames.height, frames.width, frames.channels];
        match self {
            Self::TwoEyed(both) => joined_size(one, both.places),
            _ => one,
        }
    }
}

/// A function that receives every video frame when it is handed over, on the present thread.
pub type FrameObserver = Box<dyn FnMut(&PresentedFrame<'_>) + Send>;

/// The options of a session, for any content.
#[derive(Default)]
#[non_exhaustive]
pub struct SessionOptions {
    /// The video frames per second. If it is `None`, the rate of the display counts, or 60.
    pub display_rate: Option<Rate>,
    /// The time for which content is shown. If it is `None`, the session ends with the content or when it is stopped.
    pub duration: Option<Duration>,
    /// The device that displays show from, if engines and encoders share it. If it is `None`, one is opened when it is
    /// needed.
    pub gpu: Option<Gpu>,
    /// A new folder for pictures of the video frames. In simulated time it receives all of them, otherwise as many as
    /// the disk allows.
    pub record: Option<PathBuf>,
    /// A file for the activity of each thread, in the format of Chrome's tracing.
    pub trace: Option<PathBuf>,
    /// The function that receives every video frame.
    pub observer: Option<FrameObserver>,
    /// The function that receives the light of each set.
    pub light_observer: Option<LightObserver>,
    /// The controller of the display. If it is `None` and the display has a `[device]`, windows and direct displays
    /// open it on this machine. Other outputs open only a simulated one.
    pub controller: Option<Controller>,
}

/// The description of the output of a session, and its rates.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct About {
    /// The description of the display for people.
    pub presenter: String,
    /// The video frames per second.
    pub display_rate: Rate,
    /// The video frames of a multiplex set.
    pub set_frames: u64,
    /// The sub-frames of a set, over all colors.
    pub sub_frames: u64,
    /// True if updates roll, so that any video frame may belong to a newer set.
    pub rolls: bool,
}

impl About {
    /// Returns the multiplex sets per second.
    pub fn sets_per_second(&self) -> f64 {
        self.display_rate.hz() / self.set_frames as f64
    }
}

/// The status of a session.
#[derive(Debug, Clone, Copy, Default)]
#[non_exhaustive]
pub struct Status {
    /// The time since the start (s on the clock of the display).
    pub seconds: f64,
    /// The counts of the content that was shown or dropped until now.
    pub account: Account,
    /// The accuracy of the predicted times of video frames.
    pub timing: Timing,
    /// The time at which content was lit for the first time (ns on the monotonic clock of the system), predicted until
    /// the display reports it. It is `None` before, and on a simulated clock.
    pub first_light_ns: Option<u64>,
    /// The status of a live hologram, if the session shows one. With two eyes it belongs to the left eye.
    pub live: Option<LiveStatus>,
}

impl Status {
    /// Returns the report of the output `about` up to now. The count of pending content is only available at the end.
    pub fn report(&self, about: &About) -> Report {
        let Self { seconds, account, timing, .. } = *self;
        let planes = if about.rolls { about.sub_frames / about.set_frames.max(1) } else { about.sub_frames };
        Report { account, pending: 0, seconds, planes, timing }
    }
}

/// The result of a session that has ended.
#[derive(Debug)]
pub struct Ended {
    /// The statistics of the session.
    pub statistics: Statistics,
    /// The error that ended the session, or the error of a file that could not be written.
    pub result: Result<(), SessionError>,
}

pub(super) struct Shared {
    pub stop: AtomicBool,
    pub steered: Arc<AtomicBool>,
    pub status: AtomicCell<Status>,
    pub commands: Mailbox<Command>,
    pub notes: Notes,
}

/// The number of commands that can wait for the next video frame.
pub(super) const COMMANDS: usize = 32;
