//! Opens the output of the video frames of a session.

use crate::gpu::{Gpu, Options as GpuOptions};
use crate::present::{
    Clock, Desktop, DisplayPresenter, Monitor, Offscreen, PresentError, Presenter, Rate, RealClock, SimulatedClock,
    Sink,
};
use crate::session::frame_log::error::SessionError;
use crate::session::playback::ticks::TickedOutput;
use eyebox_base::reason;
use std::path::PathBuf;
use std::rc::Rc;
use std::time::{Duration, Instant};

/// The output of video frames.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum Output {
    /// A window over all of a monitor.
    Window {
        /// The index of the monitor, its name or its size as rows x columns. If it is `None`, the first monitor with
        /// the size of the video frame is used.
        monitor: Option<String>,
    },
    /// A display that no desktop drives.
    #[cfg(feature = "direct-display")]
    Direct {
        /// The index of the display, its connector or its monitor. If it is `None`, the first display with a mode of
        /// the size of the video frame is used.
        display: Option<String>,
    },
    /// Video frames go to memory.
    Memory {
        /// True if time is simulated, and passes as fast as content arrives. If it is false, the clock of the system is
        /// used.
        simulated: bool,
        /// The file that also receives every video frame.
        sink: Option<SinkFile>,
    },
    /// The program takes each video frame when it needs it. [`TickedSession`](crate::session::TickedSession) creates
    /// this output.
    Ticked(TickedOutput),
}

/// A file that receives video frames ([`Sink`]).
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum SinkFile {
    /// The file receives all video frames in sequence.
    Raw(PathBuf),
    /// The file holds the newest video frame.
    Shared(PathBuf),
}

impl SinkFile {
    /// Checks that the place of the file is free, before anything is computed for it.
    ///
    /// # Errors
    /// Returns [`SessionError::Present`] with [`FileError::Taken`](crate::files::FileError::Taken) in it.
    pub fn check(&self) -> Result<(), SessionError> {
        match self {
            Self::Raw(file) => Ok(Sink::check_raw(file)?),
            // A file of eyebox may exist there. It is checked when it is opened.
            Self::Shared(_) => Ok(()),
        }
    }
}

pub(crate) struct OpenDisplay {
    kind: Kind,
    pub clock: Rc<dyn Clock>,
    /// The same clock if it is the clock of the system.
    pub real_clock: Option<RealClock>,
    pub rate: Rate,
    /// The rate of the video mode, if the system states it. A user may have requested another one.
    pub mode_rate: Option<Rate>,
}

enum Kind {
    Window(Box<DisplayPresenter>),
    Other(Box<dyn Presenter>, Option<Box<Desktop>>),
}

impl Output {
    /// Returns true if a display shows the video frames.
    pub(crate) fn is_shown(&self) -> bool {
        !matches!(self, Self::Memory { .. } | Self::Ticked(_))
    }

    /// Opens the output for video frames of (rows, columns, channels), at the requested `rate` or its own. A display
    /// shows from `gpu`, or from a device of its own. A monitor that is missing may appear within `patience`.
    pub(crate) fn open(
        &self,
        size: [usize; 3],
        rate: Option<Rate>,
        gpu: Option<&Gpu>,
        patience: Duration,
    ) -> Result<OpenDisplay, SessionError> {
        let [rows, columns, channels] = size;
        let real = RealClock::start();
        let usual = |known: Option<Rate>| known.map_or_else(|| Rate::new(60, 1), Ok);
        let shared = || match gpu {
            Some(gpu) => Ok(gpu.clone()),
            None => Gpu::open(&GpuOptions { allow_cpu: true, present: true, ..GpuOptions::default() }),
        };
        let (kind, known, mode_rate) = match self {
            Self::Window { monitor } => {
                let mut desktop = Desktop::open()?;
                let monitor = choose(&mut desktop, monitor.as_deref(), [rows, columns], patience)?;
                let window = desktop.fullscreen(&shared()?, &monitor, real)?;
                let (mode_rate, known) = (window.rate, rate.or(window.rate));
                (Kind::Window(Box::new(window)), known, mode_rate)
            }
            #[cfg(feature = "direct-display")]
            Self::Direct { display } => {
                let display = retry(patience, || {
                    DisplayPresenter::direct(&shared()?, display.as_deref(), [rows, columns], rate, real)
                        .map_err(SessionError::from)
                })?;
                // The rate of the mode counts, which may be 59.94 Hz if 60 Hz was requested.
                let (mode_rate, known) = (display.rate, display.rate.or(rate));
                (Kind::Other(Box::new(display), None), known, mode_rate)
            }
            Self::Memory { simulated, sink } => {
                let sink = match sink {
                    Some(SinkFile::Raw(file)) => Some(Sink::raw(file)?),
                    Some(SinkFile::Shared(file)) => Some(Sink::shared(file, size)?),
                    None => None,
                };
                let rate = usual(rate)?;
                let clock: Rc<dyn Clock> = if *simulated { Rc::new(SimulatedClock::default()) } else { Rc::new(real) };
                let memory = Offscreen::new(Rc::clone(&clock), rate, rows * columns * channels).with_sink(sink);
                let (kind, real_clock) = (Kind::Other(Box::new(memory), None), (!*simulated).then_some(real));
                return Ok(OpenDisplay { kind, clock, real_clock, rate, mode_rate: None });
            }
            Self::Ticked(ticked) => {
                let rate = usual(rate)?;
                let (clock, presenter) = ticked.open(real, rate);
                let kind = Kind::Other(presenter, None);
                return Ok(OpenDisplay { kind, clock, real_clock: Some(real), rate, mode_rate: None });
            }
        };
        let rate = usual(known)?;
        Ok(OpenDisplay { kind, real_clock: Some(real), clock: Rc::new(real), rate, mode_rate })
    }
}

/// The interval at which a missing monitor is searched.
const MONITOR_INTERVAL: Duration = Duration::from_millis(250);

/// Chooses a monitor, which may appear within `patience`. A program can open the desktop only once.
pub(super) fn choose(
    desktop: &mut Desktop,
    wanted: Option<&str>,
    size: [usize; 2],
    patience: Duration,
) -> Result<Monitor, PresentError> {
    let begun = Instant::now();
    loop {
        match desktop.choose(wanted, size) {
            Err(_) if begun.elapsed() < patience => desktop.pump_for(MONITOR_INTERVAL)?,
            chosen => return chosen,
        }
    }
}

/// Opens a display without a desktop, which may appear within `patience`.
#[cfg(feature = "direct-display")]
fn retry<T>(patience: Duration, open: impl Fn() -> Result<T, SessionError>) -> Result<T, SessionError> {
    let begun = Instant::now();
    loop {
        match open() {
            Err(error) if error.is_of_display() && begun.elapsed() < patience => std::thread::sleep(MONITOR_INTERVAL),
            opened => return opened,
        }
    }
}

impl OpenDisplay {
    pub(crate) fn presenter(&mut self) -> &mut dyn Presenter {
        match &mut self.kind {
            Kind::Window(window) => window.as_mut(),
            Kind::Other(presenter, _) => presenter.as_mut(),
        }
    }

    /// Returns the desktop for a window next to the display.
    pub(crate) fn desktop(&mut self) -> Result<&mut Desktop, PresentError> {
        match &mut self.kind {
            Kind::Window(window) => window.desktop().ok_or_else(|| PresentError::Display {
                presenter: "the window".into(),
                reason: reason!("no-desktop", "it has no desktop"),
            }),
            Kind::Other(_, Some(desktop)) => Ok(desktop),
            Kind::Other(_, none) => Ok(none.insert(Box::new(Desktop::open()?))),
        }
    }

    /// Takes the events of windows next to the display. A display that is a window takes these events while it takes
    /// its own.
    pub(crate) fn pump(&mut self) -> Result<(), PresentError> {
        match &mut self.kind {
            Kind::Other(_, Some(desktop)) => desktop.pump_for(Duration::ZERO),
            _ => Ok(()),
        }
    }
}
