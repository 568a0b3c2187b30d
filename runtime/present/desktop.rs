//! Connects to the desktop, with its event loop, a window over a whole monitor, and ordinary windows.
//!
//! The inside of a window over a monitor has exactly the size of the video frame. Otherwise the window is rejected. It
//! has no cursor and no frame. Not every system reports the effect of a compositor on it. On the output of an SLM, run
//! no compositor, or let full-screen windows bypass it.

use super::link::{Link, LinkSystem};
use super::window::{OrdinaryWindow, Queue, Windows};
use super::{Event, Interference, Monitor, PresentError, no_desktop, system};
use eyebox_base::reason;
use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;
use std::sync::Arc;
use std::time::{Duration, Instant};
use winit::application::ApplicationHandler;
use winit::dpi::PhysicalSize;
use winit::event::{ElementState, WindowEvent};
use winit::event_loop::{ActiveEventLoop, EventLoop};
use winit::keyboard::{Key, NamedKey};
use winit::monitor::MonitorHandle;
use winit::platform::pump_events::{EventLoopExtPumpEvents, PumpStatus};
use winit::window::{Fullscreen, Window as SystemWindow, WindowAttributes, WindowId};

/// Time limit for a window to open with its size.
const WINDOW_TIMEOUT: Duration = Duration::from_secs(3);
/// Interval between checks that the window's monitor is still present.
const LOOK: Duration = Duration::from_secs(1);

#[derive(Default)]
struct Handler {
    monitors: Vec<MonitorHandle>,
    /// A requested window, with a queue for the events of an ordinary one. The result is in `made`.
    wanted: Option<(WindowAttributes, Option<Queue>)>,
    made: Option<Result<SystemWindow, String>>,
    events: VecDeque<Event>,
    windows: Windows,
    /// The windows over monitors.
    covering: Vec<Covering>,
    /// The reason why no window shows any more.
    lost: Option<String>,
}

/// A window over a monitor.
struct Covering {
    window: WindowId,
    monitor: Monitor,
    /// The time of the last check that the monitor is present.
    seen: Instant,
    /// The reason why the window shows nothing any more.
    lost: Option<String>,
}

impl Handler {
    /// On some desktops a window outlives its monitor, and then shows on nothing.
    fn look_for_monitors(&mut self, event_loop: &ActiveEventLoop) {
        for covering in self.covering.iter_mut().filter(|covering| covering.seen.elapsed() >= LOOK) {
            covering.seen = Instant::now();
            let now = event_loop.available_monitors().map(|m| (m.name(), [m.size().height, m.size().width]));
            let monitor = &covering.monitor;
            if !monitor.is_among(now) {
                covering.lost = Some(format!("monitor {monitor} is gone, or has another mode"));
            }
        }
    }

    /// Returns the reason why a window shows nothing any more.
    fn lost(&self, window: WindowId) -> Option<&String> {
        let of = |covering: &Covering| covering.window == window;
        self.lost.as_ref().or_else(|| self.covering.iter().find(|covering| of(covering))?.lost.as_ref())
    }

    fn make(&mut self, event_loop: &ActiveEventLoop) {
        let Some((attributes, events)) = self.wanted.take() else { return };
        let made = event_loop.create_window(attributes).map_err(|e| e.to_string());
        if let (Ok(window), Some(events)) = (&made, events) {
            self.windows.add(window.id(), events);
        }
        self.made = Some(made);
    }

    fn key(&mut self, key: &Key) {
        let event = match key {
            Key::Named(NamedKey::Escape) => Event::Close,
            Key::Named(NamedKey::Space) => Event::Pause,
            Key::Named(NamedKey::ArrowRight) => Event::Step,
            Key::Named(NamedKey::PageDown) => Event::Seek(10),
            Key::Named(NamedKey::PageUp) => Event::Seek(-10),
            Key::Named(NamedKey::Home) => Event::Seek(i64::MIN),
            Key::Character(c) => match c.as_str() {
                "q" => Event::Close,
                "+" => Event::Faster(2.0),
                "-" => Event::Faster(0.5),
                _ => return,
            },
            _ => return,
        };
        self.events.push_back(event);
    }
}

impl ApplicationHandler for Handler {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        self.monitors = event_loop.available_monitors().collect();
    }

    fn about_to_wait(&mut self, event_loop: &ActiveEventLoop) {
        self.make(event_loop);
        self.look_for_monitors(event_loop);
    }

    fn suspended(&mut self, _: &ActiveEventLoop) {
        self.lost = Some("the system took its surface away".into());
    }

    fn window_event(&mut self, _: &ActiveEventLoop, id: WindowId, event: WindowEvent) {
        if self.windows.take(id, &event) {
            return;
        }
        match event {
            WindowEvent::CloseRequested => self.events.push_back(Event::Close),
            WindowEvent::Destroyed => {
                for covering in self.covering.iter_mut().filter(|covering| covering.window == id) {
                    covering.lost = Some("another program destroyed it".into());
                }
            }
            WindowEvent::KeyboardInput { event, is_synthetic: false, .. } if event.state == ElementState::Pressed => {
                self.key(&event.logical_key);
            }
            _ => {}
        }
    }
}

/// The desktop with its monitors and windows. A process can have one at a time. Any thread may open it and must keep
/// it. On macOS only the main thread may open it.
pub struct Desktop {
    event_loop: EventLoop<()>,
    handler: Handler,
}

impl Desktop {
    /// Connects to the desktop.
    ///
    /// # Errors
    /// [`PresentError::Display`] if there is no desktop.
    pub fn open() -> Result<Self, PresentError> {
        let event_loop = system::event_loop().build().map_err(|e| {
            // The library reports the place of its failure in its own source, which is of no use in a message.
            let text = e.to_string();
            let why = text.rsplit(".rs:").next().and_then(|t| t.split_once(": ")).map_or(text.as_str(), |(_, why)| why);
            let why = why.trim_end_matches([')', '.']);
            no_desktop(reason!("no-desktop", "there is none to open a window on ({why}): {}", system::MISSING))
        })?;
        system::survive(&event_loop);
        let mut desktop = Self { event_loop, handler: Handler::default() };
        desktop.pump()?;
        Ok(desktop)
    }

    /// The monitors of the desktop.
    pub fn monitors(&self) -> Vec<Monitor> {
        self.handler.monitors.iter().enumerate().map(|(index, monitor)| Monitor::new(index, monitor)).collect()
    }

    /// The monitor that `wanted` names by its index, its name or its size (rows x columns). Without a name, it is the
    /// first monitor of `size`. The monitor must have `size`.
    ///
    /// # Errors
    /// [`PresentError::Display`] with a sentence.
    pub fn choose(&self, wanted: Option<&str>, size: [usize; 2]) -> Result<Monitor, PresentError> {
        Monitor::choose(&self.monitors(), wanted, size)
    }

    /// The monitors of the left and the right eye, chosen as [`choose`](Self::choose) does. Without names they are the
    /// first two monitors of `size`.
    ///
    /// # Errors
    /// [`PresentError::Display`] with a sentence.
    pub fn choose_two(&self, [left, right]: [Option<&str>; 2], size: [usize; 2]) -> Result<[Monitor; 2], PresentError> {
        let monitors = self.monitors();
        let named = right.map(|name| Monitor::choose(&monitors, Some(name), size)).transpose()?;
        let without = |taken: &Monitor| -> Vec<Monitor> {
            monitors.iter().filter(|monitor| monitor.index != taken.index).cloned().collect()
        };
        let others = named.as_ref().map_or_else(|| monitors.clone(), without);
        let left = Monitor::choose(if left.is_some() { &monitors } else { &others }, left, size)?;
        let right = named.map_or_else(|| Monitor::choose(&without(&left), None, size), Ok)?;
        if left.index == right.index {
            return Err(no_desktop(reason!(
                "same-monitor",
                "both eyes have monitor {left}, but each eye needs its own"
            )));
        }
        Ok([left, right])
    }

    /// Checks the link to a monitor without a window, and changes nothing but what a killed session left.
    pub fn link(&self, monitor: &Monitor) -> Link {
        let name = || Some(monitor.name.clone());
        if system::is_wayland(&self.event_loop) {
            return Link::unknown(LinkSystem::Wayland, name());
        }
        system::link(monitor).unwrap_or_else(|| Link::unknown(LinkSystem::Other, name()))
    }

    /// Opens a window over all of a monitor.
    pub(super) fn cover(desktop: &SharedDesktop, monitor: &Monitor) -> Result<OnDesktop, PresentError> {
        let (window, observer) = desktop.borrow_mut().covering_window(monitor)?;
        Ok(OnDesktop { desktop: Rc::clone(desktop), window, observer })
    }

    fn covering_window(
        &mut self,
        monitor: &Monitor,
    ) -> Result<(Arc<SystemWindow>, Option<system::Observer>), PresentError> {
        let [height, width] = monitor.size.map(|n| n as u32);
        let over = self.handler.monitors[monitor.index].clone();
        let attributes = SystemWindow::default_attributes()
            .with_title("eyebox")
            .with_decorations(false)
            .with_resizable(false)
            // Without a window manager, full screen is ignored and these values count.
            .with_inner_size(PhysicalSize::new(width, height))
            .with_position(over.position())
            .with_fullscreen(Some(Fullscreen::Borderless(Some(over))));
        let since = Instant::now();
        let window = self.make(attributes, None)?;
        window.set_cursor_visible(false);
        loop {
            let is = window.inner_size();
            if [is.height, is.width] == [height, width] {
                break;
            }
            if since.elapsed() > WINDOW_TIMEOUT {
                return Err(no_desktop(reason!(
                    "window-not-opened",
                    "the window opened with {}x{} pixels on monitor {monitor}: both must be equal, nothing is scaled",
                    is.height,
                    is.width
                )));
            }
            std::thread::sleep(Duration::from_millis(5));
            self.pump()?;
        }
        let (monitor_under, seen) = (monitor.clone(), Instant::now());
        self.handler.covering.push(Covering { window: window.id(), monitor: monitor_under, seen, lost: None });
        let observer = system::Observer::open(monitor, &window);
        Ok((window, observer))
    }

    fn pump(&mut self) -> Result<(), PresentError> {
        self.pump_for(Duration::ZERO)
    }

    /// Opens an ordinary window whose inside has `size` rows and columns, if the desktop allows that size.
    ///
    /// # Errors
    /// [`PresentError::Display`] if no window opens.
    pub fn window(&mut self, title: &str, size: [usize; 2]) -> Result<OrdinaryWindow, PresentError> {
        let [height, width] = size.map(|n| n as u32);
        let inside = PhysicalSize::new(width, height);
        let (attributes, events) = (SystemWindow::default_attributes().with_title(title), Queue::default());
        let window = self.make(attributes.with_inner_size(inside), Some(Queue::clone(&events)))?;
        Ok(OrdinaryWindow { window, events })
    }

    /// Returns a window as soon as the event loop has made it. Events of an ordinary window go into `events`.
    fn make(&mut self, attributes: WindowAttributes, events: Option<Queue>) -> Result<Arc<SystemWindow>, PresentError> {
        self.handler.wanted = Some((attributes, events));
        let since = Instant::now();
        loop {
            self.pump_for(Duration::from_millis(5))?;
            match self.handler.made.take() {
                Some(Ok(window)) => return Ok(Arc::new(window)),
                Some(Err(failure)) => {
                    return Err(no_desktop(reason!("window-not-opened", "a window could not be opened ({failure})")));
                }
                None if since.elapsed() > WINDOW_TIMEOUT => {
                    return Err(no_desktop(reason!("window-not-opened", "a window was requested and did not open")));
                }
                None => {}
            }
        }
    }

    /// Processes the events of the desktop. Without events it waits for at most this time.
    ///
    /// # Errors
    /// [`PresentError::Display`] when the desktop is gone.
    pub fn pump_for(&mut self, most: Duration) -> Result<(), PresentError> {
        let gone = || no_desktop(reason!("server-gone", "the connection to it is gone: its server ended"));
        if system::is_gone() {
            return Err(gone());
        }
        match self.event_loop.pump_app_events(Some(most), &mut self.handler) {
            PumpStatus::Continue if !system::is_gone() => Ok(()),
            _ => Err(gone()),
        }
    }
}

/// A desktop that several windows over monitors share.
pub type SharedDesktop = Rc<RefCell<Desktop>>;

/// A window that covers a monitor, with its desktop.
pub(super) struct OnDesktop {
    pub(super) desktop: SharedDesktop,
    pub(super) window: Arc<SystemWindow>,
    observer: Option<system::Observer>,
}

impl OnDesktop {
    /// Checks that pictures can still be shown, and returns the reason if not.
    pub(super) fn check(&mut self) -> Result<(), PresentError> {
        let mut desktop = self.desktop.borrow_mut();
        if system::is_gone() {
            desktop.pump()?;
        }
        match desktop.handler.lost(self.window.id()) {
            None => Ok(()),
            Some(reason) => Err(PresentError::display("the window", reason.clone())),
        }
    }

    /// Returns the link to the monitor as the window found it, if the system names one.
    pub(super) fn link(&self) -> Option<&Link> {
        self.observer.as_ref().map(system::Observer::link)
    }

    /// Returns the interference with the monitor that began since the last call.
    pub(super) fn interference(&self) -> Vec<Interference> {
        self.observer.as_ref().map(system::Observer::look).unwrap_or_default()
    }

    /// Returns the desktop's reason, if it has one, for a failure that the driver reports.
    pub(super) fn explain(&mut self) -> Result<(), PresentError> {
        self.desktop.borrow_mut().pump()?;
        self.check()
    }

    pub(super) fn event(&mut self) -> Option<Event> {
        let mut desktop = self.desktop.borrow_mut();
        if desktop.handler.events.is_empty()
            && let Err(PresentError::Display { reason, .. }) = desktop.pump()
        {
            // The next picture reports this.
            desktop.handler.lost.get_or_insert(reason.to_string());
        }
        desktop.handler.events.pop_front()
    }
}
