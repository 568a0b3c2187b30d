//! A window over a whole monitor, which shows video frames as they are.
//!
//! Its inside has exactly the video frame's size, or it is refused; it has no cursor and no frame. What a compositor does
//! to it cannot be asked everywhere: on an SLM's output run none, or let full-screen windows bypass it.

use super::panel::Panels;
use super::{Event, Feedback, PlaybackError, Presenter, Rate, RealClock, connection, direct};
use crate::engine::EngineError;
use crate::engine::vulkan::{Screen, WindowHandle};
use std::collections::VecDeque;
use std::fmt;
use std::rc::Rc;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use winit::application::ApplicationHandler;
use winit::dpi::{PhysicalPosition, PhysicalSize};
use winit::event::{ElementState, WindowEvent};
use winit::event_loop::{ActiveEventLoop, EventLoop};
use winit::keyboard::{Key, NamedKey};
use winit::monitor::MonitorHandle;
use winit::platform::pump_events::{EventLoopExtPumpEvents, PumpStatus};
use winit::raw_window_handle::{HasDisplayHandle, HasWindowHandle, RawDisplayHandle, RawWindowHandle};
use winit::window::{Fullscreen, Window as SystemWindow, WindowId};

/// How long a window may take to come up with its size.
const PATIENCE: Duration = Duration::from_secs(3);
/// How often it is looked whether the window's monitor is still there.
const LOOK: Duration = Duration::from_secs(1);

/// A monitor of the desktop.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Monitor {
    /// By which it is chosen.
    pub index: usize,
    /// What the system calls it.
    pub name: String,
    /// Rows, columns.
    pub size: [usize; 2],
    /// Of its upper left corner on the desktop: down, right.
    pub position: [i32; 2],
    /// Video frames a second, where the system says.
    pub rate: Option<Rate>,
    /// All its modes: rows, columns, rate, bits a pixel.
    pub modes: Vec<([usize; 2], Option<Rate>, u16)>,
}

impl fmt::Display for Monitor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} '{}' {}x{}", self.index, self.name, self.size[0], self.size[1])
    }
}

/// Whether a monitor is there with the size that it had.
fn is_among(monitor: &Monitor, mut now: impl Iterator<Item = (Option<String>, [u32; 2])>) -> bool {
    now.any(|(name, size)| size.map(|n| n as usize) == monitor.size && name.unwrap_or_default() == monitor.name)
}

fn rate(millihertz: Option<u32>) -> Option<Rate> {
    // Some servers say 0.
    millihertz.and_then(|m| Rate::from_hz(f64::from(m) / 1000.0).ok())
}

fn described((index, monitor): (usize, &MonitorHandle)) -> Monitor {
    let [height, width] = [monitor.size().height as usize, monitor.size().width as usize];
    let position = monitor.position();
    let modes = monitor.video_modes().map(|m| {
        ([m.size().height as usize, m.size().width as usize], rate(Some(m.refresh_rate_millihertz())), m.bit_depth())
    });
    Monitor {
        index,
        name: monitor.name().unwrap_or_default(),
        size: [height, width],
        position: [position.y, position.x],
        rate: rate(monitor.refresh_rate_millihertz()),
        modes: modes.collect(),
    }
}

/// What the event loop calls.
#[derive(Default)]
struct Handler {
    monitors: Vec<MonitorHandle>,
    wanted: Option<(usize, [usize; 2])>,
    window: Option<Arc<SystemWindow>>,
    failure: Option<String>,
    events: VecDeque<Event>,
    panels: Panels,
    /// The monitor under the window, and when it was last seen.
    under: Option<(Monitor, Instant)>,
    /// Why nothing more can be shown.
    lost: Option<String>,
}

impl Handler {
    /// A window outlives its monitor on some desktops, and shows on nothing then.
    fn look_for_monitor(&mut self, event_loop: &ActiveEventLoop) {
        let Some((monitor, seen)) = self.under.as_mut().filter(|u| u.1.elapsed() >= LOOK) else { return };
        *seen = Instant::now();
        let now = event_loop.available_monitors().map(|m| (m.name(), [m.size().height, m.size().width]));
        if !is_among(monitor, now) {
            self.lost = Some(format!("monitor {monitor} is gone, or has another mode"));
        }
    }

    fn make(&mut self, event_loop: &ActiveEventLoop) {
        let Some((index, [height, width])) = self.wanted.take() else { return };
        let monitor = self.monitors[index].clone();
        let at = monitor.position();
        let attributes = SystemWindow::default_attributes()
            .with_title("eyebox")
            .with_decorations(false)
            .with_resizable(false)
            // Without a window manager full screen is ignored, and these count.
            .with_inner_size(PhysicalSize::new(width as u32, height as u32))
            .with_position(PhysicalPosition::new(at.x, at.y))
            .with_fullscreen(Some(Fullscreen::Borderless(Some(monitor))));
        match event_loop.create_window(attributes) {
            Ok(window) => {
                window.set_cursor_visible(false);
                self.window = Some(Arc::new(window));
            }
            Err(error) => self.failure = Some(error.to_string()),
        }
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
        self.panels.make(event_loop);
        self.look_for_monitor(event_loop);
    }

    fn suspended(&mut self, _: &ActiveEventLoop) {
        self.lost = Some("the system took its surface away".into());
    }

    fn window_event(&mut self, _: &ActiveEventLoop, id: WindowId, event: WindowEvent) {
        if self.panels.take(id, &event) {
            return;
        }
        match event {
            WindowEvent::CloseRequested => self.events.push_back(Event::Close),
            WindowEvent::Destroyed => self.lost = Some("another program destroyed it".into()),
            WindowEvent::KeyboardInput { event, is_synthetic: false, .. } if event.state == ElementState::Pressed => {
                self.key(&event.logical_key);
            }
            _ => {}
        }
    }
}

/// The desktop: its monitors, and windows on them. One at a time in a process, on its main thread.
pub struct Desktop {
    event_loop: EventLoop<()>,
    handler: Handler,
}

pub(super) fn no_desktop(reason: String) -> PlaybackError {
    PlaybackError::Presenter { presenter: "the desktop".into(), reason }
}

impl Desktop {
    /// Connects to it.
    ///
    /// # Errors
    /// [`PlaybackError::Presenter`] where there is none.
    pub fn open() -> Result<Self, PlaybackError> {
        let event_loop = EventLoop::new().map_err(|e| {
            // The library says where in its own source it failed: nobody's business here.
            let text = e.to_string();
            let why = text.rsplit(".rs:").next().and_then(|t| t.split_once(": ")).map_or(text.as_str(), |(_, why)| why);
            let why = why.trim_end_matches([')', '.']);
            no_desktop(format!("there is none to open a window on ({why}): set DISPLAY or WAYLAND_DISPLAY"))
        })?;
        connection::survive(&event_loop);
        let mut desktop = Self { event_loop, handler: Handler::default() };
        desktop.pump()?;
        Ok(desktop)
    }

    /// Its monitors.
    pub fn monitors(&self) -> Vec<Monitor> {
        self.handler.monitors.iter().enumerate().map(described).collect()
    }

    /// The monitor that `wanted` names by its index, its name or its size (rows x columns); without, the first that has
    /// `size`. It must have `size`.
    ///
    /// # Errors
    /// [`PlaybackError::Presenter`], in a sentence.
    pub fn choose(&self, wanted: Option<&str>, size: [usize; 2]) -> Result<Monitor, PlaybackError> {
        let monitors = self.monitors();
        let has = || monitors.iter().map(Monitor::to_string).collect::<Vec<_>>().join(", ");
        let [height, width] = size;
        let found = match wanted {
            None => monitors.iter().find(|m| m.size == size),
            Some(text) => {
                let by_size = |m: &&Monitor| format!("{}x{}", m.size[0], m.size[1]) == text;
                let by_index = text.parse::<usize>().ok().and_then(|i| monitors.get(i));
                by_index.or_else(|| monitors.iter().find(|m| m.name == text)).or_else(|| monitors.iter().find(by_size))
            }
        };
        match (found, wanted) {
            (Some(monitor), _) if monitor.size == size => Ok(monitor.clone()),
            (Some(monitor), _) => Err(no_desktop(format!(
                "monitor {monitor} is not {height}x{width} pixels, as the video frames are: nothing is scaled, so choose \
                 another monitor, mode or display"
            ))),
            (None, Some(text)) => Err(no_desktop(format!("no monitor is called '{text}': there are {}", has()))),
            (None, None) => Err(no_desktop(format!(
                "no monitor has {height}x{width} pixels, as the video frames have: there are {}",
                has()
            ))),
        }
    }

    /// A window over all of a monitor, with a swapchain.
    ///
    /// # Errors
    /// [`PlaybackError::Presenter`] where it does not come up with the monitor's size, and where Vulkan cannot show bytes
    /// as they are in it.
    pub fn window(
        mut self,
        monitor: &Monitor,
        clock: Rc<RealClock>,
        validation: bool,
    ) -> Result<Window, PlaybackError> {
        self.handler.wanted = Some((monitor.index, monitor.size));
        let since = Instant::now();
        let window = loop {
            self.pump()?;
            if let Some(failure) = self.handler.failure.take() {
                return Err(no_desktop(format!("a window could not be opened ({failure})")));
            }
            if let Some(window) = self.handler.window.clone() {
                let is = [window.inner_size().height as usize, window.inner_size().width as usize];
                if is == monitor.size {
                    break window;
                }
                if since.elapsed() > PATIENCE {
                    return Err(no_desktop(format!(
                        "the window came up with {}x{} pixels on monitor {monitor}: nothing is scaled, so they must be equal",
                        is[0], is[1]
                    )));
                }
            }
            std::thread::sleep(Duration::from_millis(5));
        };
        let handle = handle_of(&window)?;
        // SAFETY: the window lives in the presenter, and the screen is dropped before it.
        #[allow(unsafe_code)]
        let screen = unsafe { Screen::open(handle, monitor.size, validation) }.map_err(of_window)?;
        self.handler.under = Some((monitor.clone(), Instant::now()));
        Ok(Window { screen, desktop: self, _window: window, monitor: monitor.clone(), clock })
    }

    fn pump(&mut self) -> Result<(), PlaybackError> {
        self.pump_for(Duration::ZERO)
    }

    pub(super) fn panels(&mut self) -> &mut Panels {
        &mut self.handler.panels
    }

    /// Takes in what happened on the desktop, and waits so long at most where nothing did.
    ///
    /// # Errors
    /// [`PlaybackError::Presenter`] when the desktop is gone.
    pub fn pump_for(&mut self, most: Duration) -> Result<(), PlaybackError> {
        let gone = || no_desktop("the connection to it is gone: its server ended".into());
        if connection::is_gone() {
            return Err(gone());
        }
        match self.event_loop.pump_app_events(Some(most), &mut self.handler) {
            PumpStatus::Continue if !connection::is_gone() => Ok(()),
            _ => Err(gone()),
        }
    }
}

fn of_window(error: EngineError) -> PlaybackError {
    PlaybackError::Presenter { presenter: "the window".into(), reason: error.to_string() }
}

/// What Vulkan makes a surface of.
pub(super) fn handle_of(window: &SystemWindow) -> Result<WindowHandle, PlaybackError> {
    let gone = |e: winit::raw_window_handle::HandleError| no_desktop(format!("the window has no handle ({e})"));
    let (window, display) = (window.window_handle().map_err(gone)?, window.display_handle().map_err(gone)?);
    match (window.as_raw(), display.as_raw()) {
        (RawWindowHandle::Xlib(window), RawDisplayHandle::Xlib(display)) => {
            let display = display.display.ok_or_else(|| no_desktop("the X display has no handle".into()))?;
            // XCB, for every driver takes that, and not every one Xlib.
            let library = x11_dl::xlib_xcb::Xlib_xcb::open()
                .map_err(|e| no_desktop(format!("libX11-xcb could not be loaded ({e})")))?;
            // SAFETY: the display is the window's, which lives.
            #[allow(unsafe_code)]
            let connection = unsafe { (library.XGetXCBConnection)(display.as_ptr().cast()) };
            Ok(WindowHandle::Xcb { connection, window: window.window as u32 })
        }
        (RawWindowHandle::Wayland(window), RawDisplayHandle::Wayland(display)) => {
            Ok(WindowHandle::Wayland { display: display.display.as_ptr(), surface: window.surface.as_ptr() })
        }
        _ => Err(no_desktop("windows of this system are not known here: X11 and Wayland are".into())),
    }
}

/// A window over a whole monitor.
pub struct Window {
    // Before the window that it shows in.
    screen: Screen,
    desktop: Desktop,
    _window: Arc<SystemWindow>,
    monitor: Monitor,
    clock: Rc<RealClock>,
}

impl Window {
    /// What the validation layer says, to the last.
    pub fn messages(&self) -> Arc<Mutex<Vec<String>>> {
        self.screen.messages()
    }

    /// The desktop that it stands on, for other windows beside it: their events come while this one's are taken.
    pub fn desktop(&mut self) -> &mut Desktop {
        &mut self.desktop
    }

    /// Where the driver says that no more can be shown, the desktop may know why.
    fn explained(&mut self, done: Result<(), EngineError>) -> Result<(), PlaybackError> {
        let Err(error) = done else { return Ok(()) };
        self.desktop.pump()?;
        self.check()?;
        Err(of_window(error))
    }

    /// Whether anything can be shown; else what happened.
    fn check(&mut self) -> Result<(), PlaybackError> {
        if connection::is_gone() {
            self.desktop.pump()?;
        }
        match &self.desktop.handler.lost {
            None => Ok(()),
            Some(reason) => Err(PlaybackError::Presenter { presenter: "the window".into(), reason: reason.clone() }),
        }
    }
}

impl Presenter for Window {
    fn describe(&self) -> String {
        format!("a window on monitor {} by {}", self.monitor, self.screen.describe())
    }

    fn rate(&self) -> Option<Rate> {
        self.monitor.rate
    }

    fn upload(&mut self, picture: &[u8]) -> Result<(), PlaybackError> {
        self.check()?;
        let done = self.screen.upload(picture);
        self.explained(done)
    }

    fn present(&mut self, id: u64, _desired_present_time_ns: i64) -> Result<(), PlaybackError> {
        let done = self.screen.present(id);
        self.explained(done)
    }

    fn feedback(&mut self) -> Option<Feedback> {
        self.screen.lit().map(|lit| direct::feedback(lit, &self.clock))
    }

    fn timed_by(&self) -> &'static str {
        self.screen.timed_by()
    }

    fn event(&mut self) -> Option<Event> {
        if self.desktop.handler.events.is_empty()
            && let Err(PlaybackError::Presenter { reason, .. }) = self.desktop.pump()
        {
            // What is shown next says so.
            self.desktop.handler.lost.get_or_insert(reason);
        }
        self.desktop.handler.events.pop_front()
    }

    fn finish(&mut self) -> Result<(), PlaybackError> {
        self.screen.wait();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_monitor_that_is_gone_or_has_another_mode_is_not_among_those_there_are() {
        let (name, size) = ("DP-2".to_owned(), [1080, 1920]);
        let monitor = Monitor { index: 1, name, size, position: [0, 0], rate: None, modes: Vec::new() };
        let among = |list: &[(&str, [u32; 2])]| is_among(&monitor, list.iter().map(|(n, s)| (Some((*n).into()), *s)));
        assert!(among(&[("DP-1", [1080, 1920]), ("DP-2", [1080, 1920])]));
        assert!(!among(&[("DP-1", [1080, 1920])]) && !among(&[("DP-2", [720, 1280])]) && !among(&[]));
        let unnamed = Monitor { name: String::new(), ..monitor };
        assert!(is_among(&unnamed, [(None, [1080, 1920])].into_iter()));
    }
}
