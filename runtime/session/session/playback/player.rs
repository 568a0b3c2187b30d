//! Runs one video frame of the present thread, which predicts, wakes, decides, hands over and learns.

use crate::encode::VideoFrames;
use crate::gpu::Pictures;
use crate::hologram::NewestHologram;
use crate::present::{Clock, Event, PresentError, Presenter, Rate};
use crate::session::frame_log::account::Cause;
use crate::session::frame_log::error::SessionError;
use crate::session::frame_log::trace::Track;
use crate::session::playback::on_screen::VersionLog;
use crate::session::playback::pacing::Pacer;
use crate::session::playback::report::Timing;
use crate::session::playback::scheduler::{Content, Scheduler, Slot, Target, What};
use crate::session::playback::timeline::Speed;
use std::rc::Rc;
use std::time::Instant;

/// Content that can be shown, as the present thread uses a [`Stream`](crate::session::Stream). Only
/// [`settle`](Self::settle) may block.
pub(crate) trait SetSource: Content {
    /// Takes the arrived sets. `useful_from` is the first position that may still be of use. Returns the error that
    /// ended the threads of the content.
    fn poll(&mut self, useful_from: u64) -> Result<(), SessionError>;

    /// Waits for the outcome of a position. This is for simulated clocks, on which it takes no time.
    fn settle(&mut self, position: u64, target: Target) -> Result<(), SessionError>;

    /// Puts a position that is ready on the screen.
    fn show(&mut self, position: u64);

    /// Prepares this video frame of the set on the screen, if it is made from several parts.
    fn compose(&mut self, _video_frame: usize) {}

    /// Returns the set on the screen, and the number of its frame in the file.
    fn on_screen(&self) -> Option<(&VideoFrames, u64)>;

    /// Returns the set on the screen if it is on the device of the display. The video frames of `on_screen` are then
    /// empty.
    fn pictures(&self) -> Option<&Pictures> {
        None
    }

    /// Returns the version of the set on the screen, if it is a replaceable hologram.
    fn version(&self) -> Option<u64> {
        None
    }

    /// Continues with another frame of the file. Positions start at 0 again.
    fn seek(&mut self, index: u64);
}

/// A command of the user.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Command {
    /// Pauses or resumes the content.
    Pause(bool),
    /// Advances by one content frame and pauses.
    Step,
    /// Moves by this number of frames of the file from the frame on the screen.
    Seek(i64),
    /// Plays at this multiple of the rate of the content.
    Speed(f64),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Flow {
    Continue,
    /// The last set was shown for its time.
    Ended,
    /// A user closed the presenter.
    Closed,
}

/// A video frame as it was handed over.
#[derive(Debug, Clone, Copy)]
pub struct PresentedFrame<'a> {
    /// The number of the video frame of the display.
    pub vblank: u64,
    /// The predicted time of its light (ns on the clock of the player).
    pub predicted_display_time_ns: i64,
    /// The number of its frame in the file, or `None` for the idle picture.
    pub index: Option<u64>,
    /// The number of the video frame in the set.
    pub video_frame: u64,
    /// True if the set is new.
    pub new: bool,
    /// The cause why the set is not new, or late.
    pub late: Option<Cause>,
    /// The bytes of the video frame. They are empty if it goes directly from the device that encodes it to the display.
    pub picture: &'a [u8],
}

/// Connects the clock, the scheduler and the pacer.
pub(crate) struct Player {
    clock: Rc<dyn Clock>,
    /// The scheduler, with the counts of the content that was shown.
    pub(crate) scheduler: Scheduler,
    pub(crate) pacer: Pacer,
    idle: VideoFrames,
    id: u64,
    /// The accuracy of the predictions.
    pub(crate) timing: Timing,
    pub(crate) track: Track,
    /// The predicted time of the light of the last video frame that was handed over.
    pub(crate) display_time_ns: i64,
    /// The number of the first video frame with content, and the time of its light. The time is predicted until the
    /// display reports it.
    first_light: Option<(u64, i64)>,
    /// The log of the version of a hologram that is on the screen.
    versions: Option<VersionLog>,
    /// The video frames whose light was reported in this tick, each with its time.
    pub(crate) lit: Vec<(u64, i64)>,
}

impl Player {
    /// Creates a player. `idle` is shown without content, and is a set of video frames like a set of the content.
    pub(crate) fn new(clock: Rc<dyn Clock>, scheduler: Scheduler, idle: VideoFrames, track: Track) -> Self {
        let pacer = Pacer::new(scheduler.schedule().display_rate);
        Self {
            clock,
            scheduler,
            pacer,
            idle,
            id: 0,
            timing: Timing::default(),
            track,
            display_time_ns: 0,
            first_light: None,
            versions: None,
            lit: Vec::with_capacity(8),
        }
    }

    /// Returns the time at which content was lit for the first time.
    pub(crate) fn first_light_ns(&self) -> Option<i64> {
        self.first_light.map(|(_, at_ns)| at_ns)
    }

    /// Starts to store which version of a hologram is on the screen.
    pub(crate) fn follows(&mut self, newest: NewestHologram) {
        self.versions = Some(VersionLog::new(newest, self.scheduler.schedule().set_frames));
    }

    /// Applies a command of the user from the next video frame on.
    pub(crate) fn command(&mut self, command: Command, source: &mut dyn SetSource) {
        let next_display_time_ns = self.display_time_ns + self.rate().period_ns();
        match command {
            Command::Pause(paused) => self.scheduler.pause(paused, next_display_time_ns),
            Command::Step => self.scheduler.step(next_display_time_ns),
            Command::Speed(factor) => {
                if let Some(speed) = Speed::new(factor) {
                    self.scheduler.set_speed(speed, next_display_time_ns);
                }
            }
            Command::Seek(frames) => {
                let index = source.on_screen().map_or(0, |s| s.1).saturating_add_signed(frames);
                source.seek(index);
                self.scheduler.restart();
            }
        }
    }

    /// Runs one video frame. `observe` receives the video frame that was handed over.
    pub(crate) fn tick(
        &mut self,
        presenter: &mut dyn Presenter,
        source: &mut dyn SetSource,
        observe: &mut dyn FnMut(&PresentedFrame<'_>) -> Result<(), SessionError>,
    ) -> Result<Flow, SessionError> {
        while let Some(event) = presenter.event() {
            if event == Event::Close {
                return Ok(Flow::Closed);
            }
            self.command(self.meaning(event), source);
        }
        self.clock.wait_for_tick();
        let next = self.pacer.predict(self.clock.now_ns());
        self.clock.wait_until_ns(next.wake_time_ns);
        let (woken_ns, woken) = (self.clock.now_ns(), Instant::now());
        let useful = self.scheduler.useful_from(next.predicted_display_time_ns);
        source.poll(useful)?;
        let wanted = self.scheduler.wanted(next.predicted_display_time_ns);
        if let Some(wanted) = wanted.filter(|_| self.clock.is_simulated()) {
            let (start_ns, turn) = (next.predicted_display_time_ns, self.scheduler.turn());
            source.settle(wanted, Target { start_ns, hand_over_ns: woken_ns, turn })?;
        }
        let Slot { what, video_frame, late } = self.scheduler.next(next.vblank, next.predicted_display_time_ns, source);
        match what {
            What::End => return Ok(Flow::Ended),
            What::Set(position) => source.show(position),
            What::Idle | What::Keep => {}
        }
        source.compose(video_frame as usize);
        let (frames, index) = match source.on_screen() {
            Some((frames, index)) if what != What::Idle => (frames, Some(index)),
            _ => (&self.idle, None),
        };
        let at = (video_frame as usize).min(frames.count() - 1);
        let pictures = source.pictures().filter(|_| index.is_some());
        let picture = if pictures.is_some() { &[] } else { frames.frame(at) };
        let number = index.unwrap_or(u64::MAX);
        if let Some(versions) = &mut self.versions {
            versions.hands_over(self.id, index.and_then(|_| source.version()));
        }
        let uploading = Instant::now();
        match pictures {
            Some(pictures) => presenter.take(pictures, at)?,
            None => presenter.upload(picture)?,
        }
        self.track.span("upload", number, uploading);
        self.track.span("submit", number, woken);
        let presenting = Instant::now();
        let compute_ns = self.clock.now_ns() - woken_ns;
        presenter.present(self.id, next.desired_present_time_ns)?;
        self.track.span("present", number, presenting);
        self.pacer.submitted(self.id, next.vblank, compute_ns);
        if index.is_some() {
            self.first_light.get_or_insert((self.id, next.predicted_display_time_ns));
        }
        self.id += 1;
        self.display_time_ns = next.predicted_display_time_ns;
        self.lit.clear();
        while let Some(feedback) = presenter.feedback() {
            if let Some(versions) = &mut self.versions {
                versions.lit(feedback.id);
            }
            if let Some((_, at_ns)) = self.first_light.as_mut().filter(|(first, _)| *first == feedback.id) {
                *at_ns = feedback.actual_display_time_ns;
            }
            if let Some(outcome) = self.pacer.presented(feedback.id, feedback.actual_display_time_ns) {
                self.timing.add(outcome, feedback.actual_display_time_ns);
                // A late video frame keeps the number that it was handed over with.
                self.lit.push((outcome.vblank.saturating_sub(outcome.missed), feedback.actual_display_time_ns));
            }
        }
        observe(&PresentedFrame {
            vblank: next.vblank,
            predicted_display_time_ns: next.predicted_display_time_ns,
            index,
            video_frame,
            new: matches!(what, What::Set(_)),
            late,
            picture,
        })?;
        Ok(Flow::Continue)
    }

    /// Ends playback for any reason. Unless the display was lost, it is left on the first video frame of the idle
    /// picture, which is defined. Returns the error that ended playback, or else the error of the presenter.
    pub(crate) fn end<T>(
        &mut self,
        presenter: &mut dyn Presenter,
        ended: Result<T, SessionError>,
    ) -> Result<T, SessionError> {
        self.versions = None;
        if matches!(ended, Err(SessionError::Present(PresentError::Display { .. }))) {
            return ended;
        }
        let next = self.pacer.predict(self.clock.now_ns());
        self.clock.wait_until_ns(next.wake_time_ns);
        self.id += 1;
        let left = presenter
            .upload(self.idle.frame(0))
            .and_then(|()| presenter.present(self.id, next.desired_present_time_ns))
            .and_then(|()| presenter.finish());
        let how = ended?;
        left?;
        Ok(how)
    }

    pub(crate) fn rate(&self) -> Rate {
        self.scheduler.schedule().display_rate
    }

    fn meaning(&self, event: Event) -> Command {
        match event {
            Event::Close | Event::Pause => Command::Pause(!self.scheduler.is_paused()),
            Event::Step => Command::Step,
            Event::Seek(frames) => Command::Seek(frames),
            Event::Faster(times) => Command::Speed(self.scheduler.schedule().speed.factor() * times),
        }
    }
}
