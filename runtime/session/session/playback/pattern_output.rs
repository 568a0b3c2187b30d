//! Shows calibration patterns for a camera on a display of this machine.

use crate::calibrate::ShowsPatterns;
use crate::encode::{EncodeError, Encoder, PhaseSet};
use crate::optics::{Color, Display};
use crate::present::plm::{Identity, PLANES, PlmError, SOURCE_TIME, plane_of_bit};
use crate::session::frame_log::error::SessionError;
use crate::session::frame_log::notes::Notes;
use crate::session::frame_log::trace::Trace;
use crate::session::playback::controller::{ControllerReport, ControllerThread, PreparedController};
use crate::session::playback::output::Output;
use crate::session::playback::picture_output::PictureOutput;
use eyebox_base::reason;
use std::time::{Duration, Instant};

/// The largest number of sub-frames that a video frame may hold.
const MOST: usize = 24;
/// The longest time from a picture on the display to running patterns of its controller.
const CONTROLLER_STARTS: Duration = Duration::from_secs(25);

/// Shows patterns in sequence. Each takes one video frame and stays until the next.
pub struct PatternOutput {
    controller: Option<ControllerThread>,
    pictures: PictureOutput,
    encoders: Vec<(Color, Encoder)>,
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
        let controller = PreparedController::of(first, encoders.len() > 1, output, None)?;
        let patience = if controller.is_some() { SOURCE_TIME } else { Duration::ZERO };
        let display = output.open([frames.height, frames.width, frames.channels], None, None, patience)?;
        let pictures = PictureOutput::on(display, settle);
        let rate = pictures.rate();
        let watch = |c: PreparedController| c.watch(rate, Notes::default(), Trace::none().track("controller"));
        let controller = controller.map(watch).transpose()?;
        let dark = frames.bytes().to_vec();
        let mut output = Self { controller, pictures, encoders };
        if output.controller.is_some() {
            output.pictures.show(&dark)?;
            output.wait_for_controller()?;
        }
        Ok(output)
    }

    /// Waits until the controller shows the picture of the display.
    fn wait_for_controller(&mut self) -> Result<(), SessionError> {
        let begun = Instant::now();
        while let Some(controller) = &self.controller
            && !controller.is_running()
        {
            if controller.is_lost() || begun.elapsed() >= CONTROLLER_STARTS {
                return Err(PlmError::NoSource { waited_ms: begun.elapsed().as_millis() as u64 }.into());
            }
            self.pictures.pump()?;
            std::thread::sleep(Duration::from_millis(10));
        }
        Ok(())
    }

    /// Returns the identity of the display's controller, if it has one.
    pub fn controller(&self) -> Option<&Identity> {
        self.controller.as_ref().map(|controller| &controller.identity)
    }

    /// Shows one of the 24 planes of a controller on all cells, and darkness in the others.
    ///
    /// # Errors
    /// Returns [`SessionError`], and [`SessionError::Setting`] for a plane or a display that does not exist.
    pub fn show_plane(&mut self, number: usize) -> Result<(), SessionError> {
        let mut frames = match self.encoders.first() {
            Some((_, encoder)) if encoder.frames().channels == 3 && number < PLANES => encoder.frames(),
            _ => {
                return Err(reason!(
                    "plane",
                    "plane {number} is impossible, because an RGB video frame has the planes 0 to 23"
                )
                .into());
            }
        };
        let bit = plane_of_bit(number);
        for pixel in frames.bytes_mut().chunks_exact_mut(3) {
            pixel[bit / 8] = 1 << (bit % 8);
        }
        self.pictures.show(frames.frame(0))
    }

    /// Shows a level on the left half of the modulator, and level 0 on the right half.
    ///
    /// # Errors
    /// Returns [`SessionError`], and [`SessionError::Setting`] for a level that the display does not have.
    pub fn show_level(&mut self, level: usize) -> Result<(), SessionError> {
        let Some((_, encoder)) = self.encoders.first() else { return Ok(()) };
        let display = encoder.display();
        let levels = display.levels as usize;
        if level >= levels {
            return Err(reason!(
                "level",
                "level {level} is impossible, because the display has the levels 0 to {}",
                levels - 1
            )
            .into());
        }
        let turns =
            |level: usize| display.encoding.phases_turns.get(level).copied().unwrap_or(level as f64 / levels as f64);
        let [zero, own] = [0, level].map(|level| (turns(level) * std::f64::consts::TAU) as f32);
        let [height, width] = encoder.hologram_size();
        let row = |column: usize| if column < width / 2 { own } else { zero };
        let phases: Vec<f32> = (0..height * width).map(|pixel| row(pixel % width)).collect();
        let frame = encode_repeated(encoder, &phases)?;
        self.pictures.show(&frame)
    }

    /// Closes the output, and puts the controller to sleep. Returns its report.
    ///
    /// # Errors
    /// Returns [`SessionError::Thread`] if the controller's thread failed.
    pub fn finish(mut self) -> Result<Option<ControllerReport>, SessionError> {
        let stopped = self.controller.take().map(ControllerThread::stop).transpose()?;
        Ok(stopped.map(|(report, _)| report))
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
        let frame = encode_repeated(encoder, phases)?;
        Ok(self.pictures.show(&frame)?)
    }
}

/// Encodes a video frame. A set with fewer sub-frames is repeated until the video frame is full.
fn encode_repeated(encoder: &Encoder, phases: &[f32]) -> Result<Vec<u8>, SessionError> {
    let [height, width] = encoder.hologram_size();
    let all = phases.repeat(encoder.plan().sub_frames * height * width / phases.len().max(1));
    Ok(encoder.encode(&PhaseSet::new(&[&all], [height, width])?)?.frame(0).to_vec())
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
