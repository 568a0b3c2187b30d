//! Shows single pictures on a display of this machine, each of which stays until the next.

use crate::encode::Encoder;
use crate::optics::{Color, Display};
use crate::present::{Event, Link, Rate};
use crate::session::frame_log::error::SessionError;
use crate::session::playback::output::{OpenDisplay, Output};
use eyebox_base::reason;
use std::rc::Rc;
use std::time::{Duration, Instant};

/// The largest number of sub-frames that a video frame may hold.
const MOST: usize = 24;
/// After this time without feedback, a picture is assumed to have lit up.
const LIT: Duration = Duration::from_secs(1);

/// Returns the rows and columns of the video frames of a display.
///
/// # Errors
/// Returns [`SessionError::Encode`] if the display cannot be encoded for.
pub fn video_frame_size(display: &Display) -> Result<[usize; 2], SessionError> {
    let colors: Vec<Color> = display.wavelengths.iter().map(|w| w.color).collect();
    let mut first = None;
    for sub_frames in 1..=MOST {
        match Encoder::new(display, &colors, sub_frames) {
            Ok(encoder) => {
                let frames = encoder.frames();
                return Ok([frames.height, frames.width]);
            }
            Err(error) => drop(first.get_or_insert(error)),
        }
    }
    Err(first.map_or_else(|| reason!("no-color", "the display has no colors").into(), SessionError::from))
}

/// Shows pictures in sequence, as the display receives them.
pub struct PictureOutput {
    display: OpenDisplay,
    settle: Duration,
    shown: u64,
}

impl PictureOutput {
    /// Opens an output for RGB pictures of these rows and columns.
    ///
    /// # Errors
    /// Returns [`SessionError`] if the output cannot be opened.
    pub fn open(output: &Output, [rows, columns]: [usize; 2]) -> Result<Self, SessionError> {
        Ok(Self::on(output.open([rows, columns, 3], None, None, Duration::ZERO)?, Duration::ZERO))
    }

    /// Shows on an open display. `settle` is the time from the light of a picture until the modulator is stable.
    pub(crate) fn on(display: OpenDisplay, settle: Duration) -> Self {
        Self { display, settle, shown: 0 }
    }

    /// Returns the rate of the video mode, or the requested rate.
    pub(crate) fn rate(&self) -> Rate {
        self.display.mode_rate.unwrap_or(self.display.rate)
    }

    /// Handles the events of windows next to the display.
    ///
    /// # Errors
    /// Returns [`SessionError`] if the desktop is gone.
    pub fn pump(&mut self) -> Result<(), SessionError> {
        Ok(self.display.pump()?)
    }

    /// Returns the link between the swapchain and the panel, if a display shows the pictures.
    pub fn link(&mut self) -> Option<&Link> {
        self.display.presenter().link()
    }

    /// Shows a video frame and waits until it is stable.
    ///
    /// # Errors
    /// Returns [`SessionError`] if the display is lost or its window is closed.
    pub fn show(&mut self, frame: &[u8]) -> Result<(), SessionError> {
        let clock = Rc::clone(&self.display.clock);
        let presenter = self.display.presenter();
        // The feedback of the second of two frames shows that the first is on, and the last one stays.
        let first = self.shown + 1;
        for id in [first, first + 1] {
            presenter.upload(frame)?;
            presenter.present(id, clock.now_ns())?;
        }
        self.shown = first + 1;
        let begun = Instant::now();
        let mut lit = false;
        while !lit && begun.elapsed() < LIT {
            self.display.pump()?;
            if !self.is_open() {
                return Err(reason!("window-closed", "its window was closed").into());
            }
            while let Some(feedback) = self.display.presenter().feedback() {
                lit |= feedback.id >= first;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        std::thread::sleep(self.settle);
        Ok(())
    }

    /// Handles the events of the display, and returns false if its window should close.
    pub fn is_open(&mut self) -> bool {
        let presenter = self.display.presenter();
        std::iter::from_fn(|| presenter.event()).all(|event| event != Event::Close)
    }

    /// Returns the interference with the display that began since the last call, in words.
    pub fn notes(&mut self) -> Vec<String> {
        self.display.presenter().interference().iter().map(ToString::to_string).collect()
    }
}
