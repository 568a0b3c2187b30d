//! The present thread's loop, one video frame at a time: predict, wake, decide, hand over, learn.

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

/// Content that can be shown: what the present thread sees of a [`Stream`](crate::session::Stream). None of it blocks but
/// [`settle`](Self::settle).
pub(crate) trait SetSource: Content {
    /// Takes in what arrived, and says which positions may still be of use. Fails with what ended the threads behind it.
    fn poll(&mut self, useful_from: u64) -> Result<(), SessionError>;

    /// Waits until it is known what comes of a position: with simulated clocks, for which it takes no time.
    fn settle(&mut self, position: u64, target: Target) -> Result<(), SessionError>;

    /// Puts a position that is ready on the screen.
    fn show(&mut self, position: u64);

    /// What is on the screen, and which frame of the file it is.
    fn on_screen(&self) -> Option<(&VideoFrames, u64)>;

    /// What is on the screen, where it is on the display's device; the video frames above then hold nothing.
    fn pictures(&self) -> Option<&Pictures> {
        None
    }

    /// The version of what is on the screen, if it is a hologram that may be replaced.
    fn version(&self) -> Option<u64> {
        None
    }

    /// Content from another frame of the file on; positions begin anew.
    fn seek(&mut self, index: u64);
}

/// What a user can ask for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Command {
    /// Stand still, or go on.
    Pause(bool),
    /// One content frame on, and stand still.
    Step,
    /// So many frames of the file further than what is on the screen.
    Seek(i64),
    /// So many times the content's own rate.
    Speed(f64),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Flow {
    Continue,
    /// The last set was up for its time.
    Ended,
    /// A user closed the presenter.
    Closed,
}

/// A video frame as it was handed over.
#[derive(Debug, Clone, Copy)]
pub struct PresentedFrame<'a> {
    /// Which video frame of the display.
    pub vblank: u64,
    /// When it is to light up, on the player's clock.
    pub predicted_display_time_ns: i64,
    /// Which frame of the file it belongs to; none for the idle picture.
    pub index: Option<u64>,
    /// Which video frame of the set.
    pub video_frame: u64,
    /// Whether the set is new.
    pub new: bool,
    /// Why not, or why late.
    pub late: Option<Cause>,
    /// The bytes; none where the video frame goes from the device that encodes it to the display without the host.
    pub picture: &'a [u8],
}

/// Joins clock, scheduler and pacer.
pub(crate) struct Player {
    clock: Rc<dyn Clock>,
    /// What was shown, and why not more.
    pub(crate) scheduler: Scheduler,
    pub(crate) pacer: Pacer,
    idle: VideoFrames,
    id: u64,
    /// How well predictions were met.
    pub(crate) timing: Timing,
    pub(crate) track: Track,
    /// When the last video frame handed over is to light up.
    pub(crate) display_time_ns: i64,
    /// Stores which version of a hologram is on the screen.
    versions: Option<VersionLog>,
}

impl Player {
    /// `idle` is shown while there is no content: a set of video frames like content's.
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
            versions: None,
        }
    }

    /// Stores from now on which version of a hologram is on the screen.
    pub(crate) fn follows(&mut self, newest: NewestHologram) {
        self.versions = Some(VersionLog::new(newest, self.scheduler.schedule().set_frames));
    }

    /// Does what a user asked for, from the next video frame on.
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

    /// One video frame. `observe` sees what was handed over.
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
        self.id += 1;
        self.display_time_ns = next.predicted_display_time_ns;
        while let Some(feedback) = presenter.feedback() {
            if let Some(versions) = &mut self.versions {
                versions.lit(feedback.id);
            }
            if let Some(outcome) = self.pacer.presented(feedback.id, feedback.actual_display_time_ns) {
                self.timing.add(outcome, feedback.actual_display_time_ns);
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

    /// Ends playing, however that came: unless it was the display that was lost, it is left on the idle picture's first
    /// video frame, which is a defined one. Fails with what ended it, or else with what became of the presenter.
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
