//! The bench of a solve: where its camera looks, and pictures through pupils.

use super::sensor::Sensor;
use crate::acquire::{check, two_pi_level};
use crate::captures::{Ask, Session, Shot, shown};
use crate::dots;
use crate::link::Link;
use crate::pattern::{self, Pattern};
use crate::picture::Picture;
use crate::{CalibrateError, CameraCommand, ShowsPatterns};
use eyebox_base::error::Reason;
use eyebox_base::reason;
use eyebox_optics::{Color, Display, Pupil};
use std::path::PathBuf;

/// Light on average over the SLM's image, as a share of full scale, below which a picture is black.
const BLACK: f64 = 0.002;
/// Where the brightest thousandth is to be and may be at least, for cameras that do not choose, as shares of full scale; and how
/// often it is tried.
const BRIGHT: [f32; 2] = [0.7, 0.25];
const EXPOSURES: usize = 4;
/// Dots that are so far off, as a share of their spacing, RMS, say nothing of where the camera looks.
const OFF: f64 = 0.1;

/// A bench whose camera takes part in a solve.
pub struct CameraBench<'a> {
    pub(super) camera: Camera<'a>,
    pub(super) colors: Vec<OfColor>,
    pub(super) steps: usize,
}

/// What shows patterns and takes pictures.
pub(super) struct Camera<'a> {
    pub(super) session: Session<'a>,
    slm: [usize; 2],
    /// Where an iris stands that does not move, where the command does not say so.
    iris_mm: Option<[f64; 3]>,
}

/// What is known of the bench in a colour.
pub(super) struct OfColor {
    pub(super) color: Color,
    /// The bench's nm.
    nm: f64,
    two_pi_level: f64,
    pub(super) sensor: Sensor,
    /// Dark level, a share of full scale; none where there is no picture of it.
    dark: Option<f64>,
}

/// What the camera's pixels saw through a pupil.
pub(super) struct CapturedLight {
    /// Where the iris was.
    pub(super) pupil: Pupil,
    /// Light in a millisecond, in the order of the sensor's pixels; not a number where it was saturated.
    pub(super) light: Vec<f32>,
}

impl<'a> CameraBench<'a> {
    /// Starts the camera's command, sees that the bench is the display's, and looks where the camera looks, in each of these
    /// colours. `steps` is the number of steps of each. In a folder that a calibration kept, the pictures are added to its own, and its
    /// picture of the dots is not taken again. `shows`: what shows the patterns, where the command does not. `say` is told lines that are not for
    /// this program.
    ///
    /// # Errors
    /// [`CalibrateError`].
    pub fn open(
        display: &Display,
        colors: &[Color],
        command: &CameraCommand<'a>,
        steps: usize,
        shows: Option<&'a mut dyn ShowsPatterns>,
        say: &'a mut dyn FnMut(&str),
    ) -> Result<Self, CalibrateError> {
        if display.prescription.as_ref().is_some_and(|eye| !eye.is_perfect()) {
            let reason = reason!("prescription", "a camera has no eye's prescription: solve with `prescription` none");
            return Err(CalibrateError::bench(display, reason));
        }
        if colors.iter().any(|color| !display.modes(*color).is_empty()) {
            let reason = reason!("source-modes", "steps with a camera know one mode of a source: leave out [source]");
            return Err(CalibrateError::bench(display, reason));
        }
        let (link, hello) = Link::start(command.command, command.limit, say)?;
        let named = colors.iter().map(|c| check(display, *c, &hello, shows.is_none()));
        let named = named.collect::<Result<Vec<_>, CalibrateError>>()?;
        let first = named.first().copied().unwrap_or((Color::Green, 0.0));
        let mut session = Session::new(link, hello, command.keep, first, usize::MAX)?;
        session.shows = shows;
        let mut camera = Camera { session, slm: [display.height, display.width], iris_mm: command.iris_mm };
        let mut of_colors = Vec::with_capacity(colors.len());
        for of_color in named {
            of_colors.push(camera.look_about(display, of_color)?);
        }
        Ok(Self { camera, colors: of_colors, steps })
    }

    /// Says bye to the camera's command.
    pub fn close(mut self) {
        self.camera.session.end();
    }
}

impl Camera<'_> {
    /// Where the camera looks, by the dots, and its dark level: of pictures that lie there already, or taken now.
    fn look_about(&mut self, display: &Display, (color, nm): (Color, f64)) -> Result<OfColor, CalibrateError> {
        let (optics, two_pi_level) = (display.optics(color)?, two_pi_level(display, color));
        let camera = self.session.hello.camera.resolution;
        self.session.color = (color, nm);
        let had = self.session.adds();
        let pattern = pattern::dots_pattern(self.slm, two_pi_level);
        let is_dots = |shot: &&Shot| {
            let read = |(file, kind): &(PathBuf, String)| shown(file, kind, self.slm, two_pi_level).ok();
            shot.show.as_ref().and_then(read).is_some_and(|shown| shown.is_like(&pattern))
        };
        let picture = match had.iter().rfind(is_dots) {
            Some(shot) => shot.picture(camera)?,
            None => {
                let name = format!("dots-{color}");
                let iris_mm = self.session.hello.iris.is_some().then(|| pattern::dots_iris(&optics));
                let ask = Ask { show: Some((&name, &pattern)), iris_mm, focus_mm: 0.0 };
                self.shot(&ask)?.ok_or_else(|| self.refused("take the picture of the dots"))?.1
            }
        };
        let unclear = |reason: Reason| {
            CalibrateError::Pictures(reason.reworded(|text| {
                format!("in the picture of the dots {text}: is the SLM lit, and in focus on the camera?")
            }))
        };
        let (map, rms) = dots::find(&picture, self.slm).map_err(unclear)?;
        let spacing = pattern::spacing(self.slm) * map.zoom();
        tracing::debug!("{color}: the camera's map is off by {rms:.2} of its pixels");
        if rms > OFF * spacing {
            return Err(unclear(reason!(
                "dots-off",
                "dots are {rms:.1} camera pixels off where they should be, {spacing:.0} apart"
            )));
        }
        let dark = match had.iter().rfind(|shot| shot.show.is_none()) {
            Some(shot) => Some(shot.picture(camera)?.median()),
            None if self.session.hello.camera.dark => {
                self.session.take(&Ask::default())?.map(|shot| shot.picture(camera)).transpose()?.map(|p| p.median())
            }
            None => None,
        };
        Ok(OfColor { color, nm, two_pi_level, sensor: Sensor::new(map), dark })
    }

    /// What the bench said last of what it could not do.
    pub(super) fn refused(&self, what: &str) -> CalibrateError {
        let text = self.session.left_out.last().cloned().unwrap_or_else(|| "it did not say why".into());
        CalibrateError::Refused { what: what.into(), text }
    }

    /// A picture that is bright enough, as far as the camera goes; none where the bench could not.
    fn shot(&mut self, ask: &Ask) -> Result<Option<(Shot, Picture)>, CalibrateError> {
        let camera = self.session.hello.camera.clone();
        for tried in 1.. {
            let Some(shot) = self.session.take(ask)? else { return Ok(None) };
            let picture = shot.picture(camera.resolution)?;
            let most = camera.exposure_ms.map_or(1e3, |range| range[1]);
            let brightest = picture.brightest();
            if camera.auto_exposure || brightest >= BRIGHT[1] || shot.exposure_ms >= 0.99 * most || tried >= EXPOSURES {
                return Ok(Some((shot, picture)));
            }
            let longer = f64::from(BRIGHT[0] / brightest.max(1e-3)) * shot.exposure_ms;
            self.session.exposure_ms = Some(longer.min(most));
        }
        Ok(None)
    }

    /// The pupil nearest to this one that the bench has.
    fn within_reach(&self, pupil: Pupil) -> (Option<[f64; 3]>, f64) {
        let within = |v: f64, [low, high]: [f64; 2]| v.clamp(low, high);
        let ([x, y, d, z], hello) = (pupil.to_mm(), &self.session.hello);
        let iris = hello.iris.as_ref().map(|i| [within(x, i.x_mm), within(y, i.y_mm), within(d, i.diameter_mm)]);
        (iris, hello.focus_mm.map_or(0.0, |range| within(z, range)))
    }

    /// How many of a set's sub-frames are shown in turn at a time: as many as the bench can, or as this machine's display has places
    /// for, in whole shares.
    fn at_once(&self, frames: usize) -> usize {
        match &self.session.shows {
            None => self.session.hello.slm.sub_frames.min(frames),
            Some(shows) => {
                let places = shows.sub_frames();
                (1..=places).rev().find(|n| places.is_multiple_of(*n) && frames.is_multiple_of(*n)).unwrap_or(1)
            }
        }
    }

    /// What the camera sees of a set of sub-frames (phases, sub-frame by sub-frame) through a pupil, or the nearest that the bench
    /// has; none where the bench could not.
    pub(super) fn see(
        &mut self,
        of: &OfColor,
        phases: &[f32],
        pupil: Pupil,
    ) -> Result<Option<CapturedLight>, CalibrateError> {
        self.session.color = (of.color, of.nm);
        let (iris_mm, focus_mm) = self.within_reach(pupil);
        let pixels = self.slm[0] * self.slm[1];
        let at_once = self.at_once(phases.len() / pixels);
        let mut seen: Option<CapturedLight> = None;
        for part in phases.chunks(at_once * pixels) {
            let drive: Vec<f64> = part.iter().map(|p| f64::from(*p)).collect();
            let (name, pattern) =
                (format!("hologram-{:03}", self.session.next()), Pattern::new(self.slm, of.two_pi_level, &drive));
            let ask = Ask { show: Some((&name, &pattern)), iris_mm, focus_mm };
            let Some((shot, picture)) = self.shot(&ask)? else { return Ok(None) };
            let share = part.len() as f64 / phases.len() as f64;
            let light = of.light(&shot, &picture)?;
            let Some([x, y, d]) = shot.iris_mm.or(self.iris_mm) else {
                let reason = "its answer has no iris_mm: of a fixed iris the camera's command has to say where it is, or \
                              `iris` X,Y,DIAMETER in mm";
                return Err(CalibrateError::captures(&shot.file, Reason::new("no-iris", reason)));
            };
            let pupil = Pupil::from_mm([x, y, d, shot.focus_mm]).check()?;
            let sum = seen.get_or_insert_with(|| CapturedLight { pupil, light: vec![0.0; light.len()] });
            sum.light.iter_mut().zip(light).for_each(|(sum, v)| *sum += share as f32 * v);
        }
        Ok(seen)
    }
}

impl OfColor {
    /// Light in a millisecond over the dark, in shares of full scale.
    fn light(&self, shot: &Shot, picture: &Picture) -> Result<Vec<f32>, CalibrateError> {
        let of = |at: &usize| picture.values[*at];
        let dark = self.dark.unwrap_or_else(|| {
            // Where nothing is lit; if nothing is, the least of what is.
            let (from, share) = match self.sensor.beside.len() {
                0..100 => (&self.sensor.pixels, 100),
                _ => (&self.sensor.beside, 2),
            };
            let mut values: Vec<f32> = from.iter().map(of).collect();
            values.sort_by(f32::total_cmp);
            values.get(values.len() / share).copied().map_or(0.0, f64::from)
        }) as f32;
        let values: Vec<f32> = self.sensor.pixels.iter().map(of).collect();
        let mean = values.iter().map(|v| f64::from(v - dark)).sum::<f64>() / values.len().max(1) as f64;
        if mean.is_nan() || mean < BLACK {
            let reason = reason!(
                "black",
                "is black: over the SLM's image it has {:.2} % of full scale after {:.3} ms; is the laser on, and the iris open?",
                100.0 * mean,
                shot.exposure_ms
            );
            return Err(CalibrateError::captures(&shot.file, reason));
        }
        let rate = (1.0 / shot.exposure_ms) as f32;
        let light = |at: &usize| if picture.is_full(*at) { f32::NAN } else { (picture.values[*at] - dark) * rate };
        Ok(self.sensor.pixels.iter().map(light).collect())
    }
}
