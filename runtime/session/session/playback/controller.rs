//! Starts the controller of a display, checks it while the display shows, and puts it to sleep at the end.
//!
//! The controller has a thread of its own, so that the present thread never waits for it. Its receiver is switched on
//! before the display opens, because the monitor may appear only then. The patterns start when the controller is locked
//! to the picture of the display.

use crate::encode::Encoder;
use crate::optics::{Color, Device};
use crate::present::Rate;
use crate::present::plm::{
    self, Condition, Controller, Identity, Leds, PLANES, PlmError, SOURCE_TIME, State, exposure_us, plane_of_bit,
};
use crate::session::frame_log::error::SessionError;
use crate::session::frame_log::notes::Notes;
use crate::session::frame_log::threads::{join, spawn};
use crate::session::frame_log::trace::Track;
use crate::session::playback::output::Output;
use eyebox_base::error::ErrorData;
use eyebox_base::reason;
use serde_json::{Value, json};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// The interval of checks, after the guide.
const CHECK_INTERVAL: Duration = Duration::from_secs(1);
/// The interval at which a waiting thread checks for the end.
const LOOK: Duration = Duration::from_millis(50);
/// The most events that a report lists. All are counted.
const MOST_EVENTS: usize = 64;

/// An event of a controller.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct ControllerEvent {
    /// The time since the start of the session (s).
    pub seconds: f64,
    /// The kind of the event, `running`, `abort`, `trigger`, `no-picture`, `connected` or `error`.
    pub kind: &'static str,
    /// The event in words.
    pub text: String,
    /// The error as data, for events of the kind `error`.
    pub error: Option<ErrorData>,
}

/// The statistics of the controller of a display.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct ControllerReport {
    /// The identity of the controller.
    pub identity: Identity,
    /// The video frames per second that the patterns were computed for.
    pub rate_hz: f64,
    /// The exposure of a plane (us). It is `None` if the patterns never ran.
    pub exposure_us: Option<u32>,
    /// The number of checks of the running controller.
    pub checks: u64,
    /// The checks that found an aborted video frame.
    pub aborts: u64,
    /// The checks that found the planes stopped by the line at TRIG_IN_2.
    pub stopped: u64,
    /// The number of times that the picture was lost.
    pub lost_pictures: u64,
    /// The number of times that a lost connection was opened again.
    pub reconnections: u64,
    /// The number of errors of the controller and of its connection.
    pub errors: u64,
    /// The first 64 events.
    pub events: Vec<ControllerEvent>,
    /// True if the controller was put to sleep at the end.
    pub asleep: bool,
}

impl ControllerReport {
    /// Returns the report for programs, with the keys of `docs/plm.md`.
    pub fn to_json(&self) -> Value {
        let event =
            |e: &ControllerEvent| json!({ "seconds": e.seconds, "kind": e.kind, "text": e.text, "error": e.error });
        json!({
            "board": self.identity.board, "firmware": self.identity.firmware, "versions": self.identity.versions, "flips": self.identity.flips,
            "rate_hz": self.rate_hz, "exposure_us": self.exposure_us, "checks": self.checks, "aborts": self.aborts, "stopped": self.stopped,
            "lost_pictures": self.lost_pictures, "reconnections": self.reconnections, "errors": self.errors, "asleep": self.asleep,
            "events": self.events.iter().map(event).collect::<Vec<_>>(),
        })
    }
}

/// Returns the outputs for light sources of each plane. They follow the colors that an encoder puts into it. With
/// `together`, all colors share each plane.
///
/// # Errors
/// Returns [`SessionError::Setting`] if the display does not show single bits of RGB video frames, or shows different
/// colors in the same plane.
pub fn leds_of_planes(encoder: &Encoder, together: bool) -> Result<[Leds; PLANES], SessionError> {
    let (packed, display) = (encoder.packed(), encoder.display());
    let mut leds = [None; PLANES];
    for slot in &packed.slots {
        let ([bit], 3) = (&slot.bits[..], packed.channels) else {
            return Err(reason!(
                "device-packing",
                "the display '{}' has a controller for bit planes, but its packing has no single bits of RGB video \
                 frames. Use packing = \"planes24\"",
                display.name
            )
            .into());
        };
        let wanted = match encoder.colors()[slot.color] {
            _ if together => Leds::ALL,
            Color::Red => Leds::RED,
            Color::Green => Leds::GREEN,
            Color::Blue => Leds::BLUE,
        };
        let place = &mut leds[plane_of_bit(usize::from(*bit))];
        if place.is_some_and(|before| before != wanted) {
            return Err(reason!(
                "device-colors",
                "the display '{}' shows different colors in the same plane of its video frames, but its controller \
                 lights the same sources in all of them. Use one video frame per set",
                display.name
            )
            .into());
        }
        *place = Some(wanted);
    }
    Ok(leds.map(Option::unwrap_or_default))
}

/// Opens a controller again after its connection was lost.
type Reopen = Box<dyn FnMut() -> Result<Controller, PlmError> + Send>;

/// A controller whose receiver is on.
pub(crate) struct PreparedController {
    controller: Controller,
    device: Device,
    reopen: Reopen,
    identity: Identity,
    leds: [Leds; PLANES],
}

impl PreparedController {
    /// Prepares the controller of the display of `encoder`, if the output needs one. With `together`, all colors share
    /// each plane.
    pub(crate) fn of(
        encoder: &Encoder,
        together: bool,
        output: &Output,
        given: Option<Controller>,
    ) -> Result<Option<Self>, SessionError> {
        let Some(device) = encoder.display().device else { return Ok(None) };
        if given.is_none() && !device.simulated && !output.is_shown() {
            return Ok(None);
        }
        Ok(Some(Self::start(device, given, leds_of_planes(encoder, together)?)?))
    }

    /// Prepares `given`, or the controller of this machine.
    pub(crate) fn start(device: Device, given: Option<Controller>, leds: [Leds; PLANES]) -> Result<Self, SessionError> {
        let mut controller = given.map_or_else(|| plm::open(&device), Ok)?;
        controller.set_triggers(device.trigger_out, device.trigger_in);
        let identity = controller.prepare(device.link)?;
        let reopen = Box::new(move || plm::open(&device));
        Ok(Self { controller, device, reopen, identity, leds })
    }

    /// Starts the patterns on a thread as soon as the controller is locked, for a display of this rate.
    pub(crate) fn watch(self, rate: Rate, notes: Notes, track: Track) -> Result<ControllerThread, SessionError> {
        let identity = self.identity.clone();
        let mut watch = Watch::new(self, rate, notes, track)?;
        let stop = Arc::new(AtomicBool::new(false));
        let ends = Arc::clone(&stop);
        let running = Arc::new(AtomicBool::new(false));
        let runs = Arc::clone(&running);
        let lost = Arc::new(AtomicBool::new(false));
        let loses = Arc::clone(&lost);
        let thread = spawn("watches the controller", move || {
            let goes_on = || !ends.load(Ordering::Acquire);
            while goes_on() {
                let checked = Instant::now();
                watch.step(&mut { goes_on });
                runs.store(watch.is_running(), Ordering::Release);
                loses.store(watch.is_lost, Ordering::Release);
                while goes_on() && checked.elapsed() < CHECK_INTERVAL {
                    std::thread::sleep(LOOK);
                }
            }
            watch.finish()
        })?;
        Ok(ControllerThread { identity, stop, running, lost, thread: Some(thread) })
    }
}

/// The thread of a controller. The controller sleeps when this is dropped.
pub(crate) struct ControllerThread {
    pub identity: Identity,
    stop: Arc<AtomicBool>,
    running: Arc<AtomicBool>,
    lost: Arc<AtomicBool>,
    thread: Option<JoinHandle<(ControllerReport, Track)>>,
}

impl ControllerThread {
    /// Returns true if the patterns ran at the last check.
    pub(crate) fn is_running(&self) -> bool {
        self.running.load(Ordering::Acquire)
    }

    /// Returns true while the connection of the controller is lost.
    pub(crate) fn is_lost(&self) -> bool {
        self.lost.load(Ordering::Acquire) || self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Puts the controller to sleep, and returns its report.
    pub(crate) fn stop(mut self) -> Result<(ControllerReport, Track), SessionError> {
        self.stop.store(true, Ordering::Release);
        let thread = self.thread.take().expect("a controller has its thread until it is stopped");
        join("watches the controller", thread)
    }
}

impl Drop for ControllerThread {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// The steps of the thread.
struct Watch {
    controller: Controller,
    device: Device,
    reopen: Reopen,
    /// True while the connection is lost.
    is_lost: bool,
    leds: [Leds; PLANES],
    /// True if the planes ran at the last check of this line.
    was_running: Option<bool>,
    report: ControllerReport,
    notes: Notes,
    track: Track,
    begun: Instant,
    /// The last note, which is not repeated.
    noted: String,
}

impl Watch {
    fn new(prepared: PreparedController, rate: Rate, notes: Notes, track: Track) -> Result<Self, SessionError> {
        let PreparedController { controller, device, reopen, identity, leds } = prepared;
        // An impossible rate is refused before anything is shown.
        exposure_us(rate.hz())?;
        let report = ControllerReport {
            identity,
            rate_hz: rate.hz(),
            exposure_us: None,
            checks: 0,
            aborts: 0,
            stopped: 0,
            lost_pictures: 0,
            reconnections: 0,
            errors: 0,
            events: Vec::new(),
            asleep: false,
        };
        Ok(Self {
            controller,
            device,
            reopen,
            is_lost: false,
            leds,
            was_running: None,
            report,
            notes,
            track,
            begun: Instant::now(),
            noted: String::new(),
        })
    }

    fn is_running(&self) -> bool {
        !self.is_lost && self.controller.state() == State::Running
    }

    /// Starts or checks the controller, and opens a lost connection again.
    fn step(&mut self, goes_on: &mut dyn FnMut() -> bool) {
        if self.is_lost && self.reconnect().is_err() {
            // The next step tries again.
            return;
        }
        let done = if self.controller.state() == State::Running { self.check() } else { self.begin(goes_on) };
        let Err(error) = done else { return };
        if matches!(error, PlmError::NoSource { .. }) && !goes_on() {
            return;
        }
        self.report.errors += 1;
        self.event("error", error.to_string(), Some(ErrorData::of(&error)));
        if error.is_of_link() {
            self.controller.abandon();
            self.is_lost = true;
        }
    }

    /// Opens the controller again, and takes it through all steps, because it may have been switched off.
    fn reconnect(&mut self) -> Result<(), PlmError> {
        let mut controller = (self.reopen)()?;
        controller.set_triggers(self.device.trigger_out, self.device.trigger_in);
        if let Err(error) = controller.prepare(self.device.link) {
            controller.abandon();
            return Err(error);
        }
        (self.controller, self.is_lost) = (controller, false);
        self.report.reconnections += 1;
        self.event("connected", "the controller is connected again".into(), None);
        Ok(())
    }

    fn begin(&mut self, goes_on: &mut dyn FnMut() -> bool) -> Result<(), PlmError> {
        self.controller.wait_for_source(SOURCE_TIME, goes_on)?;
        let exposure_us = self.controller.begin(self.report.rate_hz, &self.leds)?;
        self.report.exposure_us = Some(exposure_us);
        let hz = self.report.rate_hz;
        self.event("running", format!("the controller shows {PLANES} planes of {exposure_us} us at {hz:.3} Hz"), None);
        Ok(())
    }

    fn check(&mut self) -> Result<(), PlmError> {
        let condition = self.read_condition()?;
        if self.device.trigger_in.is_some() && condition.main.is_locked() {
            let is_running = condition.main.is_running();
            self.report.stopped += u64::from(!is_running);
            if self.was_running.replace(is_running) != Some(is_running) {
                let text = if is_running { "started" } else { "stopped" };
                self.event("trigger", format!("the line at TRIG_IN_2 {text} the planes"), None);
            }
        } else if !condition.is_showing() {
            self.report.lost_pictures += 1;
            self.event("no-picture", "the controller lost the picture, and starts again".into(), None);
            self.controller.recover()?;
        }
        Ok(())
    }

    /// Reads the condition of the running controller, and counts aborts.
    fn read_condition(&mut self) -> Result<Condition, PlmError> {
        let condition = self.controller.poll()?;
        self.report.checks += 1;
        if condition.hardware.has_aborted() {
            self.report.aborts += 1;
            let hz = self.report.rate_hz;
            let text = format!(
                "the controller aborted video frames, because its {PLANES} planes do not fit them. The video mode is \
                 faster than {hz:.3} Hz"
            );
            self.event("abort", text, None);
        }
        match condition.hardware.fault() {
            Some(fault) => Err(PlmError::Hardware { fault, status: condition.hardware.0 }),
            None => Ok(condition),
        }
    }

    fn event(&mut self, kind: &'static str, text: String, error: Option<ErrorData>) {
        self.track.span(kind, self.report.checks, Instant::now());
        if self.noted != text {
            self.notes.send(text.clone());
            self.noted.clone_from(&text);
        }
        if self.report.events.len() < MOST_EVENTS {
            let seconds = self.begun.elapsed().as_secs_f64();
            self.report.events.push(ControllerEvent { seconds, kind, text, error });
        }
    }

    fn finish(mut self) -> (ControllerReport, Track) {
        if self.is_lost {
            return (self.report, self.track);
        }
        if self.controller.state() == State::Running {
            // Aborts of the last second count, too. An error repeats in the next commands.
            let _ = self.read_condition();
        }
        match self.controller.sleep() {
            Ok(()) => self.report.asleep = true,
            Err(error) => {
                self.report.errors += 1;
                self.event("error", error.to_string(), Some(ErrorData::of(&error)));
            }
        }
        (self.report, self.track)
    }
}

#[cfg(test)]
#[path = "controller_tests.rs"]
mod tests;
