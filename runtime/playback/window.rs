//! A window over a whole monitor, which shows video frames as they are.
//!
//! Its inside has exactly the video frame's size, or it is refused; it has no cursor and no frame. What a compositor does
//! to it cannot be asked everywhere: on an SLM's output run none, or let full-screen windows bypass it.

use super::panel::Panels;
use super::{Event, Feedback, PlaybackError, Presenter, Rate, RealClock};
use crate::engine::EngineError;
use crate::engine::vulkan::{Lit, Screen, WindowHandle};
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
}

impl Handler {
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
    }

    fn window_event(&mut self, _: &ActiveEventLoop, id: WindowId, event: WindowEvent) {
        if self.panels.take(id, &event) {
            return;
        }
        match event {
            WindowEvent::CloseRequested | WindowEvent::Destroyed => self.events.push_back(Event::Close),
            WindowEvent::KeyboardInput { event, .. } if event.state == ElementState::Pressed => {
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
        match self.event_loop.pump_app_events(Some(most), &mut self.handler) {
            PumpStatus::Continue => Ok(()),
            PumpStatus::Exit(_) => Err(no_desktop("the connection to it is gone".into())),
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
}

impl Presenter for Window {
    fn describe(&self) -> String {
        format!("a window on monitor {} by {}", self.monitor, self.screen.describe())
    }

    fn rate(&self) -> Option<Rate> {
        self.monitor.rate
    }

    fn upload(&mut self, picture: &[u8]) -> Result<(), PlaybackError> {
        self.screen.upload(picture).map_err(of_window)
    }

    fn present(&mut self, id: u64, _desired_present_time_ns: i64) -> Result<(), PlaybackError> {
        self.screen.present(id).map_err(of_window)
    }

    fn feedback(&mut self) -> Option<Feedback> {
        let (id, actual_display_time_ns) = match self.screen.lit()? {
            Lit::Monotonic { id, time_ns } => (id, self.clock.at_monotonic_ns(time_ns)),
            Lit::At { id, time } => (id, self.clock.at_ns(time)),
        };
        Some(Feedback { id, actual_display_time_ns })
    }

    fn event(&mut self) -> Option<Event> {
        if self.desktop.handler.events.is_empty() && self.desktop.pump().is_err() {
            return Some(Event::Close);
        }
        self.desktop.handler.events.pop_front()
    }

    fn finish(&mut self) -> Result<(), PlaybackError> {
        self.screen.wait();
        Ok(())
    }
}
