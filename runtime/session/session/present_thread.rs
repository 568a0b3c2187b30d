//! Runs the present thread, which owns the display and waits only for the display.

use crate::encode::Encoder;
use crate::gpu::{Gpu, Messages};
use crate::optics::Display;
use crate::present::plm::SOURCE_TIME;
use crate::present::{Interference, Link, Presenter, SECOND_NS};
use crate::session::feeds::eye_content::EyeContent;
use crate::session::feeds::following::{HandedOver, LiveState};
use crate::session::feeds::statistics::TwoEyesReport;
use crate::session::feeds::statistics::{Ending, Statistics};
use crate::session::feeds::{ActiveContent, ContentSetup};
use crate::session::frame_log::error::SessionError;
use crate::session::frame_log::trace::{Trace, Written};
use crate::session::options::{About, Content, Ended, FrameObserver, SessionOptions, Shared, Status};
use crate::session::playback::controller::{ControllerThread, PreparedController};
use crate::session::playback::output::{OpenDisplay, Output};
use crate::session::playback::player::{Command, Flow, Player, PresentedFrame};
use crate::session::playback::pulses::PulseThread;
use crate::session::playback::record::Recording;
use crate::session::playback::report::Report;
use crate::session::playback::scheduler::Scheduler;
use crate::session::playback::triggers::TriggerThread;
use crate::session::refinement::set_timing::as_ns;
use eyebox_base::reason;
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// Returns the display whose triggers a session has. Of two panels it is the first one with triggers.
fn bench_of(content: &Content) -> Display {
    let encoders = content.encoders();
    let has = |encoder: &&&Encoder| encoder.display().trigger_in.is_some() || encoder.display().trigger_out.is_some();
    encoders.iter().find(has).unwrap_or(&encoders[0]).display().clone()
}

/// Returns the statistics of two eyes.
fn two_eyes(running: &ActiveContent, presenter: &dyn Presenter, right_link: Option<Link>) -> Option<TwoEyesReport> {
    let ActiveContent::Both(both) = running else { return None };
    let [video_frames, differing] = both.counts;
    let (stereo, apart) = (both.stereo, presenter.apart());
    Some(TwoEyesReport { stereo, video_frames, differing, apart, right_link, ..TwoEyesReport::default() })
}

pub(super) struct PresentThread {
    shared: Arc<Shared>,
    running: ActiveContent,
    player: Player,
    recording: Option<Recording>,
    observer: Option<FrameObserver>,
    trace: Option<Written>,
    sub_frames: u64,
    begun_ns: i64,
    /// The longest time of content on the display, and the time since which it is shown.
    most_ns: Option<i64>,
    content_since_ns: Option<i64>,
    messages: Vec<Messages>,
    interference: Vec<Interference>,
    /// The links and the controllers of all panels, the left one first.
    link: Vec<Link>,
    controllers: Vec<Option<ControllerThread>>,
    triggers: Option<TriggerThread>,
    pulses: Option<PulseThread>,
    // The display is the last field, so that objects on its desktop or its device are dropped before it.
    display: OpenDisplay,
}

impl PresentThread {
    pub(super) fn start(
        content: Content,
        output: &Output,
        options: SessionOptions,
        shared: Arc<Shared>,
    ) -> Result<Self, SessionError> {
        let written = options.trace.as_deref().map(Trace::write).transpose()?;
        let trace = written.as_ref().map_or_else(Trace::none, Written::trace);
        let (newest, encoder_gpu) = match &content {
            Content::Play(play) => (play.sequence.newest().cloned(), play.device.clone()),
            Content::Live(_) => (None, None),
            Content::TwoEyed(both) => (None, both.device()),
        };
        let size = content.frame_size();
        let bench = bench_of(&content);
        if content.is_refined() && bench.trigger_in.is_some() {
            return Err(reason!(
                "trigger-in-refined",
                "the display '{}' has [trigger_in], which advances sequences that are played, but this session refines \
                 its content for the pupil. Leave [trigger_in] out, or play the sequence",
                bench.name
            )
            .into());
        }
        // The monitor of a controller may appear only when its receiver is on.
        let mut given = options.controller;
        let of = |encoder: &&Encoder| PreparedController::of(encoder, content.is_joint(), output, given.take());
        let controllers = content.encoders().iter().map(of).collect::<Result<Vec<_>, _>>()?;
        let patience = if controllers.iter().any(Option::is_some) { SOURCE_TIME } else { Duration::ZERO };
        let mut display = output.open(size, options.display_rate, options.gpu.as_ref(), patience)?;
        let notes = shared.notes.clone();
        let mut messages: Vec<Messages> = options.gpu.iter().map(Gpu::messages).collect();
        let other_gpu = encoder_gpu.filter(|gpu| !options.gpu.iter().any(|other| gpu.is(other)));
        messages.extend(other_gpu.iter().map(Gpu::messages));
        let setup = match content {
            Content::Play(play) => play.start(&display, notes, trace.clone())?.map(ActiveContent::One),
            Content::Live(live) => {
                let on_host = options.record.is_some() || options.observer.is_some();
                live.start(&mut display, on_host, Arc::clone(&shared.steered), &notes, trace.clone(), None)?
                    .map(ActiveContent::One)
            }
            Content::TwoEyed(both) => {
                both.start(&mut display, &shared.steered, &notes, &trace)?.map(ActiveContent::Both)
            }
        };
        let mode_rate = display.mode_rate.unwrap_or(display.rate);
        let watch = |controller: Option<PreparedController>| {
            let watch = |controller: PreparedController| {
                controller.watch(mode_rate, shared.notes.clone(), trace.track("controller"))
            };
            controller.map(watch).transpose()
        };
        let controllers = controllers.into_iter().map(watch).collect::<Result<Vec<_>, _>>()?;
        let link: Vec<Link> = display.presenter().links().into_iter().cloned().collect();
        link.iter().flat_map(Link::notes).for_each(|note| shared.notes.send(note));
        let interference = link.iter().flat_map(Link::wrong).cloned().collect();
        let ContentSetup { running, schedule, idle, sub_frames } = setup;
        let simulated = display.clock.is_simulated();
        let recording =
            options.record.as_deref().map(|folder| Recording::start(folder, size, simulated)).transpose()?;
        // Their lists go into the folder of the recording.
        let record = options.record.as_deref();
        let (pulses, trigger_out) = match display.real_clock {
            Some(clock) => {
                let pulses =
                    bench.trigger_in.map(|trigger| PulseThread::start(&trigger, clock, record, shared.notes.clone()));
                (pulses.transpose()?, bench.trigger_out)
            }
            None => {
                if bench.trigger_in.is_some() || bench.trigger_out.is_some() {
                    shared.notes.send("the clock is simulated, so no pulse of a trigger is given or taken");
                }
                (None, None)
            }
        };
        let triggers = TriggerThread::start(
            trigger_out,
            options.light_observer,
            display.real_clock,
            display.rate.period_ns(),
            record,
            shared.notes.clone(),
            trace.track("pulses"),
        )?;
        let mut player = Player::new(Rc::clone(&display.clock), Scheduler::new(schedule), idle, trace.track("present"));
        if let Some(newest) = newest {
            player.follows(newest);
        }
        Ok(Self {
            shared,
            running,
            player,
            recording,
            observer: options.observer,
            trace: written,
            sub_frames,
            begun_ns: display.clock.now_ns(),
            most_ns: options.duration.map(as_ns),
            content_since_ns: None,
            messages,
            interference,
            link,
            controllers,
            triggers,
            pulses,
            display,
        })
    }

    pub(super) fn about(&mut self) -> About {
        let schedule = *self.player.scheduler.schedule();
        About {
            presenter: self.display.presenter().describe(),
            display_rate: schedule.display_rate,
            set_frames: schedule.set_frames,
            sub_frames: self.sub_frames,
            rolls: schedule.rolls,
        }
    }

    /// Shows content until the session ends.
    pub(super) fn run(mut self) -> Ended {
        let ended = loop {
            match self.tick() {
                Ok(None) => {}
                Ok(Some(ending)) => break Ok(ending),
                Err(error) => break Err(error),
            }
        };
        self.finish(ended)
    }

    fn seconds(&self) -> f64 {
        (self.display.clock.now_ns() - self.begun_ns) as f64 / SECOND_NS as f64
    }

    /// Returns the time at which content was lit for the first time, on the monotonic clock of the system.
    fn first_light_ns(&self) -> Option<u64> {
        let clock = self.display.real_clock?;
        self.player.first_light_ns().map(|at_ns| clock.monotonic_ns(at_ns))
    }

    fn tick(&mut self) -> Result<Option<Ending>, SessionError> {
        if self.shared.stop.load(Ordering::Acquire) {
            return Ok(Some(Ending::Stopped));
        }
        while let Some(command) = self.shared.commands.take() {
            self.player.command(command, self.running.source());
        }
        if self.pulses.as_mut().is_some_and(PulseThread::advances) {
            self.player.command(Command::Step, self.running.source());
        }
        let Self { player, display, running, recording, observer, triggers, pulses, .. } = self;
        let (mut handed_over, rolls) = (None, player.scheduler.schedule().rolls);
        let flow = player.tick(display.presenter(), running.source(), &mut |frame| {
            let PresentedFrame { predicted_display_time_ns: start_ns, video_frame, .. } = *frame;
            handed_over = Some(HandedOver { start_ns, video_frame, decided: rolls || video_frame == 0 });
            if let Some(observer) = observer {
                observer(frame);
            }
            if let (Some(triggers), Some(content), 0) = (&mut *triggers, frame.index, video_frame) {
                triggers.set(content, frame.vblank, frame.new, start_ns);
            }
            if let Some(pulses) = pulses {
                pulses.handed_over(frame);
            }
            recording.as_mut().map_or(Ok(()), |recording| recording.add(frame))
        })?;
        if let Some(triggers) = &mut self.triggers {
            self.player.lit.iter().for_each(|(frame, at_ns)| triggers.lit(*frame, *at_ns));
        }
        match flow {
            Flow::Continue => {}
            Flow::Ended => return Ok(Some(Ending::End)),
            Flow::Closed => return Ok(Some(Ending::Closed)),
        }
        for following in running.lives_mut() {
            if !following.after(handed_over, display) {
                return Ok(Some(Ending::Closed));
            }
        }
        if let (ActiveContent::Both(both), Some(_)) = (running, handed_over) {
            both.handed_over();
        }
        // The duration also ends the wait for an application that never connects.
        let waits = self.running.lives().any(|following| following.first_is_to_come);
        if waits || self.player.scheduler.account().due > 0 {
            let (now_ns, period_ns) = (self.player.display_time_ns, self.player.rate().period_ns());
            let passed_ns = now_ns - *self.content_since_ns.get_or_insert(now_ns) + period_ns;
            if self.most_ns.is_some_and(|most_ns| passed_ns >= most_ns) {
                return Ok(Some(Ending::Duration));
            }
        }
        for note in self.display.presenter().panel_notes() {
            self.shared.notes.send(note);
        }
        for interference in self.display.presenter().interference() {
            self.shared.notes.send(interference.to_string());
            self.interference.push(interference);
        }
        self.shared.status.store(Status {
            seconds: self.seconds(),
            account: *self.player.scheduler.account(),
            timing: self.player.timing,
            first_light_ns: self.first_light_ns(),
            live: self.running.lives().next().map(LiveState::status),
        });
        Ok(None)
    }

    /// Shows the idle picture, ends the threads and returns the result.
    fn finish(mut self, ended: Result<Ending, SessionError>) -> Ended {
        let ended_by = *ended.as_ref().unwrap_or(&Ending::Failed);
        let mut result = self.player.end(self.display.presenter(), ended).map(drop);
        let (seconds, first_light_ns) = (self.seconds(), self.first_light_ns());
        let presenter = self.display.presenter();
        let schedule = *self.player.scheduler.schedule();
        let planes = self.sub_frames * schedule.decided_every() / schedule.set_frames.max(1);
        let mut statistics = Statistics {
            report: Report::new(&self.player.scheduler, &self.player.timing, seconds, planes),
            ended_by,
            first_light_ns,
            presenter: presenter.describe(),
            timed_by: presenter.timed_by(),
            display_hz: schedule.display_rate.hz(),
            content_hz: schedule.content_rate.hz(),
            set_frames: schedule.set_frames,
            margin_ms: self.player.pacer.margin_ns as f64 / 1e6,
            interference: self.interference,
            two_eyes: two_eyes(&self.running, presenter, self.link.get(1).cloned()),
            link: self.link.into_iter().next(),
            ..Statistics::default()
        };
        let mut tracks = vec![self.player.track];
        for (at, eye) in self.running.into_eyes().into_iter().enumerate() {
            match eye {
                EyeContent::Play(stream) => tracks.extend(stream.stop()),
                EyeContent::Live(following) => {
                    result = result.and(following.followed());
                    let (live, more, kept) = following.stop();
                    result = result.and(kept);
                    match (at, &mut statistics.two_eyes) {
                        (1, Some(both)) => both.right_live = Some(live),
                        _ => statistics.live = Some(live),
                    }
                    tracks.extend(more);
                }
            }
        }
        if let Some(triggers) = self.triggers.map(TriggerThread::stop) {
            match triggers {
                Ok((report, track)) => {
                    statistics.trigger_out = report;
                    tracks.push(track);
                }
                Err(error) => result = result.and(Err(error)),
            }
        }
        if let Some(pulses) = self.pulses.map(PulseThread::stop) {
            match pulses {
                Ok(report) => statistics.trigger_in = Some(report),
                Err(error) => result = result.and(Err(error)),
            }
        }
        // The idle picture is on the display. The thread is stopped here, so that its report is complete.
        for (at, controller) in self.controllers.into_iter().enumerate() {
            match controller.map(ControllerThread::stop) {
                None => {}
                Some(Ok((report, track))) => {
                    match (at, &mut statistics.two_eyes) {
                        (1, Some(both)) => both.right_controller = Some(report),
                        _ => statistics.controller = Some(report),
                    }
                    tracks.push(track);
                }
                Some(Err(error)) => result = result.and(Err(error)),
            }
        }
        drop(tracks);
        let written = self.trace.map_or(Ok(()), Written::finish);
        let recorded = self.recording.map_or(Ok(0), Recording::finish).map(|left_out| {
            statistics.pictures_left_out = left_out;
        });
        result = result.and(written).and(recorded);
        // The messages of the validation layer are complete after all objects that it watches are dropped.
        drop(self.display);
        for messages in &self.messages {
            statistics.validation.extend(messages.lock().map(|m| m.clone()).unwrap_or_default());
        }
        Ended { statistics, result }
    }
}
