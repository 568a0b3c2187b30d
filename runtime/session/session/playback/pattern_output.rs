//! Shows calibration patterns for a camera on a display of this machine.

use crate::calibrate::ShowsPatterns;
use crate::encode::{EncodeError, Encoder, PhaseSet};
use crate::optics::{Color, Display};
use crate::present::Event;
use crate::session::frame_log::error::SessionError;
use crate::session::playback::output::{OpenDisplay, Output};
use eyebox_base::reason;
use std::time::{Duration, Instant};

/// The largest number of sub-frames that a video frame may hold.
const MOST: usize = 24;
/// After this time without feedback, a pattern is assumed to have lit up.
const LIT: Duration = Duration::from_secs(1);

/// Shows patterns in sequence. Each takes one video frame and stays until the next.
pub struct PatternOutput {
    display: OpenDisplay,
    encoders: Vec<(Color, Encoder)>,
    settle: Duration,
    shown: u64,
}

impl PatternOutput {
    /// Opens an output for some colors of a display, one at a time. `settle` is the time from the light of a pattern
    /// until the modulator is stable.
    ///
    /// # Errors
    /// Returns [`SessionError`], and [`SessionError::Setting`] if the display shows no set of one color in one video
    /// frame.
    pub fn open(output: &Output, display: &Display, colors: &[Color], settle: Duration) -> Result<Self, SessionError> {
        let encoders = colors.iter().map(|color| Ok((*color, alone(display, *color)?)));
        let encoders = encoders.collect::<Result<Vec<_>, SessionError>>()?;
        let Some((_, first)) = encoders.first() else {
            return Err(reason!("no-color", "`colors` is empty, but patterns need at least one color").into());
        };
        let frames = first.frames();
        let display = output.open([frames.height, frames.width, frames.channels], None, None)?;
        Ok(Self { display, encoders, settle, shown: 0 })
    }

    /// Shows a video frame and waits until it is stable.
    fn put(&mut self, frame: &[u8]) -> Result<(), SessionError> {
        let clock = std::rc::Rc::clone(&self.display.clock);
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
            let presenter = self.display.presenter();
            while let Some(event) = presenter.event() {
                if event == Event::Close {
                    return Err(reason!("window-closed", "its window was closed").into());
                }
            }
            while let Some(feedback) = presenter.feedback() {
                lit |= feedback.id >= first;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        std::thread::sleep(self.settle);
        Ok(())
    }
}

impl ShowsPatterns for PatternOutput {
    fn sub_frames(&self) -> usize {
        self.encoders.iter().map(|(_, encoder)| encoder.plan().sub_frames).min().unwrap_or(1)
    }

    fn show(&mut self, color: Color, phases: &[f32]) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
        let Some((_, encoder)) = self.encoders.iter_mut().find(|(c, _)| *c == color) else {
            return Err(format!("the output was opened without the color {color}").into());
        };
        let [height, width] = encoder.hologram_size();
        // A set with fewer sub-frames is repeated until the video frame is full.
        let all = phases.repeat(encoder.plan().sub_frames * height * width / phases.len().max(1));
        let frame = encoder.encode(&PhaseSet::new(&[&all], [height, width])?)?.frame(0).to_vec();
        Ok(self.put(&frame)?)
    }
}

/// Creates the encoder for one color alone, whose video frame holds a whole set.
fn alone(display: &Display, color: Color) -> Result<Encoder, SessionError> {
    let mut first: Option<EncodeError> = None;
    for sub_frames in 1..=MOST {
        match Encoder::new(display, &[color], sub_frames) {
            Ok(encoder) if encoder.packed().video_frames == 1 => return Ok(encoder),
            Ok(_) => {}
            Err(error) => drop(first.get_or_insert(error)),
        }
    }
    Err(match first {
        Some(error) => error.into(),
        None => {
            let name = &display.name;
            SessionError::Setting(reason!(
                "color-alone",
                "the display '{name}' shows no set of {color} alone in one video frame"
            ))
        }
    })
}
