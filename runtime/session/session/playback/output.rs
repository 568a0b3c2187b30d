//! Where a session's video frames go.

use crate::gpu::{Gpu, Options as GpuOptions};
use crate::present::{
    Clock, Desktop, DisplayPresenter, Offscreen, PresentError, Presenter, Rate, RealClock, SimulatedClock, Sink,
};
use crate::session::frame_log::error::SessionError;
use crate::session::playback::ticks::TickedOutput;
use eyebox_base::reason;
use std::path::PathBuf;
use std::rc::Rc;
use std::time::Duration;

/// Where video frames go.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum Output {
    /// A window over all of a monitor: by its index, its name or its size as rows x columns; without, the first of the video
    /// frame's size.
    Window {
        /// Which.
        monitor: Option<String>,
    },
    /// A display that no desktop drives: by its index, its connector or its monitor; without, the first that has a mode of the
    /// video frame's size.
    #[cfg(feature = "direct-display")]
    Direct {
        /// Which.
        display: Option<String>,
    },
    /// Memory.
    Memory {
        /// Whether time passes as fast as content comes, and waits for it; else it is the system's.
        simulated: bool,
        /// Where every video frame goes besides.
        sink: Option<SinkFile>,
    },
    /// The program itself, which takes each when it wants it: [`TickedSession`](crate::session::TickedSession) makes it.
    Ticked(TickedOutput),
}

/// A file that takes video frames ([`Sink`]).
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum SinkFile {
    /// All of them, one after the other.
    Raw(PathBuf),
    /// The newest.
    Shared(PathBuf),
}

impl SinkFile {
    /// Refuses a place that is somebody's, before anything is computed for it.
    ///
    /// # Errors
    /// [`SessionError::Present`], [`FileError::Taken`](crate::files::FileError::Taken) in it.
    pub fn check(&self) -> Result<(), SessionError> {
        match self {
            Self::Raw(file) => Ok(Sink::check_raw(file)?),
            // One of ours may be there: it is looked at when it is opened.
            Self::Shared(_) => Ok(()),
        }
    }
}

pub(crate) struct OpenDisplay {
    kind: Kind,
    pub clock: Rc<dyn Clock>,
    /// The same, where it is the system's.
    pub real_clock: Option<RealClock>,
    pub rate: Rate,
}

enum Kind {
    Window(Box<DisplayPresenter>),
    Other(Box<dyn Presenter>, Option<Box<Desktop>>),
}

impl Output {
    /// Opens it for video frames of (rows, columns, channels), at the `rate` that is asked for or its own. A display is
    /// shown on from `gpu`, or from a device of its own.
    pub(crate) fn open(
        &self,
        size: [usize; 3],
        rate: Option<Rate>,
        gpu: Option<&Gpu>,
    ) -> Result<OpenDisplay, SessionError> {
        let [rows, columns, channels] = size;
        let real = RealClock::start();
        let usual = |known: Option<Rate>| known.map_or_else(|| Rate::new(60, 1), Ok);
        let shared = || match gpu {
            Some(gpu) => Ok(gpu.clone()),
            None => Gpu::open(&GpuOptions { allow_cpu: true, present: true, ..GpuOptions::default() }),
        };
        let (kind, known) = match self {
            Self::Window { monitor } => {
                let desktop = Desktop::open()?;
                let monitor = desktop.choose(monitor.as_deref(), [rows, columns])?;
                let window = desktop.fullscreen(&shared()?, &monitor, real)?;
                let known = rate.or(window.rate);
                (Kind::Window(Box::new(window)), known)
            }
            #[cfg(feature = "direct-display")]
            Self::Direct { display } => {
                let display = DisplayPresenter::direct(&shared()?, display.as_deref(), [rows, columns], rate, real)?;
                // Its own rate is the mode's, which may be 59.94 where 60 was asked for.
                let known = display.rate.or(rate);
                (Kind::Other(Box::new(display), None), known)
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
                return Ok(OpenDisplay { kind, clock, real_clock, rate });
            }
            Self::Ticked(ticked) => {
                let rate = usual(rate)?;
                let (clock, presenter) = ticked.open(real, rate);
                return Ok(OpenDisplay { kind: Kind::Other(presenter, None), clock, real_clock: Some(real), rate });
            }
        };
        let rate = usual(known)?;
        Ok(OpenDisplay { kind, real_clock: Some(real), clock: Rc::new(real), rate })
    }
}

impl OpenDisplay {
    pub(crate) fn presenter(&mut self) -> &mut dyn Presenter {
        match &mut self.kind {
            Kind::Window(window) => window.as_mut(),
            Kind::Other(presenter, _) => presenter.as_mut(),
        }
    }

    /// The desktop that a window beside the display stands on.
    pub(crate) fn desktop(&mut self) -> Result<&mut Desktop, PresentError> {
        match &mut self.kind {
            Kind::Window(window) => window.desktop().ok_or_else(|| PresentError::Display {
                presenter: "the window".into(),
                reason: reason!("no-desktop", "it stands on no desktop"),
            }),
            Kind::Other(_, Some(desktop)) => Ok(desktop),
            Kind::Other(_, none) => Ok(none.insert(Box::new(Desktop::open()?))),
        }
    }

    /// Takes events of windows beside the display; a window of its own takes them while it is asked for its own.
    pub(crate) fn pump(&mut self) -> Result<(), PresentError> {
        match &mut self.kind {
            Kind::Other(_, Some(desktop)) => desktop.pump_for(Duration::ZERO),
            _ => Ok(()),
        }
    }
}
