//! The handle to a session: start, status, events, stop, statistics.

use super::live::LiveStatus;
use super::player::Command;
use super::present_thread::PresentThread;
use super::{Account, Live, Notes, Output, Play, PresentedFrame, SessionError, Statistics, Timing};
use crate::gpu::Gpu;
use crate::mailbox::Mailbox;
use crate::present::Rate;
use crossbeam_utils::atomic::AtomicCell;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::sync_channel;
use std::thread::JoinHandle;
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

/// Something that happened.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum SessionEvent {
    /// A line that a user wants to read: a hologram left out, a device lost, a tracker gone.
    Note(String),
    /// It has ended; [`Session::stop`] says how.
    Ended,
}

/// Why a session ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Ending {
    /// The content was over.
    End,
    /// A user closed the display, or a window beside it.
    Closed,
    /// Its duration was over.
    Duration,
    /// It was stopped.
    Stopped,
    /// Something failed.
    Failed,
}

impl Ending {
    /// For people and statistics.
    pub fn name(self) -> &'static str {
        match self {
            Self::End => "the end",
            Self::Closed => "closed",
            Self::Duration => "the duration",
            Self::Stopped => "a stop",
            Self::Failed => "an error",
        }
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

/// What both sides share.
pub(super) struct Shared {
    pub stop: AtomicBool,
    pub steered: Arc<AtomicBool>,
    pub status: AtomicCell<Status>,
    pub commands: Mailbox<Command>,
    pub notes: Notes,
}

/// Commands that wait for the next video frame at most.
const COMMANDS: usize = 32;

/// Content on a display, on threads of its own. Dropped, it stops.
///
/// The present thread owns the display and waits for nothing but it; when content fails or ends, the idle picture is left,
/// which is a defined one.
pub struct Session {
    shared: Arc<Shared>,
    about: About,
    thread: Option<JoinHandle<Ended>>,
    told_end: AtomicBool,
}

impl Session {
    /// Opens the display and begins to show. Returns once that is known to work.
    ///
    /// # Errors
    /// All of [`SessionError`]: before anything is shown.
    pub fn start(content: impl Into<Content>, output: Output, options: SessionOptions) -> Result<Self, SessionError> {
        let content = content.into();
        let steered = matches!(&content, Content::Live(live) if live.steered);
        let shared = Arc::new(Shared {
            stop: AtomicBool::new(false),
            steered: Arc::new(AtomicBool::new(steered)),
            status: AtomicCell::new(Status::default()),
            commands: Mailbox::new(COMMANDS),
            notes: Notes::default(),
        });
        let (tell, started) = sync_channel(1);
        let theirs = Arc::clone(&shared);
        let failed = |reason: String| SessionError::Thread { what: "presents", reason };
        let thread = std::thread::Builder::new()
            .name("eyebox presents".into())
            .spawn(move || match PresentThread::start(content, &output, options, theirs) {
                Ok(mut present) => {
                    let _ = tell.send(Ok(present.about()));
                    present.run()
                }
                Err(error) => {
                    let _ = tell.send(Err(error));
                    Ended { statistics: Statistics::default(), result: Ok(()) }
                }
            })
            .map_err(|e| failed(format!("could not be started ({e})")))?;
        let about = started.recv().map_err(|_| failed("failed, which is a fault of eyebox".into()))??;
        Ok(Self { shared, about, thread: Some(thread), told_end: AtomicBool::new(false) })
    }

    /// What it shows on.
    pub fn about(&self) -> &About {
        &self.about
    }

    /// How it is doing, as of the last video frame.
    pub fn status(&self) -> Status {
        self.shared.status.load()
    }

    /// The next thing that happened, waiting so long for it.
    pub fn event(&self, within: Duration) -> Option<SessionEvent> {
        // Asked before: what was told last is not missed.
        let running = self.is_running();
        if let Some(note) = self.shared.notes.take_within(if running { within } else { Duration::ZERO }) {
            return Some(SessionEvent::Note(note));
        }
        let told = running || self.told_end.swap(true, Ordering::Relaxed);
        (!told).then_some(SessionEvent::Ended)
    }

    /// Pauses, steps, seeks or changes the speed of what is played, from the next video frame on.
    pub fn command(&self, command: Command) {
        let _ = self.shared.commands.push(command);
    }

    /// Whether a live hologram follows the eye; if not, the one for the whole eyebox is shown.
    pub fn steer(&self, steered: bool) {
        self.shared.steered.store(steered, Ordering::Release);
    }

    /// Whether something is still shown.
    pub fn is_running(&self) -> bool {
        self.thread.as_ref().is_some_and(|t| !t.is_finished())
    }

    /// Stops it, if it has not ended, and says what came of it.
    pub fn stop(mut self) -> Ended {
        self.shared.stop.store(true, Ordering::Release);
        let ended = self.thread.take().and_then(|thread| thread.join().ok());
        ended.unwrap_or_else(|| {
            let reason = "failed, which is a fault of eyebox".into();
            let result = Err(SessionError::Thread { what: "presents", reason });
            Ended { statistics: Statistics::default(), result }
        })
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
