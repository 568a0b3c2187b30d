//! Checks the link to an output on a thread, once per second, and sets it right while a session shows.

use super::link::{Link, LinkCheck, LinkSystem, XLink};
use super::{Interference, Monitor};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::Duration;
use winit::raw_window_handle::{HasWindowHandle, RawWindowHandle};
use winit::window::Window as SystemWindow;

/// Interval between requests to the X server, which has no event for ramps.
const PERIOD: Duration = Duration::from_secs(1);
/// The longest wait for the thread to put the link back. A server that answers needs some milliseconds.
const PATIENCE: Duration = Duration::from_secs(2);

/// Checks the link to one output on its own thread, so that the thread that presents does not wait for the X server.
/// The link is put back when this is dropped.
pub(super) struct Observer {
    link: Link,
    found: Receiver<Interference>,
    /// Ends the thread when it is dropped.
    stop: Option<Sender<()>>,
    /// Disconnects when the thread has ended.
    ended: Receiver<()>,
}

impl Observer {
    /// Checks the link of a window to a monitor, sets it right, and starts to observe it. Returns nothing if the
    /// environment names no X server. Wayland reports nothing.
    pub(super) fn open(monitor: &Monitor, window: &SystemWindow) -> Option<Self> {
        let window = match window.window_handle().ok()?.as_raw() {
            RawWindowHandle::Xlib(window) => window.window as u32,
            RawWindowHandle::Xcb(window) => window.window.get(),
            _ => {
                let (_, found) = channel();
                let (_, ended) = channel();
                let link = Link::unknown(LinkSystem::Wayland, Some(monitor.name.clone()));
                return Some(Self { link, found, stop: None, ended });
            }
        };
        let mut x = XLink::open(&monitor.name)?;
        x.begin(window);
        let link = x.check();
        let ((tell, found), (stop, stopped), (end, ended)) = (channel(), channel(), channel());
        let mut news = News::new(&link);
        let observe = move || {
            while stopped.recv_timeout(PERIOD) == Err(RecvTimeoutError::Timeout) {
                news.of(&x.check()).into_iter().for_each(|one| drop(tell.send(one)));
            }
            x.put_back();
            drop::<Sender<()>>(end);
        };
        std::thread::Builder::new().name("observer".into()).spawn(observe).ok()?;
        Some(Self { link, found, stop: Some(stop), ended })
    }

    /// The link at the beginning.
    pub(super) fn link(&self) -> &Link {
        &self.link
    }

    /// Returns the interference that began since the last call.
    pub(super) fn look(&self) -> Vec<Interference> {
        self.found.try_iter().collect()
    }
}

impl Drop for Observer {
    fn drop(&mut self) {
        if self.stop.take().is_some() {
            let _ = self.ended.recv_timeout(PATIENCE);
        }
    }
}

/// Checks the link to a monitor without a session. Returns nothing without an X server.
pub(super) fn link(monitor: &Monitor) -> Option<Link> {
    Some(XLink::open(&monitor.name)?.check())
}

/// Finds what is new in a check.
struct News {
    /// The interference at the last check.
    now: Vec<Interference>,
    /// Ramps that were replaced. A program that loads the same ramp every few seconds is reported once.
    ramps: Vec<Interference>,
}

impl News {
    /// The parts that were wrong at the beginning are no news.
    fn new(link: &Link) -> Self {
        Self { now: link.wrong().cloned().collect(), ramps: Vec::new() }
    }

    fn of(&mut self, link: &Link) -> Vec<Interference> {
        let found: Vec<_> = link.checks.iter().filter_map(LinkCheck::disturbs).cloned().collect();
        let is_known = |one: &Interference| self.now.contains(one) || self.ramps.contains(one);
        let new: Vec<_> = found.iter().filter(|one| !is_known(one)).cloned().collect();
        self.ramps.extend(new.iter().filter(|one| matches!(one, Interference::GammaRamp { .. })).cloned());
        self.now = found;
        new
    }
}
