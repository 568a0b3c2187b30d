//! Opens the output of the video frames of a session.

use crate::engine::EngineError;
use crate::gpu::{Gpu, Options as GpuOptions};
use crate::present::{
    Clock, Desktop, DisplayPresenter, Offscreen, PresentError, Presenter, Rate, RealClock, SharedDesktop,
    SimulatedClock, Sink, TwoPanels,
};
use crate::session::frame_log::error::SessionError;
use crate::session::playback::ticks::TickedOutput;
use eyebox_base::reason;
use std::cell::{RefCell, RefMut};
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
    /// Two displays that the left and the right eye see.
    Pair {
        /// The display of the left eye, a window or a display that no desktop drives.
        left: Box<Output>,
        /// The display of the right eye, of the same kind.
        right: Box<Output>,
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
    /// Two panels, with the desktop of their windows.
    Pair(Box<TwoPanels>, Option<SharedDesktop>),
    Other(Box<dyn Presenter>, Option<SharedDesktop>),
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
                let monitor = choose(&mut desktop, patience, |d| d.choose(monitor.as_deref(), [rows, columns]))?;
                let window = desktop.fullscreen(&shared()?, &monitor, real)?;
                let (mode_rate, known) = (window.rate, rate.or(window.rate));
                (Kind::Window(Box::new(window)), known, mode_rate)
            }
            Self::Pair { left, right } => {
                // The joined picture holds one panel below the other.
                let panel = [rows / 2, columns];
                let (kind, mode_rate) = open_pair([left, right], panel, rate, &shared, (real, patience))?;
                (kind, rate.or(mode_rate), mode_rate)
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

/// Opens the displays of both eyes, each for video frames of `panel` rows and columns.
fn open_pair(
    outputs: [&Output; 2],
    panel: [usize; 2],
    rate: Option<Rate>,
    shared: &dyn Fn() -> Result<Gpu, EngineError>,
    (real, patience): (RealClock, Duration),
) -> Result<(Kind, Option<Rate>), SessionError> {
    let (panels, desktop) = match outputs {
        [Output::Window { monitor: left }, Output::Window { monitor: right }] => {
            let mut desktop = Desktop::open()?;
            let names = [left.as_deref(), right.as_deref()];
            let [left, right] = choose(&mut desktop, patience, |d| d.choose_two(names, panel))?;
            let panels = desktop.fullscreen_on_two(&shared()?, [&left, &right], real)?;
            let desktop = panels[0].shared_desktop();
            (panels, desktop)
        }
        #[cfg(feature = "direct-display")]
        [Output::Direct { display: left }, Output::Direct { display: right }] => {
            let gpu = shared()?;
            let open = |name: &Option<String>| {
                retry(patience, || {
                    DisplayPresenter::direct(&gpu, name.as_deref(), panel, rate, real).map_err(SessionError::from)
                })
            };
            ([open(left)?, open(right)?], None)
        }
        _ => {
            return Err(reason!(
                "pair-of-outputs",
                "`output` must be two windows or two direct displays for two panels, one for each eye"
            )
            .into());
        }
    };
    let [left, right] = panels;
    let (mode_rate, other) = (left.rate, right.rate);
    if let (Some(a), Some(b)) = (mode_rate, other)
        && (a.hz() / b.hz() - 1.0).abs() > SAME_RATE
    {
        return Err(reason!(
            "pair-of-rates",
            "the left panel has {a} video frames per second and the right one {b}. Give both the same mode"
        )
        .into());
    }
    let period = mode_rate.or(rate).map_or_else(|| Rate::new(60, 1), Ok)?;
    let panels = TwoPanels::new(Box::new(left), Box::new(right), period.period_ns());
    Ok((Kind::Pair(Box::new(panels), desktop), mode_rate))
}

/// The largest relative difference of two rates that count as the same mode. Modes of 59.94 and 60 Hz differ by 0.001.
const SAME_RATE: f64 = 5e-4;

/// Chooses monitors, which may appear within `patience`. A program can open the desktop only once.
pub(super) fn choose<T>(
    desktop: &mut Desktop,
    patience: Duration,
    wanted: impl Fn(&Desktop) -> Result<T, PresentError>,
) -> Result<T, PresentError> {
    let begun = Instant::now();
    loop {
        match wanted(desktop) {
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
            Kind::Pair(panels, _) => panels.as_mut(),
            Kind::Other(presenter, _) => presenter.as_mut(),
        }
    }

    /// Returns the desktop for a window next to the display.
    pub(crate) fn desktop(&mut self) -> Result<RefMut<'_, Desktop>, PresentError> {
        match &mut self.kind {
            Kind::Window(window) => window.desktop().ok_or_else(|| PresentError::Display {
                presenter: "the window".into(),
                reason: reason!("no-desktop", "it has no desktop"),
            }),
            Kind::Other(_, desktop) | Kind::Pair(_, desktop) => {
                if desktop.is_none() {
                    *desktop = Some(Rc::new(RefCell::new(Desktop::open()?)));
                }
                Ok(desktop.as_ref().expect("it was opened").borrow_mut())
            }
        }
    }

    /// Takes the events of windows next to the display. A display that is a window takes these events while it takes
    /// its own.
    pub(crate) fn pump(&mut self) -> Result<(), PresentError> {
        match &mut self.kind {
            Kind::Other(_, Some(desktop)) => desktop.borrow_mut().pump_for(Duration::ZERO),
            _ => Ok(()),
        }
    }
}
