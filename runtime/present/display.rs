//! Presents on a display, through a window over a monitor or directly without a desktop.

use super::desktop::{Desktop, OnDesktop, SharedDesktop};
use super::link::Link;
use super::swapchain::{Policy, Swapchain};
use super::system::handle_of;
use super::timing::PresentTiming;
use super::{Event, Feedback, Interference, Monitor, PresentError, Presenter, Rate, RealClock};
use eyebox_compute::gpu::{EngineError, Gpu, Pictures, PixelOrder};
use std::cell::{RefCell, RefMut};
use std::rc::Rc;
use std::time::{Duration, Instant};

/// Shows video frames on a display, with a swapchain of exactly its size.
pub struct DisplayPresenter {
    // The swapchain is dropped before the window that it shows in.
    swapchain: Swapchain,
    name: String,
    /// Video frames per second, or none without a known rate.
    pub rate: Option<Rate>,
    clock: RealClock,
    window: Option<OnDesktop>,
    /// The link without a desktop.
    link: Option<Link>,
}

/// The time in which a new window reaches its size.
const SETTLES: Duration = Duration::from_secs(3);

impl Desktop {
    /// Opens a window over all of a monitor. It shows from this device, or from the device of its instance that can
    /// show there.
    ///
    /// # Errors
    /// [`PresentError::Display`] if the window does not open with the monitor's size, or if Vulkan cannot show
    /// unchanged bytes in it.
    pub fn fullscreen(self, gpu: &Gpu, monitor: &Monitor, clock: RealClock) -> Result<DisplayPresenter, PresentError> {
        Self::covering(&Rc::new(RefCell::new(self)), gpu, monitor, clock)
    }

    /// Opens a window over each of two monitors, as [`fullscreen`](Self::fullscreen) does over one.
    ///
    /// # Errors
    /// The errors of [`fullscreen`](Self::fullscreen).
    pub fn fullscreen_on_two(
        self,
        gpu: &Gpu,
        monitors: [&Monitor; 2],
        clock: RealClock,
    ) -> Result<[DisplayPresenter; 2], PresentError> {
        let desktop = Rc::new(RefCell::new(self));
        let [left, right] = monitors;
        let left = Self::covering(&desktop, gpu, left, clock)?;
        // The device of the first window shows in both, so that one loss of the device is one error.
        let right = Self::covering(&desktop, left.gpu(), right, clock)?;
        Ok([left, right])
    }

    fn covering(
        desktop: &SharedDesktop,
        gpu: &Gpu,
        monitor: &Monitor,
        clock: RealClock,
    ) -> Result<DisplayPresenter, PresentError> {
        let on = Self::cover(desktop, monitor)?;
        let (handle, since) = (handle_of(&on.window)?, Instant::now());
        let swapchain = loop {
            // SAFETY: the window lives in the presenter, and the swapchain is dropped before it.
            #[allow(unsafe_code)]
            match unsafe { Swapchain::open(gpu, handle, Policy::Exact(monitor.size)) } {
                Ok(swapchain) => break swapchain,
                // A window manager that has just started changes the size of windows for a moment.
                Err(EngineError::Unsuitable { .. }) if since.elapsed() < SETTLES => {
                    desktop.borrow_mut().pump_for(Duration::from_millis(20))?;
                }
                Err(error) => return Err(PresentError::display("the window", error.to_string())),
            }
        };
        let name = format!("a window on monitor {monitor}");
        Ok(DisplayPresenter { swapchain, name, rate: monitor.rate, clock, window: Some(on), link: None })
    }
}

impl DisplayPresenter {
    #[cfg(feature = "direct-display")]
    pub(super) fn on_display(
        swapchain: Swapchain,
        name: String,
        rate: Option<Rate>,
        clock: RealClock,
        link: Option<Link>,
    ) -> Self {
        Self { swapchain, name, rate, clock, window: None, link }
    }

    /// The device that shows the frames, for engines, encoders and other windows.
    pub fn gpu(&self) -> &Gpu {
        self.swapchain.gpu()
    }

    /// The desktop of the window, for other windows on it. Their events arrive while this window's events are read.
    pub fn desktop(&mut self) -> Option<RefMut<'_, Desktop>> {
        self.window.as_mut().map(|window| window.desktop.borrow_mut())
    }

    /// The desktop of the window, to be shared with other windows.
    pub fn shared_desktop(&self) -> Option<SharedDesktop> {
        self.window.as_ref().map(|window| Rc::clone(&window.desktop))
    }

    fn explained(&mut self, done: Result<(), EngineError>) -> Result<(), PresentError> {
        let Err(error) = done else { return Ok(()) };
        let Some(window) = &mut self.window else {
            return Err(PresentError::display("direct display", error.to_string()));
        };
        window.explain()?;
        Err(PresentError::display("the window", error.to_string()))
    }
}

impl Presenter for DisplayPresenter {
    fn describe(&self) -> String {
        format!("{} by {}", self.name, self.swapchain.describe())
    }

    fn timed_by(&self) -> &'static str {
        self.swapchain.timed_by()
    }

    fn upload(&mut self, picture: &[u8]) -> Result<(), PresentError> {
        self.window.as_mut().map_or(Ok(()), OnDesktop::check)?;
        let done = self.swapchain.upload(picture);
        self.explained(done)
    }

    fn takes(&self) -> Option<(&Gpu, PixelOrder)> {
        Some((self.swapchain.gpu(), self.swapchain.pixel_order()))
    }

    fn take(&mut self, pictures: &Pictures, index: usize) -> Result<(), PresentError> {
        self.window.as_mut().map_or(Ok(()), OnDesktop::check)?;
        let done = self.swapchain.take(pictures, index);
        self.explained(done)
    }

    fn present(&mut self, id: u64, _desired_present_time_ns: i64) -> Result<(), PresentError> {
        let done = self.swapchain.present(id);
        self.explained(done)
    }

    fn feedback(&mut self) -> Option<Feedback> {
        let PresentTiming { id, time_ns } = self.swapchain.timing()?;
        Some(Feedback { id, actual_display_time_ns: self.clock.at_monotonic_ns(time_ns) })
    }

    fn event(&mut self) -> Option<Event> {
        self.window.as_mut()?.event()
    }

    fn link(&self) -> Option<&Link> {
        match &self.window {
            Some(window) => window.link(),
            None => self.link.as_ref(),
        }
    }

    fn interference(&mut self) -> Vec<Interference> {
        self.window.as_ref().map(OnDesktop::interference).unwrap_or_default()
    }

    fn finish(&mut self) -> Result<(), PresentError> {
        let done = self.swapchain.wait();
        self.explained(done)
    }
}
