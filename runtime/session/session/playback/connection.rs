//! Runs the controller of a display without a session, for programs that show their own pictures.

use crate::encode::Encoder;
use crate::optics::{Color, Device, DeviceKind, Display, VideoLink};
use crate::present::plm::{Identity, SOURCE_TIME};
use crate::present::{Desktop, Rate};
use crate::session::frame_log::error::SessionError;
use crate::session::frame_log::notes::{Notes, SessionEvent};
use crate::session::frame_log::trace::Trace;
use crate::session::playback::controller::{ControllerReport, ControllerThread, PreparedController, leds_of_planes};
use crate::session::playback::output::choose;
use std::time::Duration;

/// The controller of a display while another program shows pictures on it. The controller sleeps when this is dropped.
pub struct ControllerConnection {
    thread: ControllerThread,
    notes: Notes,
}

impl ControllerConnection {
    /// Sets the controller of a display up, and starts its patterns when it is locked to a picture. Without a
    /// `[device]` the display has a DLPC900 on DisplayPort. If `rate` is `None`, it is the rate of the monitor with the
    /// size of the display's video frames, otherwise the display's own rate, otherwise 60 Hz or 30 Hz of the input.
    ///
    /// # Errors
    /// Returns [`SessionError::Plm`], [`SessionError::Encode`], and [`SessionError::Setting`] for a display whose
    /// packing does not fit a controller.
    pub fn start(display: &Display, rate: Option<Rate>) -> Result<Self, SessionError> {
        let device = display.device.unwrap_or(Device::new(DeviceKind::Dlpc900, VideoLink::default()));
        let colors: Vec<Color> = display.wavelengths.iter().map(|w| w.color).collect();
        let encoder = encoder_of_planes(display, &colors)?;
        let controller = PreparedController::start(device, None, leds_of_planes(&encoder, false)?)?;
        let size = [encoder.frames().height, encoder.frames().width];
        let of_monitor = || if device.simulated { None } else { rate_of_monitor(size) };
        let usual = || Rate::from_hz(display.rate_hz.unwrap_or(device.link.usual_rate_hz()));
        let rate = match rate.or_else(of_monitor) {
            Some(rate) => rate,
            None => usual()?,
        };
        let notes = Notes::default();
        let thread = controller.watch(rate, notes.clone(), Trace::none().track("controller"))?;
        Ok(Self { thread, notes })
    }

    /// Returns the identity of the controller.
    pub fn identity(&self) -> &Identity {
        &self.thread.identity
    }

    /// Returns the next note for the user, waiting up to `within` for it.
    pub fn note(&self, within: Duration) -> Option<String> {
        match self.notes.recv_timeout(within)? {
            SessionEvent::Note(note) => Some(note),
            SessionEvent::Ended => None,
        }
    }

    /// Returns true while the connection of the controller is lost.
    pub fn is_lost(&self) -> bool {
        self.thread.is_lost()
    }

    /// Puts the controller to sleep, and returns its report.
    ///
    /// # Errors
    /// Returns [`SessionError::Thread`] if its thread failed.
    pub fn stop(self) -> Result<ControllerReport, SessionError> {
        Ok(self.thread.stop()?.0)
    }
}

/// Returns the encoder of one video frame of a display with these colors.
fn encoder_of_planes(display: &Display, colors: &[Color]) -> Result<Encoder, SessionError> {
    let one = |sub_frames: usize| Encoder::new(display, colors, sub_frames);
    // The fewest sub-frames that the packing takes.
    let fitting = (1..=24).find_map(|sub_frames| one(sub_frames).ok());
    fitting.map_or_else(|| Ok(one(24)?), Ok)
}

/// Returns the rate of the monitor with this size, which appears late.
fn rate_of_monitor(size: [usize; 2]) -> Option<Rate> {
    choose(&mut Desktop::open().ok()?, SOURCE_TIME, |d| d.choose(None, size)).ok()?.rate
}
