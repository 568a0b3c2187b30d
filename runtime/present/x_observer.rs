//! Reads the interference with an output from an X server (gamma ramp, screen saver, power saving).

use super::{Interference, Monitor};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::Duration;
use x11rb::connection::RequestConnection as _;
use x11rb::errors::ReplyError;
use x11rb::protocol::dpms::{self, ConnectionExt as _, DPMSMode};
use x11rb::protocol::randr::{self, ConnectionExt as _};
use x11rb::protocol::screensaver::{self, ConnectionExt as _};
use x11rb::rust_connection::RustConnection;

/// Interval between requests to the X server, which has no event for ramps.
const PERIOD: Duration = Duration::from_secs(1);

/// Reads the interference with one output on its own thread, so that the thread that presents does not wait for the X
/// server.
pub(super) struct Observer {
    found: Receiver<Interference>,
    /// Ends the thread when it is dropped.
    _stop: Sender<()>,
}

impl Observer {
    /// Starts to observe the output of a monitor. Returns nothing if the environment names no X server.
    pub(super) fn open(monitor: &Monitor) -> Option<Self> {
        let mut output = Output::open(monitor)?;
        let ((tell, found), (stop, stopped)) = (channel(), channel());
        let observe = move || {
            loop {
                output.look().into_iter().for_each(|one| drop(tell.send(one)));
                if stopped.recv_timeout(PERIOD) != Err(RecvTimeoutError::Timeout) {
                    break;
                }
            }
        };
        std::thread::Builder::new().name("observer".into()).spawn(observe).ok()?;
        Some(Self { found, _stop: stop })
    }

    /// Returns the interference that began since the last call.
    pub(super) fn look(&self) -> Vec<Interference> {
        self.found.try_iter().collect()
    }
}

/// An output of an X server, over its own connection.
struct Output {
    server: RustConnection,
    root: u32,
    /// The output that shows the monitor, and its CRTC.
    output: Option<(String, u32)>,
    has_saver: bool,
    has_dpms: bool,
    /// The interference at the last check.
    now: Vec<Interference>,
}

impl Output {
    /// Connects to the X server of the environment. Returns nothing if there is none.
    fn open(monitor: &Monitor) -> Option<Self> {
        let (server, screen) = RustConnection::connect(None).ok()?;
        let root = x11rb::connection::Connection::setup(&server).roots.get(screen)?.root;
        let has = |name| server.extension_information(name).ok().flatten().is_some();
        let (has_randr, has_saver) = (has(randr::X11_EXTENSION_NAME), has(screensaver::X11_EXTENSION_NAME));
        let has_dpms = has(dpms::X11_EXTENSION_NAME);
        let output = if has_randr { output(&server, root, monitor).ok().flatten() } else { None };
        Some(Self { server, root, output, has_saver, has_dpms, now: Vec::new() })
    }

    /// Returns the interference that began since the last check.
    fn look(&mut self) -> Vec<Interference> {
        let found: Vec<_> = [self.ramp(), self.saver(), self.power()].into_iter().flatten().collect();
        let new = found.iter().filter(|one| !self.now.contains(one)).cloned().collect();
        self.now = found;
        new
    }

    fn ramp(&self) -> Option<Interference> {
        let (output, crtc) = self.output.as_ref()?;
        let ramp = self.server.randr_get_crtc_gamma(*crtc).ok()?.reply().ok()?;
        let levels = [&ramp.red, &ramp.green, &ramp.blue].into_iter().map(|channel| change(channel)).max()?;
        (levels > 0).then(|| Interference::GammaRamp { output: output.clone(), levels })
    }

    fn saver(&self) -> Option<Interference> {
        let reply = self.server.screensaver_query_info(self.root).ok().filter(|_| self.has_saver)?.reply().ok()?;
        (reply.state == u8::from(screensaver::State::ON)).then_some(Interference::ScreenSaver)
    }

    fn power(&self) -> Option<Interference> {
        let reply = self.server.dpms_info().ok().filter(|_| self.has_dpms)?.reply().ok()?;
        (reply.state && reply.power_level != DPMSMode::ON).then_some(Interference::PowerSaving)
    }
}

/// Finds the output that shows a monitor, and its CRTC.
fn output(server: &RustConnection, root: u32, monitor: &Monitor) -> Result<Option<(String, u32)>, ReplyError> {
    let resources = server.randr_get_screen_resources_current(root)?.reply()?;
    for output in resources.outputs {
        let info = server.randr_get_output_info(output, resources.config_timestamp)?.reply()?;
        if info.crtc != 0 && info.name == monitor.name.as_bytes() {
            return Ok(Some((monitor.name.clone(), info.crtc)));
        }
    }
    Ok(None)
}

/// Returns the largest change by a ramp, in whole levels of 8 bits. A ramp of zeros was never set (Xvfb). On some
/// servers (Xorg's dummy), a ramp without a change has only the high byte. That is less than a level.
fn change(ramp: &[u16]) -> u32 {
    if ramp.len() < 2 || ramp.iter().all(|value| *value == 0) {
        return 0;
    }
    let last = ramp.len() as f64 - 1.0;
    let off = |(i, value): (usize, &u16)| (f64::from(*value) - (65535.0 * i as f64 / last).round()).abs() / 257.0;
    ramp.iter().enumerate().map(off).fold(0.0, f64::max) as u32
}

#[cfg(test)]
mod tests {
    use super::change;

    #[test]
    fn a_ramp_changes_levels_by_its_distance_from_a_line() {
        let ramp = |n: usize, of: fn(f64) -> f64| -> Vec<u16> {
            (0..n).map(|i| (65535.0 * of(i as f64 / (n as f64 - 1.0))).round() as u16).collect()
        };
        for n in [2, 256, 1024, 4096] {
            assert_eq!(change(&ramp(n, |x| x)), 0, "{n} entries");
        }
        assert_eq!(change(&(0..256).map(|i| i << 8).collect::<Vec<u16>>()), 0);
        assert_eq!(change(&ramp(256, |x| 0.8 * x)), 51);
        assert_eq!(change(&ramp(256, |x| 1.0 - x)), 255);
        // sRGB's 2.2 against a line gives 0.283 at 0.518.
        assert_eq!(change(&ramp(1024, |x| x.powf(2.2))), 72);
        assert_eq!((change(&[0; 256]), change(&[]), change(&[9])), (0, 0, 0));
    }
}
